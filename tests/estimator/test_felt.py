"""From simulated strokes to everything that is said of the object: the whole chain, its wiring and its words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.estimator.setup import Setup, drawn_truth
from benchmarks.object.scenes import Recorded, contacts, record
from estimator.object.estimate import ObjectEstimate, estimate_object
from estimator.table.contacts import ContactTable
from vbaa_calib.simulate.scene.objects import TouchObject
from vbaa_calib.simulate.scene.scene import Sweep

RIG = Setup(real=True, exact=False, tilt_rad=0.5).rig()
BALL = TouchObject("sphere", np.array([0.16, 0.0, -0.05]), np.zeros(3), 0.04, 0.04)


def stroked(mu: float, seed: int, frames: int = 12) -> tuple[Recorded, ContactTable]:
    """The ball there and back, by a rig that is off as much as its covariance says."""
    rng = np.random.default_rng([seed, int(100 * mu)])
    sweeps = [Sweep("tilt", -1, frames, 6, 0.05, (0.05, 0.08), 1.5, (-way, way)) for way in (0.12, -0.12)]
    recorded = record(drawn_truth(RIG, rng), replace(BALL, friction=mu), sweeps, rng, given=RIG)
    return recorded, contacts(recorded)


@pytest.fixture(scope="module")
def rough() -> tuple[Recorded, ContactTable, ObjectEstimate]:
    recorded, table = stroked(0.4, 1)
    return recorded, table, estimate_object(table, RIG)


def normal_errors_deg(recorded: Recorded, felt: ObjectEstimate) -> np.ndarray:
    true = recorded.truth.normal_world[felt.surface.touched_row]
    return np.degrees(np.arccos(np.clip((true * felt.normals.normal).sum(axis=1), -1.0, 1.0)))


def test_friction_and_normals_of_a_simulated_ball(rough: tuple[Recorded, ContactTable, ObjectEstimate]) -> None:
    recorded, _, felt = rough
    assert felt.friction.determined
    assert felt.friction.mu == pytest.approx(0.4, abs=0.03)
    assert felt.friction.interval[0] <= 0.4 <= felt.friction.interval[1]
    assert np.sqrt(np.mean(normal_errors_deg(recorded, felt)[felt.friction.used_as == "sliding"] ** 2)) < 3.0


def test_without_a_rig_less_is_certain(rough: tuple[Recorded, ContactTable, ObjectEstimate]) -> None:
    _, table, felt = rough
    alone = estimate_object(table)
    assert np.isnan(alone.friction.nu_rad).all()
    assert alone.friction.mu == pytest.approx(0.4, abs=0.03)
    assert alone.friction.std > felt.friction.std


def test_a_slippery_object_pushes_along_its_normal() -> None:
    """Fig. 7(b): within two degrees, and the interval of μ holds 0."""
    recorded, table = stroked(0.0, 2)
    felt = estimate_object(table, RIG)
    sliding = felt.friction.used_as == "sliding"
    assert np.degrees(np.median(np.abs(felt.friction.psi_rad - felt.friction.nu_rad)[sliding])) < 2.0
    assert felt.friction.interval[0] == 0.0
    assert felt.friction.interval[1] < 0.05
    assert np.median(normal_errors_deg(recorded, felt)) < 2.0
