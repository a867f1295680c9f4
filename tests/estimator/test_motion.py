"""A swinging antenna bends under its own inertia: how much of it is told, and that rest is not taken for motion."""

from __future__ import annotations

import numpy as np
import pytest

from estimator.contact.motion import PIECES, Beam, Inertia, Motion, Shapes
from estimator.contact.motion import _inertia as inertia
from vbaa_calib.antenna.linear import deflection

from .vibrations import DENSITY, EI, LENGTH, frequency_rad_s, mode_shape, modes, shaken

BEAM = Beam(LENGTH, EI, DENSITY)
S = np.linspace(0.02, 1.0, 80) * LENGTH
STD_M = 4e-6


def swinging(time_s: np.ndarray, across_m: np.ndarray, contact: float = np.nan, std_m: float = STD_M) -> Shapes:
    """Frames of a straight antenna along x with a deflection (B, G) along z."""
    points = np.zeros((len(time_s), PIECES, 3))
    points[..., 0] = BEAM.pieces_m
    points[..., 2] = across_m
    return Shapes(time_s, points, np.full((len(time_s), 1), std_m), np.full(len(time_s), contact))


def deflection_by_load(load_N_m: np.ndarray, at_m: np.ndarray) -> np.ndarray:
    """(..., N, 3) small deflection at arc lengths (N,) of the clamped antenna under a load (..., G, 3) N/m."""
    by_piece = deflection(at_m[:, None], BEAM.pieces_m, 1.0, EI)
    across = by_piece @ load_N_m[..., 1:] * (LENGTH / PIECES)
    return np.concatenate([0.0 * across[..., :1], across], axis=-1)


def times(rate_hz: float, count: int, rng: np.random.Generator, jitter: float = 0.0) -> np.ndarray:
    return (np.arange(count) + jitter * rng.uniform(-0.5, 0.5, count)) / rate_hz


def same(one: Inertia, other: Inertia, atol: float = 0.0) -> None:
    for name, value in vars(one).items():
        np.testing.assert_allclose(np.asarray(getattr(other, name)), np.asarray(value), rtol=1e-9, atol=atol)


@pytest.mark.parametrize("contact", [0.0, 0.03, 0.1, 0.4, 0.78, 0.93, 1.0])
def test_first_mode(contact: float) -> None:
    wave = modes(contact, 1)[0][0]
    assert BEAM.first_mode_rad_s(np.array(contact)) == pytest.approx(frequency_rad_s(wave), rel=2e-3)
    assert BEAM.first_mode_rad_s(np.array(np.nan)) == pytest.approx(2 * np.pi * 9.628, rel=1e-3)


@pytest.mark.parametrize("rate_hz", [30.0, 60.0, 240.0, 1000.0])
def test_a_free_antenna_rings(rate_hz: float) -> None:
    """In its first mode inertia is all that bends it: the predicted deflection is the one seen, times the response."""
    (wave,), (coefficients,) = modes(0.0, 1)
    time = times(rate_hz, int(0.6 * rate_hz) + 5, np.random.default_rng(1), 0.1)
    swing = 2e-3 * np.cos(frequency_rad_s(wave) * time + 0.4)
    verdict = inertia(swinging(time, swing[:, None] * mode_shape(BEAM.pieces_m, 0.0, wave, coefficients)), BEAM)
    bent = deflection_by_load(verdict.load_N_m, S)
    true = swing[:, None] * mode_shape(S, 0.0, wave, coefficients)
    whole = slice(int(0.03 * rate_hz) + 1, -int(0.03 * rate_hz) - 1)
    told = bent[whole, :, 2] / verdict.response[whole, None]
    assert np.abs(told - true[whole]).max() < {30.0: 0.12, 60.0: 0.06}.get(rate_hz, 0.04) * 2e-3
    assert np.abs(bent[whole, :, :2]).max() < 1e-15
    assert verdict.significant[whole][np.abs(swing[whole]) > 1e-4].all()
    expected = {30.0: 0.70, 60.0: 0.92}.get(rate_hz, 0.84)
    assert verdict.response[whole].mean() == pytest.approx(expected, abs=0.02)


def contact_fit(across_m: np.ndarray, contact_m: float, force_N: float) -> np.ndarray:
    """(2,) distance and force of the least-squares static beam through a shape (N,), from a start nearby."""
    unknowns = np.array([contact_m, force_N])
    for _ in range(30):
        slopes = by_contact(unknowns[0], unknowns[1])
        misfit = across_m - deflection(S, unknowns[0], unknowns[1], EI)
        unknowns = unknowns + np.linalg.lstsq(slopes, misfit, rcond=None)[0]
    return unknowns


