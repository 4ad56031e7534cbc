"""The panel of searches: ranges and a goal, the points as they come, and the best of them as a scene."""

from collections.abc import Callable
from functools import partial

from nicegui import ui

from . import jobs, searches
from .notes import FILES, columns, tell
from .project import Project, free_name


class SearchPanel:
    """The searches: a form for another one, their state, and what the chosen one has found."""

    def __init__(self, project: Project) -> None:
        self._project = project
        self._shown: list[jobs.Job] = []
        self._drawn: tuple[jobs.Job | None, searches.Found] | None = None
        with ui.row().classes("w-full no-wrap items-start"):
            with ui.column().classes("w-96 shrink-0 gap-1"):
                self._form()
                self._table = ui.table(
                    columns=columns("search", "scene", "state"), rows=[], row_key="search",
                    selection="single", pagination=6, on_select=self._show,
                ).props("dense").classes("w-full")  # fmt: skip
                with ui.row():
                    self._stop = ui.button("Stop", on_click=lambda: self._do(jobs.stop))
                    self._again = ui.button("Go on", on_click=lambda: self._do(jobs.again))
                    self._take = ui.button("Take the best as a scene", on_click=lambda: self._do(self._write))
                    for button in (self._stop, self._again, self._take):
                        button.props("dense outline")
            with ui.column().classes("grow min-w-0 gap-1"):
                self._title = ui.label()
                axes = {"type": "value", "scale": True, "nameLocation": "middle", "nameGap": 28}
                dots = {"each seed": 4, "mean": 10}.items()
                series = [{"type": "scatter", "name": name, "symbolSize": size} for name, size in dots]
                self._plot = ui.echart({
                    "xAxis": axes, "yAxis": {**axes, "nameGap": 50}, "series": series, "legend": {"top": 0},
                    "grid": {"left": 75, "right": 20, "top": 30, "bottom": 45}, "animation": False,
                }).classes("w-full h-64")  # fmt: skip
                self._points = ui.table(columns=[], rows=[], pagination=8).props("dense").classes("w-full")
                self._links = ui.row()
                self._said = ui.label().classes("font-mono text-xs whitespace-pre-wrap break-all w-full")
        self.refresh()

    def _form(self) -> None:
        self._scene = ui.select([], label="Scene to search", on_change=self._name_it)
        self._ranges: list[tuple[ui.select, ui.number, ui.number]] = []
        for k in (1, 2, 3):
            with ui.row().classes("w-full no-wrap gap-1"):
                key = ui.select([], label=f"Key {k}", new_value_mode="add-unique", clearable=True)
                low, high = (ui.number(f"{end} {k}").props("dense") for end in ("Least", "Largest"))
            key.props("dense").classes("grow")
            self._ranges.append((key, low.classes("w-16"), high.classes("w-16")))
        goals = list(searches.GOALS)
        self._goal = ui.select(goals, label="Goal: the least", value=goals[0], new_value_mode="add-unique")
        with ui.row().classes("w-full no-wrap items-center gap-1"):
            self._trials = ui.number("Points", value=24, min=1).props("dense").classes("w-16")
            self._seeds = ui.input("Seeds", value="1,2").props("dense").classes("w-20")
            self._name = ui.input("Name of the search").props("dense").classes("grow")
            button = ui.button("Search", on_click=lambda: tell(self._ask))
            button.bind_enabled_from(self._scene, "value", bool)
        for field in (self._scene, self._goal):
            field.props("dense").classes("w-full")

    def refresh(self) -> None:
        """Show scenes, searches and points as their files are now."""
        if (scenes := self._project.scenes()) != self._scene.options:
            kept = self._scene.value if self._scene.value in scenes else next(iter(scenes), None)
            self._scene.set_options(scenes, value=kept)
        self._suggest()
        found = [job for job in jobs.jobs(self._project) if job.kind == jobs.SEARCH]
        if found != self._shown:
            self._shown = found
            rows = [{"search": job.name, "scene": job.scene, "state": job.state} for job in reversed(found)]
            self._table.update_rows(rows, clear_selection=False)
        self._show()

    def _suggest(self) -> None:
        """Offer the keys of the scene."""
        keys = searches.suggested(self._project, self._scene.value or "")
        for select, *_ in self._ranges:
            if (offered := sorted({*keys, select.value} - {None})) != select.options:
                select.set_options(offered)

    def _name_it(self) -> None:
        taken = {job.name for job in jobs.jobs(self._project)}
        self._name.set_value(free_name(f"{self._scene.value}-search", taken))

    def _ask(self) -> None:
        ranges = [(key.value, low.value, high.value) for key, low, high in self._ranges if key.value]
        trials = int(self._trials.value or 0)  # of the page, a float
        options = {"least": self._goal.value, "trials": trials, "seeds": self._seeds.value}
        searches.ask_for(self._project, self._name.value or "", self._scene.value, ranges, **options)
        self.refresh()
        self._table.selected = self._table.rows[:1]
        self._name_it()
        self._show()

    def _one(self) -> jobs.Job | None:
        names = {row["search"] for row in self._table.selected}
        return next((job for job in self._shown if job.name in names), None)

    def _show(self) -> None:
        """Show the state of the chosen search, and its points where they are new."""
        job = self._one()
        state, name = (job.state, job.name) if job else ("", "")
        found = searches.found(self._project, name)
        self._stop.set_enabled(state in ("queued", "running"))
        self._again.set_enabled(state in ("stopped", "failed"))
        self._take.set_enabled(state == "done")
        self._said.set_text(jobs.log(self._project, name) if job else "")
        if (job, found) == self._drawn:
            return
        self._drawn = job, found
        self._title.set_text(f"{name}: {state}, {len(found.points)} points" if job else "Choose a search")
        self._links.clear()
        with self._links:
            for file in ["trials.csv"] * bool(found.points) + ["best.yaml"] * (state == "done"):
                ui.link(file, f"{FILES}/searches/{name}/{file}", new_tab=True)
        self._draw(found)

    def _draw(self, found: searches.Found) -> None:
        """The goal over the first key, and all points as a table."""
        options, first = self._plot.options, [(point.values[0], point) for point in found.points]
        options["series"][0]["data"] = [[x, y] for x, point in first for y in point.by_seed.values()]
        options["series"][1]["data"] = [[x, point.result.mean] for x, point in first if not point.lack]
        options["xAxis"]["name"], options["yAxis"]["name"] = "".join(found.keys[:1]), found.goal
        self._plot.update()
        self._points.columns = columns(*found.keys, found.goal)
        self._points.update_rows(
            [dict(zip((*found.keys, found.goal), point.words(), strict=True)) for point in found.points]
        )

    def _do(self, work: Callable[[Project, str], None]) -> None:
        if job := self._one():
            tell(partial(work, self._project, job.name))
            self.refresh()

    def _write(self, project: Project, name: str) -> None:
        scene = free_name(f"{name}-best", project.scenes())
        project.write_scene(scene, searches.best_scene(project, name))
        ui.notify(f"{scene} is among the scenes")
