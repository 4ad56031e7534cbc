"""Files that come with the package: scenes, references, meshes, templates, the schema."""

from pathlib import Path

from ..errors import InputError

_PACKAGE = Path(__file__).resolve().parents[1]


def config_folder() -> Path:
    """The folder `config` of the source tree, or that of the installation, in share/subsoil_ros.

    Raises:
        InputError: the package was copied without its data files.
    """
    if (_PACKAGE.parent / "package.xml").is_file():
        return _PACKAGE.parent / "config"
    for prefix in _PACKAGE.parents:  # an installed package stands some folders below its prefix
        found = prefix / "share" / "subsoil_ros" / "config"
        if found.is_dir():
            return found
    raise InputError(
        f"{_PACKAGE}: the files that come with it (share/subsoil_ros) are not there; install the package "
        "with pip or colcon instead of copying it"
    )


def shipped_scene(path: Path) -> Path:
    """Return `path`, or the shipped scene of that name if `path` is a bare name without a file."""
    return _shipped(path, "scenes")


def shipped_reference(path: Path) -> Path:
    """As shipped_scene, for reference files."""
    return _shipped(path, "references")


def shipped_material(path: Path) -> Path:
    """As shipped_scene, for material files."""
    return _shipped(path, "materials")


def shipped_soil(path: Path) -> Path:
    """As shipped_scene, for soils of laboratories."""
    return _shipped(path, "soils")


def material_names() -> list[str]:
    """Names of the shipped materials."""
    return sorted(path.stem for path in (config_folder() / "materials").glob("*.yaml"))


def _shipped(path: Path, kind: str) -> Path:
    if path.is_file() or path.suffix or path.parent != Path():
        return path
    try:
        found = config_folder() / kind / f"{path}.yaml"
    except InputError:
        return path
    return found if found.is_file() else path


def template_names() -> list[str]:
    """Names of the scenes that `subsoil new` writes."""
    return sorted(path.stem for path in (config_folder() / "templates").glob("*.yaml"))
