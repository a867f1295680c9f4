"""The calibration benchmark: its rigs, its judge, its table."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from benchmarks.board_faults import FAULTS
from benchmarks.boards import draw, error_mm, rigs
from benchmarks.calibration.calibration import STYLES, run
from benchmarks.calibration.judge import judged
from benchmarks.calibration.methods import ORACLE, SOLVERS, Outcome
from vbaa_calib.geometry import Pose


def test_the_judge_reports_a_wrong_lens_at_its_size() -> None:
    """A centre that is 2 px off moves every point on C by about 2 px; a pose from the jig takes that up."""
    truth = rigs()[1].camera
    assert error_mm(truth, truth) < 1e-9
    off = dataclasses.replace(truth, matrix=truth.matrix + np.array([[0, 0, 0], [0, 0, 2.0], [0, 0, 0]]))
    assert error_mm(off, truth) == pytest.approx(2.0 / 2800 * 400, rel=0.15)
    assert error_mm(off, truth, from_jig=True) < 0.1 * error_mm(off, truth)


@pytest.mark.parametrize("kind", FAULTS)
def test_faults_are_as_many_as_they_say_and_all_are_known(kind: str) -> None:
    """Corners that are called good lie where the true board has them, within the noise, the others do not."""
    rig = dataclasses.replace(rigs()[0], views=60, outliers=0.1, faults=kind, outlier_px=(3.0, 100.0))
    given = draw(rig, 7)
    again = draw(rig, 7)
    assert all(
        np.array_equal(one.corners_px, two.corners_px) for one, two in zip(given.views, again.views, strict=True)
    )
    assert 0.07 < 1 - np.mean(np.concatenate(given.good)) < 0.13
    for view, good, pose in zip(given.views, given.good, given.poses, strict=True):
        pixels, _ = rig.camera.project(Pose.from_rotvec(pose[:3], pose[3:]) @ rig.board_points_m[view.ids])
        off = np.linalg.norm(view.corners_px - pixels, axis=1)
        assert np.all(off[good] < 6 * rig.noise_px)
        assert np.all(off[~good] > 3.0 - 6 * rig.noise_px)


def test_boards_and_noise_are_as_wrong_as_they_say() -> None:
    plain = rigs()[0]
    rig = dataclasses.replace(plain, stretch=(0.01, -0.02), shear=0.003, sagittas_m=(1e-3, 0.0), twist_m=5e-4)
    truth, board = plain.board_points_m, rig.board_points_m
    np.testing.assert_allclose(board[:, 0], 1.01 * truth[:, 0] + 0.003 * truth[:, 1])
    np.testing.assert_allclose(board[:, 1], 0.98 * truth[:, 1])
    rise = board[:, 2].reshape(7, 10)
    assert rise[0, 0] - rise[0, -1] == pytest.approx(1e-3)
    assert np.mean(rise[:, [0, -1]]) - np.mean(rise[:, 4:6]) == pytest.approx(1e-3, rel=0.05)
    for noise_px, blur, tails in ((0.05, 0.0, np.inf), (0.3, 0.0, 3.0), (0.1, 0.8, np.inf)):
        given = draw(dataclasses.replace(plain, noise_px=noise_px, blur=blur, tails=tails), 8)
        each, lengths = [], []
        for view, pose in zip(given.views, given.poses, strict=True):
            off = view.corners_px - plain.camera.project(Pose.from_rotvec(pose[:3], pose[3:]) @ truth[view.ids])[0]
            each.append(np.std(off))
            lengths.append(np.linalg.norm(off, axis=1))
        assert np.exp(np.std(np.log(each))) == pytest.approx(np.exp(blur), rel=0.3)
        assert np.exp(np.mean(np.log(each))) == pytest.approx(noise_px, rel=0.5 if blur else 0.2)
        far = np.quantile(np.concatenate(lengths), 0.999) / np.median(np.concatenate(lengths))
        assert (far > 6.0) == (blur > 0.0 or np.isfinite(tails))


def test_the_judge_believes_only_deviations_that_hold_the_truth() -> None:
    """Lenses drawn from a covariance err by it and are covered; with a deviation three times too small they are not."""
    rig, rng = rigs()[0], np.random.default_rng(9)
    given = draw(rig, 9)
    root = np.diag([0.5, 0.5, 0.4, 0.4, 1e-3, 5e-3, 1e-4, 1e-4, 1e-2])
    for small in (1.0, 3.0):
        found = []
        for _ in range(60):
            camera = rig.camera.moved(root @ rng.normal(size=9))
            camera = dataclasses.replace(camera, covariance=(root / small) @ (root / small).T)
            found.append(judged("", 9, "", Outcome(camera, 0.0, trusted=True), given))
        for stated, covered in (("stated", "covered"), ("jig_stated", "jig_covered")):
            ratio = np.sqrt(np.mean([getattr(one, stated) ** 2 for one in found]))
            assert ratio == pytest.approx(small, rel=0.25)
            inside = np.mean([getattr(one, covered) for one in found])
            assert 0.88 < inside <= 1.0 if small == 1.0 else inside < 0.75
        wrong = np.mean([one.wrong for one in found])
        assert wrong < 0.02 if small == 1.0 else wrong > 0.1


@pytest.mark.slow
def test_the_table_holds_every_method() -> None:
    chosen = ["f 900, mild barrel, 25 views", "f 900, 5 % outliers, bowed 0.5 mm", "drawn: fisheye"]
    rows = run(1, 5, chosen)
    methods = {row.method for row in rows}
    assert methods == {*SOLVERS, "lensboy", "mrcal"} == set(STYLES)
    assert len(rows) == len(chosen) * len(methods)
    for row in rows:
        assert row.error_mm is not None or row.note
        assert row.method != ORACLE or row.ratio == 1.0
    spoilt = {row.method: row for row in rows if "outliers" in row.cell}
    assert spoilt["OpenCV"].jig_ratio > 3 * spoilt["ours, lens given"].jig_ratio
    assert spoilt["ours, auto"].outliers_found == 1.0
