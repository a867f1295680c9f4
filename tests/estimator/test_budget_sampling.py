"""The error budget against sampling: rigs, noise and friction drawn as they are said to be, estimated one by one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.estimator.shapes import ShapesOf, rod_shapes
from estimator.budget.parts import FRICTION, improved, propagate
from estimator.budget.space import LENS, RIG_CAUSES
from estimator.solver.rig_arrays import RigArrays

from .budget_draws import FRICTION_RAD, RIG, errors, linearised, rung_shapes, three_touches


def sampled(
    draws: int, seed: int, known_cause: str | None, made_by: ShapesOf = rung_shapes
) -> tuple[np.ndarray, np.ndarray]:
    """(B, 6) sampled and predicted deviations; a cause that is known has no error and no place in the rig's."""
    rng, touches = np.random.default_rng(seed), three_touches(RIG)
    _, space, given = linearised(RIG, touches)
    rig, rubs = RIG, FRICTION_RAD * rng.normal(size=draws)
    estimator_friction = FRICTION_RAD
    now = propagate(given)
    if known_cause == FRICTION:
        rubs, estimator_friction = 0.0 * rubs, 0.0
    elif known_cause is not None:
        names = RIG_CAUSES.get(known_cause, RIG.parameter_names[17:])
        rows = [RIG.parameter_names.index(name) for name in names]
        ahead = np.linalg.solve(RIG.covariance[np.ix_(rows, rows)], RIG.covariance[rows])
        less = RIG.covariance - RIG.covariance[:, rows] @ ahead
        less[rows], less[:, rows] = 0.0, 0.0
        rig = replace(RIG, covariance=0.5 * (less + less.T))
    if known_cause is not None:
        now = propagate(given, improved(space, known_cause, 0.0))
    axes = RigArrays.from_rig(rig, FRICTION_RAD, np.empty(0)).axes
    steps = rng.normal(size=(draws, axes.shape[1])) @ axes.T
    off = errors(rig, steps, touches, rubs, rng, estimator_friction, made_by)
    return np.sqrt((off**2).mean(axis=0)), np.sqrt(now.variance)


def test_sampled_errors_are_as_large_as_predicted() -> None:
    """Rigs, noise and friction drawn as they are said to be; and again where friction is known to be none."""
    for cause, draws in ((None, 100), (FRICTION, 50)):
        drawn, said = sampled(draws, 3, cause)
        ratio = np.sqrt((drawn**2 / said**2).mean(axis=0))
        assert ((ratio > 0.83) & (ratio < 1.2)).all(), (cause, ratio)


@pytest.mark.slow
@pytest.mark.parametrize("cause", [None, FRICTION, LENS, "bow"])
def test_more_samples_fall_as_predicted_when_a_cause_is_known(cause: str | None) -> None:
    drawn, said = sampled(400, 5, cause, rod_shapes)
    assert np.isfinite(drawn).all()
    np.testing.assert_allclose(drawn, said, rtol=0.15, atol=1e-9)
    before = np.sqrt(propagate(linearised(RIG, three_touches(RIG))[2]).variance)
    assert cause is None or (said < before * (1 + 1e-9)).all()
