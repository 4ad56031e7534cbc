"""A tine set back inside itself: its facets, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from validation.inset_tine import MESHES, main


@pytest.mark.parametrize("name", ["share", "shank"])
def test_every_facet_goes_inside_by_the_length(tmp_path: Path, name: str) -> None:
    """By none: the tine itself."""
    given = trimesh.load_mesh(MESHES / f"{name}.stl")
    for inset_mm in (0, 5):
        main([str(tmp_path), "--inset-mm", str(inset_mm)])
        mesh = trimesh.load_mesh(tmp_path / f"{name}.stl")
        reach = [np.max(given.vertices @ n) - np.max(mesh.vertices @ n) for n in given.face_normals]
        np.testing.assert_allclose(reach, 1e-3 * inset_mm, atol=1e-4)
        assert mesh.is_watertight
        if inset_mm == 0:
            assert mesh.volume == pytest.approx(given.volume, rel=1e-3)


def test_it_becomes_narrower_alone(tmp_path: Path) -> None:
    main([str(tmp_path), "--narrower-mm", "10"])
    given, mesh = trimesh.load_mesh(MESHES / "share.stl"), trimesh.load_mesh(tmp_path / "share.stl")
    np.testing.assert_allclose(given.bounds - mesh.bounds, [[0.0, -0.01, 0.0], [0.0, 0.01, 0.0]], atol=1e-7)


@pytest.mark.parametrize("words", ["--narrower-mm 16", "--inset-mm 50"])
def test_what_leaves_nothing_is_refused(tmp_path: Path, words: str) -> None:
    with pytest.raises(SystemExit, match="leaves nothing of the"):
        main([str(tmp_path), *words.split()])
