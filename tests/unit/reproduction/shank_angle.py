"""The shank's angle as the mechanism engine starts with it, for tests of the levers."""

from reproduction.yuan_yu_2020.machine_variants import shank_and_frame, start_places
from subsoil_ros.loading.loader import ResolvedScene


def relative_angle_rad(resolved: ResolvedScene) -> float:
    """Angle of the shank against the frame at the start, zero in the reference pose."""
    assert resolved.scene.mechanism is not None
    bodies, places = resolved.scene.mechanism.bodies, start_places(resolved)
    shank, frame = (places[name][2] - bodies[name].angle_rad for name in shank_and_frame(resolved.scene))
    return shank - frame
