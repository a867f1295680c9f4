"""How far the readings' clock is from the pictures': the moment and the bent picture must agree.

One camera hardly sees the force along its line of sight, so that a picture does not say what the sensor must read. But
while the antenna is pressed, the direction of the force changes slowly: the moment follows the bend that is seen, by a
factor that is nearly the same for a second. At the right offset it does so best.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from estimator.table.contacts import Measured
from vbaa_calib.core.errors import InputError
from vbaa_calib.streams import Reading, Source, Synchronizer, Taken, Timing, taken_frames

from .estimate import ContactEstimator
from .recording import Ground, detections, first_looks

FARTHEST_S = 1.0
"""The offset is looked for so far to either side."""
MOST_PICTURES = 3000
"""Of a recording, so many pictures are used, its first ones."""
_MOST_STD_S = 0.02
"""An offset that is not better known is not told."""
_WINDOW_S, _WINDOW_FRAMES = 1.0, 12
"""For so long, and for so many pictures at least, the moment follows the bend by one factor that changes evenly."""
_FREE = 0.05
"""Less of the usual bend is none."""
_COARSE_S, _FINER, _ROUNDS = 0.005, 8.0, 3
_REWEIGHTINGS, _HUBER = 4, 2.0
_LARGEST_GAP = 5.0  # between readings, in their usual intervals
_LEAST_EXPLAINED = 0.15
"""At the right offset the bend leaves less than this part unexplained of what it does at others."""
_LEAST_SIGNAL = 5.0
"""The moment must leave its mean, and what the bend explains of it its noise, by so many deviations."""
_OTHER = 2.0
"""Another offset that leaves less than so many times as much unexplained may be the right one."""


@dataclass(frozen=True)
class ClockOffset:
    """What is added to the readings' times to have them on the pictures' clock, its deviation, and from how many
    pictures."""

    offset_s: float
    std_s: float
    frames: int


@dataclass(frozen=True, eq=False)
class _Windows:
    """Pictures in windows of time: times (B,), where windows begin (W,), and by what the moment is explained in each
    (B, P)."""

    times_s: np.ndarray
    begins: np.ndarray
    features: np.ndarray

    def explained(self, values: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """(K, B) the part of values (K, B) with weights (K, B) that each window's features explain by least squares."""
        weighted = weight[..., None] * self.features
        normal = np.add.reduceat(weighted[..., None] * self.features[:, None, :], self.begins, axis=1)
        side = np.add.reduceat(weighted * values[..., None], self.begins, axis=1)
        size = np.trace(normal, axis1=-2, axis2=-1)[..., None, None]
        found = np.linalg.solve(normal + (1e-9 * size + 1e-300) * np.eye(side.shape[-1]), side[..., None])[..., 0]
        counts = np.diff(np.append(self.begins, len(self.times_s)))
        return np.einsum("kbp,bp->kb", np.repeat(found, counts, axis=1), self.features)


