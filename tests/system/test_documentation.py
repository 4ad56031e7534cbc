"""Commands, Python and scenes in README, docs and their like work: what readers copy runs here.

The blocks of a page run in their order in one folder, with `config` and `examples` of the repository
in it. A block below a line `<!-- not run: REASON -->` is only checked: its syntax, the words of every
`subsoil` command, and the options of benchmarks and examples. A block below `<!-- design: MODULE -->` is
read by its `read_design`.
"""

import contextlib
import functools
import importlib
import io
import json
import os
import re
import runpy
import shlex
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import jsonschema
import pytest

from subsoil_ros.cli.main import VERBS, parse
from subsoil_ros.yaml_document import parse_yaml

ROOT = Path(__file__).parents[2]
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "examples").glob("*/README.md")),
    *sorted((ROOT / "reproduction").glob("*/*.md")),
    *sorted((ROOT / "benchmarks").glob("*.md")),
    *sorted((ROOT / "validation").glob("*.md")),
]
LANGUAGES = {"bash", "python", "yaml", "text", "json", "dockerfile"}
_FENCE = re.compile(r"^ *```(.*)$")
_NOT_RUN = re.compile(r"^ *<!-- not run: (.+) -->$")
_DESIGN = re.compile(r"^ *<!-- design: ([\w.]+) -->$")
_LIST_ITEM = re.compile(r" *([-*+]|\d+[.)]) ")
_PROGRAM = re.compile(
    r"(?<![\w/])python3? (?:-m ((?:benchmarks|dev|reproduction|validation)[.\w]+)"
    r"|((?:benchmarks|dev|examples)/[\w/]+\.py))([^`\n|]*)"
)
_INLINE_COMMAND = re.compile(r"(?<!`)`subsoil ([a-z][a-z-]*)([^`]*)`")


@dataclass(frozen=True)
class Block:
    """A fenced block of a page."""

    page: Path
    line: int
    language: str
    text: str
    not_run: str  # why; empty if it runs
    design: str  # module that reads it; empty if it is no design of a study or calibration

    @property
    def name(self) -> str:
        return f"{self.page.relative_to(ROOT)}:{self.line}"


def blocks(page: Path) -> list[Block]:
    """All fenced blocks of a page."""
    found: list[Block] = []
    inside: list[str] | None = None
    above, label, start = "", "", 0
    for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1):
        fence = _FENCE.match(line)
        if fence and inside is None:
            inside, label, start = [], fence.group(1), number
        elif fence and inside is not None:
            why, design = _NOT_RUN.match(above), _DESIGN.match(above)
            text = "\n".join(inside) + "\n"
            found.append(Block(page, start, label, text, why[1] if why else "", design[1] if design else ""))
            inside = None
        elif inside is not None:
            inside.append(line)
        if inside is None and line.strip():
            above = line
    assert inside is None, f"{page}: a fence is not closed"
    return found


ALL = [block for page in PAGES for block in blocks(page)]


def indented_code(text: str) -> list[str]:
    """First lines of code blocks that are made by indenting, outside of lists: they escape the checks."""
    found = []
    fenced, listed, before = False, False, ""
    for line in text.splitlines():
        if _FENCE.match(line):
            fenced = not fenced
        elif not fenced and line.strip():
            if _LIST_ITEM.match(line):
                listed = True
            elif not line.startswith(" ") and not before.strip():
                listed = False
            if line.startswith("    ") and not before.strip() and not listed:
                found.append(line)
        before = line
    return found


def test_blocks_say_their_language():
    """No block goes unchecked because it names no language, or is indented instead of fenced."""
    assert [block.name for block in ALL if block.language not in LANGUAGES] == []
    assert [f"{page.name}: {line}" for page in PAGES for line in indented_code(page.read_text())] == []
    assert indented_code("Text:\n\n    subsoil run\n    more\n") == ["    subsoil run"]
    assert indented_code("- item\n\n    of the item\n\n```text\n\n    fenced\n```\n") == []
    assert indented_code("- item\n\ntext\n\n    code\n") == ["    code"]


def complaint(words: list[str]) -> str:
    """What `subsoil` says against the words of a command; empty if it understands them."""
    with contextlib.redirect_stderr(io.StringIO()) as said, contextlib.redirect_stdout(io.StringIO()):
        try:
            parse(words)
        except SystemExit as ended:
            return said.getvalue() if ended.code else ""  # --help ends with 0
    return ""


