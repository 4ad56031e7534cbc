"""`make run`: what the Makefile, the kernels that it compiles before, and the README say of it agree."""

import re
import shlex
from pathlib import Path

from dev import warm_kernels
from subsoil_ros.cli.main import parse
from subsoil_ros.loading.loader import load_scene

ROOT = Path(__file__).parents[3]
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")


def variable(name: str) -> str:
    return re.search(rf"^{name} := (.*)$", MAKEFILE, re.MULTILINE).group(1)


def test_kernels_are_those_of_the_first_scene():
    """dev.warm_kernels compiles for the scene that `make run` simulates."""
    assert (ROOT / variable("first_scene")).samefile(warm_kernels.SCENE)


def test_readme_describes_the_first_run():
    """Scene, seconds and size of the particles in the README are those that the flags give."""
    scene, flags = variable("first_scene"), shlex.split(variable("first_flags"))
    resolved = load_scene(ROOT / scene, parse(["run", scene, "--out", "out", *flags]).overrides)
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    told = text[text.index("`make run` sets up") :].partition("\n\n")[0]
    assert f"`{Path(scene).stem}`" in told
    assert f"{resolved.scene.duration_s:g} s of" in told
    radius_mm = 1e3 * resolved.scene.particle_soil.particles.mean_volume_radius_m
    assert f"particles are of {round(radius_mm)} mm, as in the preset [`{resolved.preset}`]" in told
