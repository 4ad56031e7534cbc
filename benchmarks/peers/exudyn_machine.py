"""The paper's machine in Exudyn (generalized-alpha, modified Newton), where that is installed."""

import time
from typing import Any

from validation.machines import SEVEN_BODIES

STEPS = 4000


def exudyn_cost() -> float | None:
    """CPU time of one step of 0.5 ms [us]; None where Exudyn is not installed.

    Rigid bodies in the plane, revolute joints, a prismatic joint, the driver as a coordinate constraint on
    the trolley's speed, one spring-damper; wheels on springs to the ground (without friction, which only
    makes it cheaper).
    """
    try:
        import exudyn
        from exudyn import itemInterface as items
    except ImportError:
        return None
    system = exudyn.SystemContainer()
    machine = system.AddSystem()
    frames = {"ground": (machine.AddObject(items.ObjectGround()), (0.0, 0.0))}
    nodes = {}
    for name, body in SEVEN_BODIES["bodies"].items():
        x, z = body["position_m"]
        node = machine.AddNode(items.Rigid2D(referenceCoordinates=[x, z, 0.0], initialVelocities=[0.5, 0, 0]))
        nodes[name] = node
        rigid = items.ObjectRigidBody2D(
            physicsMass=body["mass_kg"], physicsInertia=body["inertia_kg_m2"], nodeNumber=node
        )
        frames[name] = (machine.AddObject(rigid), (x, z))
        weight = machine.AddMarker(items.MarkerBodyPosition(bodyNumber=frames[name][0]))
        machine.AddLoad(items.Force(markerNumber=weight, loadVector=[0.0, -9.81 * body["mass_kg"], 0.0]))

    def marker(body: str, point: tuple[float, float], rigid: bool = False) -> int:
        number, centre = frames[body]
        kind = items.MarkerBodyRigid if rigid else items.MarkerBodyPosition
        local = [point[0] - centre[0], point[1] - centre[1], 0.0]
        return int(machine.AddMarker(kind(bodyNumber=number, localPosition=local)))

    for joint in SEVEN_BODIES["joints"].values():
        _add_joint(items, machine, marker, nodes, joint)
    for force in SEVEN_BODIES["forces"].values():
        _add_force(items, machine, marker, nodes, force)
    machine.Assemble()
    settings = exudyn.SimulationSettings()
    settings.timeIntegration.numberOfSteps = STEPS
    settings.timeIntegration.endTime = STEPS * 5e-4
    settings.timeIntegration.newton.useModifiedNewton = True
    settings.timeIntegration.verboseMode = 0
    settings.solutionSettings.writeSolutionToFile = False
    begin = time.process_time()
    machine.SolveDynamic(settings, solverType=exudyn.DynamicSolverType.GeneralizedAlpha)
    return 1e6 * (time.process_time() - begin) / STEPS


def _add_joint(items: Any, machine: Any, marker: Any, nodes: dict[str, int], joint: dict[str, Any]) -> None:
    if joint["kind"] == "revolute":
        pair = [marker(joint[key], joint["point_m"]) for key in ("body_a", "body_b")]
        machine.AddObject(items.RevoluteJoint2D(markerNumbers=pair))
    elif joint["kind"] == "prismatic":
        pair = [marker(joint[key], joint["point_m"], True) for key in ("body_a", "body_b")]
        machine.AddObject(items.PrismaticJoint2D(markerNumbers=pair, axisMarker0=[1.0, 0.0, 0.0]))
    else:
        node = machine.AddNode(items.PointGround())
        fixed = machine.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=0))
        driven = machine.AddMarker(items.MarkerNodeCoordinate(nodeNumber=nodes[joint["body"]], coordinate=0))
        machine.AddObject(
            items.CoordinateConstraint(
                markerNumbers=[fixed, driven], velocityLevel=True, offset=joint["speed"]["value"]
            )
        )


def _add_force(items: Any, machine: Any, marker: Any, nodes: dict[str, int], force: dict[str, Any]) -> None:
    stiffness, damping = force["stiffness_newton_per_m"], force["damping_newton_s_per_m"]
    if force["kind"] == "spring_damper":
        pair = [marker(force[f"body_{side}"], force[f"point_{side}_m"]) for side in "ab"]
        machine.AddObject(
            items.SpringDamper(
                markerNumbers=pair,
                stiffness=stiffness,
                damping=damping,
                referenceLength=force["free_length_m"],
            )
        )
        return
    node = machine.AddNode(items.PointGround())
    fixed = machine.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=0))
    moved = machine.AddMarker(items.MarkerNodeCoordinate(nodeNumber=nodes[force["body"]], coordinate=1))
    machine.AddObject(
        items.CoordinateSpringDamper(markerNumbers=[fixed, moved], stiffness=stiffness, damping=damping)
    )
