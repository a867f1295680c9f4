"""Readings at the instants of pictures: the laws of interpolation, and that nothing is used in silence."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vbaa_calib.core.errors import InputError
from vbaa_calib.streams import MessageSource, Reading, Synchronizer, Taken, Timing
from vbaa_calib.streams.messages import Messages
from vbaa_calib.streams.recorded import _with_readings
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


HOUR_S = 3600.0
STREAMS = ("moment_Nm", "pan_rad", "pictures")


def recording(count: int = 300, arrival: str = "arrival") -> list[Taken | Reading]:
    """At 20 pictures/s moment and pan at each picture's instant, a moment of 1 µN·m more each time. They arrive some
    milliseconds later by a clock 1000 s off, by that of the stamps, or as fast as a file is read."""
    several: list[Taken | Reading] = []
    for number in range(count):
        time_s = 50.0 + 0.05 * number
        arrived_s = {"arrival": 1000.0 + time_s + 1e-3 * (number % 7), "stamp": time_s, "file": 1e-5 * number}[arrival]
        several += [moment(time_s, 1e-6 * number, arrived_s), Reading(time_s, "pan_rad", 0.1, arrived_s)]
        several.append(taken(time_s, arrived_s))
    return several


def stream_of(message: Taken | Reading) -> str:
    return message.channel if isinstance(message, Reading) else "pictures"


def restamped(several: list[Taken | Reading], stream: str, numbers: range, by_s: float) -> list[Taken | Reading]:
    """With other stamps of some messages of one stream, or of every one."""
    found, seen = [], dict.fromkeys(STREAMS, 0)
    for each in several:
        if stream in (stream_of(each), "all") and seen[stream_of(each)] in numbers:
            same = isinstance(each, Taken) and each.arrived_s == each.time_s
            each = replace(each, time_s=each.time_s + by_s, arrived_s=each.arrived_s + by_s * same)
        seen[stream_of(each)] += 1
        found.append(each)
    return found


def complete(found: list[Synchronized]) -> list[float]:
    """Of the frames that have all readings: the moments, 1 µN·m each."""
    return [1e6 * each.frame.moment_Nm for each in found if each.frame.moment_Nm >= 0.0 and each.frame.pan_rad == 0.1]


@pytest.mark.parametrize("arrival", ["arrival", "stamp", "file"])
@pytest.mark.parametrize("by_s", [HOUR_S, -HOUR_S, 5.0])
@pytest.mark.parametrize("stream", STREAMS)
@pytest.mark.parametrize("number", [0, 120, 299])
def test_one_wrong_stamp_costs_one_frame(stream: str, by_s: float, arrival: str, number: int) -> None:
    """One among hundreds, or the last; the first one, which nothing is known before, the two after it as well."""
    notes: list[str] = []
    synchronizer = Synchronizer(Timing(), ["moment_Nm", "pan_rad"], notes=notes, live=arrival == "arrival")
    wrong = restamped(recording(arrival=arrival), stream, range(number, number + 1), by_s)
    found = complete(through(synchronizer, *wrong))
    lost = set(range(300)) - set(np.round(found).astype(int))
    assert len(lost) <= (1 if number else 3)
    assert lost <= set(range(number - 1, number + (2 if number else 3)))
    if number == 120:
        side = "ahead" if by_s > 0.0 else "behind"
        assert synchronizer.counts[f"{'pictures' if stream == 'pictures' else 'readings'} stamped {side}"] == 1
        assert len(notes) == 1
        assert stream in notes[0]


@pytest.mark.parametrize("arrival", ["arrival", "stamp", "file"])
@pytest.mark.parametrize("by_s", [HOUR_S, -HOUR_S])
@pytest.mark.parametrize("stream", [*STREAMS, "all"])
def test_a_clock_that_is_set_is_followed(stream: str, by_s: float, arrival: str) -> None:
    """Every picture comes out. Those of a clock of their own have no readings any more, unless all were set."""
    notes: list[str] = []
    synchronizer = Synchronizer(Timing(), ["moment_Nm", "pan_rad"], notes=notes, live=arrival == "arrival")
    found = through(synchronizer, *restamped(recording(arrival=arrival), stream, range(120, 300), by_s))
    assert len(found) == 300
    steps_s = np.diff([each.frame.time_s for each in found])
    assert (steps_s > 0.0).all()
    assert (np.abs(steps_s - 0.05) > 0.02).sum() == (by_s > 0.0 and stream in ("pictures", "all"))
    assert len(complete(found)) >= (297 if stream == "all" else 119)
    assert synchronizer.counts["pictures"] == 300
    if by_s < 0.0 or arrival != "stamp":  # an hour's pause is no jump
        assert len(notes) == (3 if stream == "all" else 1)


@given(st.lists(st.floats(1e-3, 1e5), min_size=1, max_size=40), st.lists(st.floats(0.0, 1e4), min_size=40, max_size=40))
@settings(max_examples=80, deadline=None)
def test_stamps_that_grow_are_never_left_out(steps: list[float], pauses: list[float]) -> None:
    """Whatever the clocks' units, offsets and rates: ms, files that are read at once, hours between pictures."""
    times, arrivals = 50.0 + np.cumsum(steps), np.cumsum(pauses)
    synchronizer = Synchronizer(Timing(wait_s=0.0))
    pairs = [(float(t), float(a)) for t, a in zip(times, arrivals, strict=False)]
    found = through(synchronizer, *(each for t, a in pairs for each in (moment(t, 1e-3, a), taken(t, a))))
    assert [each.frame.time_s for each in found] == [t for t, _ in pairs]
    assert synchronizer.counts["readings"] == len(pairs)
    assert not [name for name in synchronizer.counts if "stamped" in name]


