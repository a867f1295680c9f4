"""Offset between the readings' clock and the pictures', from the agreement of moment and bending.

A single camera hardly sees the force along its line of sight, so that a picture does not determine what the sensor must
read. But while the antenna is pressed, the direction of the force changes slowly: the moment is proportional to the
visible bending, by a factor that is nearly constant over a second. The offset is where that fits best.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from heapq import merge
from itertools import islice

import numpy as np

from estimator.table.contacts import Measured
from vbaa_calib.core.errors import InputError
from vbaa_calib.session import SILENT
from vbaa_calib.streams import MessageSource, Reading, Synchronizer, Taken, Timing, taken_frames
from vbaa_calib.streams.messages import Messages

from .estimate import ContactEstimator
from .recording import Ground, detected


@dataclass(frozen=True)
class _ClockSettings:
    """Settings of the search for the clocks' offset, and thresholds from which it is determined."""

    farthest_s: float = 1.0  # the offset is searched so far to either side
    most_pictures: int = 3000  # of a recording, its first ones
    apart_s: float = 10.0  # recorders with clocks of their own are started by hand within this
    most_std_s: float = 0.02  # an offset that is known less well is not given
    window_s: float = 1.0  # in which the moment follows the bend by one factor that changes evenly
    window_frames: int = 12  # pictures in such a window, least
    free_bend: float = 0.05  # of the usual bend: less is none
    steps_s: tuple[float, ...] = (5e-3, 6e-4, 1e-4)  # of the search and of its refinements
    reweightings: int = 4  # of the robust fit
    huber: float = 2.0  # residuals beyond this count linearly
    largest_gap: float = 5.0  # between readings, in their usual intervals
    most_unexplained: float = 0.05  # of what other offsets leave: another motion leaves 0.08 or more
    least_signal_std: float = 5.0  # by which the moment leaves its mean, and the bend explains it
    alternatives: int = 3  # other offsets that are refined, most
    alternative_ratio: float = 6.0  # ratio of what an offset leaves unexplained to the least, up to which it is refined
    other_ratio: float = 2.0  # one that leaves less than this ratio may be the right one
    bend_noise: float = 1e-3  # of another camera's bends, in their standard deviation: pictures show them better


_ClockOffset = tuple[float, float, int]
"""Offset to add to the readings' times, s, its standard deviation, and the number of pictures used."""


