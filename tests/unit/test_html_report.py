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

import pytest
from websockets.sync.client import ClientConnection, connect

from subsoil_ros.cli import new, report, run
from subsoil_ros.loading.loader import load_scene

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
PATIENCE_S = 60.0


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
        "record.cloud_hz=200",
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
    wanted = {"warnings", "metrics", "figures", "timings", "versions", "quantities", "scene"}
    assert wanted <= set(page.sections)
    assert f"{summary['series']['draft_newton']['mean']:.1f}" in page.sections["metrics"]
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
    """Every address is data in the page itself, and its pictures are the figures, bit for bit."""
    page = Page((reported / "report.html").read_text())
    assert all(address.startswith("data:") for address in page.addresses)
    figures = [
        base64.b64decode(a.partition(",")[2]) for a in page.addresses if a.startswith("data:image/png")
    ]
    assert sorted(figures) == sorted(path.read_bytes() for path in (reported / "figures").glob("*.png"))
    assert len(figures) >= 4
    assert "script" not in page.tags
    assert not re.search(r"https?://", (reported / "report.html").read_text())


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


class Browser:
    """A page of headless Chromium, by its DevTools protocol; keeps all events."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket = socket
        self._number = 0
        self.events: list[dict[str, Any]] = []

    def call(self, method: str, session: str | None = None, **parameters: Any) -> Any:
        """The result of a command."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        self._socket.send(json.dumps(message | ({"sessionId": session} if session else {})))
        while True:
            answer = json.loads(self._socket.recv(timeout=PATIENCE_S))
            if answer.get("id") == self._number:
                assert "error" not in answer, answer
                return answer["result"]
            self.events.append(answer)

    def wait_for(self, method: str) -> None:
        """Returns when an event has come."""
        while not any(event.get("method") == method for event in self.events):
            self.events.append(json.loads(self._socket.recv(timeout=PATIENCE_S)))


@pytest.fixture
def browser(tmp_path) -> Iterator[Browser]:
    """Headless Chromium with a profile of its own."""
    assert CHROMIUM is not None
    flags = ["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run"]
    process = subprocess.Popen(
        [
            CHROMIUM,
            *flags,
            "--remote-debugging-port=0",
            f"--user-data-dir={tmp_path / 'profile'}",
            "about:blank",
        ],
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
    )
    assert process.stderr is not None
    try:
        said = iter(process.stderr)  # ends when Chromium does
        addresses = (found.group() for line in said if (found := re.search(r"ws://\S+", line)))
        with connect(next(addresses), max_size=None) as socket:
            yield Browser(socket)
    finally:
        process.terminate()
        process.wait(PATIENCE_S)


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here (Debian: apt install chromium)")
def test_browser_shows_it(reported, browser):
    """Chromium loads the page without an error or a request to anywhere, and every figure has a size."""
    target = browser.call("Target.createTarget", url="about:blank")["targetId"]
    session = browser.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
    for domain in ("Page", "Runtime", "Log", "Network"):
        browser.call(f"{domain}.enable", session)
    browser.events.clear()
    browser.call("Page.navigate", session, url=(reported / "report.html").as_uri())
    browser.wait_for("Page.loadEventFired")
    sizes = "[i.complete, i.naturalWidth, i.naturalHeight, i.width]"
    ask = f"JSON.stringify([...document.images].map(i => {sizes}))"
    images = json.loads(browser.call("Runtime.evaluate", session, expression=ask)["result"]["value"])
    assert len(images) == len(list((reported / "figures").glob("*.png")))
    assert all(
        complete and wide > 400 and high > 200 and shown > 200 for complete, wide, high, shown in images
    )
    requested = [
        e["params"]["request"]["url"]
        for e in browser.events
        if e.get("method") == "Network.requestWillBeSent"
    ]
    assert requested[0] == (reported / "report.html").as_uri()
    assert all(url.startswith("data:") for url in requested[1:])
    said = ("Runtime.consoleAPICalled", "Runtime.exceptionThrown", "Log.entryAdded")
    assert [event for event in browser.events if event.get("method") in said] == []
