"""Several cameras in one estimate: their information adds, and what one cannot see another one does."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.estimator.bound import bound
from benchmarks.estimator.scenes import (
    Scenes,
    centrelines,
    push_for_slope,
    random_scenes,
    rod_shapes,
    rolled,
    scenes,
    with_second,
)
from benchmarks.estimator.setup import Setup, drawn_truth
from estimator import ContactEstimator
from estimator.contact.inputs import Batch
from estimator.solver.linearised import linearised
from estimator.solver.rig_arrays import RigArrays
from estimator.table.contacts import Measured
from vbaa_calib.core.errors import InputError
from vbaa_calib.rig import POSE_PARAMETERS, RIG_PARAMETERS, Rig
from vbaa_calib.session import DRIFTS

EXACT, CALIBRATED = (with_second(Setup(exact=exact, real=not exact).rig()) for exact in (True, False))


def touched(rig: Rig, count: int, seed: int, sigma_px: float = 0.1) -> tuple[Scenes, dict[str, np.ndarray]]:
    """Frames with a reading, and each camera's pixels."""
    rng = np.random.default_rng(seed)
    clean = replace(random_scenes(rig, count, rng, slope_rad=(0.1, 0.6)), sigma_px=sigma_px)
    read = clean.moment_Nm + rng.normal(0.0, rig.moment_sensor.std_Nm, count)
    return replace(clean, moment_Nm=read), centrelines(rig, clean, rng)


def answers(rig: Rig, frames: Scenes, lines, friction: float = 0.0, **more):
    """Contacts by pixels, of a rig with several cameras by their names."""
    estimator = ContactEstimator(rig, friction=friction, jobs=1)
    read = (frames.moment_Nm, frames.pan_rad, frames.tilt_rad)
    return estimator.estimate_batch(lines, *read, sigma_px=frames.sigma_px, **more)


def batch(rig: Rig, frames: Scenes, lines) -> Batch:
    columns = {"moments": frames.moment_Nm, "moments_z": None}
    return Batch.checked(rig, lines, columns, {"pans": frames.pan_rad, "tilts": frames.tilt_rad}, frames.sigma_px, {})


@pytest.mark.parametrize("rung", ["linear", "elastica", "rod"])
def test_information_of_cameras_adds(rung: str) -> None:
    """Of an exact rig: normal equations of both are the sum of each one's, readings and priors counted once."""
    frames, lines = touched(EXACT, 12, 1)
    arrays = {name: RigArrays.from_rig(rig, 0.2) for name, rig in {"both": EXACT, **EXACT.cameras}.items()}
    at = np.column_stack(
        [frames.distance_m / 0.24, frames.touches.push_N / arrays["both"].force_unit_N, np.full(12, 0.3)]
    )
    none = {name: np.full_like(each, np.nan) for name, each in lines.items()}
    found = {
        name: linearised(batch(one.rig, frames, of).frames(one), rung, at)
        for name, one, of in (
            ("both", arrays["both"], lines),
            ("left", arrays["left"], lines["left"]),
            ("right", arrays["right"], lines["right"]),
            ("nothing", arrays["both"], none),
        )
    }
    for name in ("information", "side"):
        left, right, nothing = (getattr(found[each], name) for each in ("left", "right", "nothing"))
        both = getattr(found["both"], name)
        np.testing.assert_allclose(both, left + right - nothing, rtol=1e-9, atol=1e-9 * np.abs(both).max())


