"""A reading in a wrong unit, or a joint that is somewhere else, costs no more memory than a sound one."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from estimator import Contact, ContactEstimator
from estimator.contact.recording import estimate_pictures
from estimator.table.contacts import STATUSES, Measured
from vbaa_calib.core.arrays import LARGEST_NM
from vbaa_calib.detect.whisker.corridor import Corridor
from vbaa_calib.detect.whisker.finder import AntennaFinder
from vbaa_calib.session import Frame

from ..fuzz.test_memory import taken
from ..rod_scenes import SIGMA_PX
from .contact_scenes import RIG, frame
from .drawn_frames import frame_of, picture, rig_of, shape

SIZE_PX = (320, 240)
linux = pytest.mark.skipif(sys.platform != "linux", reason="Linux alone reports the peak of memory")


def replaced(frame: Frame, number: int, moment_Nm: float, joints: np.ndarray) -> Frame:
    """The same picture with other readings."""
    return replace(
        frame, frame=number, time_s=float(number), moment_Nm=moment_Nm, pan_rad=joints[0], tilt_rad=joints[1]
    )


@linux
@pytest.mark.parametrize("bright", [True, None])
def test_no_reading_and_no_joint_angle_costs_memory(tmp_path: Path, bright: bool | None) -> None:
    """Moments of any size and sign, and any joint angles, within what is accepted at all."""
    rig, rng = rig_of(SIZE_PX), np.random.default_rng(5)
    rig = replace(rig, image=replace(rig.image, bright=bright))
    estimator = ContactEstimator(rig)
    bent = shape(rig)
    first = frame_of(tmp_path, picture(rig, bent), float(bent.moment_Nm[0]))
    factors = [100.0, -100.0, 1e3, 1e4, *rng.choice([-1, 1], 6) * 10 ** rng.uniform(0.5, 4, 6)]
    moments = first.moment_Nm * np.array(factors)
    moments = np.clip(moments, -LARGEST_NM, LARGEST_NM)
    sound = list(estimate_pictures(estimator, [first]))
    assert sound[0].contact.status == "ok"
    several = [replaced(first, n + 1, moment, rng.uniform(-3, 3, 2) * (n % 2)) for n, moment in enumerate(moments)]
    found: list[str] = []
    most = taken(lambda: found.extend(each.contact.status for each in estimate_pictures(estimator, several)))
    assert most < 3e7
    assert set(found) <= set(STATUSES)
    assert "ok" not in found[:4], "nothing is located by a moment that cannot be"


@linux
def test_a_broad_antenna_is_searched_in_bounded_memory() -> None:
    """Of either polarity: the number of shapes that are tried does not grow with its width."""
    image = np.random.default_rng(2).integers(0, 255, (240, 320)).astype(np.uint8)
    path = np.column_stack([np.linspace(20.0, 300.0, 30), np.full(30, 120.0)])
    narrow, broad = (
        AntennaFinder.prepare(Corridor(path, np.full(30, 100.0), width_px), (320, 240)) for width_px in (4.0, 200.0)
    )
    narrow.shapes(image)
    assert taken(lambda: broad.shapes(image)) < 3e8


@linux
def test_one_frame_of_many_points_makes_no_room_for_as_many_in_all() -> None:
    """A batch is as long as its longest frame; the frames beside it come out as without it."""
    seen = frame()
    one = Measured(seen.points_px, np.full(len(seen.points_px), SIGMA_PX), seen.moment_Nm, 0.0, seen.tilt_rad)
    many = np.tile(seen.points_px, (1000, 1))
    large = replace(one, points_px=many, sigma_px=np.full(len(many), SIGMA_PX))
    estimator = ContactEstimator(RIG, jobs=1)
    alone = estimator.measure(one)
    found: list[Contact] = []
    assert taken(lambda: found.extend(estimator.measure_batch([large, *[one] * 40]))) < 3e8
    assert {contact.distance_m for contact in found[1:]} == {alone.distance_m}
