"""What several unit tests share."""

from pathlib import Path

import pytest

from tests.unit.recording.recording_samples import write_bag


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """A finished bag of a made-up run."""
    return write_bag(tmp_path / "bag")