@dataclass(frozen=True, eq=False)
class _Windows:
    """Pictures grouped in windows of time: times (B,), first indices of the windows (W,), and regressors of the
    moment (B, P)."""

    times_s: np.ndarray
    begins: np.ndarray
    features: np.ndarray

    def explained(self, values: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """(K, B) fit of values (K, B) with weights (K, B) by each window's regressors, by least squares."""
        weighted = weight[..., None] * self.features
        normal = np.add.reduceat(weighted[..., None] * self.features[:, None, :], self.begins, axis=1)
        side = np.add.reduceat(weighted * values[..., None], self.begins, axis=1)
        size = np.trace(normal, axis1=-2, axis2=-1)[..., None, None]
        found = np.linalg.solve(normal + (1e-9 * size + 1e-300) * np.eye(side.shape[-1]), side[..., None])[..., 0]
        counts = np.diff(np.append(self.begins, len(self.times_s)))
        return np.einsum("kbp,bp->kb", np.repeat(found, counts, axis=1), self.features)


class _Readings:
    """Readings about y, averaged over `width_s` to either side, so that their noise does not depend on the time."""

    def __init__(self, times_s: np.ndarray, values: np.ndarray, picture_s: float, is_moment: bool = True) -> None:
        self.times_s, self.values, self.is_moment = times_s, values, is_moment
        self.step_s = float(np.median(np.diff(times_s)))
        self.width_s = max(self.step_s, 0.5 * picture_s)
        areas = 0.5 * (values[1:] + values[:-1]) * np.diff(times_s)
        self._areas = np.concatenate([[0.0], np.cumsum(areas)])

    def at(self, times_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values at times, and whether there are readings around them."""
        begin, end = times_s - self.width_s, times_s + self.width_s
        there = (begin >= self.times_s[0]) & (end <= self.times_s[-1])
        last = len(self.times_s) - 1
        gaps = np.concatenate(
            [[0.0], np.cumsum(np.diff(self.times_s) > _ClockSettings.largest_gap * self.step_s), [0.0]]
        )
        first, after = (np.clip(np.searchsorted(self.times_s, each), 1, last) for each in (begin, end))
        there &= gaps[after] == gaps[first - 1]
        return (self._area(end) - self._area(begin)) / (2.0 * self.width_s), there

    def _area(self, times_s: np.ndarray) -> np.ndarray:
        before = np.clip(np.searchsorted(self.times_s, times_s) - 1, 0, len(self.times_s) - 1)
        here = np.interp(times_s, self.times_s, self.values)
        return self._areas[before] + 0.5 * (self.values[before] + here) * (times_s - self.times_s[before])


def recorded_clock_offset(
    estimator: ContactEstimator,
    opened: Callable[..., MessageSource],
    timing: Timing,
    ground: Ground | None,
    camera: str = "",
) -> _ClockOffset:
    """`_clock_offset` of a recorded source, that `opened` opens: searched around the offset of the logging times, or
    around zero where these are unknown; if that fails, around the offset at which both begin together (`apart_s`).

    camera : a further camera: the offset of its clock from the first camera's is estimated instead, since both must see
        the same bend. `opened` then takes the offset that is added to its times. Raises InputError as that does.
    """
    if camera:
        return _camera_offset(estimator, opened, timing, ground, camera)
    ahead_s, source = opened().readings_ahead_s(), opened()
    read, pictures_s = list[Reading](), list[float]()

    def heard() -> Messages:
        for message in source.messages():
            if isinstance(message, Reading) and message.possible:
                read.append(message)
            elif isinstance(message, Taken):
                pictures_s.append(message.time_s)
            yield message

    try:
        measured = _measured(estimator, replace(source, messages=heard), replace(timing, offset_s=ahead_s), ground)
        return _from_readings(estimator, measured, read, ahead_s, _ClockSettings.farthest_s)
    except InputError:
        moments_s = [each.time_s for each in read if each.channel == "moment_Nm"]
        if not (moments_s and pictures_s):
            raise
        together_s = min(pictures_s) - min(moments_s)
        begun = min(moments_s) < max(pictures_s) - ahead_s and min(pictures_s) - ahead_s < max(moments_s)
        if begun and abs(ahead_s) > _ClockSettings.farthest_s:  # they were logged so
            raise
        source = _joined(opened(), read, together_s)
        measured = _measured(estimator, source, replace(timing, offset_s=together_s), ground)
        return _from_readings(estimator, measured, read, together_s, _ClockSettings.apart_s)


def _camera_offset(
    estimator: ContactEstimator,
    opened: Callable[[float], MessageSource],
    timing: Timing,
    ground: Ground | None,
    camera: str,
) -> _ClockOffset:
    """The offset of a further camera's clock from the first one's. Raises InputError."""
    begins: dict[str, list[float]] = {name: [] for name in estimator.rig.cameras}

    def alone(name: str, about_s: float) -> MessageSource:
        source = opened(about_s)

        def messages() -> Messages:
            for each in source.messages():
                if not isinstance(each, Taken):
                    yield each
                    continue
                begins[each.camera].append(each.time_s)
                if each.camera == name:
                    yield replace(each, camera="")

        return replace(source, messages=messages)

    first = estimator.rig.camera_name
    one, other = estimator.cameras[first], estimator.cameras[camera]
    own = _measured(one, alone(first, 0.0), timing, ground)
    span_s, other_s = ((min(each, default=0.0), max(each, default=0.0)) for each in (begins[first], begins[camera]))
    apart = other_s[0] > span_s[1] or span_s[0] > other_s[1]
    about_s = span_s[0] - other_s[0] if apart else 0.0
    seen = _measured(other, alone(camera, about_s), timing, None)
    try:
        times_s, bend = _bends(other, [replace(each, **SILENT) for each in seen])[1:]
        # how well a bend is known shows in how it scatters about the other
        readings = _Readings(times_s, bend, float(np.median(np.diff(times_s))), is_moment=False)
        farthest_s = _ClockSettings.apart_s if apart else _ClockSettings.farthest_s
        offset_s, std_s, frames = _followed(
            one, own, readings, _ClockSettings.bend_noise * float(np.std(bend)), farthest_s
        )
    except InputError:
        what = (
            f"the clock of {camera} cannot be estimated: {len(own)} and {len(seen)} pictures of {first} and {camera} "
        )
        remedy = f"state it (--camera-offset {camera}=SECONDS), or record some quick presses and estimate it there"
        raise InputError(f"{what}do not bend alike at one offset alone", remedy=remedy) from None
    return about_s + offset_s, std_s, frames


def _joined(source: MessageSource, read: Sequence[Reading], offset_s: float) -> MessageSource:
    """A source merged with its readings in order of arrival, with an offset added to their clock."""

    def messages() -> Messages:
        taken = (each for each in source.messages() if isinstance(each, Taken))
        pictures: Iterator[Taken | Reading] = (replace(each, arrived_s=each.time_s) for each in taken)
        readings: Iterator[Taken | Reading] = (replace(each, arrived_s=each.time_s + offset_s) for each in read)
        yield from merge(pictures, readings, key=lambda each: each.arrived_s)

    return replace(source, messages=messages)


def _measured(
    estimator: ContactEstimator, source: MessageSource, timing: Timing, ground: Ground | None
) -> list[Measured]:
    """Measurements of a source's first pictures."""
    # the joints' angles hardly change by what the clocks are apart
    patient = replace(timing, wait_s=2.0 * _ClockSettings.farthest_s)
    synchronizer = Synchronizer(patient, source.channels, estimator.rig.image_sizes, live=False)
    taken = islice(taken_frames(source.messages(), synchronizer), _ClockSettings.most_pictures)
    seen = list(detected(estimator, taken, ground))
    return [each.measured for each in seen if each.line.found]


def _from_readings(
    estimator: ContactEstimator,
    measured: Sequence[Measured],
    read: Sequence[Reading],
    about_s: float,
    farthest_s: float,
) -> _ClockOffset:
    moments = [(each.time_s, each.value) for each in read if each.channel == "moment_Nm"]
    times_s, first = np.unique([time_s for time_s, _ in moments], return_index=True)
    values = np.array([moment_Nm for _, moment_Nm in moments])[first]
    offset_s, std_s, frames = _clock_offset(estimator, measured, times_s + about_s, values, farthest_s)
    return about_s + offset_s, std_s, frames


def _clock_offset(
    estimator: ContactEstimator,
    several: Sequence[Measured],
    times_s: np.ndarray,
    readings_Nm: np.ndarray,
    farthest_s: float = _ClockSettings.farthest_s,
) -> _ClockOffset:
    """The offset of the readings' clock, within `farthest_s`, from pictures and readings during motion.

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
    if sensor.gain == 0.0 or len(times_s) < _ClockSettings.window_frames:
        raise _refused(f"there are {len(times_s)} readings of the moment")
    step_s = float(np.median(np.diff([each.time_s for each in several]))) if len(several) > 1 else 1.0
    readings = _Readings(times_s, readings_Nm, step_s)
    return _followed(estimator, several, readings, sensor.std_Nm, farthest_s)


def _followed(
    estimator: ContactEstimator, several: Sequence[Measured], readings: _Readings, noise_Nm: float, farthest_s: float
) -> _ClockOffset:
    """The offset of any readings that are proportional to the bending, with their noise. Raises InputError."""
    windows = _windows(estimator, several, np.full(len(several), np.nan))
    if np.std(readings.values) < _ClockSettings.least_signal_std * noise_Nm:
        raise _refused("the moment that is read hardly changes")
    coarse = np.arange(-farthest_s, farthest_s + 0.5 * _ClockSettings.steps_s[0], _ClockSettings.steps_s[0])
    lots = np.array_split(coarse, len(coarse) // 400 + 1)
    whole = np.concatenate([_cost(windows, readings, lot, noise_Nm)[0] for lot in lots])
    if not np.isfinite(whole).any():
        raise _refused("pictures and readings hardly overlap")
    best = int(np.argmin(whole))
    if best in (0, len(whole) - 1) or not np.isfinite(whole[best - 1 : best + 2]).all():
        raise _refused(f"moment and pictures agree best at {coarse[best]:+.2f} s, where the search ends")
    least = [best]
    for i in np.argsort(whole)[: np.isfinite(whole).sum()].tolist():
        near = np.abs(coarse[least] - coarse[i]).min() < 10.0 * _ClockSettings.steps_s[0]
        valley = 0 < i < len(whole) - 1 and whole[i] <= min(whole[i - 1], whole[i + 1])
        if (
            valley
            and not near
            and whole[i] < _ClockSettings.alternative_ratio * whole[best]
            and len(least) <= _ClockSettings.alternatives
        ):
            least.append(i)
    refined = [_refined(estimator, several, readings, float(coarse[i]), noise_Nm) for i in least]
    (cost, offset_s, windows), *rivals = sorted(refined, key=lambda one: one[0])
    if cost > _ClockSettings.most_unexplained * min(float(np.median(whole[np.isfinite(whole)])), 1.0):
        what = f"at no offset within {farthest_s:g} s does the moment follow the bend that the pictures show"
        raise _refused(f"{what}; is it the moment about the antenna's y?")
    _, std_s, _ = found = _judged(windows, readings, offset_s, noise_Nm)
    for other in rivals:
        if other[0] < _ClockSettings.other_ratio * cost and abs(other[1] - offset_s) > max(
            5.0 * std_s, 10.0 * _ClockSettings.steps_s[0]
        ):
            what = f"{other[1]:+.2f} s fits about as well as {offset_s:+.2f} s, as when a motion repeats itself"
            raise _refused(what)
    return found


def _refined(
    estimator: ContactEstimator, several: Sequence[Measured], readings: _Readings, offset_s: float, noise_Nm: float
) -> tuple[float, float, _Windows]:
    """The unexplained fraction of the moment's variation, the offset and the windows, starting from an approximate
    offset."""
    windows, cost = None, np.inf
    for step_s in _ClockSettings.steps_s:
        # where the line of sight lies at a bent antenna depends on the force along it, which the moment shows
        at, there = readings.at(np.array([each.time_s for each in several]) - offset_s)
        windows = _windows(estimator, several, np.where(there & readings.is_moment, at, np.nan))
        offsets = offset_s + step_s * np.arange(-3.0, 4.0)
        costs = _cost(windows, readings, offsets, noise_Nm)[0]
        if not np.isfinite(costs).all():
            break
        # the least of a parabola through them: the readings' corners are not followed
        curve, slope, _ = np.polyfit(offsets - offset_s, costs, 2)
        if curve > 0.0:
            offset_s += float(np.clip(-0.5 * slope / curve, -3.0 * step_s, 3.0 * step_s))
        cost = float(costs.min())
    assert windows is not None
    return cost, offset_s, windows


def _refused(what: str) -> InputError:
    remedy = "state it (--clock-offset SECONDS), or record some quick presses with the moment and estimate it there"
    return InputError(f"the clocks' offset cannot be estimated: {what}", where="--clock-offset", remedy=remedy)


def _bends(estimator: ContactEstimator, several: Sequence[Measured]) -> tuple[list[Measured], np.ndarray, np.ndarray]:
    """The pictures in which an antenna is detected, their times (B,), and the clamp moment (B,), in the solver's
    unit, of the force across the line of sight, which pictures determine well. Raises InputError where there are too
    few."""
    numbers = estimator.measure_batch(several).numbers if several else None
    usable = np.zeros(0, bool) if numbers is None else numbers.finite & np.isfinite(numbers.unknowns[:, :3]).all(axis=1)
    if numbers is None or usable.sum() < 3 * _ClockSettings.window_frames:
        raise _refused(f"only {int(usable.sum())} pictures show the antenna")
    seen = [each for each, use in zip(several, usable, strict=True) if use]
    unknowns = numbers.unknowns[usable]
    across = np.array([-1.0, 1.0]) * estimator.rig.T_antenna_camera.translation_m[[2, 1]]
    bend = unknowns[:, 0] * (unknowns[:, 1:3] @ across) / np.linalg.norm(across)
    return seen, np.array([each.time_s for each in seen]), bend


def _windows(estimator: ContactEstimator, several: Sequence[Measured], moments_Nm: np.ndarray) -> _Windows:
    """The pictures in which an antenna is detected, fitted with these moments (B,), with the regressors of the
    moment.

    Raises InputError where they are too few.
    """
    pairs = zip(several, moments_Nm, strict=True)
    silent = [replace(each, **SILENT | {"moment_Nm": float(moment)}) for each, moment in pairs]
    seen, times, bend = _bends(estimator, silent)
    rotation, _ = estimator.rig.kinematics.world_antenna(*np.array([[each.pan_rad, each.tilt_rad] for each in seen]).T)
    weight = (np.swapaxes(rotation, 1, 2) @ estimator.rig.gravity_world_m_s2)[:, 2]
    window = _window_of(times, np.abs(bend))
    kept = np.bincount(window)[window] >= _ClockSettings.window_frames
    if kept.sum() < 3 * _ClockSettings.window_frames:
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
    """(B,) window index of each picture: a new window begins just before a touch, and after `window_s`."""
    touched = bend > _ClockSettings.free_bend * np.quantile(bend, 0.98)
    length_s = max(_ClockSettings.window_s, _ClockSettings.window_frames * float(np.median(np.diff(times_s))))
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
    """(K,) fraction of the moment's variation that the bending does not explain at offsets (K,), with robust weights
    (K, B); infinite where too few pictures have readings."""
    values, there = readings.at(windows.times_s - offsets[:, None])
    base = weight = there.astype(float)
    for _ in range(_ClockSettings.reweightings):
        residual = np.abs(values - windows.explained(values, weight))
        scale = np.array([np.median(row[use]) if use.any() else 0.0 for row, use in zip(residual, there, strict=True)])
        bound = _ClockSettings.huber * np.maximum(scale / 0.6745, noise_Nm)[:, None]
        weight = base * np.minimum(1.0, bound / np.maximum(residual, 1e-300))
    mean = (base * values).sum(axis=1, keepdims=True) / np.maximum(base.sum(axis=1, keepdims=True), 1.0)
    all_of_it = (base * (values - mean) ** 2).sum(axis=1)
    cost = (weight * (values - windows.explained(values, weight)) ** 2).sum(axis=1)
    enough = there.sum(axis=1) >= max(2 * _ClockSettings.window_frames, 0.5 * there.shape[1])
    return np.where(enough, cost / np.maximum(all_of_it, 1e-300), np.inf), weight


def _judged(windows: _Windows, readings: _Readings, offset_s: float, noise_Nm: float) -> _ClockOffset:
    """The offset with its standard deviation. Raises InputError where there is too little motion."""
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
    if not std_s <= _ClockSettings.most_std_s:
        known = f"it is known to {1e3 * std_s:.0f} ms only" if np.isfinite(std_s) else "nothing moves"
        raise _refused(f"{known}: the moment changes too little, or too slowly, while the antenna is seen to bend")
    return offset_s, std_s, count


def _with_neighbours(score: np.ndarray) -> float:
    """Variance of the sum of scores (B,) in order, including the correlation of neighbours as far as it extends."""
    score = score - score.mean()
    variance = float(score @ score)
    total, least = variance, 2.0 / np.sqrt(len(score))
    for lag in range(1, len(score) // 4):
        shared = float(score[lag:] @ score[:-lag])
        if shared < least * variance:
            break
        total += 2.0 * shared
    return total
