"""`subsoil workbench`: runs and work beside the page as processes, and the page in a real browser."""

import asyncio
import http.client
import json
import os
import random
import shutil
import socket
import subprocess
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import trimesh
from selenium import webdriver
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.remote.webelement import WebElement
from selenium.webdriver.support.ui import WebDriverWait

from subsoil_ros.errors import InputError
from subsoil_ros.workbench import asides, jobs
from subsoil_ros.workbench.project import Project, first_scene
from subsoil_ros.yaml_document import dump_yaml, parse_yaml
from tests.unit.scene.step_prism import step_prism

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "google-chrome", "chromium-browser"))), None)
DRIVER = shutil.which("chromedriver")
PATIENCE_S = 300.0
PICTURES = os.environ.get("SUBSOIL_PICTURES")
SHARE = Path(__file__).parents[2] / "config" / "meshes" / "share.stl"
needs_page = pytest.importorskip("nicegui", reason="needs the extra workbench")


@pytest.fixture
def project(tmp_path: Path) -> Project:
    """A project with a share and a scene around it, 0.5 m of a wedge model."""
    shutil.copy(SHARE, tmp_path)
    project = Project(tmp_path)
    scene = first_scene("share.stl") | {"travel_m": 0.5}
    scene["tools"]["tool"]["depth_m"] = 0.15
    project.write_scene("pull", dump_yaml(scene))
    return project


def wait_for(project: Project, name: str, *states: str) -> jobs.Job:
    """The run, once it is in one of the states."""
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        jobs.start_due(project)
        (job,) = (job for job in jobs.jobs(project) if job.name == name)
        if job.state in states:
            return job
        time.sleep(0.05)
    raise AssertionError(f"{name}: {job}")


def test_runs_wait_for_a_core_and_leave_their_results(
    project: Project, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One after the other on one core; runs of the command line are listed too; one that fails says why."""
    monkeypatch.setattr(os, "cpu_count", lambda: 1)
    project.write_scene("wrong", "soil: mud\n")
    jobs.ask_for(project, "first", "pull")
    jobs.ask_for(project, "second", "wrong")
    with pytest.raises(InputError, match="of this name"):
        jobs.ask_for(project, "first", "pull")
    project.write_scene("pull", "changed: after it was asked for\n")
    jobs.start_due(project)
    assert [(job.name, job.state) for job in jobs.jobs(project)] == [
        ("first", "running"), ("second", "queued"),
    ]  # fmt: skip
    assert wait_for(project, "first", "done", "failed").state == "done"
    assert "mud" in wait_for(project, "second", "failed").detail
    (project.runs / "first.job").unlink()
    assert [(job.name, job.state) for job in jobs.jobs(project)] == [
        ("first", "done"), ("second", "failed"),
    ]  # fmt: skip
    drawn = asyncio.run(asides.ask("series", project.run_folder("first")))
    mean = json.loads((project.run_folder("first") / "summary.json").read_text())["series"]["draft_newton"][
        "mean"
    ]
    assert drawn["mean"].startswith(f"{mean:.0f} N +- ")
    assert len(drawn["time_s"]) == len(drawn["draft_newton"]) > 10
    assert drawn["soil"] == ""


def test_what_is_checked_beside_the_page(project: Project) -> None:
    """The words of the command, and the tool at its depth; of a mesh with a hole the reason alone."""
    answer = asyncio.run(asides.check(project.scene_file("pull")))
    assert answer["ok"]
    assert "150 mm deep" in answer["words"]
    assert answer["bounds_m"][0][2] == pytest.approx(-0.15)
    assert (answer["seed_key"], answer.get("faults_m")) == ("soil.seed", None)
    box = trimesh.creation.box((0.02, 0.1, 0.4))
    box.update_faces([face > 0 for face in range(len(box.faces))])
    box.export(project.folder / "share.stl")
    answer = asyncio.run(asides.check(project.scene_file("pull")))
    assert not answer["ok"]
    assert "subsoil check: " in answer["words"]
    assert len(answer["faults_m"]) == 3


def test_work_that_takes_too_long_is_ended(monkeypatch: pytest.MonkeyPatch, project: Project) -> None:
    monkeypatch.setattr(asides, "LONGEST_S", 0.01)
    answer = asyncio.run(asides.check(project.scene_file("pull")))
    assert (answer["ok"], answer["words"], answer["error"]) == (False, *2 * ("took longer than 0 s",))


@pytest.fixture
def address(project: Project) -> Iterator[str]:
    """Of a workbench on a free port."""
    yield from served(project)


def served(project: Project, *words: str) -> Iterator[str]:
    """The address that a workbench prints; its process is ended afterwards. NiceGUI heeds the variable."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    process = subprocess.Popen(
        [*asides.COMMAND, "workbench", str(project.folder), "--port", str(port), *words],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        env={key: value for key, value in os.environ.items() if key != "PYTEST_CURRENT_TEST"},
    )  # fmt: skip
    try:
        assert process.stdout is not None
        said = process.stdout.readline()
        address = next((word for word in said.split() if word.startswith("http://")), None)
        assert address is not None, said + process.stdout.read()
        threading.Thread(target=process.stdout.read, daemon=True).start()  # a full pipe would stop it
        end = time.monotonic() + PATIENCE_S
        while status(f"http://127.0.0.1:{port}/") is None and time.monotonic() < end:
            time.sleep(0.05)
        yield address
    finally:
        process.kill()
        process.wait()
        for job in jobs.jobs(project):
            if job.goes_on:
                jobs.stop(project, job.name)


