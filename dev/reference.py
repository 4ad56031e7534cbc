"""Write the generated parts of docs/ anew: python -m dev.reference

Between the lines `<!-- generated: NAME -->` and END of a page stands what GENERATED makes of the sources, so
that it can be read where it lies. tests/unit/repository/test_reference.py tells when a page is not current.
"""

import argparse
import contextlib
import inspect
import io
import os
import re
from pathlib import Path
from unittest import mock

import subsoil_ros
from dev.scene_keys import scene_keys
from subsoil_ros.api.check_scene import CheckResult, Cost
from subsoil_ros.api.read import Run
from subsoil_ros.cli.main import VERBS, parse
from subsoil_ros.loading.loader import ResolvedScene
from subsoil_ros.yaml_document import parse_yaml

ROOT = Path(__file__).parents[1]
MESSAGES = ROOT / "msg_defs"
SCENES = ROOT / "config" / "scenes"

END = "<!-- end of generated -->"
BLOCK = re.compile(rf"^<!-- generated: ([a-z_]+) -->\n.*?^{END}$", re.MULTILINE | re.DOTALL)


def command_line() -> str:
    """What `subsoil VERB --help` prints, for every verb and its actions, as Markdown."""
    words = [[verb] for verb in VERBS] + [["bag", "info"], ["bag", "recover"]]
    return "\n\n".join(f"## {' '.join(each)}\n\n```text\n{_help_of(each)}```" for each in sorted(words))


def _help_of(words: list[str]) -> str:
    """The help of a verb or of an action of it; argparse takes its width from the environment."""
    said = io.StringIO()
    wide = mock.patch.dict(os.environ, {"COLUMNS": "100"})
    with wide, contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
        parse([*words, "--help"])
    return said.getvalue()


def messages() -> str:
    """Every interface of subsoil_msgs with its comments, as Markdown."""
    paths = [path for kind in ("msg", "srv", "action") for path in sorted(MESSAGES.glob(f"{kind}/*.{kind}"))]
    return "\n\n".join(f"## {path.name}\n\n```text\n{path.read_text()}```" for path in paths)


def shipped_scenes() -> str:
    """Every scene of config/scenes with its description, as a table."""
    rows = []
    for path in sorted(SCENES.glob("*.yaml")):
        description = parse_yaml(path.read_text(), path.name).get("description", "")
        rows.append(f"| `{path.stem}` | {description} |")
    return "\n".join(["| scene | |", "|---|---|", *rows])


PUBLIC = ("load_scene", "check", "run", "read_run", "serve", "Machine", "ExternalSoil", "MujocoMachine")
RETURNED = (ResolvedScene, CheckResult, Cost, Run)


def python() -> str:
    """The public functions and classes with their docstrings, as Markdown."""
    found = [getattr(subsoil_ros, name) for name in PUBLIC]
    parts = [*map(_documented, found), "## What they return", *map(_documented, RETURNED)]
    return "\n\n".join(parts)


def _documented(item: object) -> str:
    """Heading, signature and docstring; of a class also those of its public methods."""
    name = getattr(item, "__name__", "")
    lines = [f"def {name}{_signature(item)}" if inspect.isfunction(item) else f"class {name}"]
    lines += [inspect.getdoc(item) or ""]
    members = vars(item).items() if inspect.isclass(item) else ()
    for key, member in members:
        function = member.fget if isinstance(member, property) else member
        if not key.startswith("_") and inspect.isfunction(function) and inspect.getdoc(function):
            told = f"{key}: property" if isinstance(member, property) else f"def {key}{_signature(function)}"
            lines += [
                told,
                *(f"    {line}".rstrip() for line in (inspect.getdoc(function) or "").splitlines()),
            ]
    return f"### {name}\n\n```text\n" + "\n".join(lines) + "\n```"


def _signature(function: object) -> str:
    """Arguments and what is returned, names of modules left out."""
    text = str(inspect.signature(function))  # type: ignore[arg-type]
    return re.sub(r"\b(?:[a-z_]+\.)+(?=[A-Z])", "", text).replace("'", "")


GENERATED = {
    "command_line": command_line,
    "messages": messages,
    "python": python,
    "scene_keys": scene_keys,
    "shipped_scenes": shipped_scenes,
}


def written_anew() -> dict[Path, str]:
    """Every page with a generated part, as it should be."""
    texts = {page: page.read_text(encoding="utf-8") for page in sorted((ROOT / "docs").glob("*.md"))}
    return {
        page: BLOCK.sub(
            lambda match: f"<!-- generated: {match[1]} -->\n\n{GENERATED[match[1]]()}\n\n{END}", text
        )
        for page, text in texts.items()
        if BLOCK.search(text)
    }


def main() -> int:
    """Write the pages."""
    argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    ).parse_args()
    for page, text in written_anew().items():
        page.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
