"""Texts as editors and spreadsheets write them: YAML with tabs, other encodings, CSV of other countries."""

from pathlib import Path

import numpy as np
import pytest

from subsoil_ros.analysis.series import read_table_csv
from subsoil_ros.cli.main import main
from subsoil_ros.errors import InputError, SceneError
from subsoil_ros.yaml_document import parse_yaml


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("a: 0.5\t\nb: 1\n", {"a": 0.5, "b": 1}),
        ("a: 0.5\t# half\nb: 'x\t#y'\n", {"a": 0.5, "b": "x\t#y"}),
        ("a:\t{b: [1,\t2]}\t\t\n", {"a": {"b": [1, 2]}}),
        (b"\xef\xbb\xbfa: 1\r\n", {"a": 1}),
    ],
)
def test_tabs_beside_values_are_blanks(text: str | bytes, value: object) -> None:
    """As YAML has it; a byte order mark is no text."""
    assert parse_yaml(text, "scene.yaml") == value


@pytest.mark.parametrize(("escaped", "shown"), [(r"\0", r"\x00"), (r"\ud83d\ude9c", r"\ud83d")])
def test_what_no_file_name_can_have_is_refused(escaped: str, shown: str) -> None:
    """NUL, and the halves of a character that JSON writes for one beyond U+FFFF."""
    with pytest.raises(SceneError) as refused:
        parse_yaml(f'{{"tools": {{"mesh": "{escaped}"}}}}', "scene.yaml")
    assert f"scene.yaml: tools.mesh: has '{shown}', which no name or file can have" in str(refused.value)


NINE = ",".join(["*a{}"] * 9)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a:\n\tb: 1\n", "scene.yaml:2:1: not valid YAML: found character '\\t'"),
        (b"# first\nname: caf\xe9\n", "scene.yaml:2: byte 0xe9 is not UTF-8 text; save the file as UTF-8"),
        ("a: &a [*a]\n", "nested without end"),
        (
            "a0: &a0 [0]\n" + "".join(f"a{k}: &a{k} [{NINE.format(*[k - 1] * 9)}]\n" for k in range(1, 10)),
            "its aliases make more than 1,000,000 values of it",
        ),
    ],
)
def test_what_is_no_scene_text_is_named_by_its_line(text: str | bytes, words: str) -> None:
    """In one line, at once."""
    with pytest.raises(SceneError) as refused:
        parse_yaml(text, "scene.yaml")
    assert words in str(refused.value)


@pytest.mark.parametrize(
    "text", ["time_s,draft\n0.5,2.25\n", "time_s;draft\n0,5;2,25\n", '# a;b\n"time_s"\t"draft"\n0.5\t2,25\n']
)
def test_csv_of_any_spreadsheet(text: str, tmp_path: Path) -> None:
    """Commas, or semicolons or tabs with decimal commas."""
    path = tmp_path / "table.csv"
    path.write_text(text)
    found = read_table_csv(path)
    assert {name: column.tolist() for name, column in found.items()} == {"time_s": [0.5], "draft": [2.25]}
    assert found["draft"].dtype == np.float64


def test_csv_in_another_encoding_is_named_by_its_line(tmp_path: Path) -> None:
    """The line, not the byte."""
    path = tmp_path / "table.csv"
    path.write_bytes(b"time_s,draft\n0,1\n1,\xe9\n")
    with pytest.raises(InputError, match="line 3 is no text in UTF-8"):
        read_table_csv(path)


def test_a_terminal_of_ascii_gets_what_it_can_show(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """`check` prints boxes and signs that such a terminal has not."""
    with (tmp_path / "out").open("w", encoding="ascii") as stream:
        monkeypatch.setattr("sys.stdout", stream)
        assert main(["check", "tine"]) == 0
    assert "tine" in (tmp_path / "out").read_text(encoding="ascii")