class _Readings:
    """The readings about y, averaged over `width_s` to either side, so that noise does not depend on the instant."""

    def __init__(self, times_s: np.ndarray, values: np.ndarray, picture_s: float) -> None:
        self.times_s, self.values = times_s, values
        self.step_s = float(np.median(np.diff(times_s)))
        self.width_s = max(self.step_s, 0.5 * picture_s)
        areas = 0.5 * (values[1:] + values[:-1]) * np.diff(times_s)
        self._areas = np.concatenate([[0.0], np.cumsum(areas)])

    def at(self, times_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values at times, and whether there are readings around them."""
        begin, end = times_s - self.width_s, times_s + self.width_s
        there = (begin >= self.times_s[0]) & (end <= self.times_s[-1])
        last = len(self.times_s) - 1
        gaps = np.concatenate([[0.0], np.cumsum(np.diff(self.times_s) > _LARGEST_GAP * self.step_s), [0.0]])
        first, after = (np.clip(np.searchsorted(self.times_s, each), 1, last) for each in (begin, end))
        there &= gaps[after] == gaps[first - 1]
        return (self._area(end) - self._area(begin)) / (2.0 * self.width_s), there

    def _area(self, times_s: np.ndarray) -> np.ndarray:
        before = np.clip(np.searchsorted(self.times_s, times_s) - 1, 0, len(self.times_s) - 1)
        here = np.interp(times_s, self.times_s, self.values)
        return self._areas[before] + 0.5 * (self.values[before] + here) * (times_s - self.times_s[before])


def recorded_clock_offset(
    estimator: ContactEstimator, opened: Callable[[], Source], timing: Timing, ground: Ground | None
) -> ClockOffset:
    """`clock_offset` of a recorded source, which `opened` opens, about what the times of logging show.

    Raises InputError as that does.
    """
    ahead_s, source = opened().readings_ahead_s(), opened()
    read: list[tuple[float, float]] = []

    def heard() -> Iterator[Taken | Reading | None]:
        for message in source.messages():
            if isinstance(message, Reading) and message.channel == "moment_Nm" and message.possible:
                read.append((message.time_s + ahead_s, message.value))
            yield message

    # the joints' angles hardly change by what the clocks are apart
    patient = replace(timing, offset_s=ahead_s, wait_s=2.0 * FARTHEST_S)
    synchronizer = Synchronizer(patient, source.channels, estimator.rig.camera.image_size, live=False)
    taken = islice(taken_frames(heard(), synchronizer), MOST_PICTURES)
    seen = list(detections(estimator, first_looks(estimator, taken, ground)))
    times_s, first = np.unique([time_s for time_s, _ in read], return_index=True)
    moments_Nm = np.array([moment_Nm for _, moment_Nm in read])[first]
    found = clock_offset(estimator, [each.measured for each in seen if each.line.found], times_s, moments_Nm)
    return replace(found, offset_s=ahead_s + found.offset_s)


def clock_offset(
    estimator: ContactEstimator, several: Sequence[Measured], times_s: np.ndarray, readings_Nm: np.ndarray
) -> ClockOffset:
    """The offset of the readings' clock, within `FARTHEST_S`, from pictures and readings with motion in both.

    Its deviation comes from how the readings scatter about what the bend explains, with what neighbours share.

    Parameters
    ----------
    several : what is seen in pictures, in order of time. Their moments are not used.
    times_s, readings_Nm : (R,) of the moment about y, in order of time.

    Raises
    ------
    InputError : the data do not support it, and why.
    """
    sensor = estimator.rig.moment_sensor
    if not sensor.exists:
        raise _refused("the rig has no moment sensor")
    if sensor.gain == 0.0 or len(times_s) < _WINDOW_FRAMES:
        raise _refused(f"there are {len(times_s)} readings of the moment")
    windows = _windows(estimator, several, np.full(len(several), np.nan))
    readings = _Readings(times_s, readings_Nm, float(np.median(np.diff(windows.times_s))))
    if np.std(readings_Nm) < _LEAST_SIGNAL * sensor.std_Nm:
        raise _refused("the moment that is read hardly changes")
    step_s = max(_COARSE_S, FARTHEST_S / 500.0)
    coarse = np.arange(-FARTHEST_S, FARTHEST_S + 0.5 * step_s, step_s)
    whole, _ = _cost(windows, readings, coarse, sensor.std_Nm)
    if not np.isfinite(whole).any():
        raise _refused("pictures and readings hardly overlap")
    best = int(np.argmin(whole))
    if best in (0, len(whole) - 1) or not np.isfinite(whole[best - 1 : best + 2]).all():
        raise _refused(f"moment and pictures agree best at {coarse[best]:+.2f} s, where the search ends")
    offset_s = float(coarse[best])
    for _ in range(_ROUNDS):
        # where the line of sight lies at a bent antenna depends on the force along it, which the moment shows
        at, there = readings.at(np.array([each.time_s for each in several]) - offset_s)
        windows = _windows(estimator, several, np.where(there, at, np.nan))
        offsets = offset_s + step_s * np.arange(-3.0, 4.0)
        # the least of a parabola through them: the readings' corners are not followed
        curve, slope, _ = np.polyfit(offsets - offset_s, _cost(windows, readings, offsets, sensor.std_Nm)[0], 2)
        if curve > 0.0:
            offset_s += float(np.clip(-0.5 * slope / curve, -3.0 * step_s, 3.0 * step_s))
        step_s = max(step_s / _FINER, 1e-4)
    found = _judged(windows, readings, offset_s, sensor.std_Nm)
    if whole[best] > _LEAST_EXPLAINED * min(float(np.median(whole[np.isfinite(whole)])), 1.0):
        what = f"at no offset within {FARTHEST_S:g} s does the moment follow the bend that the pictures show"
        raise _refused(f"{what}; is it the moment about the antenna's y?")
    for i in range(1, len(whole) - 1):
        apart = abs(coarse[i] - coarse[best]) > max(5.0 * found.std_s, 10.0 * _COARSE_S)
        if apart and whole[i] <= min(whole[i - 1], whole[i + 1]) and whole[i] < _OTHER * whole[best]:
            what = f"{coarse[i]:+.2f} s fits about as well as {offset_s:+.2f} s, as when a motion repeats itself"
            raise _refused(what)
    return found


def _refused(what: str) -> InputError:
    remedy = "state it (--clock-offset SECONDS), or record some quick presses with the moment and estimate it there"
    return InputError(f"the clocks' offset cannot be estimated: {what}", where="--clock-offset", remedy=remedy)


def _windows(estimator: ContactEstimator, several: Sequence[Measured], moments_Nm: np.ndarray) -> _Windows:
    """The pictures in which an antenna is seen, fitted with these moments (B,), and what explains the moment in them.

    Raises InputError where they are too few.
    """
    given = zip(several, moments_Nm, strict=True)
    silent = [replace(each, moment_Nm=float(moment), moment_z_Nm=np.nan) for each, moment in given]
    numbers = estimator.measure_batch(silent).numbers if silent else None
    usable = np.zeros(0, bool) if numbers is None else numbers.finite & np.isfinite(numbers.unknowns[:, :3]).all(axis=1)
    if numbers is None or usable.sum() < 3 * _WINDOW_FRAMES:
        raise _refused(f"only {int(usable.sum())} pictures show the antenna")
    seen = [each for each, use in zip(silent, usable, strict=True) if use]
    times, unknowns = np.array([each.time_s for each in seen]), numbers.unknowns[usable]
    # the moment at the clamp of the force across the line of sight: what a picture shows well
    across = np.array([-1.0, 1.0]) * estimator.rig.T_antenna_camera.translation_m[[2, 1]]
    bend = unknowns[:, 0] * (unknowns[:, 1:3] @ across) / np.linalg.norm(across)
    rotation, _ = estimator.rig.kinematics.world_antenna(*np.array([[each.pan_rad, each.tilt_rad] for each in seen]).T)
    weight = (np.swapaxes(rotation, 1, 2) @ estimator.rig.gravity_world_m_s2)[:, 2]
    window = _window_of(times, np.abs(bend))
    kept = np.bincount(window)[window] >= _WINDOW_FRAMES
    if kept.sum() < 3 * _WINDOW_FRAMES:
        raise _refused(f"only {int(kept.sum())} pictures in a row show the antenna")
    times, bend, weight, window = times[kept], bend[kept], weight[kept], window[kept]
    begins = np.flatnonzero(np.diff(window, prepend=-1))
    parts = np.split(times, begins[1:])
    share = np.concatenate([2.0 * (part - part.mean()) / max(np.ptp(part), 1e-9) for part in parts])
    columns = [np.ones(len(times)), bend, bend * share]
    if np.ptp(weight) > 1e-2:  # the antenna's own, where the joints move
        columns.append(weight - weight.mean())
    features = np.stack(columns, axis=1)
    return _Windows(times, begins, features / np.abs(features).max(axis=0))


def _window_of(times_s: np.ndarray, bend: np.ndarray) -> np.ndarray:
    """(B,) in which window each picture is: another begins just before a touch does, and after `_WINDOW_S`."""
    touched = bend > _FREE * np.quantile(bend, 0.98)
    length_s = max(_WINDOW_S, _WINDOW_FRAMES * float(np.median(np.diff(times_s))))
    begins = [0]
    for i in range(3, len(times_s)):
        if touched[i] and not touched[i - 3 : i].any():
            begins.append(i - 2)
        elif times_s[i] - times_s[begins[-1]] >= length_s:
            begins.append(i)
    return np.searchsorted(begins, np.arange(len(times_s)), side="right")


def _cost(
    windows: _Windows, readings: _Readings, offsets: np.ndarray, noise_Nm: float
) -> tuple[np.ndarray, np.ndarray]:
    """(K,) the part of the moment's change that the bend does not explain at offsets (K,); infinite where too few
    pictures have readings. With robust weights (K, B)."""
    values, there = readings.at(windows.times_s - offsets[:, None])
    base = weight = there.astype(float)
    for _ in range(_REWEIGHTINGS):
        residual = np.abs(values - windows.explained(values, weight))
        scale = np.array([np.median(row[use]) if use.any() else 0.0 for row, use in zip(residual, there, strict=True)])
        bound = _HUBER * np.maximum(scale / 0.6745, noise_Nm)[:, None]
        weight = base * np.minimum(1.0, bound / np.maximum(residual, 1e-300))
    mean = (base * values).sum(axis=1, keepdims=True) / np.maximum(base.sum(axis=1, keepdims=True), 1.0)
    all_of_it = (base * (values - mean) ** 2).sum(axis=1)
    cost = (weight * (values - windows.explained(values, weight)) ** 2).sum(axis=1)
    enough = there.sum(axis=1) >= max(2 * _WINDOW_FRAMES, 0.5 * there.shape[1])
    return np.where(enough, cost / np.maximum(all_of_it, 1e-300), np.inf), weight


def _judged(windows: _Windows, readings: _Readings, offset_s: float, noise_Nm: float) -> ClockOffset:
    """The offset with its deviation. Raises InputError where too little moves."""
    _, weight = _cost(windows, readings, np.array([offset_s]), noise_Nm)
    by_s = max(readings.step_s, 0.5 * readings.width_s)
    at = windows.times_s - offset_s
    (values, there), (ahead, _), (behind, _) = (readings.at(each) for each in (at, at + by_s, at - by_s))
    rate = (ahead - behind) / (2.0 * by_s)
    rows = np.stack([values, rate])
    residual, slope = np.where(there, rows - windows.explained(rows, np.repeat(weight, 2, axis=0)), 0.0)
    count = int(there.sum())
    score = slope * weight[0] * residual
    by_window = np.add.reduceat(score, windows.begins)
    count_of = len(by_window)
    variance = max(_with_neighbours(score), float(by_window @ by_window) * count_of / max(count_of - 1, 1))
    information = float((weight[0] * slope**2).sum()) - count * (noise_Nm / by_s) ** 2 / 2.0 * readings.step_s / (
        2.0 * readings.width_s
    )
    free = windows.features.shape[1] * len(windows.begins)
    std_s = float(np.sqrt(variance * count / max(count - free, 1)) / information) if information > 0.0 else np.inf
    if not std_s <= _MOST_STD_S:
        known = f"it is known to {1e3 * std_s:.0f} ms only" if np.isfinite(std_s) else "nothing moves"
        raise _refused(f"{known}: the moment changes too little, or too slowly, while the antenna is seen to bend")
    return ClockOffset(offset_s, std_s, count)


def _with_neighbours(score: np.ndarray) -> float:
    """Variance of the sum of scores (B,) in order, with what neighbours have in common, as far as it goes."""
    score = score - score.mean()
    variance = float(score @ score)
    total, least = variance, 2.0 / np.sqrt(len(score))
    for lag in range(1, len(score) // 4):
        shared = float(score[lag:] @ score[:-lag])
        if shared < least * variance:
            break
        total += 2.0 * shared
    return total
