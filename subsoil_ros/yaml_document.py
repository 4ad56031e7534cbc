"""A scene as a plain YAML document: reading, merging, removing; independent of the keys of a scene."""

import codecs
import difflib
import math
import re
from collections.abc import Iterator, Mapping
from io import StringIO
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.composer import Composer, ComposerError
from ruamel.yaml.constructor import SafeConstructor
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, ScalarNode
from ruamel.yaml.representer import RepresenterError

from .errors import SceneError

Document = dict[str, Any]

LARGEST_SIZE = 1_000_000
"""Largest number of values in a document, its aliases expanded."""

_PLAIN = ("tag:yaml.org,2002:str", "tag:yaml.org,2002:merge")


_NO_TEXT = re.compile("[\0\ud800-\udfff]")
"""NUL, and halves of a character, as JSON writes one beyond U+FFFF."""


class _Composer(Composer):
    """Composer that refuses repeated keys, and keys that are not text."""

    def compose_mapping_node(self, anchor: str | None) -> MappingNode:
        node: MappingNode = super().compose_mapping_node(anchor)
        lines: dict[str, int] = {}
        for key, _ in node.value:
            if key.tag not in _PLAIN:
                shown = key.value if isinstance(key, ScalarNode) else "of several values"
                problem = f"key {shown} is not text; put it in quotes"
                raise ComposerError(None, None, problem, key.start_mark)
            if key.value in lines:
                first = lines[key.value]
                problem = f"key '{key.value}' is given twice, first in line {first}; keep one of them"
                raise ComposerError(None, None, problem, key.start_mark)
            lines[key.value] = key.start_mark.line + 1
        return node


class _Constructor(SafeConstructor):
    """Constructor that reads dates as text."""


_Constructor.add_constructor("tag:yaml.org,2002:timestamp", SafeConstructor.construct_yaml_str)


def _yaml() -> YAML:
    """Reader and writer of YAML 1.2."""
    yaml = YAML(typ="safe", pure=True)
    yaml.Composer, yaml.Constructor = _Composer, _Constructor
    yaml.default_flow_style = False
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    yaml.width = 1000  # a folded line would end in a blank
    yaml.representer.ignore_aliases = lambda data: True  # not every reader follows them
    return yaml


def dump_yaml(document: Document | list[Document]) -> str:
    """The document as YAML text that `parse_yaml` reads back equal, its keys in the same order."""
    stream = StringIO()
    _yaml().dump(document, stream)
    return stream.getvalue()


def parse_yaml(text: str | bytes, source: str) -> Any:
    """Parse YAML 1.2; `source` names it in errors.

    Raises SceneError with line and column for a syntax error, a repeated key, a key that is not text, or
    bytes that are not UTF-8; for numbers that are not finite; for aliases that multiply.
    """
    if isinstance(text, bytes) and not text.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        text = _decoded(text, source)
    try:
        value = _loaded(text)
        if _size(value, {}) > LARGEST_SIZE:
            raise SceneError(f"{source}: its aliases make more than {LARGEST_SIZE:,} values of it; use fewer")
        for path, leaf in leaves(value):
            where = f"{source}: {path}" if path else source
            if isinstance(leaf, float) and not math.isfinite(leaf):
                raise SceneError(f"{where}: given {leaf}, allowed are finite numbers only")
            if (found := _NO_TEXT.search(f"{path} {leaf}")) is not None:
                raise SceneError(
                    f"{where}: has {found[0]!a}, which no name or file can have; remove it, or write a "
                    "character as itself instead of its halves"
                )
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"{source}:{mark.line + 1}:{mark.column + 1}" if mark else source
        raise SceneError(f"{where}: not valid YAML: {error.problem or error.context}") from error
    except YAMLError as error:
        raise SceneError(f"{source}: not valid YAML text: {' '.join(str(error).split())}") from error
    except ValueError as error:  # for example an integer of too many digits
        raise SceneError(f"{source}: a value cannot be read: {error}") from error
    except RecursionError as error:
        raise SceneError(f"{source}: nested without end; remove the alias that contains itself") from error
    return value


