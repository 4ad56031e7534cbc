"""A MuJoCo model as the machine of a scene. Needs the extra `mujoco`."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, PhysicsError
from ..extras import require
from ..loading.loader import ResolvedScene
from ..messages import SpatialMotion, ToolMotion, ToolWrench
from ..scene.tool_mesh import load_tool_mesh
from ..ticks import NANOSECONDS_PER_SECOND, tick_end_s

Control = Callable[[Any, Any, float], None]
"""Called with model, data and time [s] at the start of every exchange, to set data.ctrl, data.xfrc_applied
and the like. What it sets stays until it sets it anew; the soil's forces are added to data.xfrc_applied."""


class MujocoMachine:
    """Moves each tool of a scene as the MuJoCo site of the same name.

    A site's frame is the tool's: origin and axes of its meshes. A wrench acts at the site, held through
    the exchange. A tool that stays in the plane of travel takes x, z and pitch of its site alone, and only
    force and torque in that plane are applied.

    Args:
        scene: with path.external: true.
        mjcf: file of the model, or its text. Its timestep must divide the communication step; its integrator
            may not be RK4, which cannot take forces at a point that moves.
        control: sets the inputs of the model; it must depend on its arguments alone, or a resumed run
            differs from a whole one.

    Raises:
        InputError: MuJoCo is missing, the model cannot be read, or does not fit the scene.
    """

    def __init__(self, scene: ResolvedScene, mjcf: str | Path, control: Control | None = None) -> None:
        require("MujocoMachine", "mujoco")
        import mujoco

        self._mujoco, self._control = mujoco, control
        self._interval_ns = scene.timing.communication_step_ns
        try:
            text = isinstance(mjcf, str) and mjcf.lstrip().startswith("<")
            read = mujoco.MjModel.from_xml_string if text else mujoco.MjModel.from_xml_path
            self.model = read(str(mjcf))
        except ValueError as error:
            raise InputError(f"MuJoCo cannot read the model: {' '.join(str(error).split())}") from error
        self.data = mujoco.MjData(self.model)
        if self.model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4:
            raise InputError("MuJoCo model: option.integrator: given RK4, allowed are Euler and implicitfast")
        self._steps = self._steps_of(self.model.opt.timestep)
        self._tools = [(name, self._site(name), tool.is_spatial) for name, tool in scene.scene.tools.items()]
        if self.model.nkey:
            mujoco.mj_resetDataKeyframe(self.model, self.data, 0)
        self._place()
        self.effective_mass_kg = {
            name: self._effective_mass_kg(
                site, load_tool_mesh(scene.directory, scene.scene, name).about_body()
            )
            for name, site, _ in self._tools
        }

    def initial_motions(self) -> tuple[ToolMotion, ...]:
        """Motions at the first keyframe of the model, or at its reference pose if it has none."""
        return tuple(self._motion(*tool) for tool in self._tools)

    def advance(self, tick: int, wrenches: tuple[ToolWrench, ...]) -> tuple[ToolMotion, ...]:
        """Motions at the end of `tick`.

        Raises:
            PhysicsError: MuJoCo warns of a state that is not finite.
        """
        mujoco, model, data = self._mujoco, self.model, self.data
        if self._control is not None:
            self._control(model, data, tick_end_s(tick - 1, self._interval_ns))
        applied = data.xfrc_applied.copy()
        for _ in range(self._steps):
            mujoco.mj_step1(model, data)
            data.xfrc_applied[:] = applied
            for (_, site, spatial), wrench in zip(self._tools, wrenches, strict=True):
                self._apply(site, spatial, wrench)
            mujoco.mj_step2(model, data)
        data.xfrc_applied[:] = applied
        for kind in (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL,
                     mujoco.mjtWarning.mjWARN_BADQACC):  # fmt: skip
            if data.warning[kind].number:
                raise PhysicsError(f"MuJoCo: {mujoco.mju_warningText(kind, data.warning[kind].lastinfo)}")
        self._place()
        return tuple(self._motion(*tool) for tool in self._tools)

    def state_arrays(self) -> dict[str, NDArray[np.float64]]:
        """The integration state, as MuJoCo calls it."""
        kind = self._mujoco.mjtState.mjSTATE_INTEGRATION
        state = np.empty(self._mujoco.mj_stateSize(self.model, kind))
        self._mujoco.mj_getState(self.model, self.data, state, kind)
        return {"state": state}

    def restore(self, arrays: Mapping[str, NDArray[np.float64]]) -> None:
        """Restore a state that `state_arrays` returned."""
        kind = self._mujoco.mjtState.mjSTATE_INTEGRATION
        self._mujoco.mj_setState(self.model, self.data, np.ascontiguousarray(arrays["state"]), kind)
        self._place()

    def _steps_of(self, timestep_s: float) -> int:
        steps, rest = divmod(self._interval_ns, max(1, round(timestep_s * NANOSECONDS_PER_SECOND)))
        if rest or not steps:
            raise InputError(
                f"MuJoCo model: option.timestep: given {timestep_s:g} s; it must be a whole part of "
                f"coupling.communication_step_ns {self._interval_ns}, which the scene gives or derives: "
                f"set the timestep to {self._interval_ns * 1e-9:g} s, or that to a multiple of the timestep"
            )
        return int(steps)

    def _site(self, name: str) -> int:
        site = self._mujoco.mj_name2id(self.model, self._mujoco.mjtObj.mjOBJ_SITE, name)
        if site < 0:
            names = ", ".join(self.model.site(k).name for k in range(self.model.nsite)) or "none"
            raise InputError(f"MuJoCo model: no site '{name}' for the tool of that name; sites are {names}")
        return int(site)

    def _place(self) -> None:
        """Compute the poses of the present state; after a step, MuJoCo has those of its start."""
        self._mujoco.mj_kinematics(self.model, self.data)
        self._mujoco.mj_comPos(self.model, self.data)

    def _apply(self, site: int, spatial: bool, wrench: ToolWrench) -> None:
        fx, fy, fz = wrench.force_x_newton, wrench.force_y_newton, wrench.force_z_newton
        tx, ty, tz = wrench.torque_x_newton_m, wrench.torque_y_newton_m, wrench.torque_z_newton_m
        if not spatial:
            fy = tx = tz = 0.0
        body = self.model.site_bodyid[site]
        x, y, z = (self.data.site_xpos[site] - self.data.xipos[body]).tolist()
        self.data.xfrc_applied[body] += (
            fx, fy, fz, tx + y * fz - z * fy, ty + z * fx - x * fz, tz + x * fy - y * fx
        )  # fmt: skip

    def _motion(self, name: str, site: int, spatial: bool) -> ToolMotion:
        model, data, mujoco = self.model, self.data, self._mujoco
        linear, angular = np.zeros((3, model.nv)), np.zeros((3, model.nv))
        mujoco.mj_jacSite(model, data, linear, angular, site)
        velocity, spin, place = linear @ data.qvel, angular @ data.qvel, data.site_xpos[site]
        axes = data.site_xmat[site]
        if spatial:
            quaternion = np.empty(4)
            mujoco.mju_mat2Quat(quaternion, axes)
            w, x, y, z = quaternion
            return SpatialMotion.of(name, tuple(place), (x, y, z, w), tuple(velocity), tuple(spin))
        angle, (x, y, z) = math.atan2(axes[6], axes[0]), place.tolist()
        return ToolMotion(name, x, y, z, angle, float(velocity[0]), float(velocity[2]), -float(spin[1]))

    def _effective_mass_kg(self, site: int, mesh: Any) -> float:
        """Effective mass at the vertex farthest from the body's centre of mass, in the direction that moves
        most easily; without equality constraints, which only add to it."""
        model, data, mujoco = self.model, self.data, self._mujoco
        body = model.site_bodyid[site]
        points = data.site_xpos[site] + mesh.vertices_m @ data.site_xmat[site].reshape(3, 3).T
        point = points[np.linalg.norm(points - data.xipos[body], axis=1).argmax()]
        linear = np.zeros((3, model.nv))
        mujoco.mj_jac(model, data, linear, None, point, body)
        mujoco.mj_crb(model, data)
        mujoco.mj_factorM(model, data)
        moved = np.empty_like(linear)
        mujoco.mj_solveM(model, data, moved, linear)
        return 1.0 / float(np.linalg.eigvalsh(linear @ moved.T)[-1])