def test_deviations_are_the_bounds() -> None:
    """Stated deviations against Cramér and Rao's, from the simulator's own forward model; errors follow them."""
    frames, lines = touched(EXACT, 300, 2)
    found = answers(EXACT, frames, lines)
    assert set(found.status.tolist()) == {"ok"}
    deaf, information = replace(EXACT.moment_sensor, std_Nm=1e6), []
    for rig in (EXACT.cameras["left"], replace(EXACT.cameras["right"], moment_sensor=deaf)):
        (seen,) = centrelines(rig, replace(frames, sigma_px=1e-9), np.random.default_rng(0)).values()
        information.append(np.linalg.inv(bound(replace(frames, rig=rig, points_px=seen)).covariance))
    std = np.sqrt(np.diagonal(np.linalg.inv(information[0] + information[1]), axis1=1, axis2=2))
    np.testing.assert_allclose(found.distance_std_m / std[:, 0], 1.0, atol=0.05)
    np.testing.assert_allclose(found.force_std_N[:, 1:] / std[:, 1:], 1.0, atol=0.1)
    off = np.column_stack([found.distance_m - frames.distance_m, (found.force_N - frames.force_N)[:, 1:]])
    square = np.mean((off / np.column_stack([found.distance_std_m, found.force_std_N[:, 1:]])) ** 2, axis=0)
    np.testing.assert_allclose(square, 1.0, atol=0.3)


def test_a_calibrated_rigs_intervals_cover() -> None:
    """Truths drawn from the joint covariance of both cameras: their own errors, and the antenna's that they share."""
    rng, off = np.random.default_rng(3), []
    for seed in range(60):
        true = drawn_truth(CALIBRATED, rng)
        frames, lines = touched(true, 5, 100 + seed, sigma_px=0.05)
        found = answers(CALIBRATED, replace(frames, rig=CALIBRATED), lines)
        assert (found.status == "ok").all()
        off.append((found.distance_m - frames.distance_m) / found.distance_std_m)
    off = np.concatenate(off)
    assert 0.9 < np.mean(np.abs(off) < 1.96) < 0.99


def test_joint_covariance_has_each_cameras_own() -> None:
    """Of pose and antenna as its own calibration says; the poses go together as far as the antenna moves both."""
    rng = np.random.default_rng(4)
    first = _correlated(CALIBRATED.cameras["left"], rng)
    other = replace(first, T_antenna_camera=CALIBRATED.others["right"].T_antenna_camera, camera_name="right")
    rig = replace(first, others={"right": other})
    whole, count, pose = rig.covariance_with_tip, len(first.covariance), len(POSE_PARAMETERS)
    np.testing.assert_allclose(whole[:count, :count], first.covariance, rtol=1e-6, atol=1e-18)
    own = np.r_[count : count + pose, pose : len(RIG_PARAMETERS), count + pose : len(whole)]
    np.testing.assert_allclose(whole[np.ix_(own, own)], other.covariance, rtol=1e-5, atol=1e-16)
    across = whole[:pose, count : count + pose]
    shared = slice(pose, len(RIG_PARAMETERS))
    slopes = first.covariance[:pose, shared] @ np.linalg.pinv(first.covariance[shared, shared], 1e-14, True)
    expected = slopes @ first.covariance[shared, shared] @ slopes.T
    np.testing.assert_allclose(across, expected, rtol=1e-3, atol=1e-3 * np.abs(expected).max())
    step = np.sqrt(np.diag(whole))
    there = rig.moved(step)
    np.testing.assert_allclose(there.others["right"].step_from(rig.others["right"]), step[own], rtol=1e-6, atol=1e-12)
    again = rig.with_covariance(2.0 * whole)
    np.testing.assert_allclose(again.covariance_with_tip, 2.0 * whole, rtol=1e-6, atol=1e-16)


def _correlated(rig: Rig, rng: np.random.Generator) -> Rig:
    std = np.sqrt(np.diag(rig.covariance))
    std[17:] = 1e-3
    mixed = np.eye(len(std)) + 0.3 * rng.normal(size=(len(std), len(std))) / np.sqrt(len(std))
    return replace(rig, covariance=np.outer(std, std) * (mixed @ mixed.T))


