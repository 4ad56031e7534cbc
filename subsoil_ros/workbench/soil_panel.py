"""The panel of soils: the shipped ones, and soils of one's own that are calibrated here."""

from collections.abc import Callable
from typing import NamedTuple

from nicegui import ui

from ..errors import InputError
from ..loading.files import config_folder, shipped_names
from ..loading.material_file import read_laboratory_soil
from ..yaml_document import dump_yaml
from . import jobs
from .notes import columns, tell
from .project import MATERIAL, Project, checked, write


class Value(NamedTuple):
    """One value of a laboratory's soil on the page, and the ends of its slider."""

    label: str
    least: float
    largest: float
    step: float
    unit: float = 1.0  # of the file, in units of the page


VALUES = {
    "cohesion_pa": Value("Cohesion [kPa]", 0.0, 30.0, 0.5, 1e-3),
    "friction_angle_deg": Value("Friction angle [deg]", 24.0, 38.0, 0.5),
    "bulk_density_kg_per_m3": Value("Moist bulk density [kg/m3]", 1100.0, 1900.0, 10.0),
    "metal_friction_angle_deg": Value("Friction angle on metal [deg]", 12.0, 30.0, 0.5),
}
"""Ends: somewhat beyond the shipped soils. What no particles can represent is refused by the calibration."""

START = "loam"
RADIUS_M = 0.01
"""Of the particles of the calibration, which holds from half of it to twice as much."""


class SoilPanel:
    """Sliders of a soil, its calibration as it goes on, and the shipped soils."""

    def __init__(self, project: Project) -> None:
        self._project = project
        folder = config_folder() / "soils"
        shipped = {
            name: read_laboratory_soil(folder / f"{name}.yaml").model_dump()
            for name in shipped_names("soils")
            if (config_folder() / "materials" / f"{name}.yaml").is_file()
        }
        self._sliders: dict[str, ui.slider] = {}
        with ui.row().classes("w-full no-wrap items-start gap-6"):
            with ui.column().classes("w-80 gap-1"):
                ui.label("My soil: peak strength from shear tests").classes("font-bold")
                for key, value in VALUES.items():
                    with ui.row().classes("w-full no-wrap justify-between"):
                        ui.label(value.label)
                        shown = ui.label()
                    start = shipped[START][key] * value.unit
                    slider = ui.slider(min=value.least, max=value.largest, step=value.step, value=start)
                    slider.props(f'aria-label="{value.label}"')
                    shown.bind_text_from(slider, "value", lambda number: f"{number:g}")
                    self._sliders[key] = slider
                self._name = ui.input("Name of the soil").props("dense").classes("w-full")
                ui.button("Calibrate", on_click=self._calibrate).tooltip("some ten minutes of one core")
                rows = [
                    {"soil": name} | {key: f"{soil[key] * VALUES[key].unit:g}" for key in VALUES}
                    for name, soil in shipped.items()
                ]
            with ui.column().classes("grow gap-1"):
                labels = {key: value.label for key, value in VALUES.items()}
                ui.table(columns=columns(soil="shipped", **labels), rows=rows).props("dense")
                with ui.row().classes("items-center"):
                    self._jobs = ui.select([], label="Calibration", on_change=self.refresh).classes("w-48")
                    self._stop = ui.button("Stop", on_click=lambda: self._do(jobs.stop)).props("outline")
                    self._again = ui.button("Again", on_click=lambda: self._do(jobs.again)).props("outline")
                self._state = ui.label()
                self._said = ui.label().classes("font-mono text-xs whitespace-pre-wrap")
        self.refresh()

    def refresh(self) -> None:
        """Show the calibrations, and what the chosen one has said."""
        found = {job.name: job for job in jobs.jobs(self._project) if job.kind == jobs.SOIL}
        if list(found) != self._jobs.options:
            self._jobs.set_options(list(found))
        job = found.get(self._jobs.value or "")
        self._stop.set_enabled(job is not None and job.goes_on)
        self._again.set_enabled(job is not None and job.state in ("stopped", "failed"))
        done = f": soils/{job.name}{MATERIAL} can be chosen in a scene" if job and job.state == "done" else ""
        self._state.set_text(f"{job.state}{done}" if job else "")
        self._said.set_text(jobs.log(self._project, job.name) if job else "")

    def _do(self, work: Callable[[Project, str], None]) -> None:
        tell(lambda: work(self._project, self._jobs.value))
        self.refresh()

    def _calibrate(self) -> None:
        def begin() -> None:
            name, folder = checked(self._name.value or ""), self._project.folder / "soils"
            folder.mkdir(exist_ok=True)
            values = {key: slider.value / VALUES[key].unit for key, slider in self._sliders.items()}
            laboratory, material = folder / f"{name}.yaml", folder / f"{name}{MATERIAL}"
            if laboratory.exists() or material.exists() or name.endswith("_material"):
                raise InputError(f"{name}: there is a soil of this name; choose another")
            words = ["calibrate", str(laboratory), "--radius", str(RADIUS_M), "--out", str(material)]
            jobs.put(self._project, name, words, material, jobs.SOIL)
            soil = {"model": "laboratory", "name": name, "source": "given in the workbench"}
            write(laboratory, dump_yaml(soil | values).encode())
            self.refresh()
            self._jobs.set_value(name)

        tell(begin)
