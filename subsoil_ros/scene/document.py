"""A scene as a plain YAML document: reading, merging, removing. Knows no keys of the scene itself."""

import difflib
import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

from ..errors import SceneError

Document = dict[str, Any]

_FLOAT = re.compile(
    r"""^[-+]?(?:[0-9][0-9_]*\.[0-9_]*(?:[eE][-+]?[0-9]+)?
    |\.[0-9][0-9_]*(?:[eE][-+]?[0-9]+)?
    |[0-9][0-9_]*[eE][-+]?[0-9]+
    |\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$""",
    re.VERBOSE,
)


class _SceneYaml(yaml.SafeLoader):
    """Safe YAML that refuses repeated keys, reads 1e-5 as a number and dates as text."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict:
        seen: dict[object, yaml.Mark] = {}
        for key_node, _ in node.value:
            if key_node.tag == "tag:yaml.org,2002:merge":
                continue
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, str):
                raise yaml.constructor.ConstructorError(
                    None, None, f"key {key!r} is not text; put it in quotes", key_node.start_mark
                )
            if key in seen:
                raise yaml.constructor.ConstructorError(
                    None,
                    None,
                    f"key '{key}' is given twice, first in line {seen[key].line + 1}; keep one of them",
                    key_node.start_mark,
                )
            seen[key] = key_node.start_mark
        return super().construct_mapping(node, deep=deep)


_SceneYaml.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if not tag.endswith((":float", ":timestamp"))]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
_SceneYaml.add_implicit_resolver("tag:yaml.org,2002:float", _FLOAT, list("-+0123456789."))


class _SceneDumper(yaml.SafeDumper):
    """Quotes the texts that _SceneYaml would not read as text."""


_SceneDumper.yaml_implicit_resolvers = {
    first: [*resolvers, *yaml.SafeDumper.yaml_implicit_resolvers.get(first, ())]
    for first, resolvers in _SceneYaml.yaml_implicit_resolvers.items()
}


def dump_yaml(document: Document) -> str:
    """The document as YAML text that `parse_yaml` reads back equal, its keys in the same order."""
    return yaml.dump(document, Dumper=_SceneDumper, sort_keys=False, allow_unicode=True, width=110)


def parse_yaml(text: str | bytes, source: str) -> object:
    """Parse YAML; `source` names it in errors.

    Raises SceneError with line and column for a syntax error, a repeated key or a key that is not
    text, and for numbers that are not finite.
    """
    try:
        value = yaml.load(text, Loader=_SceneYaml)  # a SafeLoader
        for path, leaf in leaves(value):
            if isinstance(leaf, float) and not math.isfinite(leaf):
                where = f"{source}: {path}" if path else source
                raise SceneError(f"{where}: given {leaf}, allowed are finite numbers only")
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"{source}:{mark.line + 1}:{mark.column + 1}" if mark else source
        raise SceneError(f"{where}: not valid YAML: {error.problem or error.context}") from error
    except yaml.YAMLError as error:
        raise SceneError(f"{source}: not valid YAML text: {' '.join(str(error).split())}") from error
    except ValueError as error:  # for example an integer of too many digits
        raise SceneError(f"{source}: a value cannot be read: {error}") from error
    except RecursionError as error:
        raise SceneError(f"{source}: nested without end; remove the alias that contains itself") from error
    return value


def plain_value(value: object, source: str) -> object:
    """A copy of a value as YAML would give it. Raises SceneError for what YAML cannot say, as parse_yaml."""
    try:
        text = yaml.dump(value, Dumper=_SceneDumper, sort_keys=False, allow_unicode=True)
    except yaml.representer.RepresenterError as error:
        raise SceneError(
            f"{source}: holds a value of type {type(error.args[1]).__name__}; allowed are numbers, texts, "
            "booleans, None, lists, and mappings of them"
        ) from error
    return parse_yaml(text, source)


def read_document(path: Path, shown: str) -> Document:
    """Read a YAML file that holds a mapping; `shown` is its name in errors."""
    try:
        content = path.read_bytes()
    except FileNotFoundError as error:
        raise SceneError(f"{shown}: no such scene file{_similar_files(path)}") from error
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

    A mapping whose `kind` differs replaces: the keys of another kind would be unknown there. Where `model`
    differs, as of soil, only the bin stays.
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
            if "kind" in value and value["kind"] != beneath.get("kind"):
                beneath = {}
            if "model" in value and value["model"] != beneath.get("model", "dem"):
                beneath = {key: beneath[key] for key in ("bin",) if key in beneath}
            merged[key] = merge(beneath, value, source, here)
        else:
            merged[key] = value
    return merged
