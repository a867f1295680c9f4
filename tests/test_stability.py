"""Inputs moved by 1e-12 of themselves, and in another order, move no answer: rounding decides nothing.

Lenses from corners and contacts from centrelines: no reported number by more than `MOST` of its deviation, and no
status. A short form here; all lens models and photo sets among the slow tests.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.estimator.hard import CASES
from benchmarks.estimator.scenes import Scenes
from benchmarks.processors import Report, apart, of_contacts, of_lens
from estimator import ContactEstimator
from vbaa_calib.calibrate.lens.intrinsics import solve_intrinsics
from vbaa_calib.calibrate.lens.models import LENS_MODELS
from vbaa_calib.detect.board.corners import BoardView

from .calibrate.photo_sets import detected

MOVED, MOST, MOST_OF_LENS = 1e-12, 1e-4, 1e-6
"""Part of themselves by which the inputs are moved, and part of its deviation by which a number may move."""
Rng = np.random.Generator


def moved(values: np.ndarray, rng: Rng) -> np.ndarray:
    return values * (1.0 + MOVED * rng.uniform(-1.0, 1.0, np.shape(values)))


def held(one: Report, other: Report, most: float = MOST) -> None:
    found = apart(one, other)
    assert found.statuses == []
    assert found.most <= most, f"{found.most:.1e} at {found.where}"


# corners to lens


def moved_view(view: BoardView, rng: Rng) -> BoardView:
    """Every corner moved by nothing, and all of them in another order."""
    order = rng.permutation(len(view.ids))
    return replace(view.picked(order), corners_px=moved(view.corners_px, rng)[order])


LENSES = [
    ("gopro", "auto"),
    ("gopro", "rational"),
    *(
        pytest.param(name, model, marks=pytest.mark.slow)
        for name in ("realsense", "gopro", "ucl_left", "ucl_right")
        for model in ("auto", *LENS_MODELS)
        if (name, model) not in {("gopro", "auto"), ("gopro", "rational")}
    ),
]


@pytest.mark.parametrize(("name", "model"), LENSES)
def test_lenses_of_real_photographs(name: str, model: str) -> None:
    views, spec = detected(name)
    least = 20 if spec.legacy_pattern else 6
    one = of_lens(solve_intrinsics(views, spec, model, least))
    for seed in range(2):
        rng = np.random.default_rng(seed)
        order = rng.permutation(len(views))
        others = [moved_view(views[index], rng) for index in order]
        held(one, of_lens(solve_intrinsics(others, spec, model, least)), MOST_OF_LENS)


# centrelines to contacts


def estimated(frames: Scenes, order: Sequence[int], points: Callable[[int], np.ndarray], rng: Rng) -> Report:
    """Frames in an order, points of each as `points` picks them, all of it moved by nothing; reported as they came."""
    lines = [moved(np.asarray(frames.points_px[index], float)[points(index)], rng) for index in order]
    joints = frames.pan_rad[order], frames.tilt_rad[order]
    found = ContactEstimator(frames.rig).estimate_batch(
        lines, moved(frames.moment_Nm, rng)[order], *joints, sigma_px=frames.sigma_px
    )
    back = np.argsort(order)
    report = of_contacts(found)
    numbers = {name: (values[back], std[back]) for name, (values, std) in report.numbers.items()}
    return Report(numbers, {"status": [report.statuses["status"][index] for index in back]})


@pytest.mark.parametrize("count", [4, pytest.param(60, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", CASES)
def test_hard_cases_of_the_estimator(name: str, count: int) -> None:
    """Pixels and readings moved by nothing, points and frames in another order."""
    frames = CASES[name](count, np.random.default_rng(7))
    size, rng = frames.points_px.shape[1], np.random.default_rng(4)
    one = estimated(frames, np.arange(count), lambda _: np.arange(size), rng)
    held(one, estimated(frames, rng.permutation(count), lambda _: rng.permutation(size), rng))
