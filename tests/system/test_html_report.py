"""`subsoil report --html`: one page that is whole in itself, as a parser and as a browser see it."""

import argparse
import base64
import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from plotly.offline import get_plotlyjs
from selenium import webdriver
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import Select, WebDriverWait

from subsoil_ros.analysis.summary import Summary
from subsoil_ros.cli import new, report, run
from subsoil_ros.figures.html_report import LARGEST_BYTES
from subsoil_ros.figures.replay import replay
from subsoil_ros.figures.snapshots import Snapshots
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.run_results import results_of

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "google-chrome", "chromium-browser"))), None)
DRIVER = shutil.which("chromedriver")
PATIENCE_S = 120.0


def verb(module, *words: object) -> int:
    parser = argparse.ArgumentParser()
    module.add_arguments(parser)
    return module.run(parser.parse_args([str(word) for word in words]))


@pytest.fixture(scope="module")
def reported(tmp_path_factory) -> Path:
    """The folder of a short run, with a warning in a log and a name that is also HTML, reported."""
    folder = tmp_path_factory.mktemp("html")
    verb(new, folder / "scene", "--template", "machine")
    changes = [
        "duration_s=0.01",
        "record.cloud_hz=500",
        "name='<b>a & b</b>'",
        "report.note='a \"note\" <i>'",
    ]
    words = [word for change in changes for word in ("--set", change)]
    verb(run, folder / "scene/scene.yaml", "--out", folder / "run", "--mode", "direct", *words)
    (folder / "run/log").mkdir()
    lines = ["[INFO] [1.0] [soil]: fine", "[WARN] [1.0] [soil]: 1 particle lost", ""]
    (folder / "run/log/soil.log").write_text("\n".join(lines))
    assert verb(report, folder / "run", "--html") == 0
    return folder / "run"


class Page(HTMLParser):
    """The texts of a page by the id of their section, and every address in it."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.sections: dict[str, str] = {}
        self.addresses: list[str] = []
        self.tags: list[str] = []
        self._section = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.tags.append(tag)
        self.addresses += [given[key] or "" for key in ("src", "href", "srcset", "action") if key in given]
        if tag == "section":
            self._section = given["id"] or ""

    def handle_data(self, data: str) -> None:
        self.sections[self._section] = self.sections.get(self._section, "") + data


def test_page_holds_everything(reported):
    """Table, figures, scene, versions, timings, warnings; texts of the scene are texts, not HTML."""
    page = Page((reported / "report.html").read_text())
    summary = json.loads((reported / "summary.json").read_text())
    order = ["top", "warnings", "results", "plots", "replay-section", "figures", "timings", "versions"]
    assert list(page.sections) == ["", *order, "quantities", "scene"]
    results = page.sections["results"]
    for row in results_of(Summary.model_validate(summary), load_scene(reported / "scene.yaml")):
        assert all(cell in results for cell in row.cells())
    assert f"power {summary['loads']['power']['draft_watt']['mean']:.0f} W" in results
    assert "loam" in page.sections["top"]
    assert "particle radius" in page.sections["top"]
    assert "soil: [WARN] [1.0] [soil]: 1 particle lost" in page.sections["warnings"]
    assert 'a "note" <i>' in page.sections["warnings"]
    assert "fine" not in page.sections["warnings"]
    assert f"{summary['run']['steps']:,}" in page.sections["timings"]
    assert summary["run"]["versions"]["numba"] in page.sections["versions"]
    assert "Those of the run." in page.sections["versions"]
    columns = (reported / "series.csv").read_text().splitlines()[0].split(",")
    assert all(name in page.sections["quantities"] for name in columns if name != "time_s")
    assert (reported / "scene.yaml").read_text() in page.sections["scene"]
    assert load_scene(reported / "scene.yaml").scene_hash in page.sections["scene"]
    assert "b" not in page.tags
    assert "i" not in page.tags


def test_page_needs_no_other_file(reported):
    """Every address is data in the page itself; of still pictures it has those that no plot replaces."""
    text = (reported / "report.html").read_text()
    page = Page(text)
    assert all(address.startswith("data:") for address in page.addresses)
    figures = [
        base64.b64decode(a.partition(",")[2]) for a in page.addresses if a.startswith("data:image/png")
    ]
    assert figures == [(reported / f"figures/{name}.png").read_bytes() for name in ("tool", "soil_cut")]
    assert text.count(get_plotlyjs()) == 1
    assert not re.search(r"https?://", text.replace(get_plotlyjs(), ""))


def test_same_run_same_page(reported):
    """A second report of a run gives the same bytes."""
    first = (reported / "report.html").read_bytes()
    assert verb(report, reported, "--html") == 0
    assert (reported / "report.html").read_bytes() == first
    assert len(first) < LARGEST_BYTES


def decoded(spec: dict[str, str]) -> NDArray[np.float32]:
    """An array of plotly's JSON."""
    assert spec["dtype"] == "f4"
    return np.frombuffer(base64.b64decode(spec["bdata"]), np.float32)


def test_replay_shows_the_recorded_soil(reported):
    """With room for all, every moment has the particles behind the mid-plane where the bag has them."""
    resolved = load_scene(reported / "scene.yaml")
    snapshots = Snapshots(reported / "bag", resolved)
    figure, words = replay(snapshots, resolved, 1e9)
    frames = figure.to_dict()["frames"]
    middle = len(frames) // 2
    assert figure.layout.sliders[0].active == middle
    np.testing.assert_array_equal(figure.data[0].x, decoded(frames[middle]["data"][0]["x"]))
    assert f"{len(frames)} of {len(snapshots.times_ns)} recorded moments" in words
    assert "100 % of its" in words
    for shown, frame in zip(frames, snapshots.read(snapshots.times_ns), strict=True):
        behind = frame.positions_m[:, 1] >= 0.0
        places = np.stack([decoded(shown["data"][0][axis]) for axis in "xyz"], axis=1)
        np.testing.assert_array_equal(places, frame.positions_m[behind])
        np.testing.assert_array_equal(
            decoded(shown["data"][0]["marker"]["color"]), frame.speeds_m_per_s[behind]
        )