def test_what_one_sees_edge_on_another_one_sees() -> None:
    """Without a reading: pushed along the first camera's line of sight, and along the second's."""
    for roll in (0.5 * np.pi, 0.0):
        distance = np.linspace(0.4, 0.9, 12) * 0.24
        push = rolled(push_for_slope(np.full(12, 0.3), distance, EXACT.antenna.stiffness_Nm2), roll)
        frames = scenes(EXACT, distance, push, made_by=rod_shapes)
        lines = centrelines(EXACT, frames, np.random.default_rng(5))
        read = replace(frames, moment_Nm=np.full(12, np.nan))
        alone = [answers(rig, read, lines[name]).status for name, rig in EXACT.cameras.items()]
        assert sum(("ok" not in each.tolist()) for each in alone) == 1
        found = answers(EXACT, read, lines)
        assert (found.status == "ok").all()
        assert (np.abs(found.distance_m - distance) < 4.0 * found.distance_std_m).all()
        assert (np.abs((found.force_N - frames.force_N) / found.force_std_N)[:, 1:] < 4.5).all()


def test_a_camera_that_shows_nothing_drops_out() -> None:
    """Of a frame, whose contact is then that of the other one alone; its reason says so."""
    frames, lines = touched(EXACT, 8, 6)
    covered = lines | {"right": lines["right"].copy()}
    covered["right"][:4] = np.nan
    covered["right"][4, 3:] = np.nan
    found, alone = answers(EXACT, frames, covered), answers(EXACT.cameras["left"], frames, lines["left"])
    both = answers(EXACT, frames, lines)
    np.testing.assert_allclose(found.distance_m[:5], alone.distance_m[:5], rtol=1e-7)
    np.testing.assert_allclose(found.covariance_world_m2[:5], alone.covariance_world_m2[:5], rtol=1e-4, atol=1e-14)
    np.testing.assert_array_equal(found.distance_m[5:], both.distance_m[5:])
    assert found[0].reason.endswith("; right shows no antenna")
    assert found[4].reason.endswith("; right shows only 3 points: left out")
    assert "right" not in found[5].reason
    neither = answers(EXACT, frames, {name: np.full_like(each, np.nan) for name, each in lines.items()})
    assert (neither.status == "no_antenna").all()
    left_out = answers(EXACT, frames, {"left": lines["left"]})
    np.testing.assert_array_equal(left_out.distance_m[:4], found.distance_m[:4])


def test_the_order_of_points_and_cameras_does_not_matter() -> None:
    frames, lines = touched(EXACT, 6, 7)
    shuffled = {name: lines[name][:, ::-1] for name in ("right", "left")}
    np.testing.assert_array_equal(answers(EXACT, frames, shuffled).distance_m, answers(EXACT, frames, lines).distance_m)
    one = ContactEstimator(EXACT, friction=0.0).estimate(
        {name: each[0] for name, each in lines.items()},
        moment=float(frames.moment_Nm[0]),
        pan=float(frames.pan_rad[0]),
        tilt=float(frames.tilt_rad[0]),
        sigma_px={"left": 0.1, "right": np.full(lines["right"].shape[1], 0.1)},
    )
    assert one.distance_m == pytest.approx(answers(EXACT, frames, lines).distance_m[0], rel=1e-9)


def test_gross_errors_of_one_camera_are_left_out() -> None:
    frames, lines = touched(EXACT, 20, 8)
    fouled = lines | {"right": lines["right"].copy()}
    fouled["right"][:, 40:46] += 60.0
    found = answers(EXACT, frames, fouled)
    assert (found.status == "ok").all()
    assert (np.abs(found.distance_m - frames.distance_m) < 4.5 * found.distance_std_m).all()


def test_derivatives_of_both_cameras_pixels() -> None:
    """Against contacts of moved pixels."""
    frames, lines = touched(EXACT, 3, 9)
    found = answers(EXACT, frames, lines, jacobian=True).jacobian
    count = lines["left"].shape[1]
    for name, point, at in (("left", 150, 150), ("right", 120, count + 120)):
        for axis in range(2):
            moved = []
            for step in (0.02, -0.02):
                there = lines | {name: lines[name].copy()}
                there[name][:, point, axis] += step
                moved.append(answers(EXACT, frames, there).distance_m)
            slope = (moved[0] - moved[1]) / 0.04
            np.testing.assert_allclose(found.by_pixels[:, 0, at, axis], slope, rtol=0.05, atol=2e-7)


