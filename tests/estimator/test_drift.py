"""Rigs that changed since their calibration; shapes, pixels and changes by what shares no code with the estimator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.drift import ALL, CHANGES, FREE, NONE, SEEN, UNSEEN, changed, estimated
from benchmarks.mistakes.recordings import clean_recording
from benchmarks.mistakes.rigs import KINDS, Calibrated, known_rig
from estimator import Contact, ContactEstimator
from estimator.contact.drift import summary
from estimator.solver.rig_arrays import RigArrays
from estimator.table.contacts import Measured
from vbaa_calib.camera import Camera
from vbaa_calib.geometry import Pose
from vbaa_calib.rig import Rig
from vbaa_calib.session import DRIFTS, Drift

from ..rod_scenes import LENGTH_M, RIG_STD, SIGMA_PX, World, along, camera_pose, gravity_antenna, press
from .contact_scenes import RIG, frame
from .contact_scenes import estimated as estimated_frame

LAB = DRIFTS["lab"]


@pytest.fixture(scope="module")
def known() -> Calibrated:
    return known_rig(KINDS[0], 0)


def off(found: list[Contact], distance_m: np.ndarray) -> np.ndarray:
    """(T,) errors of the distances, in deviations; NaN where none is located."""
    both = [((one.distance_m - true) / one.distance_std_m) for one, true in zip(found, distance_m, strict=True)]
    return np.array(both)[np.isfinite(distance_m)]


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))])
def test_a_rig_that_changed_keeps_its_contacts(known: Calibrated, seed: int) -> None:
    """With free frames and without: what is located without the change is located with it, within its deviations."""
    before, after = (changed(known, change, seed) for change in (Drift(), CHANGES[ALL]))
    for way in (UNSEEN, SEEN):
        unchanged, found = (estimated(known.rig, way, each.frames) for each in (before, after))
        was, error = (off(each, after.truth.distance_m) for each in (unchanged, found))
        assert (np.isnan(error) & ~np.isnan(was)).sum() <= 1
        assert np.nanmax(np.abs(error)) < 5
        assert {one.status for one in found[:FREE]} == {"no_contact"}


def test_free_frames_tell_what_has_changed(known: Calibrated) -> None:
    change = Drift(picture_shift_px=0.4, moment_zero=10.0)
    estimator = ContactEstimator(replace(known.rig, drift=LAB))
    moved, still = (changed(known, each, 1).frames for each in (change, Drift()))
    true_px = (moved[0].points_px - still[0].points_px).mean(axis=0)
    true_zero = moved[0].moment_Nm - still[0].moment_Nm
    list(estimator.run(moved))
    told = summary(estimator.drift)
    along = still[0].points_px[-1] - still[0].points_px[0]
    across = abs(np.array([-along[1], along[0]]) @ true_px) / np.linalg.norm(along)
    assert told["free_frames"] == FREE
    assert told["picture_px"] == pytest.approx(across, abs=0.03)
    zero = told["parameters"]["moment_offset_Nm"]
    assert abs(zero["change"] - true_zero) < 4 * zero["std"]
    assert zero["std"] < 0.5 * zero["prior_std"]
    assert told["beyond"] == []


def test_what_has_changed_is_said_where_the_lens_shows_a_part() -> None:
    """A wide lens close to the antenna shows its first part; how much, depends on the lens, which free frames correct.
    How far the antenna has moved is measured where both show it; where neither does, there is no number, and no end."""
    world = World(Pose(camera_pose().rotation, np.array([0.05, 0.0, 0.1])))
    lens_std = np.array([1.0, 1.0, 0.5, 0.5, 0.02, 1e-9, 1e-4, 1e-4])
    matrix = np.array([[480.0, 0.0, 480.0], [0.0, 480.0, 360.0], [0.0, 0.0, 1.0]])
    camera = Camera("opencv", (960, 720), matrix, np.array([-0.25, 0.0, 0.0, 0.0]), np.diag(lens_std**2))
    rig = replace(world.rig(), camera=camera, drift=LAB).with_covariance(np.diag(np.append(RIG_STD, lens_std) ** 2))
    free, _ = press(world.rod, gravity_antenna(0.3)[None], np.array([0.1]), np.zeros((1, 2)))
    at_m = world.T_antenna_camera.inverse() @ along(free, np.linspace(0.01, 1.0, 300) * LENGTH_M)
    true = replace(camera, distortion=np.array([-0.235, 0.0, 0.0, 0.0]))
    before, now_px = camera.project(at_m)[0], true.project(at_m)[0] + [0.0, 0.6]
    line = now_px[true.in_picture(now_px)]
    assert 100 < len(line) < 280
    moment_Nm = -world.sensor.gain * free.clamp_moment_Nm[0, 1] + world.sensor.offset_Nm
    rng, sigma_px = np.random.default_rng(1), np.full(len(line), SIGMA_PX)
    recording = [
        Measured(line + rng.normal(0.0, SIGMA_PX, line.shape), sigma_px, moment_Nm, 0.0, 0.3, time_s=float(number))
        for number in range(6)
    ]
    estimator = ContactEstimator(rig)
    assert len(list(estimator.run(recording))) == len(recording)
    assert estimator.drift.now.camera.valid_region().ideal_radius != pytest.approx(camera.valid_region().ideal_radius)
    told = summary(estimator.drift)
    moved_px = (now_px - before)[true.in_picture(now_px) & camera.in_picture(before), 1]  # the antenna lies along u
    assert told["free_frames"] > 0
    assert told["picture_px"] == pytest.approx(np.sqrt(np.mean(moved_px**2)), rel=0.1)
    away = replace(rig, camera=replace(camera, image_size=(1, 1)))
    assert summary(replace(estimator.drift, calibrated=away))["picture_px"] is None


def test_free_frames_give_back_what_drift_costs(known: Calibrated) -> None:
    frames = changed(known, Drift(), 2).frames
    ignored, unseen, seen = (
        np.nanmedian([one.distance_std_m for one in estimated(known.rig, way, frames)[FREE:]])
        for way in (NONE, UNSEEN, SEEN)
    )
    # they may give more: they tell, too, what the calibration's own lines had in common
    assert ignored < unseen
    assert seen - ignored < 0.7 * (unseen - ignored)


def test_what_all_frames_share_is_what_the_rig_moves() -> None:
    """The estimate follows each of the rig's errors; in squares they make the shared part."""
    seen = frame()
    here = estimated_frame(seen, friction=0.0)
    axes = np.asarray(RigArrays.from_rig(RIG, 0.0).axes)
    moved = [estimated_frame(seen, RIG.moved(step), friction=0.0) for step in 0.1 * axes.T]
    by_axis = [10.0 * (one.distance_m - here.distance_m) for one in moved]
    assert np.sqrt(np.sum(np.square(by_axis))) == pytest.approx(here.distance_shared_std_m, rel=0.05)
    by_axis = [10.0 * (one.point_world_m - here.point_world_m) for one in moved]
    assert np.sqrt(np.square(by_axis).sum(axis=0)) == pytest.approx(here.point_shared_std_m, rel=0.1, abs=1e-6)
    assert here.distance_shared_std_m < here.distance_std_m
    assert (here.force_shared_std_N[1:] < here.force_std_N[1:]).all()


def test_rig_json_keeps_it(known: Calibrated) -> None:
    rig = known.rig
    rough = replace(rig, drift=DRIFTS["rough"])
    assert Rig.from_dict(rough.to_dict()).drift == DRIFTS["rough"]
    before = {key: value for key, value in rig.to_dict().items() if key != "drift"}
    assert Rig.from_dict(before).drift == LAB


@pytest.mark.parametrize("number", range(3))
def test_one_free_picture_that_was_moved_moves_no_contact(number: int) -> None:
    """By a pixel, among ten and more: what drift may do, but the other free frames know better."""
    was = clean_recording(KINDS[number], 5)
    frames, free = list(was.frames), np.flatnonzero(was.free)
    row = int(free[np.random.default_rng(number).integers(10)])
    frames[row] = replace(frames[row], points_px=frames[row].points_px + np.array([0.6, 0.8]))
    for before, after in zip(*(ContactEstimator(was.rig).run(each) for each in (was.frames, frames)), strict=True):
        if before.status == after.status == "ok":
            assert abs(before.distance_m - after.distance_m) < 0.3 * before.distance_std_m
            assert (np.abs(before.force_N - after.force_N)[1:] < 0.3 * before.force_std_N[1:]).all()
