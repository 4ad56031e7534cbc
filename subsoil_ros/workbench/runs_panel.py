"""The panel of runs: their state, their draft and soil as they go on, reports and comparisons."""

from functools import partial
from typing import Any
from urllib.parse import quote

from nicegui import background_tasks, ui
from nicegui.element import Element

from . import jobs
from .asides import COMMAND, DRAWING_ROOM, ask, said, watched
from .notes import FILES, SOIL, columns, tell
from .project import Project, free_name

DRAW_S = 600.0
"""Longest time for a report or a comparison."""

VIEWER = "https://app.foxglove.dev/~/view?ds=foxglove-websocket&ds.url="
"""Foxglove with a running simulation, whose address follows."""

GROWS = ("running", "stopping")
"""States of a run whose record grows."""


class Soil(Element, component="soil.js"):
    """The particles of a run at an address; none at ""."""

    def show(self, url: str, run: str) -> None:
        """Draw them; of another run as at first, of the same one as it was turned."""
        self.set_visibility(bool(url))
        if self._props.get("url") != url:
            self._props |= {"url": url, "run": run}
            self.update()


class RunsPanel:
    """The runs: their state, their draft as it grows, and what can be done with them."""

    def __init__(self, project: Project) -> None:
        self._project = project
        self._shown: list[jobs.Job] = []
        self._looking = self._writes = False
        self._drawn = ""  # name of the run in the plot
        self._answer: dict[str, Any] = {}  # in the plot
        self._live = ""  # address that is linked
        shown = [column | {"sortable": True} for column in columns("run", "scene", "state")]
        with ui.row().classes("w-full no-wrap items-start"):
            with ui.column().classes("w-96 shrink-0 gap-1"):
                self._table = ui.table(
                    columns=shown, rows=[], row_key="run", selection="multiple", pagination=12,
                    on_select=lambda: self._chosen(),
                ).props("dense").classes("w-full")  # fmt: skip
                with ui.row():
                    self._buttons = {
                        name: ui.button(name, on_click=work).props("dense outline")
                        for name, work in (
                            ("Stop", self._stop), ("Resume", self._resume), ("Report", self._report),
                            ("Compare", self._compare),
                        )
                    }  # fmt: skip
            with ui.column().classes("grow min-w-0 gap-1"):
                self._title = ui.label("Choose a run; choose two or more to compare them")
                axes = {"type": "value", "scale": True, "nameLocation": "middle", "nameGap": 28}
                self._plot = ui.echart(
                    {
                        "xAxis": {**axes, "name": "time [s]"},
                        "yAxis": {**axes, "name": "draft [N]", "nameGap": 45},
                        "grid": {"left": 70, "right": 20, "top": 20, "bottom": 45},
                        "animation": False,
                        "series": [{"type": "line", "showSymbol": False, "data": []}],
                    }
                ).classes("w-full h-64")
                with ui.row().classes("w-full no-wrap"):
                    self._soil = Soil()
                    self._soil.show("", "")
                    self._links = ui.column().classes("gap-0")
                self._detail = ui.label().classes("font-mono text-xs whitespace-pre-wrap")
        self.refresh()
        self._chosen()

    def refresh(self) -> None:
        """Show the runs as their files are now, and the draft of one that goes on."""
        found = [job for job in jobs.jobs(self._project) if job.kind == jobs.RUN]
        if found == self._shown:
            return
        self._shown = found
        self._table.update_rows(
            [{"run": job.name, "scene": job.scene, "state": job.state} for job in reversed(found)],
            clear_selection=False,
        )
        self._chosen()

    def look(self) -> None:
        """Draw the record so far of the chosen run, where it goes on."""
        if (one := self._one()) is not None and one.state in GROWS:
            if (live := jobs.live_address(self._project, one.name)) != self._live:
                self._live = live
                with self._links:
                    ui.link(f"Foxglove: {live}", VIEWER + quote(live, safe=""), new_tab=True)
            watch = watched(self._project.run_folder(one.name))
            if watch.answer and watch.answer is not self._answer:
                self._show(one, watch.answer, f"{SOIL}/{one.name}")

    def _selected(self) -> list[jobs.Job]:
        names = {row["run"] for row in self._table.selected}
        return [job for job in self._shown if job.name in names]

    def _chosen(self) -> None:
        """Show the state of the chosen runs, and the record of the one that is chosen."""
        chosen = self._selected()
        one = chosen[0] if len(chosen) == 1 else None
        done = bool(chosen) and all(job.state == "done" for job in chosen)
        for name, able in (
            ("Stop", any(job.state in ("queued", "running") for job in chosen)),
            ("Resume", one is not None and one.state in ("stopped", "failed")),
            ("Report", one is not None and done and not self._writes),
            ("Compare", len(chosen) > 1 and done and not self._writes),
        ):
            self._buttons[name].set_enabled(able)
        self._answer, self._live = {}, ""
        self._plot.set_visibility(one is not None)
        if one is None or one.name != self._drawn:
            self._drawn = ""
            self._plot.options["series"][0]["data"] = []
            self._plot.update()
            self._soil.show("", "")
        self._links.clear()
        self._detail.set_text(one.detail if one else "")
        if one is None:
            self._title.set_text(f"{len(chosen)} runs" if chosen else "Choose a run; two or more to compare")
            return
        self._title.set_text(f"{one.name}: {one.state}")
        with self._links:
            for file in ("scene.yaml", "series.csv", "summary.json", "bag/bag_0.mcap", "report.html"):
                if (self._project.runs / one.name / file).is_file():
                    ui.link(file, f"{FILES}/runs/{one.name}/{file}", new_tab=True)
        if one.state in GROWS:
            self.look()
        else:
            background_tasks.create(self._draw())

    async def _draw(self) -> None:
        """Draw the record of the chosen run, again where another one was chosen meanwhile."""
        if self._looking:
            return
        self._looking = True
        try:
            seen: jobs.Job | None = None
            while (one := self._one()) is not None and one != seen:
                seen = one
                if one.state in GROWS or not (self._project.runs / one.name / "bag").is_dir():
                    return
                answer = await ask("series", self._project.run_folder(one.name))
                if one == self._one():
                    soil = answer.get("soil", "")
                    self._show(one, answer, f"data:application/octet-stream;base64,{soil}" if soil else "")
        finally:
            self._looking = False

    def _one(self) -> jobs.Job | None:
        """The run that is chosen alone, as it is now."""
        chosen = self._selected()
        return chosen[0] if len(chosen) == 1 else None

    def _show(self, job: jobs.Job, answer: dict[str, Any], soil_url: str) -> None:
        """Draw an answer (live.py: drawn), and the soil at an address."""
        if "error" in answer:
            self._detail.set_text(job.detail or answer["error"])
            return
        self._drawn, self._answer = job.name, answer
        data = [list(pair) for pair in zip(answer["time_s"], answer["draft_newton"], strict=True)]
        self._plot.options["series"][0]["data"] = data
        self._plot.options["xAxis"]["max"] = answer["duration_s"]
        self._plot.update()
        self._soil.show(soil_url, job.name)
        done = f"{data[-1][0]:.2f} of {answer['duration_s']:g} s" if data else "begins"
        mean = f"; mean draft {answer['mean']}" if answer["mean"] else ""
        self._title.set_text(f"{job.name}: {job.state}, {done}{mean}")

    def _stop(self) -> None:
        for name in [job.name for job in self._selected() if job.goes_on]:
            tell(partial(jobs.stop, self._project, name))

    def _resume(self) -> None:
        if (job := self._one()) is not None:
            name = free_name(job.name, {item.name for item in self._shown})
            tell(lambda: jobs.ask_for(self._project, name, job.scene, resume=job.name))

    async def _report(self) -> None:
        if (job := self._one()) is not None:
            folder = self._project.run_folder(job.name)
            await self._make(f"{FILES}/runs/{job.name}/report.html", "report", str(folder), "--html")

    async def _compare(self) -> None:
        names = [job.name for job in self._selected()]
        place = self._project.folder / "comparisons"
        place.mkdir(exist_ok=True)
        name = free_name(names[0], {path.name for path in place.iterdir()})
        folders = [str(self._project.run_folder(item)) for item in names]
        page = f"{FILES}/comparisons/{name}/comparison.html"
        await self._make(page, "compare", *folders, "--html", "--out", str(place / name))

    async def _make(self, page: str, *words: str) -> None:
        """Let a command write a page; show what it said and link the page, if the same is chosen still."""
        before, self._writes = self._selected(), True
        self._chosen()
        self._detail.set_text(f"subsoil {words[0]} is at work ...")
        try:
            status, out, err = await said(*COMMAND, *words, longest_s=DRAW_S, room=DRAWING_ROOM)
        finally:
            self._writes = False
        self._chosen()
        if self._selected() == before:
            self._detail.set_text(err if status else out)
            if not status:
                with self._links:
                    ui.link(page.rpartition("/")[2], page, new_tab=True)