@pytest.mark.parametrize("block", [b for b in ALL if b.language == "bash"], ids=lambda block: block.name)
def test_commands_exist(block):
    """The shell reads every block, and `subsoil` knows every verb and option in it."""
    subprocess.run(["bash", "-n"], input=block.text, text=True, check=True)
    text = re.sub(r"<<'?END'?.*?^END$", "", block.text.replace("\\\n", " "), flags=re.DOTALL | re.MULTILINE)
    for line in text.splitlines():
        words = shlex.split(line, comments=True)
        words = words[1:] if words and "=" in words[0] else words
        if words and words[0].rpartition("/")[2] == "subsoil":
            assert complaint([word for word in words[1:] if word != "&"]) == "", line


@functools.cache
def help_of(*words: str) -> str:
    """What `subsoil VERB --help` prints, or `subsoil VERB ACTION --help`."""
    quiet = contextlib.redirect_stderr(io.StringIO())
    with quiet, contextlib.redirect_stdout(io.StringIO()) as said, contextlib.suppress(SystemExit):
        parse([*words, "--help"])
    return said.getvalue()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_in_the_text_exist(page):
    """Verbs and options that a sentence or a table names are those of the command line."""
    wrong = []
    for verb, rest in _INLINE_COMMAND.findall(page.read_text()):
        options = re.findall(r"(?<![\w-])--[a-z-]+", rest)
        known = help_of(verb) + help_of(verb, rest.split()[0]) if options else ""
        if verb not in VERBS or any(option not in known for option in options):
            wrong.append(f"subsoil {verb}{rest}")
    assert wrong == []


SCENE_BLOCKS = [b for b in ALL if b.language == "yaml" and not b.design and not b.not_run]

PROGRAMS = sorted(
    {
        (module or path, tuple(re.findall(r"(?<![\w-])--[a-z-]+", words)))
        for page in PAGES
        for module, path, words in _PROGRAM.findall(page.read_text())
        if "--ros-args" not in words  # a node: tests/ros starts it
    }
)


@pytest.mark.parametrize(("program", "options"), PROGRAMS, ids=str)
def test_programs_exist(program, options, monkeypatch):
    """Benchmarks and examples that a page tells to start do start, and know the options it gives them."""
    for name, library in (("dev.rerun_picture", "rerun"), ("examples/bucket_arm/loader.py", "pybullet")):
        if program == name:
            pytest.importorskip(library, reason=f"needs {library}")
    monkeypatch.setattr(sys, "argv", [program, "--help"])
    monkeypatch.syspath_prepend(str(ROOT))
    if program.endswith(".py"):
        monkeypatch.syspath_prepend(str((ROOT / program).parent))  # as python does
        start = functools.partial(runpy.run_path, str(ROOT / program))
    else:
        start = functools.partial(runpy.run_module, program)
    with contextlib.redirect_stdout(io.StringIO()) as said, pytest.raises(SystemExit) as ended:
        start(run_name="__main__")
    assert ended.value.code == 0
    assert [option for option in options if option not in said.getvalue()] == []


@pytest.mark.parametrize("block", [b for b in ALL if b.design], ids=lambda block: block.name)
def test_designs_are_valid(block, tmp_path):
    """Designs of studies and calibrations in the docs are read as the command reads its file."""
    path = tmp_path / "design.yaml"
    path.write_text(block.text)
    importlib.import_module(block.design).read_design(path)


@pytest.mark.parametrize("block", SCENE_BLOCKS, ids=lambda block: block.name)
def test_scenes_are_valid(block):
    """Scenes and parts of scenes in the docs have only keys that there are, with values that are allowed."""
    schema = json.loads((ROOT / "config/scene.schema.json").read_text())
    part = {key: value for key, value in schema.items() if key not in ("if", "then", "else")}
    document = parse_yaml(block.text, block.name)
    jsonschema.Draft7Validator(part | {"$ref": "#/$defs/PartialScene"}).validate(document)


RUN = {
    page: [b for b in ALL if b.page == page and b.language in ("bash", "python") and not b.not_run]
    for page in PAGES
}


FIRST = ("README.md", "docs/api.md")
"""Pages that `make test` runs; the others run in `make test-full`."""


def page_to_run(page: Path) -> object:
    """The page as a parameter."""
    name = page.relative_to(ROOT).as_posix()
    return pytest.param(page, id=name, marks=[] if name in FIRST else [pytest.mark.full])


@pytest.mark.parametrize("page", [page_to_run(page) for page, found in RUN.items() if found])
def test_page_runs(page, tmp_path):
    """Every block of a page ends well, in the order of the page."""
    for folder in ("config", "examples"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    environment = {
        **os.environ,
        "PATH": f"{sys.prefix}/bin:{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "MPLBACKEND": "Agg",
    }
    for block in RUN[page]:
        program = ["bash", "-euo", "pipefail", "-c"] if block.language == "bash" else [sys.executable, "-c"]
        done = subprocess.run(
            [*program, block.text], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, f"{block.name}\n{block.text}\n{done.stdout}\n{done.stderr}"
