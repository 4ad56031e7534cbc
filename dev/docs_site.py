"""Hooks of mkdocs: reports join the site, links work in both places, typeset formulas.

In the repository a page names another by the path between their files. The site has the content of docs/ at
its top, and what ADDED names beside it. Formulas in LaTeX become MathML, which browsers draw without a
script.
"""

import html
import posixpath
import re
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

DOCS = "docs/"
ADDED = (
    "benchmarks/", "examples/", "reproduction/", "tests/README.md", "validation/",
    "CHANGELOG.md", "CONTRIBUTING.md",
)  # fmt: skip
SUFFIXES = {".md", ".png", ".gif"}
_TARGET = re.compile(r"(?<=\]\()([^)#:\s]+)")
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


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Change links between files to links between pages of the site."""
    uri = page.file.src_uri
    own = uri if uri.startswith(ADDED) else DOCS + uri

    def linked(match: re.Match[str]) -> str:
        target = posixpath.normpath(posixpath.join(posixpath.dirname(own), match[1]))
        if not target.startswith((DOCS, *ADDED)):
            return match[1]
        return posixpath.relpath(target.removeprefix(DOCS), posixpath.dirname(uri) or ".")

    return _TARGET.sub(linked, markdown)


def on_page_content(html_text: str, page: Page, **_: Any) -> str:
    """Typeset the formulas of a page. A formula that cannot be read ends the build."""

    def typeset(match: re.Match[str]) -> str:
        latex = html.unescape(match[3]).replace("{aligned}", "{split}")
        formula = convert(latex, display="block" if match[2] == "[" else "inline")
        if "\\" in formula:  # a command that the library does not know stays as it is
            raise PluginError(f"{page.file.src_uri}: no MathML for the formula {latex}")
        return formula

    return _FORMULA.sub(typeset, html_text)