def by_contact(contact_m: float, force_N: float) -> np.ndarray:
    """(N, 2) change of the static beam's shape with distance and force."""
    step = 1e-6
    by_distance = deflection(S, contact_m + step, force_N, EI) - deflection(S, contact_m - step, force_N, EI)
    return np.stack([by_distance / (2 * step), deflection(S, contact_m, 1.0, EI)], axis=1)


@pytest.mark.parametrize(("contact", "rate_hz"), [(0.3, 240.0), pytest.param(0.7, 1000.0, marks=pytest.mark.slow)])
def test_ringing_on_a_contact_moves_it_as_predicted(contact: float, rate_hz: float) -> None:
    force = 0.01 * 3 * EI / (contact * LENGTH) ** 3
    (wave,), (coefficients,) = modes(contact, 1)
    time = times(rate_hz, int(0.3 * rate_hz), np.random.default_rng(2), 0.1)
    swing = 4e-5 * np.cos(frequency_rad_s(wave) * time)

    def shape(s_m: np.ndarray) -> np.ndarray:
        static = deflection(s_m, contact * LENGTH, force, EI)
        return static + swing[:, None] * mode_shape(s_m, contact, wave, coefficients)

    verdict = inertia(swinging(time, shape(BEAM.pieces_m), contact), BEAM)
    bent = deflection_by_load(verdict.load_N_m, S)[..., 2]
    predicted = np.linalg.lstsq(by_contact(contact * LENGTH, force), bent.T, rcond=None)[0][0] / verdict.response
    made = np.array([contact_fit(frame, contact * LENGTH, force)[0] for frame in shape(S)]) - contact * LENGTH
    judged = np.isfinite(predicted)
    judged[: int(0.02 * rate_hz) + 1] = judged[-int(0.02 * rate_hz) - 1 :] = False
    assert judged.sum() > 0.2 * rate_hz
    assert np.abs(made).max() > 1e-4
    assert np.abs(predicted - made)[judged].max() < 0.06 * np.abs(made).max()


def test_a_shaken_base_bends_the_antenna() -> None:
    omega = 2 * np.pi * 4.0
    time = np.arange(120) / 240.0
    swing = 0.01 * np.sin(omega * time)
    verdict = inertia(swinging(time, swing[:, None] * (1.0 + shaken(BEAM.pieces_m, omega))), BEAM)
    bent = deflection_by_load(verdict.load_N_m, S)[..., 2]
    true = swing[:, None] * shaken(S, omega)
    middle = slice(10, -10)
    assert np.abs(true[middle]).max() > 1e-3
    assert np.abs(bent - true)[middle].max() < 0.05 * np.abs(true).max()


@pytest.mark.parametrize("rate_hz", [30.0, 240.0])
def test_rest_is_not_taken_for_motion(rate_hz: float) -> None:
    """Noise in distance, force and direction bends the whole shape; it hardly ever looks like inertia."""
    rng, count = np.random.default_rng(3), 20_000
    slopes = (BEAM.pieces_m / LENGTH)[:, None] ** [1, 2]  # of the shape, and its curvature near the clamp
    slopes /= np.linalg.norm(slopes, axis=1).max()
    time = times(rate_hz, count, rng, 0.2)
    shapes = swinging(time, 0.3 * time[:, None] + STD_M * rng.normal(size=(count, 2)) @ slopes.T)
    shapes.points_m[..., 1] += STD_M * rng.normal(size=(count, 1)) * slopes[:, 1]
    verdict = inertia(shapes, BEAM)
    assert np.isfinite(verdict.load_N_m[1:-1]).all()
    assert verdict.significant.sum() <= 1e-4 * count
    tip = verdict.load_N_m[1:-1, -1, 2] / verdict.load_std_N_m[1:-1, -1, 2]
    assert tip.std() == pytest.approx(1.0, abs=0.1)


def random_recording(count: int) -> Shapes:
    rng = np.random.default_rng(5)
    time = np.cumsum(rng.choice([0.004, 0.01, 0.03, 0.07], count, p=[0.5, 0.2, 0.25, 0.05]))
    time[rng.integers(count, size=6)] = np.nan
    shapes = swinging(time, rng.normal(0.0, 1e-3, (count, PIECES)))
    contact = rng.choice([np.nan, 0.4, 0.8], count)
    return Shapes(shapes.time_s, shapes.points_m, shapes.std_m, contact)


@pytest.mark.parametrize("part", [1, 7, 300])
def test_in_parts_as_at_once(part: int) -> None:
    shapes, judge = random_recording(300), Motion(BEAM)
    parts = [judge.push(shapes.picked(slice(at, at + part))) for at in range(0, 300, part)]
    last = judge.finish()
    assert last is not None
    together = Inertia(*(np.concatenate([vars(v)[name] for v in [*parts, last]]) for name in vars(last)))
    same(inertia(shapes, BEAM), together)
    assert len(judge.push(shapes.picked(slice(0, 1))).response) <= 1