def test_drift_of_each_camera_is_learnt() -> None:
    """From the free antenna: the second camera was turned, the first was not."""
    rig = replace(CALIBRATED, drift=DRIFTS["rough"])
    right = rig.others["right"]
    turn = np.array([0.002, 0.0, 0.0, 0.0, 0.0, 0.0])
    turned = replace(right, T_antenna_camera=right.T_antenna_camera.retract(turn))
    true = replace(rig, others={"right": turned})
    frames = scenes(true, np.full(40, 0.12), np.zeros((40, 2)), made_by=rod_shapes)
    lines = centrelines(true, replace(frames, sigma_px=0.1), np.random.default_rng(10))
    estimator = ContactEstimator(rig, friction=0.0)
    several = [
        Measured(
            *(lines["left"][i], np.full(200, 0.1), float(frames.moment_Nm[i]), 0.0, 0.0),
            time_s=0.02 * i,
            others={"right": Measured(lines["right"][i], np.full(200, 0.1), np.nan, 0.0, 0.0)},
        )
        for i in range(40)
    ]
    assert {contact.status for contact in estimator.run(several)} == {"no_contact"}
    now = estimator.drift.now
    assert estimator.drift.frames > 0
    middle = np.array([[0.12, 0.0, 0.0]])
    for name, moved_px in (("left", 0.0), ("right", 1.8)):
        across = [
            one.camera.project(one.T_antenna_camera.inverse() @ middle)[0][0, 1]
            for one in (now.cameras[name], true.cameras[name], rig.cameras[name])
        ]
        assert abs(across[1] - across[2]) >= moved_px
        assert abs(across[0] - across[1]) < 0.1


def test_rig_json_holds_every_camera(tmp_path) -> None:
    """What differs for each; a file of one camera is as it was."""
    rig = replace(EXACT, others={"right": _correlated(EXACT.others["right"], np.random.default_rng(12))})
    rig.save(tmp_path / "rig.json")
    data = json.loads((tmp_path / "rig.json").read_text())
    assert (data["camera_name"], set(data["cameras"])) == ("left", {"right"})
    assert set(data["cameras"]["right"]) >= {"camera", "T_antenna_camera", "joint"}
    again = Rig.load(tmp_path / "rig.json")
    np.testing.assert_array_equal(again.covariance_with_tip, rig.covariance_with_tip)
    frames, lines = touched(EXACT, 4, 13)
    there, before = (answers(each, frames, lines).distance_m for each in (again, rig))
    np.testing.assert_allclose(there, before, rtol=1e-9)
    assert not {"camera_name", "cameras"} & set(EXACT.cameras["left"].to_dict())
    data["cameras"]["right"]["T_antenna_camera"]["translation_m"] = [0.0, 0.0, "far"]
    with pytest.raises(InputError, match="T_antenna_camera"):
        Rig.from_dict(data)
    with pytest.raises(InputError, match="cameras"):
        Rig.from_dict(data | {"cameras": {"the right": {}}})


def test_what_is_no_camera_of_the_rig_is_refused() -> None:
    frames, lines = touched(EXACT, 2, 11)
    for wrong, words in (
        (lines["left"], "several cameras"),
        ({"middle": lines["left"]}, "no camera middle"),
        ({}, "several cameras"),
        (lines | {"right": lines["right"][:1]}, "2"),
    ):
        with pytest.raises(InputError, match=words):
            answers(EXACT, frames, wrong)
    with pytest.raises(InputError, match="called left"):
        replace(EXACT, others={"left": EXACT.others["right"]})
