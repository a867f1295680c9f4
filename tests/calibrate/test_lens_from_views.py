"""A few views that contradict the others are left out and named; where many do, or the zoom was changed, it is said."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from targets.board import corner_points
from vbaa_calib.calibrate.from_corners import calibrate_lens
from vbaa_calib.calibrate.lens.intrinsics import LensSolution
from vbaa_calib.calibrate.lens_from_views import solve_lens
from vbaa_calib.detect.board.corners import BoardView

from .photo_sets import detected
from .synthetic_views import SPEC, board_view, pose_towards, projection
from .test_diagnose_views import INTRINSICS, SIZE, pictures


def solved(views: list[BoardView]) -> LensSolution:
    """From corners, as other programs ask for it; names are view 000000, view 000001, …"""
    return calibrate_lens([(view.ids, view.corners_px) for view in views], SIZE, corner_points(SPEC), "opencv4")


def with_a_wrong_view(fault: str, count: int, seed: int) -> tuple[list[BoardView], int]:
    """Views of which one is wrong, and its index."""
    rng = np.random.default_rng(seed + 1000)
    at, focal = int(rng.integers(count)), np.ones(count)
    focal[at] = {"zoom": 1.3, "focus": 1.05}.get(fault, 1.0)
    views = pictures(seed, focal, sigma_px=0.2 if seed % 2 else 0.05)
    wrong = views[at]
    ids, corners = wrong.ids, wrong.corners_px
    match fault:
        case "blurred":
            corners = corners + 1.5 * rng.normal(size=corners.shape)
        case "moved":  # a rolling shutter shears it
            corners = corners + 0.02 * (corners[:, 1:] - 360.0) * (1.0, 0.0)
        case "few":
            picked = np.sort(rng.choice(len(ids), 8, replace=False))
            ids, corners = ids[picked], corners[picked] + 4.0 * rng.normal(size=(8, 2))
        case "misread":  # as in a row of the board in its mirror image
            order = np.argsort(ids // 8 * 8 + 7 - ids % 8, kind="stable")
            ids, corners = np.sort(ids // 8 * 8 + 7 - ids % 8), corners[order]
        case "camera":
            other = np.array([0.7, 0.7, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0]) * INTRINSICS
            other += (0, 0, 60.0, -30.0, 0.1, -0.1, 0.0, 0.0)
            pixels = projection("opencv", corner_points(SPEC), pose_towards(rng, 0.13, 0.8).vector, other)[0]
            elsewhere = board_view(wrong.name, pixels, SIZE, rng, 0.1)
            ids, corners = elsewhere.ids, elsewhere.corners_px
    views[at] = dataclasses.replace(wrong, ids=ids, corners_px=corners)
    return views, at


@pytest.mark.parametrize(
    ("fault", "count"),
    [
        *((fault, 12) for fault in ("zoom", "focus", "blurred", "moved", "few", "camera")),
        *(("few", count) for count in (6, 30)),
        *(
            pytest.param(fault, count, marks=pytest.mark.slow)
            for fault in ("zoom", "blurred", "camera")
            for count in (6, 30)
        ),
    ],
)
def test_a_view_that_contradicts_the_others_is_left_out_and_named(fault: str, count: int) -> None:
    """Whatever is wrong with it; the verdict is about the lens that remains."""
    right = 0
    for seed in (0, 1, 2):
        views, at = with_a_wrong_view(fault, count, seed)
        solution = solved(views)
        names = [view.name for view in solution.dropped]
        assert set(names) <= {f"view {at:06d}"}
        assert solution.grade == ("trusted" if count > 6 else "look at")
        off = solution.camera.parameters[0] - INTRINSICS[0]
        assert abs(off) < 4.0 * np.sqrt(solution.camera.covariance[0, 0])
        if names:
            right += 1
            assert solution.outliers[at].tolist() == views[at].ids.tolist()
            assert sum(map(len, solution.outliers)) < len(views[at].ids) + 3
            assert [view.name for view in solution.views] == [f"view {k:06d}" for k in range(count) if k != at]
    assert right >= (3 if count == 30 else 2)


@pytest.mark.parametrize(
    ("count", "first", "last", "by"),
    [(12, 6, 12, 1.05), (12, 9, 12, 1.3), (12, 10, 12, 1.3), (12, 0, 2, 0.7), (30, 15, 30, 1.3), (30, 22, 30, 0.7)],
)
def test_a_change_of_zoom_stays_wrong(count: int, first: int, last: int, by: float) -> None:
    """However large it is, and though the views after it are few."""
    for seed in (0, 1):
        views = pictures(seed, np.where((np.arange(count) >= first) & (np.arange(count) < last), by, 1.0))
        solution = solved(views)
        assert solution.grade == "do not use"
        assert solution.verdict.findings[0].name in ("focus_changed", "odd_view", "centre_moved")


@pytest.mark.parametrize("sigma_px", [0.05, 0.3])
def test_of_clean_views_none_is_left_out(sigma_px: float) -> None:
    for seed in range(6):
        for count in (5, 6, 12):
            solution = solved(pictures(200 + seed, np.ones(count), sigma_px=sigma_px))
            assert not solution.dropped
            assert solution.grade != "do not use"


@pytest.mark.slow
def test_one_bad_photograph_does_not_condemn_the_lens() -> None:
    views, spec = detected("ucl_left")
    solution = solve_lens(views, spec)
    assert "Frame_010.jpg" in {view.name for view in solution.dropped}
    assert len(solution.views) == 48
    assert solution.trusted
    assert solution.camera.parameters[:2] == pytest.approx((832.45, 908.30), abs=1.0)
