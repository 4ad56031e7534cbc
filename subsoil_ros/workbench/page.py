"""The page: a panel of scenes and one of runs."""

from nicegui import app, ui
from starlette.responses import FileResponse, Response

from . import jobs
from .asides import newest_soil
from .notes import FILES, SOIL
from .project import Project
from .runs_panel import RunsPanel
from .scene_panel import ScenePanel
from .search_panel import SearchPanel
from .soil_panel import SoilPanel

FRESH = {"cache-control": "no-cache"}
"""Files of a run that goes on change."""

AS_IT_IS = {"content-encoding": "identity"}
"""Compressed, a soil would take longer than to the next one."""

SHOWN_S, LOOKED_S = 1.0, 0.5
"""Between two looks at the files, and at the record of a run that goes on."""


def build(project: Project) -> None:
    """Register the page of a project."""
    app.timer(SHOWN_S, lambda: jobs.start_due(project))

    @app.get(FILES + "/{path:path}")
    def file(path: str) -> Response:
        found = project.served(path)
        return Response(status_code=404) if found is None else FileResponse(found, headers=FRESH)

    @app.get(SOIL + "/{run}")
    async def soil_of(run: str, after: float = -1.0) -> Response:
        soil = newest_soil(project.runs / run, after)
        return Response(soil, 200 if soil else 204, headers=AS_IT_IS)

    @ui.page("/", title="subsoil workbench")
    def index() -> None:
        ui.query(".nicegui-content").classes("p-2 gap-1")
        with ui.tabs().props("dense align=left") as tabs:
            scene, runs, search, soil = map(ui.tab, ("Scene", "Runs", "Search", "Soil"))
        with ui.tab_panels(tabs, value=scene, keep_alive=True, animated=False).classes("w-full"):
            with ui.tab_panel(scene).classes("p-1"):
                scene_panel = ScenePanel(project, lambda: tabs.set_value(runs))
            with ui.tab_panel(runs).classes("p-1"):
                runs_panel = RunsPanel(project)
            with ui.tab_panel(search).classes("p-1"):
                search_panel = SearchPanel(project)
            with ui.tab_panel(soil).classes("p-1"):
                soil_panel = SoilPanel(project)

        def refresh() -> None:
            scene_panel.refresh()
            runs_panel.refresh()
            search_panel.refresh()
            soil_panel.refresh()

        ui.timer(SHOWN_S, refresh)
        ui.timer(LOOKED_S, runs_panel.look)
