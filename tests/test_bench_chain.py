"""The headline benchmark: its wall of error by another route."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.chain.chain import run
from benchmarks.chain.methods import OURS
from benchmarks.chain.scenes import (
    FRICTION_STD_RAD,
    Cell,
    Photograph,
    at_places,
    cell,
    contact_bound,
    drawn,
    equal_information,
    frames_at_information,
    information_of,
    seen_pixels,
)
from benchmarks.estimator.scenes import Touches, push_for_slope, rod_shapes, rolled, scenes
from estimator import ContactEstimator

SIZE = (320, 320)


@pytest.fixture(scope="module")
def pages() -> Cell:
    return cell(SIZE, "exact", 3, 1)


def test_the_bound_is_carried_from_the_columns_to_the_contact(pages: Cell) -> None:
    """Column by column, by where neighbouring touches cross it: no points, no places, no bound of the estimator's."""
    one = pages.photographs[0]
    known, rig = information_of(one), one.truth.rig
    arclength = np.linspace(0.0, rig.antenna.length_m, 800)

    def crossed(touches: Touches) -> np.ndarray:
        pixels = seen_pixels(rig, rod_shapes(rig, touches, arclength).points_m[0])
        return np.interp(known.column, pixels[:, 0], pixels[:, 1])

    lean = np.arctan(np.gradient(crossed(one.truth.touches)))
    table = []
    for name, step in (("distance_m", 1e-4), ("push_y", 1e-5), ("push_z", 1e-5), ("friction_rad", 0.01)):
        either = [_moved(one, name, sign * step) for sign in (1.0, -1.0)]
        aside = (crossed(either[0]) - crossed(either[1])) / (2 * step) * np.cos(lean)
        moments = [rod_shapes(rig, touches, arclength).moment_Nm[0] for touches in either]
        by_moment = (moments[0] - moments[1]) / (2 * step) / rig.moment_sensor.std_Nm
        table.append(np.append(aside * np.sqrt(known.per_px2), by_moment))
    told = np.array(table) @ np.array(table).T + np.diag([0.0, 0.0, 0.0, FRICTION_STD_RAD**-2])
    carried = contact_bound(frames_at_information([one.truth], [known])).std[0, 0]
    assert carried == pytest.approx(np.sqrt(np.linalg.inv(told)[0, 0]), rel=0.02)


def test_a_column_tells_as_much_as_the_light_of_a_neighbouring_touch_differs(pages: Cell) -> None:
    """A little more push, drawn anew: the light's change, freed of level, slope and height, over its noise."""
    one = pages.photographs[0]
    known, rig, step = information_of(one), one.truth.rig, 3e-4
    columns, grey = known.column, one.drawing.light()
    line = (grey - one.drawing.light(antenna=False))[:, columns]
    weight = 1.0 / np.sqrt(one.drawing.variance(grey)[:, columns])
    weight *= np.abs(np.arange(SIZE[1])[:, None] - line.argmax(axis=0)) <= 6
    either = [_moved(one, "push_y", sign * step) for sign in (1.0, -1.0)]
    change = np.subtract(*(drawn(rig, touches).light()[:, columns] for touches in either)) * weight
    arclength = np.linspace(0.0, rig.antenna.length_m, 800)
    points = [seen_pixels(rig, rod_shapes(rig, touches, arclength).points_m[0]) for touches in either]
    aside = np.subtract(*(np.interp(columns, pixels[:, 0], pixels[:, 1]) for pixels in points))
    told = []
    for place, column in enumerate(change.T):
        free = np.stack([np.ones(SIZE[1]), np.linspace(-1.0, 1.0, SIZE[1]), line[:, place]], axis=1)
        free *= weight[:, place, None]
        told.append(np.linalg.norm(column - free @ np.linalg.lstsq(free, column, rcond=None)[0]) / abs(aside[place]))
    half = slice(len(columns) // 2, -6)
    np.testing.assert_allclose(np.median((np.array(told) / np.sqrt(known.per_px2))[half]), 1.0, atol=0.03)


def _moved(one: Photograph, name: str, step: float) -> Touches:
    touches = one.truth.touches
    if name.startswith("push"):
        return replace(touches, push_N=touches.push_N + step * np.array([name == "push_y", name == "push_z"]))
    return replace(touches, **{name: getattr(touches, name) + step})


def test_centrelines_as_good_as_the_picture_allows_are_solved_to_the_bound(pages: Cell) -> None:
    rng, rig = np.random.default_rng(3), pages.rig
    places, sigma_px = equal_information([information_of(one) for one in pages.photographs])
    distance = rng.uniform(0.4, 0.8, 60) * rig.antenna.length_m
    push = push_for_slope(rng.uniform(0.1, 0.2, 60), distance, rig.antenna.stiffness_Nm2)
    friction = np.clip(FRICTION_STD_RAD * rng.normal(size=60), -1.0, 1.0)
    touched = scenes(rig, distance, rolled(push, rng.uniform(-1.0, 1.0, 60)), friction, made_by=rod_shapes)
    clean = at_places(replace(touched, sigma_px=sigma_px), places)
    frames = clean.noisy(rng)
    found = ContactEstimator(rig, friction=FRICTION_STD_RAD).estimate_batch(
        frames.points_px, frames.moment_Nm, frames.pan_rad, frames.tilt_rad, sigma_px=sigma_px
    )
    scaled = (found.distance_m - distance) / contact_bound(clean).std[:, 0]
    assert np.isfinite(scaled).all()
    assert np.sqrt(np.mean(scaled**2)) == pytest.approx(1.0, abs=3 / np.sqrt(120))


@pytest.mark.slow
def test_nobody_is_beyond_the_walls() -> None:
    """Unbiased methods are those that know what bends the antenna; the others may be right by luck, not so often."""
    for row in run(3, 0, quick=True, sizes=(SIZE,)):
        assert row.read_ms < min(row.ms, row.ms_recording)
        if row.family == OURS and row.of_bound is not None:
            assert row.of_bound > 1.0 - 3.0 / np.sqrt(2 * row.pictures * row.answered)
