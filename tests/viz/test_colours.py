"""Numbers as colours and as words."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator.table.contacts import ContactTable
from viz.scene.colours import MODES, UNKNOWN, contact_scale, round_ticks, scale
from viz.scene.object_items import touch_of
from viz.scene.scene import build_scene

from .felt import felt as made_up


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


def test_each_way_to_colour_has_its_numbers(table: ContactTable) -> None:
    scene = build_scene(table)
    ends = {mode: (found.low, found.high, found.unit) for mode in MODES for found in [contact_scale(scene, mode)]}
    assert ends["force"] == (20, 80, "mN")
    assert ends["time"] == (0, 3, "s")
    assert ends["uncertainty"][0] <= 0.4 <= ends["uncertainty"][1]


def findings(table: ContactTable, *, told: bool) -> Any:
    """Made-up findings, with what they say of normals: every other one is vague."""
    felt = made_up(table, told=told)
    row = np.flatnonzero(table.located)
    std = np.where(np.arange(len(row)) % 2, 0.05, 0.8)
    felt.normals = SimpleNamespace(normal=felt.surface.touched_normal, std_rad=std)
    felt.friction.row = row
    felt.compliance = felt.surface.compliance
    return felt


def test_what_was_felt_is_said_and_vague_normals_are_left_out(table: ContactTable) -> None:
    touch = touch_of(findings(table, told=True))
    assert touch.cone_rad == pytest.approx(np.arctan(0.3))
    assert touch.facts[0] == "Friction: μ = 0.300 ± 0.010 (95 %: 0.280 to 0.320)."
    assert touch.facts[1] == "The object's stiffness: 250 N/m (95 %: 238 to 263 N/m)."
    assert touch.facts[2] == "One patch was left out."
    assert np.isnan(touch.normals[::2]).all()
    assert np.isfinite(touch.normals[1::2]).all()


def test_what_cannot_be_told_has_its_reason_and_no_cone(table: ContactTable) -> None:
    touch = touch_of(findings(table, told=False))
    assert touch.cone_rad is None
    assert touch.facts[0].startswith("Friction cannot be told: It never slid.")
    assert touch.facts[1] == "The force hardly varied."