def status(address: str, **headers: str) -> int | None:
    """HTTP status of an address; None: no answer."""
    try:
        with urllib.request.urlopen(urllib.request.Request(address, headers=headers), timeout=30) as answer:
            return int(answer.status)
    except urllib.error.HTTPError as error:
        return error.code
    except urllib.error.URLError:
        return None


def test_only_this_machine_and_only_the_folder_are_served(address: str, project: Project) -> None:
    """Not a page that another host's name leads to, and no file outside the project."""
    assert status(address) == 200
    assert status(address, Host="evil.example") == 400
    assert status(f"{address}files/pull.yaml") == 200
    project.runs.mkdir(exist_ok=True)
    (project.runs / "link").symlink_to("/etc")
    (project.folder / ".secret.yaml").touch()
    (project.folder / "notes.txt").touch()
    for path in (
        "../etc/passwd", "..%2f..%2fetc/passwd", "%2e%2e/passwd", "/etc/passwd", "runs/link/passwd",
        "runs/../notes.txt", "notes.txt", ".secret.yaml", "runs/.lock", "runs", "", "a%00b.yaml",
    ):  # fmt: skip
        assert status(f"{address}files/{path}") == 404, path


def test_random_requests_do_no_harm(address: str, project: Project) -> None:
    """No address that is made up of such pieces is an error of the server, or writes a file."""
    pieces = ["files", "soil", "runs", "pull.yaml", "..", ".", "", "%2e%2e", "%2f", "%00", "%ff", "%s", "*",
              "?", "&after=x", "?after=nan", "?after=1e999", "_nicegui", "_nicegui_ws", "\\",
              "a" * 5000]  # fmt: skip
    before, chosen = set(project.folder.rglob("*")), random.Random(1)
    host = address.removeprefix("http://").rstrip("/")
    for _ in range(500):
        path = "/" + chosen.choice(["/", "", "%2f"]).join(chosen.choices(pieces, k=chosen.randint(1, 6)))
        client = http.client.HTTPConnection(host, timeout=30)
        client.request(chosen.choice(["GET", "HEAD", "POST", "PUT", "DELETE"]), path, chosen.randbytes(99))
        assert client.getresponse().status < 500, path
        client.close()
    assert status(address) == 200
    assert set(project.folder.rglob("*")) == before


def test_one_workbench_serves_a_project(address: str, project: Project) -> None:
    """Two would start each run twice."""
    with pytest.raises(InputError, match="another workbench serves it"):
        jobs.claim(project)


