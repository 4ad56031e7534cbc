"""docs/install.md and Dockerfile say the same."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[3]
TEXT = (ROOT / "docs" / "install.md").read_text(encoding="utf-8")
DOCKERFILE = (ROOT / "Dockerfile").read_text(encoding="utf-8")


def test_the_container_has_the_packages_that_are_named() -> None:
    """Those of the first paragraph (Debian: `...`) and those of the container's; no other."""
    installed = set(re.search(r"--no-install-recommends \\\n(.*?) \\\n", DOCKERFILE, re.DOTALL)[1].split())
    needed = set(re.search(r"\(Debian: `([^`]*)`\)", TEXT)[1].split())
    section = TEXT.split("## In a container")[1].split("```")[-1]
    quoted = {name for words in re.findall(r"`([^`]*)`", section) for name in words.split()}
    assert installed - needed == quoted - {"Dockerfile", "/data", "--user"}
    assert needed <= installed


def test_results_of_the_container_are_the_users() -> None:
    """The command in the docs is the Dockerfile's own; it names --user, who can write where HOME is."""
    (command,) = re.findall(r"^docker run .*$", TEXT, re.MULTILINE)
    assert f"# {command}\n" in DOCKERFILE
    assert '--user "$(id -u):$(id -g)"' in command
    home = re.search(r"HOME=(\S+)", DOCKERFILE)[1]
    assert f"RUN mkdir --mode=1777 {home}\n" in DOCKERFILE
    assert f":{home}/runs" in command
