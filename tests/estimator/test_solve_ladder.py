"""The ladder: each rung on request, the lowest that is good enough by itself, and biases that are as predicted."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.estimator.scenes import elastica_shapes
from estimator.contact.settings import ContactSettings
from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.native import core

from ..rod_scenes import LENGTH_M, RIG_STD, World, camera_pose
from .contact_scenes import (
    STRAIGHT,
    WORLD,
    answered,
    deviations,
    estimated,
    fitted_std,
    frame,
    rubbed,
    scene_deviations,
)

LIGHT = World(camera_pose(0.6, 1.0), STRAIGHT).rig(np.zeros(17), np.zeros(3))
"""A straight antenna without weight, known exactly: the paper's, but for how far it bends."""
HEAVY = WORLD.rig(np.zeros(17))


def test_each_rung_on_request() -> None:
    seen = frame()
    found = {model: estimated(seen, model=model) for model in (*RUNGS, "auto")}
    assert [found[rung].model for rung in RUNGS] == list(RUNGS)
    for rung in ("elastica", "rod"):
        assert found[rung].status == "ok"
        assert found[rung].reason.startswith(f"{rung} was asked for")
        assert np.abs(deviations(found[rung], seen)).max() < 3.5
    assert found["auto"].model == "elastica"
    assert found["auto"].reason.startswith("elastica: linear would be")
    assert found["auto"].distance_m == pytest.approx(found["rod"].distance_m, abs=1e-4)
    # what knows nothing of this antenna's weight and bow must not pass for an answer
    assert found["paper"].status == "failed"


def test_auto_climbs_as_the_antenna_bends() -> None:
    """Straight and weightless: the paper's beam while the slope is small, then the elastica, which is exact for it."""
    slopes = [0.6, 1.0, 4.0, 8.0, 16.0, 32.0]
    found = answered(rubbed(LIGHT, [0.6] * 6, slopes, made_by=elastica_shapes))
    assert [contact.status for contact in found] == ["ok"] * 6
    assert [contact.model for contact in found] == ["paper"] * 2 + ["elastica"] * 4
    assert found[0].reason.startswith("paper: its bias is 0.0")
    climbing = [contact.bias["linear"] for contact in found]
    assert climbing == sorted(climbing)
    assert climbing[-1] > 50.0


def test_noise_and_an_unsure_rig_keep_auto_low() -> None:
    scenes = rubbed(HEAVY, [0.6], [32.0], sigma_px=0.02)
    assert answered(scenes)[0].model == "rod"
    assert answered(rubbed(HEAVY, [0.6], [32.0], sigma_px=0.5))[0].model == "elastica"
    assert answered(rubbed(WORLD.rig(3.0 * RIG_STD), [0.6], [32.0], sigma_px=0.02))[0].model == "elastica"


@pytest.mark.parametrize("rung", ["linear", "elastica"])
def test_friction_is_counted_among_the_biases_of_what_does_not_know_it(rung: str) -> None:
    scenes = rubbed(LIGHT, [0.6], [10.0], made_by=elastica_shapes)
    slippery, rough = (answered(scenes, rung, friction)[0].bias[rung] for friction in (0.0, 0.3))
    assert (rough > slippery + 0.3) == (rung == "linear")


def made_and_said(rung: str, std: float, straight: bool) -> tuple[np.ndarray, np.ndarray]:
    """(K,) biases really made without noise on a rung, and those that it predicts; in deviations of noise and rig."""
    rng, high = np.random.default_rng(3), rung == "elastica"
    world = World(camera_pose(0.6, 1.0), STRAIGHT) if straight else WORLD
    rig = world.rig(std * RIG_STD, np.zeros(3)) if straight else world.rig(std * RIG_STD)
    count, low, most = (20, 18.0, 34.0) if high else (60, 0.7, 25.0)
    slope = np.exp(rng.uniform(np.log(low), np.log(most), count))
    contact, roll = rng.uniform(0.3, 0.9, count), rng.uniform(-1.0, 1.0, count) * (1.0 if high else 3.0)
    # else the elastica has no bias worth the name
    scenes = rubbed(rig, contact, slope, 0.0, roll, sigma_px=0.01 if high else 0.1)
    found = answered(scenes, rung, friction=0.0)
    off = np.column_stack(
        [LENGTH_M * found.numbers.unknowns[:, 0] - scenes.distance_m, (found.numbers.force_N - scenes.force_N)[:, 1:]]
    )
    made = np.abs(off / fitted_std(found, scenes, rung, 0.0)).max(axis=1)
    said = found.numbers.bias[:, RUNGS.index(rung)]
    fits = found.numbers.converged & (found.numbers.scatter <= core.solver.WRONG_SHAPE)
    counted = fits & (made > 0.3) & (made < 10.0)
    return made[counted], said[counted]


@pytest.mark.parametrize(
    ("rung", "straight", "std"),
    [
        ("paper", True, 0.25),
        ("linear", True, 0.25),
        ("linear", False, 0.0),
        ("elastica", False, 0.0),
    ],
)
def test_bias_is_what_was_predicted(rung: str, straight: bool, std: float) -> None:
    """Frictionless rods without noise: within a factor of two where it is 0.3 to 10 deviations."""
    made, said = made_and_said(rung, std, straight)
    assert len(made) >= 8
    assert (said / made < 2.0).all(), said / made
    assert (said / made > 0.5).all(), said / made


@pytest.mark.parametrize(
    ("rung", "std", "friction", "count"),
    [("linear", 0.0, 0.0, 100), ("linear", 0.0, 0.2, 100), ("linear", 0.25, 0.2, 100), ("paper", 0.25, 0.2, 25)],
)
def test_a_demanded_rung_is_never_wrong_and_confident(rung: str, std: float, friction: float, count: int) -> None:
    """What a rung makes wrong is in its deviations, or the frame fails and says so."""
    rng = np.random.default_rng(4)
    rig = WORLD.rig(std * RIG_STD) if std else HEAVY
    contact, slope = rng.uniform(0.2, 0.95, count), np.exp(rng.uniform(0.0, np.log(34.0), count))
    scenes = rubbed(rig, contact, slope, friction * rng.normal(size=count), rng.uniform(-3.0, 3.0, count))
    found = answered(scenes, rung, friction)
    off = np.abs(scene_deviations(found, scenes))
    assert not (off > 4.0).any()
    said = np.array([one.predicted_bias_std for one in found])
    assert not (np.isfinite(found.distance_m) & (said > ContactSettings.highest_bias)).any()
    assert (rung == "linear") == bool((found.status == "ok").any())
    assert any(one.reason.startswith(f"{rung} is too low for this frame") for one in found)
