"""Readings at the instants of pictures: the laws of interpolation, and that nothing is used in silence."""

from __future__ import annotations

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vbaa_calib.core.errors import InputError
from vbaa_calib.streams import Reading, Synchronizer, Taken, Timing
from vbaa_calib.streams import now_s as steady_s
from vbaa_calib.streams.recorded import line_messages
from vbaa_calib.streams.synchronize import Synchronized

PICTURE = np.zeros((4, 6), np.uint8)


def taken(time_s: float, arrived_s: float | None = None, image: np.ndarray = PICTURE) -> Taken:
    return Taken(time_s, image, time_s if arrived_s is None else arrived_s)


def moment(time_s: float, value: float, arrived_s: float | None = None) -> Reading:
    return Reading(time_s, "moment_Nm", value, time_s if arrived_s is None else arrived_s)


def through(synchronizer: Synchronizer, *messages: Taken | Reading) -> list[Synchronized]:
    found = [each for message in messages for each in synchronizer.push(message)]
    return [*found, *synchronizer.finish()]


@given(
    st.lists(st.floats(0.001, 0.09), min_size=2, max_size=30),
    st.floats(-0.5, 0.5),
    st.floats(-1e-2, 1e-2),
    st.floats(0.0, 1.0),
    st.floats(-3.0, 3.0),
)
@settings(max_examples=60, deadline=None)
def test_a_line_is_interpolated_exactly(
    steps: list[float], slope: float, value: float, share: float, offset_s: float
) -> None:
    """Whatever the readings' times and the clocks' offset: between readings on a line the picture's lies on it."""
    times = 100.0 + np.cumsum(steps)
    at = times[0] + share * (times[-1] - times[0])
    readings = [moment(t - offset_s, value + slope * (t - 100.0), t) for t in times]
    (found,) = through(Synchronizer(Timing(offset_s=offset_s)), *readings, taken(at, times[-1]))
    assert found.frame.moment_Nm == pytest.approx(value + slope * (at - 100.0), abs=1e-12)
    assert found.age_s <= max(steps) + 1e-12


def test_readings_as_far_apart_as_the_gap_count_however_times_are_rounded() -> None:
    """Ten readings a second and the usual gap of a tenth; pictures at the same instants, in a video's whole
    milliseconds: 0.3 lies before 3 · 0.1."""
    synchronizer = Synchronizer(Timing(), ["moment_Nm"])
    readings = [moment(number * 0.1, 1e-3 * number) for number in range(40)]
    found = through(synchronizer, *readings, *(taken(round(number * 0.1, 3)) for number in range(40)))
    assert [each.frame.moment_Nm for each in found] == pytest.approx([1e-3 * number for number in range(40)], abs=1e-9)


def test_a_reading_at_the_very_instant_is_taken_as_it_is() -> None:
    synchronizer = Synchronizer(Timing(), ["moment_Nm"])
    list(synchronizer.push(moment(1.0, 0.1 + 0.2)))
    (found,) = synchronizer.push(taken(1.0))
    assert (found.frame.moment_Nm, found.age_s) == (0.1 + 0.2, 0.0)


def test_nothing_is_made_up() -> None:
    """Before the first reading, after the last, and in a gap a picture has none."""
    synchronizer = Synchronizer(Timing(gap_s=0.1, wait_s=0.0))
    found = through(
        synchronizer,
        moment(1.0, 1e-3),
        moment(1.2, 2e-3),
        *(taken(t, 2.0) for t in (0.9, 1.1, 1.3)),
        moment(1.35, 3e-3),
    )
    assert [np.isnan(each.frame.moment_Nm) for each in found] == [True, True, True]
    assert synchronizer.counts["pictures without a moment"] == 3
    assert synchronizer.counts["readings late"] == 0


def test_a_container_that_rounds_to_milliseconds_loses_no_reading() -> None:
    (found,) = through(Synchronizer(Timing()), moment(1.0, 1e-3), taken(1.0004, 2.0))
    assert found.frame.moment_Nm == 1e-3
    assert found.age_s == pytest.approx(4e-4)


def test_a_picture_waits_for_what_comes_after_it_and_no_longer() -> None:
    synchronizer = Synchronizer(Timing(wait_s=0.2), ["moment_Nm"])
    assert not list(synchronizer.push(moment(0.98, 1e-3)))
    assert not list(synchronizer.push(taken(1.0)))
    assert not list(synchronizer.ready(1.19))
    (found,) = synchronizer.push(moment(1.02, 3e-3))
    assert found.frame.moment_Nm == pytest.approx(2e-3)
    assert not list(synchronizer.push(taken(1.1)))
    (found,) = synchronizer.ready(1.31)
    assert np.isnan(found.frame.moment_Nm)
    list(synchronizer.push(moment(1.09, 3e-3, 1.4)))
    assert synchronizer.counts["readings late"] == 1


