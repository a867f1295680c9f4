"""From a recording's files to the estimator and back: what is handed over, in which order, and how much at a time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import islice

import numpy as np

from estimator.contact.recording import estimate_centrelines
from estimator.table.contacts import FRICTION_RAD, Contact, Measured
from tests.estimator.drawn_frames import rig_of
from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.rig import Rig
from vbaa_calib.session import Frame
from viz.cli import estimate as cli

FRAMES = [
    Frame(None, 0.01 * n, -0.02 * n, 1e-3 * n, frame=10 + n, time_s=0.1 * n, moment_z_Nm=-1e-3 * n) for n in range(10)
]
SIGMAS = [0.1, 0.2, np.nan, 0.3]
LINES = {frame.frame: np.column_stack([np.full((4, 2), float(frame.frame)), SIGMAS]) for frame in FRAMES}


class Chunked:
    """Stands in for an estimator that takes its frames four at a time and answers with each frame's own time."""

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.taken: list[Measured] = []

    def run(self, recording: Iterable[Measured]) -> Iterator[Contact]:
        rest = iter(recording)
        while chunk := list(islice(rest, 4)):
            self.taken += chunk
            yield from (
                Contact(status="ok", reason=f"{seen.time_s:.1f}", model="rod", in_contact=True) for seen in chunk
            )


def test_every_frame_gets_its_own_contact() -> None:
    estimator = Chunked(rig_of((320, 240)))
    found = list(estimate_centrelines(estimator, FRAMES, LINES))
    assert [item.frame for item in found] == FRAMES
    assert [item.contact.reason for item in found] == [f"{frame.time_s:.1f}" for frame in FRAMES]
    for item in found:
        seen = item.measured
        assert seen is not None
        assert (seen.points_px == item.frame.frame).all()
        noise = estimator.rig.image.noise_px
        np.testing.assert_array_equal(seen.sigma_px, [0.1, 0.2, noise, 0.3])
        expected = item.frame
        assert (seen.moment_Nm, seen.moment_z_Nm) == (expected.moment_Nm, expected.moment_z_Nm)
        assert (seen.pan_rad, seen.tilt_rad, seen.time_s) == (expected.pan_rad, expected.tilt_rad, expected.time_s)


def test_frames_are_made_when_they_are_asked_for() -> None:
    estimator = Chunked(rig_of((320, 240)))
    found = estimate_centrelines(estimator, FRAMES, LINES)
    assert not estimator.taken
    assert [item.frame.frame for item in islice(found, 5)] == [10, 11, 12, 13, 14]
    assert len(estimator.taken) == 8


def test_the_command_offers_what_the_estimator_takes() -> None:
    """It names them without importing the estimator, for the sake of a quick --help."""
    assert ("auto", *RUNGS) == cli.MODELS
    assert cli.FRICTION_RAD == FRICTION_RAD