def test_another_host_needs_the_token(project: Project) -> None:
    for address in served(project, "--host", "0.0.0.0"):
        bare, _, token = address.replace("0.0.0.0", "127.0.0.1").partition("?token=")
        assert len(token) >= 32
        name = f"subsoil_workbench_{bare.rstrip('/').rpartition(':')[2]}"
        assert status(bare) == status(f"{bare}files/pull.yaml") == status(f"{bare}?token=wrong") == 403
        assert status(f"{bare}files/pull.yaml", Cookie=f'a={{"x": 1}}; {name}={token}') == 200
        opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
        with opener.open(f"{bare}?token={token}", timeout=30) as answer:
            assert answer.status == 200


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("none/none",), "none/none: is no folder, and cannot be made"),
        ((".", "--port", "70000"), "--port 70000: cannot be used"),
    ],
)
def test_what_cannot_be_served(words: tuple[str, ...], told: str) -> None:
    command = [*asides.COMMAND, "workbench", *words]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert (ended.returncode, told in ended.stderr) == (2, True), ended.stderr


@pytest.fixture
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[webdriver.Chrome]:
    """Headless Chromium of the size of a small screen; draws WebGL on the processor."""
    yield from opened(tmp_path_factory)


@pytest.fixture
def other_browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[webdriver.Chrome]:
    """A second one, with a profile of its own."""
    yield from opened(tmp_path_factory)


