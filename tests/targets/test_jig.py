"""What is printed in 3-D: closed, oriented solids of the sizes that were asked for, and the board's pose in them."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import yaml

from targets.jig import _write_jig
from vbaa_calib.session.settings import read_pose

SIZES = {"margin_mm": 5.0, "thickness_mm": 3.0, "wire_mm": 0.8}


def triangles(path: Path) -> np.ndarray:
    """(T, 3, 3) of a binary STL."""
    data = path.read_bytes()
    count = int.from_bytes(data[80:84], "little")
    assert len(data) == 84 + 50 * count
    facets = np.frombuffer(data, np.dtype([("numbers", "<f4", 12), ("more", "<u2")]), count, 84)["numbers"]
    normals, corners = facets[:, :3].astype(float), facets[:, 3:].reshape(-1, 3, 3).astype(float)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    np.testing.assert_allclose(normals, across / np.linalg.norm(across, axis=1, keepdims=True), atol=1e-6)
    return corners


def volume_mm3(corners: np.ndarray) -> float:
    return float(np.einsum("ti,ti->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0)


@pytest.mark.parametrize("squares", [(9, 7), (3, 2)])
def test_solids_are_closed_and_of_the_sizes_asked_for(squares: tuple[int, int], tmp_path: Path) -> None:
    outline = 12.0 * squares[0], 12.0 * squares[1]
    _write_jig(tmp_path, outline, **SIZES)
    parts = {name: triangles(tmp_path / f"{name}.stl") for name in ("jig", "clamp", "cap")}
    for corners in parts.values():
        points = np.round(corners, 4)
        edges = Counter((tuple(face[i]), tuple(face[(i + 1) % 3])) for face in points.tolist() for i in range(3))
        # each edge is passed once in each direction
        assert set(edges.values()) == {1}
        assert all(edges[end, begin] == 1 for begin, end in edges)
        assert volume_mm3(corners) > 0.0
    clamp = parts["clamp"].reshape(-1, 3)
    np.testing.assert_allclose(clamp.min(axis=0), [-16.0, -12.0, -14.0])
    np.testing.assert_allclose(clamp.max(axis=0), [0.0, 12.0, 0.0])
    groove = 16.0 * 0.9 * 0.4
    holes = 2 * 2.5**2 * 14.0
    assert volume_mm3(parts["clamp"]) == pytest.approx(16.0 * 24.0 * 14.0 - groove - holes, rel=1e-5)
    assert volume_mm3(parts["cap"]) == pytest.approx(16.0 * 24.0 * 6.0 - 16.0 * 0.9 * 0.28 - 2 * 2.5**2 * 6.0, rel=1e-5)
    # plate and walls
    assert np.ptp(parts["jig"][..., 0]) == pytest.approx(16.0 + 8.0 + outline[0] + 10.0, abs=1e-4)


def test_the_boards_pose_is_that_of_the_tray(tmp_path: Path) -> None:
    """Its back lies on the floor, its plate against both walls, its face looks to the camera and below the antenna."""
    text = _write_jig(tmp_path, (108.0, 84.0), **SIZES)
    jig = yaml.safe_load(text)["jig"]
    pose = read_pose(jig["T_antenna_board"], "jig.yaml", "jig")
    corners = pose @ (1e-3 * np.array([[0.0, 0.0, 0.0], [108.0, 84.0, 0.0], [0.0, 0.0, -3.0]]))
    points = 1e-3 * triangles(tmp_path / "jig.stl").reshape(-1, 3)
    floor, top = np.unique(np.round(points[:, 2], 7))[[1, 2]]
    assert corners[0, 2] == pytest.approx(floor)
    assert floor < corners[2, 2] < -0.4e-3 < 0.0
    assert top - floor == pytest.approx(3e-3, abs=1e-6)
    assert corners[0, 0] - 5e-3 == pytest.approx(8e-3)
    assert corners[0, 1] + 5e-3 == pytest.approx(np.unique(np.round(points[:, 1], 7))[-2])
    assert corners[0, 1] == pytest.approx(-corners[1, 1])


def test_sizes_that_cannot_be_printed_are_refused(tmp_path: Path) -> None:
    for wrong in ({"wire_mm": 0.1}, {"thickness_mm": 9.0}):
        with pytest.raises(ValueError, match="needed"):
            _write_jig(tmp_path / "none", (108.0, 84.0), **(SIZES | wrong))
    assert not (tmp_path / "none").exists()
