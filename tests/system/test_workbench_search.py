"""Searches of `subsoil workbench`: as processes of the queue, and on the page in a real browser."""

import re
from pathlib import Path

import pytest
from selenium import webdriver
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from subsoil_ros.loading.loader import load_scene
from subsoil_ros.workbench import jobs, searches
from subsoil_ros.workbench.project import Project
from tests.system import test_workbench as page

address, browser = page.address, page.browser
RAKE = "tools.tine.blade.rake_deg"


@pytest.fixture
def project(tmp_path: Path) -> Project:
    """A project with a blade, 1.5 m of a wedge model."""
    project = Project(tmp_path)
    project.write_scene(
        "blade",
        "soil: loam\ntravel_m: 1.5\npreset: real_time\n"
        "tools: {tine: {blade: {rake_deg: 35, width_m: 0.06}, depth_m: 0.2, speed_m_per_s: 0.5}}\n",
    )
    return project


def test_a_search_is_stopped_goes_on_and_gives_its_best(project: Project) -> None:
    """What had run is kept. A wrong range ends it with the message of the command."""
    searches.ask_for(project, "wrong", "blade", [(RAKE, 36, 28)])
    assert "must be two numbers, LEAST,LARGEST" in page.wait_for(project, "wrong", "failed").detail
    searches.ask_for(project, "first", "blade", [(RAKE, 28, 36)], trials=24, seeds="1")
    folder = searches.folder_of(project, "first")
    page.wait_for(project, "first", "running")
    while not searches.found(project, "first").points:
        page.wait_for(project, "first", "running")
    jobs.stop(project, "first")
    assert "the same command continues" in page.wait_for(project, "first", "stopped").detail
    assert list(folder.rglob("*.part*")) == []
    kept = {run: run.stat().st_mtime_ns for run in (folder / "runs").iterdir()}
    assert len(kept) >= 4
    jobs.again(project, "first")
    page.wait_for(project, "first", "done")
    found = searches.found(project, "first")
    assert len(found.points) == len(list((folder / "runs").iterdir())) > len(kept)
    assert {run: run.stat().st_mtime_ns for run in kept} == kept
    assert f"subsoil compare {project.folder}/.first.run.yaml {folder}/best.yaml" in jobs.log(
        project, "first"
    )
    best = project.write_scene("best", searches.best_scene(project, "first"))
    assert f"rake_deg: {found.points[0].values[0]}\n" in best.read_text()
    assert load_scene(best).document["tools"] == load_scene(folder / "best.yaml").document["tools"]


@pytest.mark.full
@pytest.mark.skipif(
    page.CHROMIUM is None or page.DRIVER is None, reason="no Chromium with its driver on PATH"
)
def test_from_a_form_to_the_best(address: str, browser: webdriver.Chrome, project: Project) -> None:
    """Keys are offered, points come, and the best becomes a scene; a range that is wrong is named."""
    designer = page.Designer(browser, address)
    designer.press("Search")
    search = browser.find_element(By.XPATH, "//button[.='Search']")

    def vary(key: str, low: str, high: str) -> None:
        designer.type("Key 1", key + Keys.ENTER)
        designer.type("Least 1", low)
        designer.type("Largest 1", high + Keys.TAB)
        search.click()

    designer.field("Key 1").click()
    designer.sees("tools.tine.blade.width_m")
    designer.type("Points", "12")
    designer.type("Seeds", "1,2")
    vary("tools.tine.rake", "28", "36")
    designer.sees("blade-search-1: failed")
    designer.sees("no key 'rake'")
    vary(RAKE, "28", "36")
    title = re.compile("blade-search-2: running, [1-9]")
    designer.until(lambda page: title.search(page.find_element(By.TAG_NAME, "body").text))
    designer.sees("blade-search-2: done, 12 points")
    designer.sees("subsoil compare")
    designer.picture("search")
    designer.press("Take the best as a scene")
    designer.until(lambda _: "blade-search-2-best-1" in project.scenes())
    values = searches.found(project, "blade-search-2").points[0].values
    best = project.scene_file("blade-search-2-best-1").read_text()
    assert f"rake_deg: {values[0]:g}\n" in best
    assert designer.complaints() == []
