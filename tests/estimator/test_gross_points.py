"""Points that are not the antenna's: outside the picture they are missing ones, inside one of them moves no contact."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from estimator import Contact, ContactEstimator
from estimator.table.contacts import Measured

from ..recordings import write_rig
from ..rod_scenes import SIGMA_PX, Frame
from .contact_scenes import RIG, frame

SIZE = np.array(RIG.camera.image_size)
FAR = [(65535.0, 65535.0), (1e4, 300.0), (-500.0, 300.0), (400.0, 1e6), (-1e7, -1e7)]


def measured(seen: Frame, points_px: np.ndarray, sigma_px: np.ndarray | float = SIGMA_PX) -> Measured:
    return Measured(points_px, np.full(len(points_px), sigma_px) * 1.0, seen.moment_Nm, 0.0, seen.tilt_rad)


def numbers(contact: Contact) -> tuple[object, ...]:
    return contact.status, contact.distance_m, contact.distance_std_m, *contact.force_N, *contact.force_std_N


def test_points_outside_the_picture_are_missing_ones() -> None:
    """Bit for bit, in every call; counted, and said in the reason."""
    estimator, seen = ContactEstimator(RIG), frame()
    line, rng = seen.points_px, np.random.default_rng(0)
    for far in FAR:
        several = rng.choice(len(line), rng.integers(1, 20), replace=False)
        wrong, missing = line.copy(), line.copy()
        wrong[several], missing[several] = far, np.nan
        joints = {"moment": seen.moment_Nm, "pan": 0.0, "tilt": seen.tilt_rad}
        one, other = (estimator.estimate(each, **joints) for each in (wrong, missing))
        assert numbers(one) == numbers(other)
        assert one.outside_points == len(several)
        assert f"{len(several)} point" in one.reason
        assert other.outside_points == 0
        again = estimator.measure(measured(seen, wrong)), *estimator.run([measured(seen, wrong)])
        assert {numbers(each) for each in again} == {numbers(estimator.measure(measured(seen, missing)))}
        assert {each.outside_points for each in again} == {len(several)}
    batch = estimator.estimate_batch([line, wrong], [seen.moment_Nm] * 2, [0.0] * 2, [seen.tilt_rad] * 2)
    assert batch.outside_points.tolist() == [0, len(several)]


@pytest.mark.parametrize("shown", [1.0, 0.65])
def test_no_gross_point_moves_a_contact(shown: float) -> None:
    """One anywhere in the picture, also one that claims to be precise, where the antenna is seen in whole or in part:
    less than a third of a standard deviation."""
    estimator, rng = ContactEstimator(RIG), np.random.default_rng(7)
    for roll in (-2.0, 0.4, 1.5):
        seen = frame(contact=0.6, roll=roll)
        line = seen.points_px[: int(shown * len(seen.points_px))]
        sound = estimator.measure(measured(seen, line))
        assert sound.status == "ok"
        for sigma_px in (SIGMA_PX, 1e-3, 1e-6):
            for _ in range(4):
                wrong, own, at = line.copy(), np.full(len(line), SIGMA_PX), rng.integers(len(line))
                wrong[at], own[at] = rng.uniform(0.0, 1.0, 2) * SIZE, sigma_px
                contact = estimator.measure(measured(seen, wrong, own))
                assert contact.status == "ok", contact.reason
                assert abs(contact.distance_m - sound.distance_m) < sound.distance_std_m / 3
                assert (np.abs(contact.force_N - sound.force_N) < sound.force_std_N / 3).all()


def test_one_point_in_twenty_may_be_gross() -> None:
    """Half a standard deviation; the count is in the reason. Sound frames lose no point."""
    estimator, seen, rng = ContactEstimator(RIG), frame(), np.random.default_rng(3)
    sound = estimator.measure(measured(seen, seen.points_px))
    assert "left out" not in sound.reason
    count = len(seen.points_px) // 20
    for _ in range(4):
        wrong = seen.points_px.copy()
        wrong[rng.choice(len(wrong), count, replace=False)] = rng.uniform(0.0, 1.0, (count, 2)) * SIZE
        contact = estimator.measure(measured(seen, wrong))
        assert contact.status == "ok"
        assert abs(contact.distance_m - sound.distance_m) < sound.distance_std_m / 2
        assert "far from where the neighbours lie: left out" in contact.reason


@pytest.mark.parametrize("off_px", [0.6, 8.0, 30.0])
def test_a_stretch_that_lies_off_moves_no_contact(off_px: float) -> None:
    """A tenth of the points, to one side: less than a standard deviation, wherever they are; the free antenna stays
    free."""
    estimator, rng = ContactEstimator(RIG), np.random.default_rng(9)
    for tip_m, roll in ((0.01, -2.0), (0.01, 0.4), (0.006, 1.5), (0.0, 0.0)):
        seen = frame(contact=0.6, roll=roll, tip_m=tip_m)
        line, count = seen.points_px, len(seen.points_px) // 10
        sound = estimator.measure(measured(seen, line))
        along = np.gradient(line, axis=0)
        across = np.column_stack([-along[:, 1], along[:, 0]]) / np.linalg.norm(along, axis=1, keepdims=True)
        for _ in range(4):
            wrong, begin = line.copy(), int(rng.integers(0, len(line) - count))
            stretch = slice(begin, begin + count)
            wrong[stretch] += rng.choice([-1.0, 1.0]) * off_px * across[stretch]
            contact = estimator.measure(measured(seen, wrong))
            assert contact.status == sound.status, contact.reason
            if sound.status == "ok":
                assert abs(contact.distance_m - sound.distance_m) < sound.distance_std_m
                assert (np.abs(contact.force_N - sound.force_N) < sound.force_std_N).all()


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    return write_rig(tmp_path / "rig.json")
