"""The marks and axes that plots are made of."""

from __future__ import annotations

import re

import numpy as np
import pytest

from viz.plots.marks import bars, ellipses
from viz.plots.svg import Axes, runs, ticks
from viz.report.map import spread_out


def test_an_ellipse_turns_with_its_covariance() -> None:
    axes = Axes((0.0, 1.0), (0.0, 1.0), 500.0, 500.0, 0.0, 0.0, 0.0, 0.0)
    up = np.array([1.0, 1.0]) / np.sqrt(2)
    drawn = ellipses(axes, np.array([[0.5, 0.5]]), (1e-2 * np.outer(up, up) + 1e-6 * np.eye(2))[None], ["#000"])
    degrees = float(re.findall(r"rotate\(([-\d.]+)\)", drawn)[0]) % 180
    assert degrees == pytest.approx(135.0, abs=0.5)  # up to the right: rows count downward
    assert float(re.findall(r'rx="([\d.]+)"', drawn)[0]) == pytest.approx(2 * 0.1 * 500, rel=0.01)


def test_bars_are_cut_at_the_edge() -> None:
    axes = Axes((0.0, 1.0), (0.0, 1.0))
    path = bars(axes, np.array([0.5]), np.array([-1e9]), np.array([1e9]), "#000")
    ends = [float(end) for end in re.findall(r"M[\d.]+ ([\d.]+)V([\d.]+)", path)[0]]
    assert sorted(ends) == [axes.top, axes.height - axes.bottom]


@pytest.mark.parametrize(("number", "most"), [(0, 5), (1, 5), (5, 5), (50_000, 300)])
def test_spreading_keeps_both_ends(number: int, most: int) -> None:
    found = spread_out(number, most)
    assert len(found) == min(number, most)
    assert found.tolist() == sorted(set(found.tolist()))
    if number:
        assert (found[0], found[-1]) == (0, number - 1)


@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (-3e-4, 8e-4), (144.0, 168.0), (-75.0, 71.0)])
def test_ticks_are_round_and_inside(low: float, high: float) -> None:
    found = ticks(low, high)
    assert 2 <= len(found) <= 7
    assert min(found) >= low - 1e-12
    assert max(found) <= high + 1e-12
    assert all(float(f"{tick:.2g}") == pytest.approx(tick, abs=1e-12) for tick in np.diff(found))


def test_runs_are_the_unbroken_stretches() -> None:
    assert [run.tolist() for run in runs(np.array([1, 1, 0, 1, 0, 0, 1], bool))] == [[0, 1], [3], [6]]
    assert runs(np.zeros(3, bool)) == []
