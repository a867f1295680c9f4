"""Numbers as colours and as words."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from estimator.table.contacts import ContactTable
from viz.scene.colours import UNKNOWN, round_ticks, scale
from viz.scene.facts import drawn_estimate

from .estimates import object_estimate


@pytest.mark.parametrize(
    ("values", "ends"),
    [
        ([20.2, 92.1], (20, 100)),
        ([0.0, 12.1], (0, 14)),
        ([0.0081, 0.0213], (0.008, 0.022)),
        ([5.0, 5.0], (5.0, 5.05)),
        ([0.0, np.nan], (0, 2e-10)),
        ([np.nan], (0, 1)),
    ],
)
def test_scales_end_in_round_numbers_that_hold_all_values(values: list[float], ends: tuple[float, float]) -> None:
    ticks = round_ticks(np.array(values))
    low, high = ticks[0], ticks[-1]
    assert 2 <= len(ticks) <= 11
    np.testing.assert_allclose(np.diff(ticks), np.diff(ticks)[0], rtol=1e-6)
    known = [value for value in values if np.isfinite(value)]
    assert all(low <= value <= high for value in known)
    assert (low, high) == pytest.approx(ends)


def test_colours_run_along_the_scale_and_grey_is_not_known() -> None:
    found = scale(np.array([0.0, 0.5, 1.0, np.nan]), "size", "mm", "plasma")
    hexes = ["#{:02x}{:02x}{:02x}".format(*row) for row in found.rgb]
    assert hexes[0] == found.stops[0]
    assert hexes[2] == found.stops[-1]
    assert tuple(found.rgb[3]) == UNKNOWN


@pytest.mark.parametrize("determined", [True, False])
def test_an_estimate_in_words_and_without_vague_normals(table: ContactTable, determined: bool) -> None:
    estimate = object_estimate(table, determined=determined)
    std = np.where(np.arange(table.located.sum()) % 2, 0.05, 0.8)
    estimate.normals = SimpleNamespace(normal=estimate.surface.touched_normal, std_rad=std)
    estimate.friction.row = np.flatnonzero(table.located)
    estimate.compliance = estimate.surface.compliance
    drawn = drawn_estimate(estimate)
    assert np.isnan(drawn.normals[::2]).all()
    assert np.isfinite(drawn.normals[1::2]).all()
    assert drawn.facts[2] == "One patch was withheld."
    if determined:
        assert drawn.cone_rad == pytest.approx(np.arctan(0.3))
        assert drawn.facts[0].startswith("Friction: μ = 0.300 ± 0.010 (95 %: 0.280 to 0.320)")
        assert drawn.facts[1] == "Stiffness: 250 N/m (95 %: 238 to 263 N/m)."
    else:
        assert drawn.cone_rad is None
        assert drawn.facts[0] == "Friction: Undetermined: it never slid."
        assert drawn.facts[1] == "Stiffness: Undetermined: the force hardly varied."
