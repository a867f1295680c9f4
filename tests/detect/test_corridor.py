"""The rough path through the corridor: strongly bent lines, gaps, distractions."""

from __future__ import annotations

import numpy as np
import pytest

from vbaa_calib.core.polyline import normals, resample
from vbaa_calib.detect.whisker.centreline import Centreline
from vbaa_calib.detect.whisker.corridor import Corridor, of_antennas_shape

from .drawn_lines import aside, background, bent, exposed, straight, trace, tube

WIDTH_PX = 2.3


def corridor(axis_px: np.ndarray) -> Corridor:
    """What detection allows around a free antenna."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(axis_px, axis=0), axis=1))])
    return Corridor(axis_px, 8.0 + 0.6 * along, WIDTH_PX)


def free(length_px: float = 225.0) -> np.ndarray:
    """(K, 2) the free antenna: straight to the right from (40, 120)."""
    share = np.linspace(0.0, 1.0, 60)[:, None]
    return np.array([40.0, 120.0]) + share * np.array([length_px, 0.0])


@pytest.mark.parametrize("turn_deg", [-45.0, -20.0, 0.0, 30.0, 45.0])
@pytest.mark.parametrize("bright", [True, False, None])
def test_finds_bent_lines(turn_deg: float, bright: bool | None) -> None:
    rng = np.random.default_rng(abs(int(turn_deg)))
    path = bent((40.0, 122.0), 0.0, turn_deg)
    line = tube(path, WIDTH_PX, 80.0)
    # with None glaring at the clamp, darker than its surroundings at the tip
    sign = np.interp(np.arange(line.shape[1]), [40, 130, 150, 265], [1.0, 0.4, -0.4, -1.0]) if bright is None else 1.0
    picture = exposed(background(rng) + 80.0 + (-line if bright is False else sign * line), rng)
    found = trace(picture, corridor(free()), bright)
    inside = found[:, 0] < path[:, 0].max() - 4
    assert inside.sum() > 60
    assert np.abs(aside(path, found[inside])).max() < (3.0 if bright is None else 2.5)


def test_bridges_what_hides_the_antenna() -> None:
    rng = np.random.default_rng(1)
    path = bent((40.0, 120.0), 0.0, 30.0)
    picture = background(rng) + tube(path, WIDTH_PX, 80.0)
    picture[:, 130:165] = 150.0
    found = trace(exposed(picture, rng), corridor(free()))
    seen = (found[:, 0] < 122) | (found[:, 0] > 175)
    inside = seen & (found[:, 0] < path[:, 0].max() - 4)
    assert np.abs(aside(path, found[inside])).max() < 2.5
    assert np.abs(aside(path, found[(found[:, 0] > 130) & (found[:, 0] < 165)])).max() < 12.0


def test_a_brighter_edge_and_a_line_that_does_not_start_at_the_clamp_are_no_lure() -> None:
    rng = np.random.default_rng(2)
    path = bent((40.0, 120.0), 0.0, 15.0)
    picture = background(rng, 2.0) + tube(path, WIDTH_PX, 60.0)
    picture[:60] += 120.0
    picture = picture + tube(np.array([[180.0, 80.0], [260.0, 84.0]]), WIDTH_PX, 90.0)
    found = trace(exposed(picture, rng), corridor(free()))
    inside = found[:, 0] < path[:, 0].max() - 4
    assert np.abs(aside(path, found[inside])).max() < 2.5


def test_a_corridor_that_leaves_the_picture_is_followed_as_far_as_it_goes() -> None:
    rng = np.random.default_rng(3)
    path = straight(0.0, 500.0, (290.0, 120.0))
    found = trace(exposed(background(rng) + tube(path, WIDTH_PX, 80.0), rng), corridor(free(500.0)))
    assert np.isfinite(found).all()
    assert np.abs(aside(path, found[found[:, 0] < 315])).max() < 2.5


def test_resampling_and_normals() -> None:
    points, at = resample(np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 10.0]]), 0.5)
    np.testing.assert_allclose(at, np.arange(0.0, 11.0, 0.5))
    np.testing.assert_allclose(points[10], [3.0, 4.0])
    np.testing.assert_allclose(np.linalg.norm(np.diff(points, axis=0), axis=1), 0.5)
    circle = np.stack([np.cos(np.linspace(0, 1, 50)), np.sin(np.linspace(0, 1, 50))], axis=1)
    np.testing.assert_allclose(normals(circle)[1:-1], -circle[1:-1], atol=1e-9)


@pytest.mark.parametrize("changing", [True, False])
@pytest.mark.parametrize(
    ("passes_px", "turned_rad", "verdict"), [(1.0, 0.0, "ok"), (30.0, 0.0, "no_antenna"), (0.0, 0.3, "no_antenna")]
)
def test_before_the_rig_is_known_a_line_must_leave_the_clamp(
    passes_px: float, turned_rad: float, verdict: str, changing: bool
) -> None:
    """A cable that passes it, or leaves it at an angle, is none, however much of it is seen."""
    points = free() + np.outer(np.linspace(0.0, 225.0, 60) * np.tan(turned_rad) + passes_px, [0.0, 1.0])
    seen = np.zeros(60, np.uint8)
    line = Centreline(points, np.full(60, 0.1), 1.0, 50.0, 1.0, "ok", "", guide_px=points, visibility=seen)
    assert of_antennas_shape(line, corridor(free()), changing).verdict == verdict