def test_what_is_left_out_is_counted() -> None:
    synchronizer = Synchronizer(Timing(), image_size=(6, 4))
    through(
        synchronizer,
        *(moment(t, 1e-3) for t in (1.0, 1.1, 1.1, 1.05, np.nan)),
        moment(1.2, np.inf),
        moment(1.2, 1e9),
        *(taken(t) for t in (1.0, 1.1, 1.1, 1.05, np.nan)),
        taken(1.2, image=np.zeros((5, 6), np.uint8)),
    )
    counts = {name: count for name, count in synchronizer.counts.items() if count}
    assert counts == {
        "readings": 2,
        "readings doubled": 1,
        "readings out of order": 1,
        "readings that cannot be": 3,
        "pictures": 2,
        "pictures doubled": 1,
        "pictures out of order": 2,
        "pictures of another size": 1,
    }
    assert len(synchronizer.left_out()) == 6


def test_another_camera_is_refused_at_once() -> None:
    with pytest.raises(InputError, match="6x5 px, the rig's camera 6x4"):
        list(Synchronizer(Timing(), image_size=(6, 4)).push(taken(1.0, image=np.zeros((5, 6), np.uint8))))


def test_memory_does_not_grow_with_readings() -> None:
    synchronizer = Synchronizer(Timing())
    for index in range(20_000):
        list(synchronizer.push(moment(1e-3 * index, 1e-3)))
    assert len(synchronizer._channels["moment_Nm"].times) < 10_000


def error_of(timing: Timing, at: float, *readings: Reading) -> float:
    (found,) = through(Synchronizer(timing), *readings, taken(at, 9.0))
    return found.frame.moment_errors_Nm[0]


@given(st.floats(0.01, 0.99), st.floats(-1e-2, 1e-2), st.floats(-1.0, 1.0))
@settings(max_examples=60, deadline=None)
def test_a_steady_rate_has_no_error_of_interpolation(share: float, value: float, slope: float) -> None:
    readings = [moment(t, value + slope * (t - 1.0)) for t in (1.0, 1.05, 1.1)]
    assert error_of(Timing(), 1.05 + 0.05 * share, *readings) < 1e-9
    # the clocks' deviation has: as much as the reading changes within it
    timing = Timing(offset_std_s=0.004)
    assert error_of(timing, 1.05 + 0.05 * share, *readings) == pytest.approx(0.004 * abs(slope), abs=1e-9)


def test_the_error_grows_with_the_gap_and_is_true() -> None:
    """Readings of a sine at several rates, with their noise: what is interpolated is as far off as its deviation."""
    rng, std = np.random.default_rng(0), 2e-5
    sizes = []
    for step in (0.005, 0.02, 0.05, 0.09):
        times = 1.0 + np.arange(0.0, 20.0, step)
        values = 5e-3 * np.sin(5.0 * times) + rng.normal(0.0, std, len(times))
        synchronizer = Synchronizer(Timing(moment_std_Nm=(std, 0.0)))
        readings = [moment(t, v) for t, v in zip(times, values, strict=True)]
        pictures = [taken(t, t + 0.2) for t in np.arange(1.5, 20.0, 0.0337)]
        found = through(synchronizer, *sorted([*readings, *pictures], key=lambda each: each.arrived_s))
        off = np.array([each.frame.moment_Nm - 5e-3 * np.sin(5.0 * each.frame.time_s) for each in found])
        stated = np.hypot(std, [each.frame.moment_errors_Nm[0] for each in found])
        sizes.append(np.mean(stated))
        assert np.mean(np.abs(off) < 2.0 * stated) > 0.93
    assert sizes == sorted(sizes)
    assert sizes[0] < 1.2 * std
    assert sizes[-1] > 2.0 * std


def test_readings_at_the_pictures_instants_have_no_error() -> None:
    assert error_of(Timing(), 1.05, moment(1.0, 1e-3), moment(1.05, 5e-3), moment(1.1, 1e-3)) == 0.0


def test_a_clock_that_is_set_back_holds_nothing_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """By an hour, as a day's first synchronization may: lines that name no time are timed on as before."""
    list(line_messages(b'{"moment_Nm": 0}', None))
    now_s = time.time()
    monkeypatch.setattr(time, "time", lambda: now_s - 3600.0)
    (first,), (second,) = (list(line_messages(b'{"moment_Nm": 0.1}', None)) for _ in range(2))
    assert now_s - 1.0 <= first.time_s <= second.time_s
    synchronizer = Synchronizer(Timing(wait_s=0.0), ["moment_Nm"])
    found = [*synchronizer.push(first), *synchronizer.push(taken(first.time_s)), *synchronizer.ready(steady_s())]
    assert [each.frame.moment_Nm for each in found] == [0.1]
