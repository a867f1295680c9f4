"""The upright camera's two-point formulas: exact on noise-free scenes, honest about where they are not."""

from __future__ import annotations

import numpy as np
import pytest

from estimator.paper import two_point
from estimator.paper.two_point import Part, two_point_contact
from vbaa_calib.antenna import linear

EI, LENGTH = 3.9e-3, 0.24


def scenes(count: int, seed: int, parts: tuple[Part, ...] = (Part.CURVED, Part.STRAIGHT, Part.MIXED)):
    """Points (n, 2), deflections, contact, force and true part, of random noise-free scenes."""
    rng = np.random.default_rng(seed)
    contact = rng.uniform(0.02, 1.0, 8 * count) * LENGTH
    x = np.sort(rng.uniform(0.005, 1.0, (8 * count, 2)), axis=1) * LENGTH
    force = rng.normal(size=8 * count)
    part = np.where(contact >= x[:, 1], Part.CURVED, np.where(contact <= x[:, 0], Part.STRAIGHT, Part.MIXED))
    chosen = np.flatnonzero(np.isin(part, parts))[:count]
    x, contact, force, part = x[chosen], contact[chosen], force[chosen], part[chosen]
    return x, linear.deflection(x, contact[:, None], force[:, None], EI), contact, force, part


def test_random_scenes_to_a_billionth() -> None:
    x, y, contact, force, part = scenes(200_000, 1)
    found = two_point_contact(x, y, EI, 1.1 * LENGTH)
    np.testing.assert_array_equal(found.part, part)
    away = found.condition_contact < 1e5
    assert away.mean() > 0.999
    assert np.abs(found.contact_m / contact - 1.0)[away].max() < 1e-9
    assert np.abs(found.force_y_N / force - 1.0)[away].max() < 1e-9


@pytest.mark.parametrize(
    "border", ["l → x1", "l → x2", "l → 0", "l → ∞", "l = L", "coincident", "coincident, l between", "x1 → 0"]
)
def test_near_the_singular_sets_the_error_is_what_conditioning_predicts(border: str) -> None:
    """Points drawn from a tenth to 1e-15 (relative) off a border: within 100 roundings × condition."""
    count, rng = 50_000, np.random.default_rng(2)
    near, side = 10.0 ** rng.uniform(-15, -1, count), rng.choice([-1.0, 1.0], count)
    x = np.sort(rng.uniform(0.02, 1.0, (count, 2)), axis=1) * LENGTH
    if border.startswith("coincident"):
        x[:, 1] = x[:, 0] * (1.0 + near)
    elif border == "x1 → 0":
        x[:, 0] = x[:, 1] * near
    contact = {
        "l → x1": x[:, 0] * (1.0 + side * near),
        "l → x2": x[:, 1] * (1.0 + side * near),
        "l → 0": x[:, 0] * near,
        "l → ∞": x[:, 1] / near,
        "l = L": np.full(count, LENGTH),
        "coincident": 10.0 ** rng.uniform(-3, 1, count),
        "coincident, l between": x[:, 0] + rng.uniform(0, 1, count) * (x[:, 1] - x[:, 0]),
        "x1 → 0": x[:, 1] * 10.0 ** rng.uniform(-15, 1, count),
    }[border]
    force = rng.normal(size=count)
    y = linear.deflection(x, contact[:, None], force[:, None], EI)
    found = two_point_contact(x, y, EI, LENGTH if border == "l = L" else np.inf)
    limit = 100.0 * np.finfo(float).eps
    with np.errstate(divide="ignore"):
        true_condition = two_point._conditions(*(two_point.elasticity(x[:, k], contact) for k in (0, 1)))[0]
    trusted = limit * true_condition < 1e-2
    assert trusted.mean() > 0.6
    assert (found.part[trusted] != Part.NONE).all()
    np.testing.assert_allclose(found.condition_contact[trusted], true_condition[trusted], rtol=1e-2)
    error, force_error = np.abs(found.contact_m / contact - 1.0), np.abs(found.force_y_N / force - 1.0)
    assert (error <= limit * (1.0 + found.condition_contact))[trusted].all()
    assert (force_error <= limit * (1.0 + found.condition_force))[trusted].all()


@pytest.mark.parametrize("part", [Part.CURVED, Part.STRAIGHT, Part.MIXED])
def test_condition_numbers_against_perturbation(part: Part) -> None:
    x, y, *_ = scenes(200, 6, (part,))
    found = two_point_contact(x, y, EI)
    step = 1e-7
    swing_contact, swing_force = np.zeros((2, 200))
    for point in (0, 1):
        nudge = np.ones(2)
        nudge[point] += step
        up = two_point_contact(x, y * nudge, EI)
        down = two_point_contact(x, y / nudge, EI)
        swing_contact += np.abs(up.contact_m - down.contact_m) / (2 * step * found.contact_m)
        swing_force += np.abs((up.force_y_N - down.force_y_N) / (2 * step * found.force_y_N))
    # beside a case's border one of the two nudges lands in the next case, whose derivative differs
    smooth = (found.condition_contact < 1e3) & ~np.isnan(swing_contact)
    assert smooth.sum() > 100
    np.testing.assert_allclose(swing_contact[smooth], found.condition_contact[smooth], rtol=2e-3)
    np.testing.assert_allclose(swing_force[smooth], found.condition_force[smooth], rtol=2e-3)


@pytest.mark.parametrize(
    ("x", "y"),
    [
        ((0.1, 0.1), (0.001, 0.002)),  # one position, two deflections
        ((0.1, 0.2), (0.001, -0.002)),  # bent both ways
        ((0.1, 0.2), (0.0, 0.0)),  # no load
        ((0.1, 0.2), (0.001, 0.002)),  # straight through the clamp: l → 0
        ((0.1, 0.2), (0.001, 0.0019)),  # bent back
        ((0.1, 0.2), (0.001, 0.0041)),  # more than any point load can
        ((-0.1, 0.2), (0.001, 0.003)),
        ((0.1, 0.2), (np.nan, 0.003)),
        ((np.inf, 0.2), (0.001, 0.003)),
        ((0.05, 0.1), tuple(linear.deflection(np.array([0.05, 0.1]), 0.3, 0.1, EI))),  # beyond the tip
    ],
)
def test_no_admissible_contact_is_nan(x: tuple[float, float], y: tuple[float, float]) -> None:
    with np.errstate(all="raise"):
        found = two_point_contact(x, y, EI, LENGTH)
    assert found.part == Part.NONE
    for value in (found.contact_m, found.force_y_N, found.condition_contact, found.condition_force):
        assert np.isnan(value)


def test_force_z_and_contact_position() -> None:
    """Eqs. (16) and (20): the moment sensor's component, and the beam's own point at the contact."""
    contact, f_y, f_z = 0.16, 0.2, -0.3
    moment = contact * f_z
    assert two_point.force_z(moment, contact) == pytest.approx(f_z)
    expected = [contact, linear.deflection(contact, contact, f_y, EI), linear.deflection(contact, contact, f_z, EI)]
    np.testing.assert_allclose(two_point.contact_position(contact, f_y, f_z, EI), expected, rtol=1e-14)
    assert np.isnan(two_point.force_z(moment, [0.0, -0.1, np.nan])).all()
    assert two_point.contact_position(np.full((4, 5), contact), f_y, np.full(5, f_z), EI).shape == (4, 5, 3)
