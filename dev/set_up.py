"""Steps of `make setup`, each with one message where it fails.

python -m dev.set_up environment PREFIX    a virtual environment with uv and requirements/run.txt
python -m dev.set_up packages NAME...      lists of requirements/ into the environment that runs this
python -m dev.set_up messages              subsoil_msgs: the wheel in the user's cache, or a new one
python -m dev.set_up subsoil               subsoil_ros itself, editable
python -m dev.set_up kernels               kernels of the first run

Versions are those of requirements/lock.txt. uv installs the lists, with the registries that pip is configured
for; where uv cannot be had, or fails, pip does.
"""

import ast
import fcntl
import hashlib
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).parents[1]
LISTS = ROOT / "requirements"
LOCK = LISTS / "lock.txt"

PIP_OPTIONS = {
    "index-url": "--default-index",
    "extra-index-url": "--index",
    "find-links": "--find-links",
    "constraint": "--constraints",
    "trusted-host": "--allow-insecure-host",
}
"""Settings of pip that may name several places, and what uv calls them."""

PIP_VARIABLES = {"cert": "SSL_CERT_FILE", "proxy": "ALL_PROXY", "timeout": "UV_HTTP_TIMEOUT"}
"""Settings of pip that uv reads from the environment."""


class StepFailedError(Exception):
    """A command of the set-up failed; the message is its most telling line."""


def attempt(command: list[str | Path], environment: Mapping[str, str] | None = None) -> str:
    """Output of a command that must succeed.

    Raises:
        StepFailedError: it failed, or could not be started.
    """
    try:
        done = subprocess.run(
            command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            text=True, errors="replace", check=False,
        )  # fmt: skip
    except OSError as error:
        raise StepFailedError(str(error)) from error
    if done.returncode:
        raise StepFailedError(telling_line(done.stdout) or f"{command[0]} ended with {done.returncode}")
    return done.stdout


def telling_line(output: str) -> str:
    """What a failed command's output says: no registry, a full disk, else the last error."""
    broken = re.search(r"connection broken by '?(\w+)(?:.*(\[Errno -?\d+\] [\w ]+))?", output)
    if broken and "No space left" not in output:
        return f"the registry does not answer ({broken[2] or broken[1]})"
    lines = [line.strip(" \t│╰─▶├\N{MULTIPLICATION SIGN}") for line in output.splitlines() if line.strip()]
    for pattern in (r"No space left", r"fatal error:|\bcaused by:|connect|resolve host", r"error\b", ""):
        found = [line for line in lines if re.search(pattern, line, re.IGNORECASE)]
        if found:
            return found[-1][:300]
    return ""


def settings_of_pip(listing: str) -> dict[str, str]:
    """Settings by name, of what `pip config list` prints; those of its environment variables win."""
    found = re.findall(r"^(global|install|:env:)\.([\w-]+)=(.+)$", listing, re.MULTILINE)
    order = ("global", "install", ":env:")
    by_weight = sorted(found, key=lambda item: order.index(item[0]))
    return {name.removeprefix("default-"): ast.literal_eval(value) for _, name, value in by_weight}


def as_uv(settings: Mapping[str, str]) -> tuple[list[str], dict[str, str]]:
    """Options and environment variables that make uv look where pip would."""
    options = ["--index-strategy", "unsafe-best-match"]  # as pip: the best version of all registries
    for name, option in PIP_OPTIONS.items():
        options += [word for place in settings.get(name, "").split() for word in (option, place)]
    if settings.get("no-index", "").lower() in ("1", "true", "yes", "on"):
        options.append("--no-index")
    return options, {PIP_VARIABLES[name]: settings[name] for name in PIP_VARIABLES if name in settings}


def install(python: Path, *lists: Path, lock: Path = LOCK) -> None:
    """Lists of requirements into the environment of `python`, at the versions of `lock`, one call at a time.

    Raises:
        StepFailedError: neither uv nor pip could install them.
    """
    with (python.parents[1] / "set-up.lock").open("w") as turn:
        fcntl.flock(turn, fcntl.LOCK_EX)
        _install(python, lists, lock)


def _install(python: Path, lists: tuple[Path, ...], lock: Path) -> None:
    pip = [python, "-m", "pip", "--disable-pip-version-check"]
    wanted = [word for path in lists for word in ("-r", path)] + ["-c", lock]
    uv = python.with_name("uv")
    try:
        if not uv.is_file():
            attempt([*pip, "install", "--quiet", "uv", "-c", LOCK])
        options, variables = as_uv(settings_of_pip(attempt([*pip, "config", "list"])))
        attempt(
            [uv, "pip", "install", "--quiet", "--python", python, *options, *wanted],
            {**variables, **os.environ},
        )
    except StepFailedError as error:
        if "No space left" in str(error):
            raise
        print(f"uv does not install the packages ({error}); pip tries, which takes longer.", flush=True)
        attempt([*pip, "install", "--quiet", *wanted])


