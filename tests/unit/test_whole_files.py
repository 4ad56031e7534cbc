"""A file is whole or not there, whatever ends its writer."""

from pathlib import Path

import pytest

from subsoil_ros.whole_files import write_whole


def test_an_interrupt_leaves_the_file_as_it_was(tmp_path: Path) -> None:
    """Nor is a part of the new one left."""
    path = tmp_path / "series.csv"
    path.write_text("whole")

    def interrupted(part: Path) -> None:
        part.write_text("ha")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_whole(path, interrupted)
    assert path.read_text() == "whole"
    assert list(tmp_path.iterdir()) == [path]