def answered(synchronizer: Synchronizer, several: list[Taken | Reading], ticks: bool) -> list[tuple[float, float]]:
    """When each picture arrived, and when its frame came out, with or without a tick every 20 ms."""
    found = []
    for each, after in zip(several, [*several[1:], None], strict=True):
        until_s = each.arrived_s + 5.0 if after is None else after.arrived_s
        found += [(done.taken.arrived_s, each.arrived_s) for done in synchronizer.push(each)]
        for now_s in np.arange(each.arrived_s, until_s, 0.02)[1:] if ticks else ():
            found += [(done.taken.arrived_s, float(now_s)) for done in synchronizer.ready(float(now_s))]
    return found


@given(st.lists(st.tuples(st.floats(0.5, 20.0), st.sampled_from([0.0, 0.0, 0.0, 60.0, -60.0])), max_size=12))
@settings(max_examples=40, deadline=None)
def test_live_pictures_never_wait_for_later_ones(steps: list[tuple[float, float]]) -> None:
    """Whatever jumps of the stamps there are and however far apart the pictures: ticks are enough; and all come out,
    their times growing, unless two stamps are out of order."""
    times_s = np.cumsum([5000.0, *(step for step, _ in steps)])
    offs_s = [0.0, *(off for _, off in steps)]
    for channels in ((), ("moment_Nm",)):
        synchronizer = Synchronizer(Timing(), channels)
        out = answered(synchronizer, [taken(t + o, t) for t, o in zip(times_s, offs_s, strict=True)], ticks=True)
        assert all(came_s - arrived_s < 2.0 * Timing.wait_s + 0.05 for arrived_s, came_s in out)
        lost = synchronizer.counts["pictures out of order"] + synchronizer.counts["pictures doubled"]
        assert len(out) + lost + synchronizer.counts["pictures stamped ahead"] >= len(times_s)
        assert not list(synchronizer.finish())


@pytest.mark.parametrize("by_s", [0.0, HOUR_S, -HOUR_S])
def test_readings_of_a_table_come_to_pictures_whose_first_stamp_is_wrong(by_s: float, tmp_path: Path) -> None:
    """Thousands of them, beside pictures that arrived by another clock; a first stamp that is right is kept to."""
    path = tmp_path / "readings.csv"
    path.write_text("\n".join(["time_s,moment_Nm", *(f"{number / 1000},0.001" for number in range(20_000))]))

    def messages() -> Messages:
        for number in range(380):
            yield taken(0.01 + 0.05 * number + by_s * (number == 0), 5000.0 + 0.05 * number)

    source = _with_readings(MessageSource("bag", messages), path, 0.0)
    synchronizer = Synchronizer(Timing(), source.channels, live=False)
    found = through(synchronizer, *(each for each in source.messages() if each is not None))
    assert sum(np.isfinite(each.frame.moment_Nm) for each in found) == 380 - (by_s != 0.0)


def test_recordings_of_two_clocks_are_refused_with_an_offset() -> None:
    """Readings by the time of day of a video that begins at 0: what lets both begin together is proposed, and does."""
    day_s, pictures = 1.7e9, [taken(0.1 * number) for number in range(20)]
    readings = [moment(day_s + 0.05 * number, 1.0) for number in range(40)]
    with pytest.raises(InputError, match=r"--clock-offset.* -1700000000 lets both begin together"):
        through(Synchronizer(Timing(), ["moment_Nm"], live=False), *readings, *pictures)
    late = Synchronizer(Timing(offset_s=-day_s), ["moment_Nm"], live=False)
    assert sum(np.isfinite(each.frame.moment_Nm) for each in through(late, *readings, *pictures)) >= 19


CAMERAS = {"left": (6, 4), "right": (3, 5)}


def of(camera: str, time_s: float, arrived_s: float | None = None) -> Taken:
    width, height = CAMERAS[camera]
    return replace(taken(time_s, arrived_s, np.zeros((height, width), np.uint8)), camera=camera)


@given(st.integers(0, 2**31), st.floats(0.02, 0.2), st.floats(-0.004, 0.004), st.sampled_from([1, 2, 3]), st.booleans())
@settings(max_examples=60, deadline=None)
def test_pictures_of_one_instant_are_one_frame(
    seed: int, period_s: float, lag_s: float, every: int, live: bool
) -> None:
    """However they jitter and come, at one rate or at others: none is lost or used twice, times run on."""
    rng, count = np.random.default_rng(seed), 24
    at = 100.0 + period_s * np.arange(count)
    left = [of("left", t, t + rng.uniform(0.0, 0.01)) for t in at]
    right = [
        of("right", t + lag_s, t + rng.uniform(0.01, 0.02))
        for t in at[::every] + rng.uniform(0, 1e-3, len(at[::every]))
    ]
    several = sorted([*left, *right], key=lambda each: each.arrived_s)
    found = through(Synchronizer(Timing(), image_size=CAMERAS, live=live), *several)
    assert [list(each.images) for each in found].count(["left"]) == count - len(right)
    assert sum("right" in each.images for each in found) == len(right)
    assert len(found) == count
    assert (np.diff([each.frame.time_s for each in found]) > 0.0).all()
    for each in found:
        assert all(abs(one.time_s - each.taken.time_s) <= Timing.together_s for one in each.others)
