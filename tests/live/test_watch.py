"""A rig that is watched while it is in use: a knocked camera is named soon, a sound rig never, and no frame waits."""

from __future__ import annotations

import json
from collections.abc import Iterator
from copy import copy, deepcopy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from estimator.contact.estimate import ContactEstimator
from estimator.diagnose import RecordingVerdict, RigWatch
from estimator.diagnose.service import WatchSettings
from estimator.table.contacts import LOCATED, Contact, Measured
from vbaa_calib.cli.main import main
from vbaa_calib.core.errors import Diagnosis, Verdict
from vbaa_calib.session import DRIFTS

from ..rod_scenes import LENGTH_M, MATRIX, RIG_STD, SIGMA_PX, World, camera_pose, frames, pushing, seen
from ..small_scene import small_rig
from .recordings import write

KNOCKED = Diagnosis("camera_turned", "the camera has turned by 0.06°", "calibrate again", "wrong")
BEFORE, AFTER = 40, 42
CAMERA = ("camera_turned", "picture_moved", "camera_moved", "focus_changed", "picture_scaled")
"""What a knock of a pixel may first look like: the part of the rig is right."""


class Bench:
    """A rig off by a draw of its own covariance, in use: strokes of an antenna that is free most of the time."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        world = World(camera_pose(self.rng.uniform(0.0, 0.8), self.rng.uniform(0.0, 2.0 * np.pi)))
        self.true = world.moved(self.rng.normal(0.0, RIG_STD))
        self.rig = replace(world.rig(), drift=DRIFTS["lab"])

    def knocked(self, by_px: float) -> World:
        """With the camera turned about any axis until the free antenna has moved in the picture by so much, rms."""
        axis = self.rng.normal(size=3)
        step = np.zeros(len(RIG_STD))
        step[:3] = axis / np.linalg.norm(axis) / MATRIX[0, 0]
        wire = np.linspace([0.0, 0.0, 0.0], [LENGTH_M, 0.0, 0.0], 9)
        shift = seen(self.true.moved(step).T_antenna_camera, wire) - seen(self.true.T_antenna_camera, wire)
        return self.true.moved(step * by_px / np.sqrt(np.mean(np.sum(shift**2, axis=1))))

    def frames(self, world: World, count: int, free: float) -> list[Measured]:
        """So many frames of a world, this part of them free; the points of each line share an error, too."""
        places = (self.rng.uniform(0.3, 0.95, count) * LENGTH_M).tolist()
        pushes = [
            [0.0, 0.0]
            if self.rng.random() < free
            else pushing(self.rng.uniform(0.0, 6.28), self.rng.uniform(3e-3, 0.02), place).tolist()
            for place in places
        ]
        tilts = self.rng.uniform(-0.3, 0.5, count).tolist()
        along, found = np.linspace(-1.0, 1.0, 150)[:, None], []
        for frame in frames(world, places, pushes, tilts, self.rng, points=150):
            offset, slope = self.rng.normal(0.0, 0.003, 2)
            points = frame.points_px + (offset + slope * along) * [0.4, 0.9]
            found.append(Measured(points, np.full(150, SIGMA_PX), frame.moment_Nm, 0.0, frame.tilt_rad))
        return found

    def alarms(self, several: list[Measured]) -> tuple[list[tuple[int, Diagnosis]], list[Contact]]:
        """What the watch says of these frames until its first alarm, and the contacts of all."""
        contacts = list(ContactEstimator(self.rig, jobs=1).run(several))
        watch = RigWatch(self.rig, waits=True)
        for measured, contact in zip(several, contacts, strict=True):
            watch.push(measured, contact)
            if watch.alarms:
                break
        watch.close()
        return watch.alarms, contacts


def judged(seed: int, before: int = BEFORE, after: int = AFTER) -> tuple[int, int | None]:
    """Alarms before the camera is knocked by 1 px, and the frames without contact after it until it is named."""
    bench = Bench(seed)
    several = bench.frames(bench.true, before, 0.6) + bench.frames(bench.knocked(1.0), after, 0.75)
    alarms, contacts = bench.alarms(several)
    named = [(frame, one.name) for frame, one in alarms if frame >= before]
    free = None
    if named and named[0][1] in CAMERA:
        free = sum(contact.status not in LOCATED for contact in contacts[before : named[0][0] + 1])
    return len(alarms) - len(named), free


def test_a_camera_knocked_by_a_pixel_is_named_within_thirty_free_frames() -> None:
    early, free = judged(0, 16, 34)
    assert early == 0
    assert free is not None
    assert free <= 30


@pytest.mark.slow
def test_many_knocks() -> None:
    """In twenty rigs: none beforehand; of two, one takes 32 frames and one may be the clamp or the camera."""
    found = [judged(seed) for seed in range(20)]
    assert sum(early for early, _ in found) == 0
    assert sum(free is not None and free <= 30 for _, free in found) >= 18


@pytest.mark.slow
def test_a_sound_rig_has_no_alarm() -> None:
    """In 30 rigs of 240 frames each, judged 900 times; nor do the odds come near one."""
    odds = []
    for seed in range(30):
        bench = Bench(1000 + seed)
        alarms, contacts = bench.alarms(several := bench.frames(bench.true, 240, 0.5))
        assert alarms == [], seed
        watch = RigWatch(bench.rig)
        numbered = list(zip(range(240), several, contacts, strict=True))
        odds += [watch._judged(numbered[begin : begin + 60])[0].log_odds for begin in range(0, 240, 60)]
    assert max(odds) < 0.7 * WatchSettings.least_log_odds


@pytest.mark.slow
def test_of_several_cameras_the_knocked_one_is_named() -> None:
    """None before; by 1 px, within thirty frames."""
    bench = Bench(0)
    right, pose = copy(bench), camera_pose(0.6, 2.0)
    right.true, right.rig = replace(bench.true, T_antenna_camera=pose), replace(bench.rig, T_antenna_camera=pose)
    bench.rig, several = replace(bench.rig, others={"right": right.rig}), list[Measured]()
    for world in (right.true, right.knocked(1.0)):
        right.rng = deepcopy(bench.rng)
        both = zip(bench.frames(bench.true, BEFORE, 0.6), right.frames(world, BEFORE, 0.6), strict=True)
        several += [replace(one, others={"right": replace(one, points_px=other.points_px)}) for one, other in both]
    frame, cause = bench.alarms(several)[0][0]
    assert BEFORE <= frame < BEFORE + 30
    assert cause.words.startswith("right: the camera")


def told(*verdicts: tuple[str, float]) -> Iterator[tuple[RecordingVerdict, str, float]]:
    """Judgements: the name of a cause and its log odds; no cause where it is empty."""
    for name, log_odds in verdicts:
        found = Verdict.of([replace(KNOCKED, name=name)]) if name else Verdict()
        yield RecordingVerdict(found, 0, frozenset(), log_odds), "", 0.0


@pytest.fixture
def alarmed(monkeypatch: pytest.MonkeyPatch) -> None:
    """All judgements are that the camera was knocked."""
    monkeypatch.setattr(RigWatch, "_judged", lambda *_: next(told(("camera_turned", 40.0))))


@pytest.mark.usefixtures("alarmed")
def test_an_alarm_reaches_every_output(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rig, bag = str(small_rig() / "rig.json"), str(write(tmp_path / "in.mcap"))
    assert main(["live", rig, bag, "--watch", "--lines", "--bag", str(tmp_path / "out.mcap"), "--gap", "0.5"]) == 1
    out, err = capsys.readouterr()
    lines = [json.loads(line) for line in out.splitlines()]
    with_alarm = [line for line in lines if "alarms" in line]
    assert [line["alarms"][0]["name"] for line in with_alarm] == ["camera_turned"]
    assert not with_alarm[0]["final"]
    assert "alarm, frame " in err
    assert b"/contact/alarm" in (tmp_path / "out.mcap").read_bytes()
