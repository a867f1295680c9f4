"""The offset of the readings' clock: found within its deviation, or refused where the data do not show it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from estimator import ContactEstimator
from estimator.contact import clock
from estimator.contact.clock import _clock_offset as clock_offset
from estimator.contact.clock import _ClockOffset as ClockOffset
from estimator.contact.clock import _ClockSettings as ClockSettings
from estimator.contact.clock import recorded_clock_offset
from estimator.table.contacts import Measured
from vbaa_calib.core.errors import InputError
from vbaa_calib.session import Frame
from vbaa_calib.streams import MessageSource, Taken, Timing

from ..rod_scenes import RIG_STD, World, camera_pose
from .pressing import WORLD, Motion, pictures, readings

LENGTH_S = 7.0


def estimator() -> ContactEstimator:
    return ContactEstimator(WORLD.rig(0.25 * RIG_STD), jobs=1)


@cache
def recorded(seed: int, picture_Hz: float, reading_Hz: float) -> tuple[list[Measured], np.ndarray, np.ndarray]:
    """Pictures, and times and values of readings, all on one clock."""
    rng = np.random.default_rng(seed)
    motion = Motion.drawn(rng, LENGTH_S + 2.0)
    times_s = np.arange(-1.2, LENGTH_S + 1.2, 1.0 / reading_Hz) + rng.uniform(0.0, 1.0 / reading_Hz)
    at = np.arange(0.0, LENGTH_S, 1.0 / picture_Hz)
    return pictures(motion, at, rng), times_s, readings(motion, times_s, rng)


def found(seed: int, offset_s: float, picture_Hz: float = 30.0, reading_Hz: float = 97.0) -> ClockOffset:
    several, times_s, values = recorded(seed, picture_Hz, reading_Hz)
    return clock_offset(estimator(), several, times_s - offset_s, values)


@pytest.mark.parametrize(
    ("offset_s", "picture_Hz", "reading_Hz"),
    [
        (0.012, 30.0, 30.0),
        (0.4, 15.0, 40.0),
        pytest.param(0.0, 30.0, 97.0, marks=pytest.mark.slow),
        pytest.param(-0.08, 30.0, 210.0, marks=pytest.mark.slow),
        pytest.param(-0.7, 60.0, 25.0, marks=pytest.mark.slow),
    ],
)
def test_an_injected_offset_is_found(offset_s: float, picture_Hz: float, reading_Hz: float) -> None:
    """Whatever its size and the rates, also where readings and pictures come in step; and with a useful deviation."""
    one_s, std_s, _ = found(1, offset_s, picture_Hz, reading_Hz)
    assert abs(one_s - offset_s) < 3.5 * std_s
    assert std_s < 0.25 / picture_Hz


@pytest.mark.parametrize(
    ("draws", "fewest", "least", "most"), [(5, 4, 0.3, 1.9), pytest.param(16, 13, 0.5, 1.5, marks=pytest.mark.slow)]
)
def test_the_deviation_covers_what_is_off(draws: int, fewest: int, least: float, most: float) -> None:
    offsets = np.random.default_rng(5).uniform(-0.3, 0.3, draws)
    several = [found(seed, offset_s) for seed, offset_s in enumerate(offsets)]
    off = np.array([(one_s - offset_s) / std_s for (one_s, std_s, _), offset_s in zip(several, offsets, strict=True)])
    assert np.sum(np.abs(off) < 2.0) >= fewest
    assert least < np.sqrt(np.mean(off**2)) < most


def test_what_the_data_do_not_show_is_refused() -> None:
    """A sensor that is not connected, readings of something else, no overlap, an offset out of reach, few pictures."""
    several, times_s, values = recorded(1, 30.0, 97.0)
    other = recorded(2, 30.0, 97.0)[2]
    still = np.random.default_rng(0).normal(values[0], WORLD.sensor.std_Nm, len(values))
    for why, given in {
        "hardly changes": (several, times_s, still),
        "follow the bend|about as well|known to": (several, times_s, other[: len(values)]),
        "hardly overlap": (several, times_s + 100.0, values),
        "search ends|about as well|follow the bend": (several, times_s - 1.8 * ClockSettings.farthest_s, values),
        "pictures show": (several[:20], times_s, values),
        "readings": (several, times_s[:3], values[:3]),
    }.items():
        with pytest.raises(InputError, match=why):
            clock_offset(estimator(), *given)


@pytest.mark.parametrize(("offset_s", "rate_Hz"), [pytest.param(0.137, 24.0, marks=pytest.mark.slow), (-2000.0, 30.0)])
def test_another_cameras_clock_is_found(offset_s: float, rate_Hz: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """From the bend that both cameras see from different sides, at other rates; also clocks that are far apart."""
    other, rng = World(camera_pose(-0.5, 0.4)), np.random.default_rng(2)
    motion = Motion.drawn(rng, LENGTH_S + 2.0)
    front, side = WORLD.rig(0.25 * RIG_STD), other.rig(0.25 * RIG_STD)
    rig = replace(front, others={"side": side})
    seen: dict[str, list[Measured]] = {}
    for name, world, begin_s, rate in ((rig.camera_name, WORLD, 0.0, 30.0), ("side", other, 0.013, rate_Hz)):
        seen[name] = pictures(motion, np.arange(begin_s, LENGTH_S, 1.0 / rate), rng, world)

    def opened(about_s: float) -> MessageSource:
        clock_s = {rig.camera_name: 0.0, "side": about_s - offset_s}
        taken = []
        for name, several in seen.items():
            for index, each in enumerate(several):
                image = np.zeros(front.camera.image_size[::-1], np.uint8)
                image[0, 0], image[0, 1] = divmod(index, 256)  # so that a picture is known again
                taken.append(Taken(each.time_s + clock_s[name], image, each.time_s, camera=name))
        return MessageSource("recording", lambda: (each for each in sorted(taken, key=lambda one: one.arrived_s)))

    def detected(
        own: ContactEstimator, taken: Iterable[tuple[Frame, np.ndarray]], _: object
    ) -> Iterator[SimpleNamespace]:
        for frame, image in taken:
            index = 256 * int(image[0, 0]) + int(image[0, 1])
            measured = replace(seen[own.rig.camera_name][index], time_s=frame.time_s)
            yield SimpleNamespace(line=SimpleNamespace(found=True), measured=measured)

    monkeypatch.setattr(clock, "detected", detected)
    timing = Timing(joints_rad=(0.0, 0.3))
    one_s, std_s, _ = recorded_clock_offset(ContactEstimator(rig, jobs=1), opened, timing, None, "side")
    assert abs(one_s - offset_s) < 3.5 * std_s
    assert std_s < 0.01
