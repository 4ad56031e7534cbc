"""The panel of scenes: form, text, tool in the soil, and what `subsoil check` says."""

import asyncio
import re
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any

from nicegui import background_tasks, events, ui

from ..errors import InputError
from ..yaml_document import dump_yaml
from . import jobs
from .asides import check
from .notes import tell
from .project import (
    BLADE,
    CAD_KEYS,
    FLAT_BLADE,
    LARGEST_TOOL_BYTES,
    PRESETS,
    TOOL_SUFFIXES,
    Project,
    cause_of,
    checked,
    first_scene,
    form_of,
    free_name,
    with_form,
)

TYPING_S = 0.6
"""Pause after the last key until a scene is kept and checked."""

TOLD = ("warning:", "subsoil check:")
"""How lines begin that warn, or say why a scene cannot run."""

UNITS = (None, "m", "cm", "mm", "inch")
AXES = (None, "y")

SEEDS = re.compile(r"\d+(\s*,\s*\d+)*")


class ScenePanel:
    """One scene: its form, its text, its tool in the soil, and what check says of it."""

    def __init__(self, project: Project, run_asked: Callable[[], object]) -> None:
        self._project, self._run_asked = project, run_asked
        self._name, self._kept = "", ""  # the open scene, and the text that its file has
        self._due, self._filling, self._brought = 0, False, ""
        self._checking = asyncio.Lock()
        self._seed_key: str | None = None
        with ui.row().classes("w-full no-wrap items-start gap-3"):
            with ui.column().classes("w-56 shrink-0 gap-1"):
                self._files()
                with ui.row().classes("w-full gap-x-2 gap-y-0") as self._form:
                    self._fields = self._build_form()
            with ui.column().classes("grow min-w-0 gap-1"):
                self._place = ui.column().classes("w-full h-40 gap-0")
                # Tab goes on to the next field: in the editor it would indent
                self._place.on("keydown.tab.capture", js_handler="event => event.stopPropagation()")
                self._warnings = ui.label().classes("text-sm whitespace-pre-wrap bg-amber-2 w-full")
                self._words = ui.label().classes("font-mono text-xs whitespace-pre overflow-auto w-full")
                self._words.style("height: 390px")
            with ui.column().classes("w-96 shrink-0 gap-1"):
                self._view = ui.scene(width=380, height=330, grid=False, background_color="#f4f4f0")
                with ui.row().classes("items-center no-wrap gap-2"):
                    self._run_name = ui.input("Name of the run").props("dense").classes("w-32")
                    self._seeds = ui.input("Seeds", placeholder="1, 2, 3").props("dense").classes("w-20")
                    self._live = ui.checkbox("Foxglove").props("dense")
                    self._run = ui.button("Run", on_click=self._ask_for_run)
        self._edit("")
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
        self._upload = upload = ui.upload(
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
            "unit": ui.select({unit: unit or "of the file" for unit in UNITS}, label="Its unit"),
            "up": ui.select({axis: axis or "z" for axis in AXES}, label="Upwards in it"),
            "turn_deg": ui.number("Turned [deg]", step=90),
            "rake_deg": ui.number("Rake [deg]", min=0.0, step=5),
            "width_m": ui.number("Width [m]", min=0.0, step=0.01),
            "soil": ui.select(self._project.soils(), label="Soil"),
            "depth_m": ui.number("Depth [m]", min=0.0, step=0.01),
            "speed_m_per_s": ui.number("Speed [m/s]", min=0.0, step=0.1),
            "travel_m": ui.number("Travel [m]", min=0.0, step=0.5),
            "preset": ui.select(list(PRESETS), label="Accuracy"),
        }
        for key, field in fields.items():
            width = "w-full" if key in ("mesh", "soil") else "w-[calc(50%-4px)]"
            field.classes(width).props("dense hide-bottom-space").on_value_change(
                lambda event, key=key: self._changed(key, event.value)
            )
        return fields

    def refresh(self) -> None:
        """Show the files that are in the folder now, and the scene as it was changed elsewhere."""
        if (scenes := self._project.scenes()) != self._scenes.options:
            self._scenes.set_options(scenes)
        mesh = self._fields["mesh"]
        tools = sorted({*self._project.tools(), FLAT_BLADE, *([mesh.value] if mesh.value else [])})
        if tools != mesh.options:
            mesh.set_options(tools)
        soil = self._fields["soil"]
        if missing := [name for name in self._project.soils() if name not in soil.options]:
            soil.set_options([*missing, *soil.options])
        text = self._kept
        if self._name:
            with suppress(OSError, UnicodeError):  # deleted, or damaged: the text here remains
                text = self._project.scene_file(self._name).read_text(encoding="utf-8")
        if text != self._kept:
            self._show(self._name, text)

    def _read(self, name: str) -> str | None:
        """The text of a scene; None, and a message, where it cannot be read."""
        with suppress(FileNotFoundError):  # deleted elsewhere: the text here remains
            return tell(partial(self._project.scene_file(name).read_text, encoding="utf-8"))
        return None

    def _open(self, name: str | None) -> None:
        if name and (text := self._read(name)) is not None:
            self._show(name, text)
            self._run_name.set_value(self._free_name(name))

    def _show(self, name: str, text: str) -> None:
        """Open a scene in an editor of its own: nothing of the one before can be undone into it."""
        self._name, self._kept = name, text
        self._edit(text)
        self._fill()
        background_tasks.create(self._check())

    def _edit(self, text: str) -> None:
        self._place.clear()
        with self._place:
            self._text = ui.codemirror(text, language="YAML", on_change=self._typed).classes("w-full h-40")

    def _free_name(self, name: str) -> str:
        return free_name(name, {job.name for job in jobs.jobs(self._project)})

    def _create(self) -> None:
        name, tools = self._new.value or "", [*self._project.tools(), FLAT_BLADE]

        def write() -> None:
            if checked(name) in self._project.scenes():
                raise InputError(f"{name}: there is a scene of this name; choose another")
            tool = next(tool for tool in (self._brought, self._fields["mesh"].value, *tools) if tool in tools)
            self._project.write_scene(name, with_form(dump_yaml(first_scene(tool)), {"mesh": tool}))
            self.refresh()
            self._scenes.set_value(name)
            self._new.set_value("")

        tell(write)

    async def _uploaded(self, event: events.UploadEventArguments) -> None:
        if event.file.size() > LARGEST_TOOL_BYTES:
            ui.notify(f"{event.file.name}: is too large", type="negative")
            return
        content = await event.file.read()
        self._upload.reset()
        if name := tell(lambda: self._project.add_tool(event.file.name, content)):
            self._brought = name
            self.refresh()
            ui.notify(f"{name} is in the project: choose it, or name a new scene")

    def _fill(self) -> None:
        """Show the text in the form; without a form where it is no scene in short."""
        form = form_of(self._text.value)
        self._form.set_visibility(form is not None)
        if form is None:
            return
        self._filling = True
        try:
            for key, field in self._fields.items():
                if isinstance(field, ui.select) and form[key] not in (None, *field.options):
                    field.set_options([*field.options, form[key]])
                field.set_value(form[key])
                if key in (*BLADE, *CAD_KEYS, "turn_deg"):
                    field.set_visibility((key in BLADE) == (form["mesh"] == FLAT_BLADE))
        finally:
            self._filling = False

    def _changed(self, key: str, value: object) -> None:
        if not self._filling and self._name and form_of(self._text.value) is not None:
            self._text.set_value(with_form(self._text.value, {key: value}))

    def _keep(self) -> bool:
        """Write the text to its file; not over what was changed elsewhere. Return whether it is there."""
        name, text = self._name, self._text.value
        if not name or text == self._kept:
            return bool(name)
        if (there := self._read(name)) not in (None, self._kept):
            ui.notify(f"{name} was changed elsewhere: your last change is left out", type="warning")
            self._show(name, there or "")
            return False
        if tell(partial(self._project.write_scene, name, text)) is None:
            return False
        self._kept = text
        return True

    async def _typed(self) -> None:
        """Keep the text, and check it once nothing has been typed for a while."""
        self._run.set_enabled(False)
        if self._keep():
            self._fill()
            await self._check()

    async def _check(self) -> None:
        self._due += 1
        mine, name = self._due, self._name
        self._run.set_enabled(False)
        await asyncio.sleep(TYPING_S)
        async with self._checking:
            if mine != self._due:
                return
            self._words.set_text("checking ...")
            answer = await check(self._project.scene_file(name))
        if mine == self._due:
            lines = (answer.get("words") or answer.get("error", "")).splitlines()
            told = [line for line in lines if line.startswith(TOLD)]
            self._tell(told)
            self._seed_key = answer.get("seed_key")
            self._words.set_text("\n".join(line for line in lines if line not in told))
            self._run.set_enabled(bool(answer["ok"]))
            self._draw(answer)

    def _tell(self, messages: list[str]) -> None:
        """Put each message under the field that it is about, the others above what check says."""
        by_field: dict[str | None, list[str]] = {}
        for message in messages:
            key = cause_of(message)
            seen = key is not None and self._form.visible and self._fields[key].visible
            by_field.setdefault(key if seen else None, []).append(message)
        self._warnings.set_text("\n".join(by_field.pop(None, [])))
        for key, field in self._fields.items():
            field.error = "\n".join(by_field.get(key, [])) or None

    def _draw(self, answer: dict[str, Any]) -> None:
        """The tools at their depth, the soil's surface at z = 0; or a damaged file, its faults in red."""
        self._view.clear()
        if not answer.get("stl"):
            return
        low, high = answer["bounds_m"]
        size = max(b - a for a, b in zip(low, high, strict=True))
        x, y, z = ((a + b) / 2.0 for a, b in zip(low, high, strict=True))
        with self._view:
            self._view.stl(f"data:model/stl;base64,{answer['stl']}").material("#707880")
            for ends in (faults := answer.get("faults_m", [])):
                self._view.line(*ends).material("#e00000")
                for end in ends:
                    self._view.sphere(0.015 * size).move(*end).material("#e00000")
            if not faults:
                self._view.box(3.0 * size, 2.0 * size, 0.002 * size).move(x, y).material("#a07040", 0.35)
        self._view.move_camera(x + 0.7 * size, y - 1.5 * size, z + 0.9 * size, x, y, z, duration=0.0)

    def _ask_for_run(self) -> None:
        if not self._keep():
            return

        def begin() -> None:
            name, seeds = self._run_name.value or "", (self._seeds.value or "").strip()
            if seeds and not SEEDS.fullmatch(seeds):
                raise InputError(f"Seeds: given {seeds}; give whole numbers, as 1, 2, 3")
            if seeds and self._seed_key is None:
                raise InputError(f"Seeds: given {seeds}, but nothing in this soil is random; leave them out")
            named = {f"{name}-s{seed}" if seed else name: seed for seed in map(str.strip, seeds.split(","))}
            if taken := {job.name for job in jobs.jobs(self._project)} & named.keys():
                raise InputError(f"{min(taken)}: there is a run of this name; choose another")
            for run, seed in named.items():
                settings = [f"{self._seed_key}={seed}"] if seed else []
                jobs.ask_for(self._project, run, self._name, settings=settings, live=self._live.value)
            self._run_name.set_value(self._free_name(self._name))
            self._run_asked()

        self._run.set_enabled(False)  # until it is checked again: a second click starts no second run
        tell(begin)
        background_tasks.create(self._check())
