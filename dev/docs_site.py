"""Hooks of mkdocs: pages under reproduction/ join the site; links between them and docs/ work in both places.

In the repository a page names another by the path between their files. The site has the content of docs/ at
its top, and reproduction/ beside it.
"""

import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

DOCS = "docs/"
ADDED = "reproduction"
SUFFIXES = {".md", ".png", ".gif"}
_TARGET = re.compile(r"(?<=\]\()([^)#:\s]+)")


def on_files(files: Files, config: MkDocsConfig, **_: Any) -> Files:
    """Add the pages and pictures of reproduction/."""
    root = Path(config.docs_dir).parent
    for path in sorted((root / ADDED).rglob("*")):
        if path.suffix in SUFFIXES:
            name = path.relative_to(root).as_posix()
            files.append(File.generated(config, name, abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Change links between files of the repository to links between pages of the site."""
    uri = page.file.src_uri
    own = uri if uri.startswith(f"{ADDED}/") else DOCS + uri

    def linked(match: re.Match[str]) -> str:
        target = posixpath.normpath(posixpath.join(posixpath.dirname(own), match[1]))
        if not target.startswith((DOCS, f"{ADDED}/")):
            return match[1]
        return posixpath.relpath(target.removeprefix(DOCS), posixpath.dirname(uri) or ".")

    return _TARGET.sub(linked, markdown)
