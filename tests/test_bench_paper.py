"""`vbaa bench paper`: its scenes are what they say, and on a seeded few of them the paper's claims hold."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.paper import friction as paper_drag
from benchmarks.paper import friction as paper_friction
from benchmarks.paper import sensing as paper_sensing
from benchmarks.paper import yielding as paper_yielding
from benchmarks.paper.rig import paper_rig, ring_down
from benchmarks.paper.sensing import ALL_POINTS, TWO_POINTS
from estimator.paper.baselines import Ring
from estimator.paper.baselines.moment import fit_ringing
from tests.estimator import vibrations


@cache
def found() -> SimpleNamespace:
    """All experiments at their smallest: two distances, one coefficient, two stiffnesses, two draws."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(paper_sensing, "DISTANCES_M", np.array([0.1, 0.18]))
        patch.setattr(paper_sensing, "NORMALS_DEG", (0.0, 30.0))
        for module in (paper_sensing, paper_friction):
            patch.setattr(module, "SIGMAS_PX", (0.1,))
        patch.setattr(paper_drag, "APPROACH", 6)
        patch.setattr(paper_drag, "LEG", 10)
        patch.setattr(paper_friction, "APPROACH", 6)
        patch.setattr(paper_yielding, "STIFFNESSES_N_M", (50.0, 1e5))
        for module in (paper_sensing, paper_friction, paper_yielding):
            patch.setattr(module, "TRUE_RIGS", 1)
        friction, path = paper_friction.run(1, 1, (0.3,))
        return SimpleNamespace(
            sensing=paper_sensing.run(2, 1), friction=friction, path=path, yielding=paper_yielding.run(2, 1)
        )


@pytest.mark.parametrize("contact", [0.3, 0.6])
def test_finite_elements_ring_as_beams_do(contact: float) -> None:
    """Against the modes in closed form: on a rigid edge, and free where the object's spring is nothing."""
    antenna = paper_rig().antenna
    rigid, soft = (ring_down(antenna, contact * antenna.length_m, k) for k in (np.inf, 1e-9))
    scale = np.sqrt(antenna.stiffness_Nm2 / antenna.mass_per_length_kg_m) / antenna.length_m**2
    for (time, signal), wave in ((rigid, vibrations.modes(contact, 1)[0][0]), (soft, 1.8751040687)):
        heard = fit_ringing(Ring(time, signal), (0.5 * scale * wave**2, 1.5 * scale * wave**2))
        assert not isinstance(heard, str)
        assert heard[0] == pytest.approx(scale * wave**2, rel=2e-3)


def test_fig7_the_force_points_along_the_normal_of_slippery_objects() -> None:
    rows = [row for row in found().sensing if row.method == ALL_POINTS]
    assert len(rows) == 4
    for row in rows:
        assert row.answered == 1.0
        assert (row.direction_rms_deg or 99.0) < 2.0
        assert (row.l_rms_mm or 99.0) < 5.0 * (row.l_stated_mm or 0.0)
        assert row.direction_true_deg == pytest.approx(row.normal_deg, abs=0.5)
    assert any(row.method == TWO_POINTS and row.l_rms_mm for row in found().sensing)


def test_fig5_friction_is_found() -> None:
    rows = found().friction
    assert {row.method for row in rows} >= {ALL_POINTS, TWO_POINTS}
    for row in rows:
        if row.method in (ALL_POINTS, TWO_POINTS):
            assert row.mu_mean == pytest.approx(0.3, abs=0.03)
            assert (row.normal_rms_deg or 99.0) < 2.0
    assert {row.part for row in found().path} == {"press", "there", "back"}


def test_a_yielding_object_misleads_the_active_antenna_alone() -> None:
    rows = {(row.method, row.stiffness_N_m): row for row in found().yielding}
    soft, hard = rows["Active Antenna", 50.0], rows["Active Antenna", 1e5]
    assert soft.l_expected_mm == pytest.approx(16.25, rel=1e-3)
    assert soft.l_error_mm == pytest.approx(soft.l_expected_mm, abs=2.0)
    assert abs(hard.l_error_mm or 99.0) < 2.0
    for stiffness in (50.0, 1e5):
        assert (rows[ALL_POINTS, stiffness].l_rms_mm or 99.0) < 3.0
    assert rows[ALL_POINTS, 50.0].object_mean_N_m == pytest.approx(50.0, rel=0.1)
    assert rows[ALL_POINTS, 1e5].object_answered == 0.0, "what does not give way has no stiffness to tell"
