"""The page: a panel of scenes and one of runs."""

from nicegui import app, ui
from starlette.responses import FileResponse, Response

from . import jobs
from .notes import FILES
from .project import Project
from .runs_panel import RunsPanel
from .scene_panel import ScenePanel

FRESH = {"cache-control": "no-cache"}
"""Files of a run that goes on change."""

SHOWN_S, LOOKED_S = 1.0, 3.0
"""Between two looks at the files, and at the record of a run that goes on."""


def build(project: Project) -> None:
    """Register the page of a project."""
    app.timer(SHOWN_S, lambda: jobs.start_due(project))

    @app.get(FILES + "/{path:path}")
    def file(path: str) -> Response:
        found = project.served(path)
        return Response(status_code=404) if found is None else FileResponse(found, headers=FRESH)

    @ui.page("/", title="subsoil workbench")
    def index() -> None:
        ui.query(".nicegui-content").classes("p-2 gap-1")
        with ui.tabs().props("dense align=left") as tabs:
            scene, runs = ui.tab("Scene"), ui.tab("Runs")
        with ui.tab_panels(tabs, value=scene, keep_alive=True, animated=False).classes("w-full"):
            with ui.tab_panel(scene).classes("p-1"):
                scene_panel = ScenePanel(project, lambda: tabs.set_value(runs))
            with ui.tab_panel(runs).classes("p-1"):
                runs_panel = RunsPanel(project)

        def refresh() -> None:
            scene_panel.refresh()
            runs_panel.refresh()

        ui.timer(SHOWN_S, refresh)
        ui.timer(LOOKED_S, runs_panel.look)
