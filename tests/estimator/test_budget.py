"""The error budget: its parts against the estimator's own deviations, against what it really does, and sampled."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from benchmarks.estimator.scenes import Scenes, Shapes, ShapesOf, scenes
from benchmarks.estimator.scenes import Touches as SeenTouches
from benchmarks.estimator.setup import ACROSS, RIG_STD, Setup
from estimator import ContactEstimator
from estimator.budget.budget import (
    RIG_CAUSES,
    BudgetContacts,
    _ErrorSpace,
    _Linearization,
    _linearize,
    _propagate,
    _split,
    _subsets,
    _variance,
    _variance_by_cause,
)
from estimator.contact.settings import ContactSettings
from estimator.solver.rig_arrays import RigArrays
from vbaa_calib.antenna.rungs import curves
from vbaa_calib.antenna.shape import CONTACT
from vbaa_calib.geometry import Kinematics
from vbaa_calib.geometry.covariance import independent_axes
from vbaa_calib.rig import RIG_PARAMETERS, Rig

LENS_STD = np.array([0.2, 0.2, 0.25, 0.25, 6e-4, 2e-3, 5e-5, 5e-5])
RIGID = RIG_STD * (np.array(RIG_PARAMETERS) != "clamp_give_m")
"""The simulated clamps are rigid."""
SIGMA_PX, POINTS, FRICTION_RAD = 0.05, 360, 0.1


def correlated_rig(seed: int = 0, lens: bool = True, axes: bool = False) -> Rig:
    """A leaning camera, weight, bow and a clamp that is off; everything is uncertain, and correlated."""
    rig = Setup("brown", 0.6, ACROSS, (640, 480), 0.1, real=True, exact=False).rig()
    std = np.concatenate([RIGID, LENS_STD]) if lens else RIGID
    mixed = np.eye(len(std)) + 0.25 * np.random.default_rng(seed).normal(size=(len(std), len(std)))
    rows = std[:, None] * mixed / np.linalg.norm(mixed, axis=1, keepdims=True)
    kinematics = Kinematics()
    if axes:
        by_pose = np.zeros((3, 6))
        by_pose[2, 1] = 0.8
        kinematics = Kinematics(axes_std=np.array([8e-4, 2e-4, 6e-4]), axes_by_pose=by_pose)
    image = replace(rig.image, noise_px=SIGMA_PX)
    return replace(rig, covariance=rows @ rows.T, kinematics=kinematics, image=image)


def three_touches(rig: Rig) -> BudgetContacts:
    """Away from the camera's line of sight, so that first order is enough."""
    distance = np.array([0.35, 0.6, 0.85]) * rig.antenna.length_m
    size = 2.0 * rig.antenna.stiffness_Nm2 * np.radians(14.0) / distance**2
    angle = np.array([0.0, 2.6, -1.2])
    return BudgetContacts(distance, size[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1), 0.2, 0.3)


def rung_shapes(rig: Rig, touches: SeenTouches, arclength_m: np.ndarray) -> Shapes:
    """By the library's highest rung: much faster than the rod by shooting, from which it differs by less than 1 µm."""
    made = curves(
        "rod",
        np.tile(rig.antenna.parameters, (len(touches), 1)),
        rig.antenna.length_m,
        touches.gravity_m_s2,
        touches.distance_m,
        touches.push_N,
        touches.friction_rad,
    )
    points = [
        CubicHermiteSpline(arc, curve, tangent)(arclength_m)
        for arc, curve, tangent in zip(made.arclength_m, made.points_m, made.tangents, strict=True)
    ]
    return Shapes(np.array(points), made.contact_m, made.force_N, made.moment_Nm, made.tangents[:, CONTACT])


def seen_of(
    rig: Rig, touches: BudgetContacts, made_by: ShapesOf = rung_shapes, friction_rad: float = 0.0, **changes: Any
) -> Scenes:
    """Frames of the contacts, without noise, about a point a pixel."""
    given = {"pan_rad": touches.pan_rad, "tilt_rad": touches.tilt_rad, "sigma_px": SIGMA_PX, "points": POINTS}
    return scenes(rig, touches.distance_m, touches.push_N, friction_rad, made_by=made_by, **(given | changes))