def environment(prefix: Path) -> None:
    """Make a virtual environment, with what a run and its report need."""
    attempt([sys.executable, "-m", "venv", "--clear", "--without-pip", prefix])
    attempt([prefix / "bin" / "python", "-m", "ensurepip", "--default-pip"])  # venv would hide its errors
    (prefix / "home").mkdir(exist_ok=True)  # it is HOME where the user has none
    install(prefix / "bin" / "python", LISTS / "run.txt")


def packages(*names: str) -> None:
    """Add lists of requirements/ to this environment."""
    install(Path(sys.executable), *(LISTS / f"{name}.txt" for name in names))


def messages() -> None:
    """Install subsoil_msgs from the user's cache; build it there if it is not in it."""
    from subsoil_ros.cache_folders import user_cache_folder

    folder = user_cache_folder() / "messages" / digest_of_messages()
    pip = [Path(sys.executable), "-m", "pip"]
    with tempfile.TemporaryDirectory() as made:
        wheels = sorted(folder.glob("*.whl"))
        if not wheels:
            packages("build")
            prefix = {"AMENT_PREFIX_PATH": sys.prefix, "CMAKE_PREFIX_PATH": sys.prefix}
            build = ["wheel", "--quiet", "--no-build-isolation", "--no-deps", "--wheel-dir", made]
            attempt([*pip, *build, ROOT / "msg_defs"], {**os.environ, **prefix})
            wheels = [keep(wheel, folder) for wheel in Path(made).glob("*.whl")]
        attempt([*pip, "install", "--quiet", "--no-index", "--no-deps", "--force-reinstall", *wheels])


def digest_of_messages() -> str:
    """Digest of everything that the wheel of subsoil_msgs depends on."""
    compiler = next(filter(shutil.which, (os.environ.get("CXX") or "c++", "g++", "clang++")), "")
    digest = hashlib.sha256()
    for path in sorted((ROOT / "msg_defs").rglob("*")):
        if path.is_file():
            digest.update(f"{path.relative_to(ROOT)}\0".encode() + path.read_bytes() + b"\0")
    versions = [line for line in LOCK.read_text().splitlines() if line.startswith(("ros-", "numpy"))]
    built_by = [attempt([compiler, "--version"]), sys.version, platform.machine(), *versions]
    digest.update("\n".join(built_by).encode())
    return digest.hexdigest()[:16]


def keep(wheel: Path, folder: Path) -> Path:
    """Put a wheel into a folder whole or not at all; where it cannot be kept, it stays where it is."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        part = Path(shutil.copy(wheel, folder / f"{wheel.name}.{os.getpid()}"))
        return part.replace(folder / wheel.name)
    except OSError as error:
        print(f"{folder}: the built messages are not kept ({error.strerror}).", flush=True)
        return wheel


def subsoil() -> None:
    """Install subsoil_ros in editable form, with its shared files."""
    words = ["--quiet", "--no-build-isolation", "--no-deps", "--force-reinstall", "--editable", "."]
    attempt([Path(sys.executable), "-m", "pip", "install", *words])


def kernels() -> None:
    """Compile the kernels of the first run."""
    attempt([Path(sys.executable), "-m", "dev.warm_kernels"])


STEPS = {
    "environment": lambda prefix: environment(Path(prefix)),
    "packages": packages,
    "messages": messages,
    "subsoil": subsoil,
    "kernels": kernels,
}


def main() -> int:
    """Exit status: 2 where the step failed."""
    step, *words = sys.argv[1:]
    try:
        STEPS[step](*words)
    except (StepFailedError, OSError) as error:
        print(f"set-up: {' '.join([step, *words])}: {error}", file=sys.stderr)
        print(f"{advice(step, str(error))} Then run make again: it goes on from here.", file=sys.stderr)
        return 2
    return 0


def advice(step: str, said: str) -> str:
    """What to do about a failed step."""
    if "No space left" in said:
        return (
            "Make room: docs/install.md has the size of the environment; caches in the home take as much. "
            "Or name other folders: make VENV=FOLDER; XDG_CACHE_HOME for caches, TMPDIR for temporary files."
        )
    if step in ("environment", "packages"):
        return (
            "Check that the package registry answers (pip download numpy). A mirror: pip config set "
            "global.index-url URL, for uv as well."
        )
    whole = {"kernels": "-m dev.warm_kernels", "messages": "-m pip wheel -v --no-build-isolation ./msg_defs"}
    return f"The whole output: {sys.executable} {whole.get(step, '-m pip install -v -e .')}."


if __name__ == "__main__":
    sys.exit(main())