def test_replay_is_thinned_to_its_room(reported):
    """A replay takes the room that it is given, and says which part of the soil it shows."""
    resolved = load_scene(reported / "scene.yaml")
    snapshots = Snapshots(reported / "bag", resolved)
    whole, _ = replay(snapshots, resolved, 1e9)
    room = 0.4 * len(json.dumps(whole.to_dict()))
    figure, words = replay(snapshots, resolved, room)
    assert 0.7 * room < len(json.dumps(figure.to_dict())) < 1.1 * room
    (percent,) = re.findall(r"([\d.]+) % of its", words)
    counts = [len(decoded(each.to_dict()["frames"][-1]["data"][0]["x"])) for each in (figure, whole)]
    assert counts[0] / counts[1] == pytest.approx(float(percent) / 100.0, rel=0.05)
    tiny, _ = replay(snapshots, resolved, 0.1 * room)
    assert len(tiny.to_dict()["frames"]) < len(figure.to_dict()["frames"])


def test_run_that_says_no_versions(reported):
    """An older run, whose summary has none, is reported with those of the report, and the page says so."""
    summary = json.loads((reported / "summary.json").read_text())
    versions = summary["run"].pop("versions")
    (reported / "summary.json").write_text(json.dumps(summary))
    try:
        assert verb(report, reported, "--html") == 0
        assert "did not record its own" in Page((reported / "report.html").read_text()).sections["versions"]
    finally:
        summary["run"]["versions"] = versions
        (reported / "summary.json").write_text(json.dumps(summary))


@pytest.fixture
def browser(tmp_path) -> Iterator[webdriver.Chrome]:
    """Headless Chromium with a profile of its own; draws WebGL on the processor."""
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for flag in (
        "headless=new", "no-sandbox", "disable-gpu", "disable-dev-shm-usage", "disable-background-networking",
        "disable-component-update", "disable-sync", "no-first-run", "enable-unsafe-swiftshader",
        "window-size=1200,900", f"user-data-dir={tmp_path / 'profile'}",
    ):  # fmt: skip
        options.add_argument(f"--{flag}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    service = webdriver.ChromeService(executable_path=DRIVER, log_output=subprocess.DEVNULL)
    driver = webdriver.Chrome(options, service)
    try:
        driver.set_page_load_timeout(PATIENCE_S)
        yield driver
    finally:
        driver.quit()


def wait_for(browser: webdriver.Chrome, expression: str) -> Any:
    """What an expression is in the page once it is something."""
    return WebDriverWait(browser, PATIENCE_S).until(lambda page: page.execute_script(f"return {expression}"))


@pytest.mark.full
@pytest.mark.skipif(
    CHROMIUM is None or DRIVER is None,
    reason="no Chromium with its driver on PATH (Debian: apt install chromium chromium-driver)",
)
def test_browser_plays_it(reported, browser):
    """Chromium loads the page without an error or a request, draws what is picked, and plays the replay."""
    page = reported / "report.html"
    browser.get(page.as_uri())
    summary = json.loads((reported / "summary.json").read_text())
    series = pd.read_csv(reported / "series.csv")

    title = "document.querySelector('#plot .gtitle')?.textContent"
    draft = summary["series"]["draft_newton"]
    assert wait_for(browser, title).startswith(f"Draft: mean {draft['mean']:.6g}, min {draft['min']:.6g}")
    column = "coupling.absolute_work_joule"
    Select(browser.find_element(By.ID, "pick")).select_by_visible_text(column)
    wait_for(browser, f"{title}.startsWith('{column}: ')")
    shown = wait_for(browser, "Array.from(document.getElementById('plot')._fullData[0].y)")
    np.testing.assert_array_equal(np.float32(shown), np.float32(series[column][: len(shown)]))
    assert len(series) - len(shown) <= 1  # a last row off the even times
    assert (
        wait_for(browser, "document.querySelector('#plot .scatterlayer path.js-line')?.getTotalLength()")
        > 100
    )

    element = browser.find_element(By.ID, "replay")
    place = "document.getElementById('replay').layout.sliders[0].active"
    wait_for(browser, "document.querySelector('#replay canvas')?.width > 400")
    browser.execute_script("arguments[0].scrollIntoView()", element)
    before = element.screenshot_as_png
    play = element.find_elements(By.CLASS_NAME, "updatemenu-button")[0]
    assert play.text == "Play"
    webdriver.ActionChains(browser).click(play).perform()
    last = len(Snapshots(reported / "bag", load_scene(reported / "scene.yaml")).times_ns) - 1
    wait_for(browser, f"{place} == {last}")
    assert last > 2
    assert element.screenshot_as_png != before

    assert [line for line in browser.get_log("browser") if line["level"] == "SEVERE"] == []
    messages = [json.loads(line["message"])["message"] for line in browser.get_log("performance")]
    sent = [each["params"] for each in messages if each["method"] == "Network.requestWillBeSent"]
    # The browser's own pages, such as that of the empty tab, ask too, sooner or later; they are not ours.
    asked = {each["request"]["url"] for each in sent if each["documentURL"] == page.as_uri()}
    assert page.as_uri() in asked
    assert [url for url in asked - {page.as_uri()} if not url.startswith(("data:", "blob:"))] == []