def _decoded(content: bytes, source: str) -> str:
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise SceneError(
            f"{source}:{line}: byte 0x{content[error.start]:02x} is not UTF-8 text; save the file as UTF-8"
        ) from error


def _loaded(text: str | bytes) -> Any:
    """The value of a text. A TAB after a value, which YAML allows and ruamel does not, counts as a blank."""
    while True:
        try:
            return _yaml().load(text)
        except MarkedYAMLError as error:
            mark = error.problem_mark
            if mark is None or not isinstance(text, str):
                raise
            start = text.rfind("\n", 0, mark.index) + 1
            if text[mark.index : mark.index + 1] != "\t" or not text[start : mark.index].strip():
                raise
            text = f"{text[: mark.index]} {text[mark.index + 1 :]}"


def _size(value: object, known: dict[int, int]) -> int:
    """Number of values in a document, those of an alias counted each time; `known` by id."""
    if not isinstance(value, dict | list):
        return 1
    if id(value) not in known:
        known[id(value)] = -1
        items = value.values() if isinstance(value, dict) else value
        known[id(value)] = 1 + sum(_size(item, known) for item in items)
    if known[id(value)] < 0:
        raise RecursionError
    return known[id(value)]


def plain_value(value: object, source: str) -> object:
    """Copy of a value as YAML would load it. Raises SceneError for what YAML cannot hold, as parse_yaml."""
    try:
        stream = StringIO()
        _yaml().dump(value, stream)
    except RepresenterError as error:
        raise SceneError(
            f"{source}: {error}; allowed are numbers, texts, booleans, None, lists, and mappings of them"
        ) from error
    return parse_yaml(stream.getvalue(), source)


def read_document(path: Path, shown: str) -> Document:
    """Read a YAML file that holds a mapping; `shown` is its name in errors."""
    try:
        content = path.read_bytes()
    except FileNotFoundError as error:
        raise SceneError(f"{shown}: no such file{_similar_files(path)}") from error
    except IsADirectoryError as error:
        raise SceneError(f"{shown}: is a folder; name the scene file (.yaml) in it") from error
    except OSError as error:
        raise SceneError(f"{shown}: cannot be read: {error.strerror}") from error
    document = parse_yaml(content, shown)
    if not isinstance(document, dict):
        found = "is empty" if document is None else f"holds a {type(document).__name__}"
        raise SceneError(f"{shown}: {found}; a scene is a mapping with keys such as name, duration_s, soil")
    return document


def _similar_files(path: Path) -> str:
    names = {found.name: found for found in path.parent.glob("*.yaml")} if path.parent.is_dir() else {}
    beside = [names[name] for name in difflib.get_close_matches(path.name, names, n=8, cutoff=0.0)]
    return f"; beside it there are {', '.join(p.name for p in beside)}" if beside else ""


def leaves(value: object, path: str = "") -> Iterator[tuple[str, object]]:
    """Every scalar of a document with its dotted path."""
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from leaves(item, f"{path}.{key}" if path else str(key))
    elif isinstance(value, list):
        for index, item in enumerate(value):
            yield from leaves(item, f"{path}.{index}" if path else str(index))
    else:
        yield path, value


def merge(below: Document, above: Document, source: str, path: str = "") -> Document:
    """`above` laid over `below`: mappings merge, anything else replaces, null removes.

    A mapping whose `kind` differs replaces: the keys of another kind would be unknown there. Keys without a
    kind, as in the bed of a material, stay. Where `model` differs, as of soil, only the bin stays.
    Raises SceneError where null stands for a key that is not there.
    """
    merged = dict(below)
    for key, value in above.items():
        here = f"{path}.{key}" if path else key
        if value is None:
            if key not in merged:
                raise SceneError(f"{source}: {here}: null removes a key, but there is none to remove")
            del merged[key]
            continue
        present = merged.get(key)
        if isinstance(value, dict):
            beneath = present if isinstance(present, dict) else {}
            if "kind" in value and value["kind"] != beneath.get("kind", value["kind"]):
                beneath = {}
            if "model" in value and value["model"] != beneath.get("model", "dem"):
                beneath = {key: beneath[key] for key in ("bin",) if key in beneath}
            merged[key] = merge(beneath, value, source, here)
        else:
            merged[key] = value
    return merged
