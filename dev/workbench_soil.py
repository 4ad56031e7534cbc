"""How often the workbench draws a moving soil, and what that takes: python -m dev.workbench_soil --minutes 10

First, when the page shows its first words. Then a made-up run adds clouds to its bag, ten a second, and a
page in headless Chromium looks at it. Every half minute a line: soils drawn and frames of the page a second,
heap of the page, memory and processor time of the server, of the process that reads the bag, and of the
browser. Needs Chromium and chromedriver on PATH.
"""

import argparse
import tempfile
import time
from pathlib import Path

import psutil
from selenium import webdriver

from subsoil_ros.workbench.project import Project
from tests.system.growing_run import begin
from tests.system.test_workbench import DRIVER, Designer, served

EVERY_S = 30.0
COUNT = """
const pen = document.querySelector(".soil").getContext("2d"), put = pen.putImageData.bind(pen);
window.counts = [0, 0];
pen.putImageData = (...words) => { counts[0]++; put(...words); };
const note = () => { counts[1]++; requestAnimationFrame(note); };
note();
"""
PAINTED_MS = """
const [done] = arguments, name = "first-contentful-paint";
const told = list => list.getEntriesByName(name).forEach(entry => done(entry.startTime));
new PerformanceObserver(told).observe({type: "paint", buffered: true});
"""
FLAGS = "headless=new no-sandbox disable-dev-shm-usage enable-unsafe-swiftshader enable-precise-memory-info"
KINDS = {" watch ": "watch", " workbench ": "server", "chromium": "browser"}
"""Of processes, by a word of their command."""


def processes() -> dict[str, tuple[float, float]]:
    """Memory [MB] and processor time [s] of what this process has started, by kind."""
    found = dict.fromkeys(KINDS.values(), (0.0, 0.0))
    for process in psutil.Process().children(recursive=True):
        words = " ".join(process.cmdline())
        if kind := next((kind for word, kind in KINDS.items() if word in words), None):
            memory, spent, (mega, cpu_s) = process.memory_info(), process.cpu_times(), found[kind]
            found[kind] = (mega + memory.rss / 1e6, cpu_s + spent.user + spent.system)
    return found


def measure(browser: webdriver.Chrome, minutes: float) -> None:
    """Print a line every EVERY_S."""
    browser.execute_script(COUNT)
    begun_s = last_s = time.monotonic()
    (soils, frames), spent = (0, 0), processes()
    while last_s < begun_s + 60.0 * minutes:
        time.sleep(EVERY_S)
        counts = browser.execute_script("return counts")
        heap = browser.execute_script("return performance.memory.usedJSHeapSize") / 1e6
        now_s, spends = time.monotonic(), processes()
        past_s = now_s - last_s
        line = f"{now_s - begun_s:5.0f} s: {(counts[0] - soils) / past_s:.1f} soils/s, "
        line += f"{(counts[1] - frames) / past_s:.0f} frames/s, heap {heap:.0f} MB"
        for kind, (mega, cpu_s) in spends.items():
            line += f"; {kind} {mega:.0f} MB, {100.0 * (cpu_s - spent[kind][1]) / past_s:.0f} % of a core"
        print(line, flush=True)
        last_s, (soils, frames), spent = now_s, counts, spends


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--particles", type=int, default=50_000)
    args = parser.parse_args()
    options = webdriver.ChromeOptions()
    for flag in FLAGS.split():
        options.add_argument(f"--{flag}")
    with tempfile.TemporaryDirectory(prefix="subsoil-workbench-") as folder:
        project = Project(Path(folder))
        run = begin(project, "made-up", args.particles, 10.0)
        for address in served(project):
            browser = webdriver.Chrome(options, webdriver.ChromeService(DRIVER))
            try:
                designer = Designer(browser, address)
                print(
                    f"first words of the page after {browser.execute_async_script(PAINTED_MS):.0f} ms",
                    flush=True,
                )
                designer.press("Runs")
                designer.choose("made-up")
                designer.sees("mean draft")
                measure(browser, args.minutes)
            finally:
                browser.quit()
                run.kill()
                run.wait()


if __name__ == "__main__":
    main()
