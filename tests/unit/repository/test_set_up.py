"""The set-up's script: pip's settings for uv, one line of a failure, whole wheels in the cache."""

from pathlib import Path

import pytest

from dev import set_up

SETTINGS = """global.cert='/etc/ours.pem'
global.extra-index-url='https://one.invalid/simple https://two.invalid/simple'
global.index-url='https://slow.invalid/simple'
:env:.index-url='https://mirror.invalid/simple'
:env:.default-timeout='30'
"""
BROKEN = "WARNING: Retrying (Retry(total=0)) after connection broken by "


def test_uv_looks_where_pip_would():
    """Registries, certificates and time limits; the environment wins over the files, as in pip."""
    options, variables = set_up.as_uv(set_up.settings_of_pip(SETTINGS))
    assert options[2:] == [
        "--default-index", "https://mirror.invalid/simple",
        "--index", "https://one.invalid/simple", "--index", "https://two.invalid/simple",
    ]  # fmt: skip
    assert variables == {"SSL_CERT_FILE": "/etc/ours.pem", "UV_HTTP_TIMEOUT": "30"}


@pytest.mark.parametrize(
    ("output", "said"),
    [
        (
            f"{BROKEN}'NewConnectionError('<x>: [Errno 111] Connection refused')': /uv/\nERROR: no uv",
            "the registry does not answer ([Errno 111] Connection refused)",
        ),
        (
            f"{BROKEN}'ReadTimeoutError(\"Read timed out.\")': /simple/uv/",
            "the registry does not answer (ReadTimeoutError)",
        ),
        (
            "error: Failed to install: vtk\n  Caused by: No space left on device\nmore\n",
            "Caused by: No space",
        ),
        ("a.c:3:1: fatal error: Python.h: No such file\nerror: subprocess-exited", "a.c:3:1: fatal error"),
    ],
    ids=["refused", "silent", "full disk", "compiler"],
)
def test_a_failure_is_one_telling_line(output, said):
    """Of pages of output, the line that names the cause."""
    assert set_up.telling_line(output).startswith(said)


def test_a_failed_step_says_what_to_do(monkeypatch, capsys):
    """Exit 2, the cause, the remedy, and that make goes on."""

    def full(*_: str) -> None:
        raise set_up.StepFailedError("No space left on device")

    monkeypatch.setitem(set_up.STEPS, "packages", full)
    monkeypatch.setattr("sys.argv", ["set_up", "packages", "run"])
    assert set_up.main() == 2
    said = capsys.readouterr().err
    assert "packages run: No space left on device" in said
    assert "make VENV=FOLDER" in said
    assert "run make again" in said


def test_a_wheel_is_kept_whole_or_stays_where_it_is(tmp_path, capsys):
    """The cache gets the file under its name at once; a cache that cannot be written costs a line."""
    wheel = tmp_path / "made.whl"
    wheel.write_bytes(b"wheel")
    assert set_up.keep(wheel, tmp_path / "cache") == tmp_path / "cache" / "made.whl"
    assert [path.name for path in (tmp_path / "cache").iterdir()] == ["made.whl"]
    assert set_up.keep(wheel, Path("/proc/none")) == wheel
    assert "not kept" in capsys.readouterr().out
