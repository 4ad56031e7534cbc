"""The soil of a run that goes on, in a real browser: it moves, can be turned, and leaves no process."""

import time

import psutil
import pytest
from selenium import webdriver

from subsoil_ros.workbench.project import Project
from tests.system.growing_run import begin
from tests.system.test_workbench import CHROMIUM, DRIVER, Designer, address, browser, project

__all__ = ["address", "browser", "project"]  # fixtures

PICTURE = "return document.querySelector('.soil').toDataURL()"
TURN = """
const canvas = document.querySelector(".soil");
const move = (movementX) => new PointerEvent("pointermove", {buttons: 1, movementX, movementY: 20});
canvas.dispatchEvent(move(80));
"""
TURNED = "return getElement(document.querySelector('.soil')).turn"


def watches(project: Project) -> int:
    """Processes that read a growing bag of the project for a page."""
    words = ["watch", str(project.runs / "made-up")]
    return sum((item.info["cmdline"] or [])[-2:] == words for item in psutil.process_iter(["cmdline"]))


@pytest.mark.full
@pytest.mark.skipif(CHROMIUM is None or DRIVER is None, reason="no Chromium with its driver on PATH")
def test_the_soil_of_a_run_that_goes_on(address: str, browser: webdriver.Chrome, project: Project) -> None:
    """Two pages share one process; it ends when both are gone."""
    run = begin(project, "made-up", particles=2000, hz=10.0)
    try:
        designer = Designer(browser, address)
        for tab in range(2):
            if tab:
                browser.switch_to.new_window("tab")
                designer = Designer(browser, address)
            designer.press("Runs")
            designer.choose("made-up")
            designer.sees("mean draft")
            before = browser.execute_script(PICTURE)
            designer.until(lambda page, seen=before: page.execute_script(PICTURE) != seen)
        assert watches(project) == 1
        browser.execute_script(TURN)
        turned = browser.execute_script(TURNED)
        before = browser.execute_script(PICTURE)
        designer.until(lambda page: page.execute_script(PICTURE) != before)
        assert browser.execute_script(TURNED) == turned == pytest.approx(0.8)
        assert designer.complaints() == []
        browser.get("about:blank")
        browser.switch_to.window(browser.window_handles[0])
        before = browser.execute_script(PICTURE)
        designer.until(lambda page: page.execute_script(PICTURE) != before)
        browser.get("about:blank")
        end_s = time.monotonic() + 60.0
        while watches(project) and time.monotonic() < end_s:
            time.sleep(0.1)
        assert watches(project) == 0
    finally:
        run.kill()
        run.wait()