def errors(
    believed: Rig,
    steps: np.ndarray,
    touches: BudgetContacts,
    friction_rad: np.ndarray,
    rng: np.random.Generator | None = None,
    estimator_friction: float = FRICTION_RAD,
    made_by: ShapesOf = rung_shapes,
) -> np.ndarray:
    """(D, B, 6) errors of distance, f_y, f_z and world point where the true rigs are off by `steps` (D, 17 + P).

    `friction_rad` (D,); with `rng` points and readings are noisy.
    """
    truths: list[np.ndarray] = []
    seen: list[Scenes] = []
    for step, angle in zip(steps, friction_rad, strict=True):
        true = believed.moved(step)
        made = seen_of(true, touches, made_by, float(angle), given=believed)
        seen.append(made if rng is None else made.noisy(rng))
        world = true.kinematics.T_world_antenna(touches.pan_rad, touches.tilt_rad) @ made.shapes.contact_m
        truths.append(np.concatenate([made.distance_m[:, None], made.force_N[:, 1:], world], axis=1))
    found = ContactEstimator(believed, "rod", friction=estimator_friction).estimate_batch(
        np.concatenate([made.points_px for made in seen]),
        np.concatenate([made.moment_Nm for made in seen]),
        np.concatenate([made.pan_rad for made in seen]),
        np.concatenate([made.tilt_rad for made in seen]),
        sigma_px=believed.image.noise_px,
    )
    answers = np.concatenate([found.distance_m[:, None], found.force_N[:, 1:], found.point_world_m], axis=1)
    return np.asarray(answers.reshape(len(steps), len(touches), 6) - np.array(truths))


def linearised(
    rig: Rig, touches: BudgetContacts, friction: float = FRICTION_RAD
) -> tuple[RigArrays, _ErrorSpace, _Linearization]:
    rig_arrays = RigArrays.from_rig(rig, friction)
    space = _ErrorSpace.of(rig_arrays)
    return rig_arrays, space, _linearize(rig_arrays, space, touches)


RIG = correlated_rig()


RIG_AXES = correlated_rig(axes=True)


def length_px(points_px: np.ndarray) -> np.ndarray:
    """(B,) of curves (B, N, 2) with N points in the middles of N equal pieces."""
    between = np.hypot(*np.moveaxis(np.diff(points_px, axis=1), -1, 0)).sum(axis=1)
    return np.asarray(between * points_px.shape[1] / (points_px.shape[1] - 1))


def test_parts_add_up_to_what_the_estimator_says() -> None:
    rig, touches = RIG_AXES, three_touches(RIG)
    _, space, given = linearised(rig, touches)
    now = _propagate(given, space)
    whole = np.sum(list(_variance_by_cause(space, now).values()), axis=0)
    np.testing.assert_allclose(whole, _variance(now), rtol=1e-9)
    seen = seen_of(rig, touches, points=ContactSettings.most_points)
    estimator = ContactEstimator(rig, "rod", friction=FRICTION_RAD)
    sigma = rig.image.noise_px * np.sqrt(ContactSettings.most_points / length_px(seen.points_px))
    found = estimator.estimate_batch(
        seen.points_px, seen.moment_Nm, seen.pan_rad, seen.tilt_rad, sigma_px=sigma[:, None]
    )
    said = np.concatenate([found.distance_std_m[:, None], found.force_std_N[:, 1:]], axis=1)
    np.testing.assert_allclose(np.sqrt(whole[:, :3]), said, rtol=0.01)
    point = np.diagonal(found.covariance_world_m2, axis1=1, axis2=2)
    np.testing.assert_allclose(np.sqrt(whole[:, 3:]), np.sqrt(point), rtol=0.01, atol=2e-6)


def test_shares_of_correlated_causes_are_shapleys() -> None:
    """Two numbers with correlation ρ: each has its own (1 − ρ²) and, averaged over both orders, its half."""
    rho = 0.6
    rows = [np.array([[2.0, 0.0]]), 5.0 * np.array([[rho, np.sqrt(1 - rho**2)]])]
    shares = _split(_subsets(rows, 2))
    slopes = np.array([0.7, -0.2])
    by_error = slopes[0] * rows[0][0] + slopes[1] * rows[1][0]
    stds = np.array([2.0, 5.0])
    first, second = slopes * stds
    alone = [(first + rho * second) ** 2, (second + rho * first) ** 2]
    beyond = [first**2 * (1 - rho**2), second**2 * (1 - rho**2)]
    expected = [0.5 * (a + b) for a, b in zip(alone, beyond, strict=True)]
    np.testing.assert_allclose(np.einsum("i,gij,j->g", by_error, shares, by_error), expected, rtol=1e-12)
    np.testing.assert_allclose(np.sum(expected), by_error @ by_error, rtol=1e-12)


