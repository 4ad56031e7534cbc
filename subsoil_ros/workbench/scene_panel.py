"""The panel of scenes: form, text, tool in the soil, and what `subsoil check` says."""

import asyncio
from collections.abc import Callable
from typing import Any

from nicegui import events, ui

from ..errors import InputError
from ..yaml_document import dump_yaml
from . import jobs
from .asides import check
from .notes import tell
from .project import (
    LARGEST_TOOL_BYTES,
    PRESETS,
    TOOL_SUFFIXES,
    Project,
    checked,
    first_scene,
    form_of,
    soils,
    with_form,
)

TYPING_S = 0.6
"""Pause after the last key until a scene is kept and checked."""

TOLD = ("warning:", "subsoil check:")
"""How lines begin that warn, or say why a scene cannot run."""

UNITS = (None, "m", "cm", "mm", "inch")


class ScenePanel:
    """One scene: its form, its text, its tool in the soil, and what check says of it."""

    def __init__(self, project: Project, run_asked: Callable[[], object]) -> None:
        self._project, self._run_asked = project, run_asked
        self._name, self._due, self._filling = "", 0, False
        with ui.row().classes("w-full no-wrap items-start gap-3"):
            with ui.column().classes("w-56 shrink-0 gap-1"):
                self._files()
                with ui.column().classes("w-full gap-0") as self._form:
                    self._fields = self._build_form()
            with ui.column().classes("grow min-w-0 gap-1"):
                self._text = ui.codemirror(language="YAML", on_change=self._typed).classes("w-full h-40")
                self._warnings = ui.label().classes("text-sm whitespace-pre-wrap bg-amber-2 w-full")
                self._words = ui.label().classes("font-mono text-xs whitespace-pre overflow-auto w-full")
                self._words.style("height: 390px")
            with ui.column().classes("w-96 shrink-0 gap-1"):
                self._view = ui.scene(width=380, height=330, grid=False, background_color="#f4f4f0")
                with ui.row().classes("items-center"):
                    self._run_name = ui.input("Name of the run").props("dense").classes("w-48")
                    self._run = ui.button("Run", on_click=self._ask_for_run)
        self.refresh()
        if self._scenes.options:
            self._scenes.set_value(self._scenes.options[0])

    def _files(self) -> None:
        """Choose a scene, begin a new one, bring a tool."""
        self._scenes = ui.select([], label="Scene", on_change=lambda e: self._open(e.value))
        self._scenes.classes("w-full").props("dense")
        with ui.row().classes("w-full no-wrap items-center gap-1"):
            self._new = ui.input("New scene: name").classes("grow").props("dense")
            self._new.on("keydown.enter", self._create)
            ui.button(icon="add", on_click=self._create).props('dense aria-label="New scene"')
        kinds = ",".join(TOOL_SUFFIXES)
        upload = ui.upload(
            label="Tool file",
            on_upload=self._uploaded,
            auto_upload=True,
            max_file_size=LARGEST_TOOL_BYTES,
            on_rejected=lambda: ui.notify(f"{kinds} up to 64 MB are read", type="negative"),
        )
        upload.props(f"accept={kinds} flat bordered").classes("w-full").style("max-height: 50px")

    def _build_form(self) -> dict[str, Any]:
        """What a scene in short has, by key."""
        fields: dict[str, Any] = {
            "mesh": ui.select([], label="Tool file"),
            "unit": ui.select({unit: unit or "as the file says" for unit in UNITS}, label="Its unit"),
            "soil": ui.select(soils(), label="Soil"),
            "depth_m": ui.number("Depth [m]", min=0.0, step=0.01),
            "speed_m_per_s": ui.number("Speed [m/s]", min=0.0, step=0.1),
            "travel_m": ui.number("Travel [m]", min=0.0, step=0.5),
            "preset": ui.select(list(PRESETS), label="Accuracy"),
        }
        for key, field in fields.items():
            field.classes("w-full").props("dense").on_value_change(
                lambda event, key=key: self._changed(key, event.value)
            )
        return fields

    def refresh(self) -> None:
        """Show the files that are in the folder now."""
        if (scenes := self._project.scenes()) != self._scenes.options:
            self._scenes.set_options(scenes)
        mesh = self._fields["mesh"]
        tools = sorted({*self._project.tools(), *([mesh.value] if mesh.value else [])})
        if tools != mesh.options:
            mesh.set_options(tools)

    def _open(self, name: str | None) -> None:
        if name:
            self._name = name
            self._text.set_value(tell(self._project.scene_file(name).read_text) or "")
            self._run_name.set_value(self._free_name(name))
            self._fill()

    def _free_name(self, name: str) -> str:
        taken = {job.name for job in jobs.jobs(self._project)}
        return next(found for k in range(1, 10_000) if (found := f"{name[:50]}-{k}") not in taken)

    def _create(self) -> None:
        name, tools = self._new.value or "", self._project.tools()
        if not tools:
            ui.notify("Upload a tool first", type="warning")
            return

        def write() -> None:
            if checked(name) in self._project.scenes():
                raise InputError(f"{name}: there is a scene of this name; choose another")
            mesh = self._fields["mesh"].value
            tool = mesh if mesh in tools else tools[0]
            self._project.write_scene(name, dump_yaml(first_scene(tool)))
            self.refresh()
            self._scenes.set_value(name)
            self._new.set_value("")

        tell(write)

    async def _uploaded(self, event: events.UploadEventArguments) -> None:
        content = await event.file.read()
        if name := tell(lambda: self._project.add_tool(event.file.name, content)):
            self.refresh()
            if self._form.visible:
                self._fields["mesh"].set_value(name)
            ui.notify(f"{name} is in the project")

    def _fill(self) -> None:
        """Show the text in the form; without a form where it is no scene in short."""
        form = form_of(self._text.value)
        self._form.set_visibility(form is not None)
        self._filling = True
        for key, field in self._fields.items():
            if form is not None:
                value = form[key]
                if isinstance(field, ui.select) and value not in field.options and value is not None:
                    field.set_options([*field.options, value])
                field.set_value(value)
        self._filling = False

    def _changed(self, key: str, value: object) -> None:
        if not self._filling and self._name and form_of(self._text.value) is not None:
            self._text.set_value(with_form(self._text.value, {key: value}))

    async def _typed(self) -> None:
        """Keep the text and check it, once nothing has been typed for a while."""
        self._due += 1
        mine, name, text = self._due, self._name, self._text.value
        await asyncio.sleep(TYPING_S)
        if mine != self._due or not name:
            return
        self._fill()
        tell(lambda: self._project.write_scene(name, text))
        self._words.set_text("checking ...")
        answer = await check(self._project.scene_file(name))
        if mine == self._due:
            lines = (answer.get("words") or answer.get("error", "")).splitlines()
            told = [line for line in lines if line.startswith(TOLD)]
            self._warnings.set_text("\n".join(told))
            self._words.set_text("\n".join(line for line in lines if line not in told))
            self._run.set_enabled(bool(answer.get("ok")))
            self._draw(answer)

    def _draw(self, answer: dict[str, Any]) -> None:
        """The tools at their depth; the surface of the soil is the plane z = 0."""
        self._view.clear()
        if not answer.get("stl"):
            return
        low, high = answer["bounds_m"]
        size = max(b - a for a, b in zip(low, high, strict=True))
        x, y, z = ((a + b) / 2.0 for a, b in zip(low, high, strict=True))
        with self._view:
            self._view.stl(f"data:model/stl;base64,{answer['stl']}").material("#707880")
            self._view.box(3.0 * size, 2.0 * size, 0.002 * size).move(x, y).material("#a07040", 0.35)
        self._view.move_camera(x + 0.7 * size, y - 1.5 * size, z + 0.9 * size, x, y, z, duration=0.0)

    def _ask_for_run(self) -> None:
        def begin() -> None:
            jobs.ask_for(self._project, self._run_name.value or "", self._name)
            self._run_name.set_value(self._free_name(self._name))
            self._run_asked()

        tell(begin)