def opened(tmp_path_factory: pytest.TempPathFactory) -> Iterator[webdriver.Chrome]:
    """A browser, closed afterwards."""
    options = webdriver.ChromeOptions()
    assert CHROMIUM is not None
    options.binary_location = CHROMIUM
    profile = tmp_path_factory.mktemp("profile")
    for flag in (
        "headless=new", "no-sandbox", "disable-dev-shm-usage", "disable-background-networking",
        "no-first-run", "disable-component-update", "disable-sync", "enable-unsafe-swiftshader",
        "window-size=1280,860", f"user-data-dir={profile}",
    ):  # fmt: skip
        options.add_argument(f"--{flag}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    service = webdriver.ChromeService(executable_path=DRIVER, log_output=subprocess.DEVNULL)
    driver = webdriver.Chrome(options, service)
    try:
        yield driver
    finally:
        driver.quit()


class Designer:
    """What a person does with the page."""

    def __init__(self, browser: webdriver.Chrome, address: str) -> None:
        self.browser = browser
        browser.get(address)
        self.connected()

    def connected(self) -> None:
        """Wait until the page hears what is done on it."""
        self.until(lambda page: page.execute_script("return window.did_handshake === true"))

    def field(self, label: str) -> WebElement:
        """An input by its label, once it is there."""
        return self.until(lambda page: page.find_element(By.CSS_SELECTOR, f'input[aria-label="{label}"]'))

    def type(self, label: str, text: str) -> None:
        """Put a text in place of what is there."""
        field = self.field(label)
        field.send_keys(Keys.CONTROL, "a")
        field.send_keys(text)

    def press(self, text: str) -> None:
        """A button or tab by its words, once it can be pressed."""
        path = "//*[self::button or @role='tab'][translate(., 'abcdefghijklmnopqrstuvwxyz', "
        path += f"'ABCDEFGHIJKLMNOPQRSTUVWXYZ')='{text.upper()}' or @aria-label='{text}']"

        def pressable(page: webdriver.Chrome) -> WebElement | None:
            found = page.find_elements(By.XPATH, path)
            return next((item for item in found if item.is_displayed() and item.is_enabled()), None)

        self.until(pressable).click()

    def sees(self, text: str) -> None:
        """Wait until a text is on the page."""
        self.until(lambda page: text in page.find_element(By.TAG_NAME, "body").text)

    def choose(self, run: str) -> None:
        """Mark a run in the table."""
        path = f"//tr[td[.='{run}']]//*[@role='checkbox']"
        self.until(lambda page: page.find_element(By.XPATH, path)).click()

    def until(self, condition: Any) -> Any:
        """What a condition gives once it gives something."""
        waiting = WebDriverWait(self.browser, PATIENCE_S, ignored_exceptions=(Exception,))
        return waiting.until(condition)

    def tab_to(self, name: str) -> None:
        """Go to a field or a button by the Tab key alone."""
        active = "const one = document.activeElement; "
        active += "return one.ariaLabel || one.parentElement.ariaLabel || one.innerText || ''"
        for _ in range(60):
            if self.browser.execute_script(active).strip().upper() == name.upper():
                return
            self.send(Keys.TAB)
        raise AssertionError(f"{name} cannot be reached by the Tab key")

    def send(self, *keys: str) -> None:
        """Keys to whatever has the focus."""
        ActionChains(self.browser).send_keys(*keys).perform()

    def picture(self, name: str) -> None:
        """Keep a picture of the page where they are wanted: for docs/workbench.md."""
        if PICTURES is not None:
            self.browser.save_screenshot(f"{PICTURES}/workbench_{name}.png")

    def complaints(self) -> list[str]:
        """Errors on the console."""
        return [entry["message"] for entry in self.browser.get_log("browser") if entry["level"] == "SEVERE"]


needs_browser = pytest.mark.skipif(
    CHROMIUM is None or DRIVER is None,
    reason="no Chromium with its driver on PATH (Debian: apt install chromium chromium-driver)",
)

SHARE_MM = ((0.0, 0.0), (300.0, 0.0), (0.0, 173.0))
"""A share of 30 degrees, in x and z."""


@pytest.mark.full
@needs_browser
def test_from_a_tool_to_a_comparison(address: str, browser: webdriver.Chrome, project: Project) -> None:
    """A CAD tool is brought, a scene made and run, stopped, found again, resumed, and compared."""
    cad = project.folder.parent / "tine.step"
    cad.write_text(step_prism(SHARE_MM, 60.0))
    designer = Designer(browser, address)
    browser.find_element(By.CSS_SELECTOR, "input[type=file]").send_keys(str(cad))
    designer.sees("tine.step is in the project")
    designer.type("New scene: name", "tine" + Keys.ENTER)
    designer.until(lambda page: designer.field("Scene").get_attribute("value") == "tine")
    designer.type("Depth [m]", "0.15")
    designer.type("Travel [m]", "60" + Keys.TAB)
    designer.sees("150 mm deep")
    assert "travel_m: 60" in project.scene_file("tine").read_text()
    assert browser.execute_script("return document.documentElement.scrollHeight <= innerHeight"), (
        "the first page scrolls"
    )
    designer.picture("scene")
    designer.until(lambda page: page.find_element(By.XPATH, "//*[@role='checkbox'][.='Foxglove']")).click()
    designer.press("Run")
    designer.sees("running")
    designer.choose("tine-1")
    designer.sees("mean draft")  # of what there is so far
    designer.sees("Foxglove: ws://127.0.0.1:")
    designer.press("Stop")
    designer.sees("stopped")
    browser.refresh()
    designer.connected()
    designer.press("Runs")
    designer.choose("tine-1")
    designer.press("Resume")
    designer.until(lambda page: (project.runs / "tine-1-1" / "summary.json").is_file())
    designer.choose("tine-1")
    designer.choose("tine-1-1")
    designer.sees("120.00 of 120 s; mean draft")
    jobs.ask_for(project, "other", "pull", settings=["preset=coarse"])
    designer.until(lambda page: (project.runs / "other" / "summary.json").is_file())
    designer.choose("tine-1-1")
    designer.choose("other")
    designer.sees("1.00 of 1 s; mean draft")
    pixels = "const soil = document.querySelector('canvas.soil'); return soil.offsetParent !== null && "
    pixels += "soil.getContext('2d').getImageData(0, 0, 520, 260).data.some(Boolean)"
    designer.until(lambda page: page.execute_script(pixels))
    designer.picture("run")
    designer.choose("tine-1-1")
    designer.press("Compare")
    (page,) = designer.until(lambda _: list(project.folder.glob("comparisons/*/comparison.html")))
    designer.sees("comparison.html")
    designer.picture("comparison")
    assert designer.complaints() == []
    link = browser.find_element(By.LINK_TEXT, "comparison.html").get_attribute("href")
    assert link is not None
    browser.get(link)
    designer.until(lambda page: "tine-1-1" in page.page_source)
    assert page.stat().st_size > 1000


@pytest.mark.full
@needs_browser
def test_two_browsers_and_the_keyboard_alone(
    address: str, browser: webdriver.Chrome, other_browser: webdriver.Chrome, project: Project
) -> None:
    """One makes a flat blade and two runs of it without a mouse; the other sees what it does."""
    designer, colleague = Designer(browser, address), Designer(other_browser, address)
    designer.sees("150 mm deep")
    designer.tab_to("New scene: name")
    designer.send("blade", Keys.ENTER)
    designer.until(lambda page: designer.field("Scene").get_attribute("value") == "blade")
    designer.tab_to("Tool file")
    designer.send(Keys.ENTER, Keys.HOME)
    designer.until(lambda page: page.find_elements(By.XPATH, "//*[@role='option'][.='flat blade']"))
    while designer.field("Tool file").get_attribute("aria-expanded") == "true":
        designer.send(Keys.ENTER)
    assert "blade:" in project.scene_file("blade").read_text()
    designer.tab_to("Travel [m]")
    designer.send(Keys.CONTROL + "a" + Keys.NULL, "0.5")
    designer.tab_to("Seeds")
    designer.send("1, 2")
    designer.sees("200 mm deep")
    designer.until(lambda page: page.find_element(By.XPATH, "//button[.='Run']").is_enabled())
    designer.tab_to("Run")
    designer.send(Keys.ENTER)
    colleague.press("Runs")
    colleague.sees("blade-1-s2")
    for name in ("blade-1-s1", "blade-1-s2"):
        wait_for(project, name, "done")
    colleague.until(lambda page: page.find_element(By.TAG_NAME, "body").text.count("done") == 2)
    means = [
        json.loads((project.runs / name / "summary.json").read_text())["series"]["draft_newton"]["mean"]
        for name in ("blade-1-s1", "blade-1-s2")
    ]
    assert means[0] != means[1]
    assert designer.complaints() == colleague.complaints() == []


@pytest.mark.full
@needs_browser
def test_a_calibration_is_seen_to_come_and_is_stopped(
    address: str, browser: webdriver.Chrome, project: Project
) -> None:
    """Its soil is what the sliders say; its first lines are on the page."""
    designer = Designer(browser, address)
    designer.press("Soil")
    designer.tab_to("Cohesion [kPa]")
    designer.send(Keys.ARROW_RIGHT, Keys.ARROW_RIGHT)
    designer.type("Name of the soil", "mine")
    designer.press("Calibrate")
    designer.sees("running")
    designer.picture("soil")
    assert parse_yaml((project.folder / "soils" / "mine.yaml").read_text(), "mine")["cohesion_pa"] == 11_000.0
    designer.press("Stop")
    designer.sees("stopped")
    assert not (project.folder / "soils" / "mine_material.yaml").exists()
    assert designer.complaints() == []


@pytest.mark.full
@needs_browser
def test_a_bad_mesh_is_named_and_cannot_run(
    address: str, browser: webdriver.Chrome, project: Project, tmp_path: Path
) -> None:
    box = trimesh.creation.box((0.02, 0.1, 0.4))
    box.update_faces([face > 0 for face in range(len(box.faces))])
    hole = tmp_path / "elsewhere" / "hole.stl"
    hole.parent.mkdir()
    box.export(hole)
    designer = Designer(browser, address)
    designer.sees("150 mm deep")
    browser.find_element(By.CSS_SELECTOR, "input[type=file]").send_keys(str(hole))
    designer.sees("hole.stl is in the project")
    assert "share.stl" in project.scene_file("pull").read_text()
    designer.type("New scene: name", "bad" + Keys.ENTER)
    designer.sees("is not watertight")
    field = browser.find_element(
        By.XPATH, "//label[contains(@class, 'q-select')][.//*[@aria-label='Tool file']]"
    )
    assert "is not watertight" in field.text
    designer.picture("bad_mesh")
    assert "hole.stl" in project.scene_file("bad").read_text()
    run = browser.find_element(By.XPATH, "//button[.='Run']")
    designer.until(lambda page: not run.is_enabled())
    assert designer.complaints() == []