def test_the_estimator_is_off_as_said_by_every_parameter_and_by_friction() -> None:
    """Rigs off by a third of a deviation in one parameter after the other, contacts that rub: no noise, all weights."""
    touches = three_touches(RIG)
    rig_arrays, space, given = linearised(RIG, touches)
    now, std = _propagate(given, space), np.sqrt(np.diag(RIG.covariance))
    std = np.where(std > 0.0, std, 1.0)
    scale = np.sqrt(_variance(now))
    said = now[2] @ np.linalg.pinv(rig_arrays.axes / std[:, None])
    size, count = 0.3, len(std)
    steps = np.concatenate([np.diag(size * std), np.zeros((1, count))])
    steps[14] = 0.0
    rubs = np.append(np.zeros(count), size * FRICTION_RAD)
    off = (errors(RIG, steps, touches, rubs) - errors(RIG, -steps, touches, -rubs)) / (2.0 * size)
    expected = np.concatenate([np.moveaxis(said, -1, 0), -now[0][None, ..., 3]])
    expected[14] = 0.0
    missed, whole = (np.linalg.norm(values / scale, axis=(1, 2)) for values in (off - expected, expected))
    assert (missed < 0.1 * whole + 0.03).all(), (missed, whole)
    assert whole[-1] > 1.0


def known_better(cause: str, factor: float) -> Rig:
    """The rig after a measurement of a cause that leaves its deviation times a factor: half takes a third of it."""
    covariance, rows = RIG.covariance, rows_of(cause)
    ahead = np.linalg.solve(covariance[np.ix_(rows, rows)], covariance[rows])
    less = covariance - (1.0 - factor**2) * covariance[:, rows] @ ahead
    axes = independent_axes(0.5 * (less + less.T))  # without what rounding leaves below zero
    return replace(RIG, covariance=axes @ axes.T)


def rows_of(cause: str) -> list[int]:
    names = RIG.parameter_names
    return [names.index(name) for name in RIG_CAUSES.get(cause, names[17:])]


def test_knowing_a_cause_better_is_what_a_rig_with_that_knowledge_has() -> None:
    """Independent route: the joint covariance conditioned by hand, and the whole budget made anew."""
    touches, factor = three_touches(RIG), 0.5
    _, space, here = linearised(RIG, touches)
    sensor = replace(RIG.moment_sensor, std_Nm=factor * RIG.moment_sensor.std_Nm)
    others = [
        ("pixels", factor, replace(RIG, image=replace(RIG.image, noise_px=factor * RIG.image.noise_px)), FRICTION_RAD),
        ("moment_noise", factor, replace(RIG, moment_sensor=sensor), FRICTION_RAD),
        ("friction", factor, RIG, factor * FRICTION_RAD),
        *(
            (cause, part, known_better(cause, part), FRICTION_RAD)
            for cause in ("bow", "lens")
            for part in (0.0, factor)
        ),
    ]
    for cause, part, rig, friction in others:
        _, other, there = linearised(rig, touches, friction)
        less = _variance(_propagate(here, space, cause, part))
        np.testing.assert_allclose(less, _variance(_propagate(there, other)), rtol=1e-3, err_msg=cause)


def sampled(draws: int, seed: int, cause: str, made_by: ShapesOf = rung_shapes) -> tuple[np.ndarray, np.ndarray]:
    """(B, 6) sampled and predicted deviations; a cause that is known has no error and no place in the rig's."""
    rng, touches = np.random.default_rng(seed), three_touches(RIG)
    _, space, given = linearised(RIG, touches)
    rig, rubs, friction = RIG, FRICTION_RAD * rng.normal(size=draws), FRICTION_RAD
    if cause == "friction":
        rubs, friction = 0.0 * rubs, 0.0
    elif cause:
        rig, rows = known_better(cause, 0.0), rows_of(cause)
        covariance = rig.covariance.copy()
        covariance[rows], covariance[:, rows] = 0.0, 0.0
        rig = replace(rig, covariance=covariance)
    axes = RigArrays.from_rig(rig, FRICTION_RAD).axes
    steps = rng.normal(size=(draws, axes.shape[1])) @ axes.T
    off = errors(rig, steps, touches, rubs, rng, friction, made_by)
    return np.sqrt((off**2).mean(axis=0)), np.sqrt(_variance(_propagate(given, space, cause, 0.0)))


@pytest.mark.parametrize(("cause", "draws"), [("", 60), ("friction", 40)])
def test_sampled_errors_are_as_large_as_predicted(cause: str, draws: int) -> None:
    """Rigs, noise and friction drawn as they are said to be; and again where friction is known to be none."""
    drawn, said = sampled(draws, 3, cause)
    ratio = np.sqrt((drawn**2 / said**2).mean(axis=0))
    assert ((ratio > 0.83) & (ratio < 1.2)).all(), ratio


def written(path: Path, rig: Rig | None = None) -> Path:
    path.write_text(json.dumps((correlated_rig() if rig is None else rig).to_dict()))
    return path
