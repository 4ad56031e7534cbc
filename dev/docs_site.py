"""Hooks of mkdocs: reports join the site, links work in both places, generated references, typeset formulas.

In the repository a page names another by the path between their files. The site has the content of docs/ at
its top, and what ADDED names beside it. A line `<!-- generated: NAME -->` of a page is replaced by what
GENERATED makes of the sources. Formulas in LaTeX become MathML, which browsers draw without a script.
"""

import contextlib
import html
import io
import os
import posixpath
import re
from pathlib import Path
from typing import Any
from unittest import mock

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from dev.scene_keys import scene_keys
from subsoil_ros.cli.main import VERBS, parse
from subsoil_ros.yaml_document import parse_yaml

MESSAGES = Path(__file__).parents[1] / "msg_defs"
SCENES = Path(__file__).parents[1] / "config" / "scenes"
DOCS = "docs/"
ADDED = (
    "benchmarks/", "examples/", "reproduction/", "tests/README.md", "validation/",
    "CHANGELOG.md", "CONTRIBUTING.md",
)  # fmt: skip
SUFFIXES = {".md", ".png", ".gif"}
_TARGET = re.compile(r"(?<=\]\()([^)#:\s]+)")
_GENERATED = re.compile(r"^<!-- generated: ([a-z_]+) -->$", re.MULTILINE)
_FORMULA = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.DOTALL)


def on_files(files: Files, config: MkDocsConfig, **_: Any) -> Files:
    """Add the pages and pictures that are not in docs/."""
    root = Path(config.docs_dir).parent
    for added in ADDED:
        for path in sorted((root / added).rglob("*") if added.endswith("/") else [root / added]):
            if path.suffix in SUFFIXES:
                name = path.relative_to(root).as_posix()
                files.append(File.generated(config, name, abs_src_path=str(path)))
    return files


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


GENERATED = {
    "command_line": command_line,
    "messages": messages,
    "scene_keys": scene_keys,
    "shipped_scenes": shipped_scenes,
}


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Insert generated references; change links between files to links between pages of the site."""
    uri = page.file.src_uri
    own = uri if uri.startswith(ADDED) else DOCS + uri

    def linked(match: re.Match[str]) -> str:
        target = posixpath.normpath(posixpath.join(posixpath.dirname(own), match[1]))
        if not target.startswith((DOCS, *ADDED)):
            return match[1]
        return posixpath.relpath(target.removeprefix(DOCS), posixpath.dirname(uri) or ".")

    whole = _GENERATED.sub(lambda match: GENERATED[match[1]](), markdown)
    return _TARGET.sub(linked, whole)


def on_page_content(html_text: str, page: Page, **_: Any) -> str:
    """Typeset the formulas of a page. A formula that cannot be read ends the build."""

    def typeset(match: re.Match[str]) -> str:
        latex = html.unescape(match[3]).replace("{aligned}", "{split}")
        formula = convert(latex, display="block" if match[2] == "[" else "inline")
        if "\\" in formula:  # a command that the library does not know stays as it is
            raise PluginError(f"{page.file.src_uri}: no MathML for the formula {latex}")
        return formula

    return _FORMULA.sub(typeset, html_text)
