"""Hypotheses about the moment sensor, judged by the moments that the pictures predict."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import combinations, product

import numpy as np

from vbaa_calib.core.errors import Diagnosis, Severity
from vbaa_calib.session import STANDARD_GRAVITY_M_S2 as _G

from .decision import Explanation, diagnose
from .settings import SETTINGS

_UNITS = (
    ("mN·m or N·mm", 1e3, "divide the readings by 1000"),
    ("N·cm", 1e2, "divide the readings by 100"),
    ("kgf·m", 1 / _G, "multiply the readings by 9.80665"),
    ("kgf·cm", 100 / _G, "divide the readings by 10.197"),
    ("gf·cm", 1e5 / _G, "divide the readings by 10197"),
    ("kN·m", 1e-3, "multiply the readings by 1000"),
    ("µN·m", 1e6, "divide the readings by 1000000"),
    ("lbf·in", 8.8507, "divide the readings by 8.8507"),
    ("ozf·in", 141.61, "divide the readings by 141.61"),
    ("lbf·ft", 0.73756, "divide the readings by 0.73756"),
    ("decimetres for metres", 1e1, "divide the readings by 10"),
)
"""What moments are read in, as a factor on N·m, and what to do."""


@dataclass(frozen=True, eq=False)
class MomentReadings:
    """The moment sensor's readings (F,), and the moments that the pictures predict.

    Attributes
    ----------
    read, true : N·m. about_z : of the same loads about z.
    root : (F, P) square root R of the prediction's covariance: R·Rᵀ. std_Nm : the sensor's noise, as stated.
    when : (F,) times, or the order; per : their unit, for a drift. names : of the rows.
    """

    read: np.ndarray
    true: np.ndarray
    about_z: np.ndarray
    root: np.ndarray
    std_Nm: float
    when: np.ndarray
    per: str
    names: tuple[str, ...]
    offset_std_Nm: float = SETTINGS.offset_std_Nm  # of its zero before a calibration; of a force in N
    drift: np.ndarray | None = None  # (F,) one standard deviation of an error already found

    @cached_property
    def reported(self) -> float:
        """Log likelihood of the sensor as reported."""
        return self.log_likelihood(1.0, SETTINGS.gain_std, noise=1.0)[0]

    def log_likelihood(
        self,
        gain: float,
        gain_std: float,
        noise: float | None = None,
        column: np.ndarray | None = None,
        offset_std_Nm: float | None = None,
        usual_noise: float = 1.0,
    ) -> tuple[float, float]:
        """Log likelihood of a sensor with this gain, and this ratio of its noise to the stated one; without `noise`
        the likeliest ratio, not below the usual.

        column : (F,) of a further, unknown error in its standard deviation.
        """
        offset = self.offset_std_Nm if offset_std_Nm is None else offset_std_Nm
        parts = [gain * self.root, gain_std * self.true[:, None], np.full((len(self.read), 1), offset)]
        parts += [one[:, None] for one in (column, self.drift) if one is not None]
        known = np.hstack(parts) / self.std_Nm
        off = (self.read - gain * self.true) / self.std_Nm
        variances, axes = np.linalg.eigh(known @ known.T)
        square = (axes.T @ off) ** 2
        scales = usual_noise * np.exp(np.linspace(0.0, 16.0, 161)) if noise is None else np.array([noise])
        total = np.maximum(variances, 0.0) + (scales**2)[:, None]
        every = -0.5 * (np.log(total) + square / total).sum(axis=1) - np.log(scales / usual_noise)
        best = int(np.argmax(every))
        return float(every[best]), float(scales[best])

    def gain(self, about: np.ndarray | None = None) -> tuple[float, float, float]:
        """Slope of the readings against the predicted moments, its standard deviation, and the residual scatter."""
        true = self.true if about is None else about
        columns = np.column_stack([true, np.ones_like(true)])
        found = np.linalg.lstsq(columns, self.read, rcond=None)[0]
        left = float(np.sqrt(((self.read - columns @ found) ** 2).sum() / max(len(true) - 2, 1)))
        spread = float(np.sqrt(((true - true.mean()) ** 2).sum()))
        return float(found[0]), max(left, self.std_Nm) / max(spread, 1e-15), left


def _explained(
    readings: MomentReadings, diagnosis: Diagnosis, odds: float, right: MomentReadings | None = None
) -> Explanation[MomentReadings]:
    return Explanation(diagnosis, odds - readings.reported, None if right is None else lambda: right)


def _dead(readings: MomentReadings) -> Iterator[Explanation[MomentReadings]]:
    """Hypothesis of readings that do not follow the moments."""
    spread = f"while the true moments span {1e3 * np.ptp(readings.true):.3g} mN·m"
    gain, std, _ = readings.gain()
    words = f"the moment readings do not follow the loads: gain {gain:.3g} ± {std:.2g}, {spread}"
    remedy = "check that the sensor is connected, sits between clamp and base, and that each row has its own reading"
    if np.ptp(readings.read) <= 1e-3 * readings.std_Nm:
        words = f"all {len(readings.read)} moment readings are {readings.read[0]:.4g} N·m, {spread}"
        remedy = "connect the sensor, or leave moment_Nm to what it reads, not to a zero typed in"
    least = min(factor for _, factor, _ in _UNITS)
    likely = max(readings.log_likelihood(0.0, 0.0, usual_noise=noise)[0] for noise in (1.0, least))
    covers = ("sensor_unit", "sensor_sign", "sensor_axis", "sensor_gain")
    diagnosis = Diagnosis("sensor_not_connected", words, remedy, "wrong")
    yield replace(_explained(readings, diagnosis, likely + SETTINGS.sensor_fault), covers=covers)


def _sign_and_unit(readings: MomentReadings) -> Iterator[Explanation[MomentReadings]]:
    """Hypotheses of exchanged leads, and of other units."""
    gain, std, _ = readings.gain()
    known = f"gain {gain:.4g} ± {std:.2g}"
    leads = "exchange its two leads, or change the sign of moment_Nm in all tables, the recording's too"
    for sign in (1.0, -1.0):
        for unit, factor, remedy in (("N·m", 1.0, ""), *_UNITS):
            if (sign, factor) == (1.0, 1.0):
                continue
            words, name = f"the moment sensor's {known}, as if it were read in {unit}", "sensor_unit"
            usual = SETTINGS.usual_gains[0] < gain < SETTINGS.usual_gains[1]
            if sign < 0:
                as_if = f", as if it were read in {unit}" if remedy else ""
                words, name = f"the moment sensor reads with the wrong sign: {known}{as_if}", "sensor_sign"
            what = "; ".join([leads] * (sign < 0) + [f"{remedy}: moment_Nm is in N·m"] * bool(remedy))
            severity: Severity = "wrong" if remedy and not usual else "doubt"
            width = SETTINGS.unit_std if remedy else SETTINGS.own_gain_std
            # in a larger unit its noise, too, is a smaller number
            likely, _ = readings.log_likelihood(sign * factor, width * factor, usual_noise=min(factor, 1.0))
            odds = likely + SETTINGS.sensor_fault - bool(remedy)
            right = replace(readings, read=readings.read / (sign * factor))
            yield _explained(readings, Diagnosis(name, words, what, severity), odds, right)


def _own_gain(readings: MomentReadings) -> Iterator[Explanation[MomentReadings]]:
    """Hypothesis of an arbitrary gain."""
    gain, std, _ = readings.gain()
    right = replace(readings, read=readings.read / gain) if gain else None
    words = f"the moment sensor's gain is {gain:.4g} ± {std:.2g}"
    usual = SETTINGS.usual_gains[0] < gain < SETTINGS.usual_gains[1]
    if usual and abs(gain - 1.0) > 2.0 * SETTINGS.gain_std:
        odds = readings.log_likelihood(1.0, SETTINGS.own_gain_std)[0]
        yield _explained(readings, Diagnosis("sensor_gain", words, "the rig contains this gain", "note"), odds, right)
    elif gain > 0 and not usual:
        remedy = "check its calibration and the unit of moment_Nm"
        odds = readings.log_likelihood(0.0, max(SETTINGS.any_gain_std, gain))[0] + SETTINGS.sensor_fault
        yield _explained(readings, Diagnosis("sensor_gain", f"{words}, far from 1", remedy), odds, right)


def _other_axis(readings: MomentReadings) -> Iterator[Explanation[MomentReadings]]:
    """Hypothesis of readings of the moment about z."""
    other = replace(readings, true=readings.about_z)
    for sign in (1.0, -1.0):
        gain, std, _ = readings.gain(readings.about_z)
        words = f"the moment readings follow the loads along y, not along z: gain {gain:.3g} ± {std:.2g} about z"
        remedy = "turn the sensor by 90° about the antenna, or take the channel of the moment about y"
        odds = other.log_likelihood(sign, SETTINGS.own_gain_std)[0] + SETTINGS.sensor_fault
        yield _explained(readings, Diagnosis("sensor_axis", words, remedy, "wrong"), odds)


def _drift(readings: MomentReadings) -> Iterator[Explanation[MomentReadings]]:
    """Hypothesis of a drifting zero."""
    if np.ptp(readings.when) == 0.0:
        return
    when = (readings.when - readings.when.mean()) / np.ptp(readings.when)
    column = 300.0 * readings.std_Nm * when
    columns = np.column_stack([readings.true, np.ones_like(when), when])
    found = np.linalg.lstsq(columns, readings.read, rcond=None)[0]
    words = f"the moment sensor drifts by {1e3 * found[2] / np.ptp(readings.when):.2g} mN·m per {readings.per}"
    odds = readings.log_likelihood(1.0, SETTINGS.own_gain_std, column=column)[0] + SETTINGS.noisy
    diagnosis = Diagnosis("sensor_drifts", words, "let it warm up, and zero it again before a recording")
    yield _explained(readings, diagnosis, odds, replace(readings, drift=column))


def _one_reading(readings: MomentReadings) -> Iterator[Explanation[MomentReadings]]:
    """Hypotheses of a single wrong reading."""
    less = float(np.log(len(readings.read)))
    for index, name in enumerate(readings.names):
        rest = np.arange(len(readings.read)) != index
        gain, zero = np.polyfit(readings.true[rest], readings.read[rest], 1)
        off = readings.read[index] - gain * readings.true[index] - zero
        column = np.where(rest, 0.0, 1e3 * readings.std_Nm)
        odds = readings.log_likelihood(1.0, SETTINGS.own_gain_std, column=column)[0] + SETTINGS.noisy - less
        words = f"{name}: the moment reading is {1e3 * off:+.3g} mN·m off"
        diagnosis = Diagnosis("moment_reading_off", words, "check its row")
        yield _explained(readings, diagnosis, odds, replace(readings, drift=column))


def _noise(readings: MomentReadings) -> Iterator[Explanation[MomentReadings]]:
    """Hypothesis of more noise than stated."""
    odds, noise = readings.log_likelihood(1.0, SETTINGS.own_gain_std)
    words = (
        f"the moment sensor scatters by {1e3 * noise * readings.std_Nm:.3g} mN·m, the session says "
        f"{1e3 * readings.std_Nm:.3g}"
    )
    diagnosis = Diagnosis("sensor_noise", words, "the measured scatter is used")
    yield _explained(readings, diagnosis, odds + SETTINGS.noisy, replace(readings, std_Nm=noise * readings.std_Nm))


TABLE = (_dead, _sign_and_unit, _own_gain, _other_axis, _drift, _one_reading, _noise)
"""What may be wrong with a moment sensor."""


Channels = dict[str, MomentReadings]
"""What the channels of a wrench sensor read, by their columns; forces in N for N·m."""


def _better(channels: Channels, changed: Mapping[str, tuple[MomentReadings, float, float]]) -> float:
    """Log odds that channels have a fault, over their being as reported. changed : by channel the readings without it,
    and the mean and standard deviation of their gain."""
    now = sum(one.log_likelihood(gain, std)[0] for one, gain, std in changed.values()) + SETTINGS.sensor_fault
    return now - sum(channels[name].reported for name in changed)


def _turned_channels(channels: Channels) -> Iterator[Explanation[Channels]]:
    """Hypotheses of a channel with its sign reversed."""
    for name, one in channels.items():
        odds = _better(channels, {name: (one, -1.0, SETTINGS.own_gain_std)})
        words = f"{name} reads with the wrong sign: gain {one.gain()[0]:.3g} ± {one.gain()[1]:.2g} of what is expected"
        remedy = "name its component with the other sign in wrench_sensor.components, or turn the column's sign round"
        right = {**channels, name: replace(one, read=-one.read)}
        diagnosis = Diagnosis("sensor_sign", words, remedy, "wrong")
        yield Explanation(diagnosis, odds, partial(dict, right))


def _exchanged_channels(channels: Channels) -> Iterator[Explanation[Channels]]:
    """Hypotheses of two exchanged channels of a kind, with either sign: columns, wires, or a sensor mounted a
    quarter turn round."""
    for first, second in combinations(channels, 2):
        if first.endswith("_Nm") != second.endswith("_Nm"):
            continue
        a, b = channels[first], channels[second]
        for signs in product((1.0, -1.0), repeat=2):
            as_first, as_second = replace(a, read=signs[0] * b.read), replace(b, read=signs[1] * a.read)
            std = SETTINGS.own_gain_std
            odds = _better(channels, {first: (as_first, 1.0, std), second: (as_second, 1.0, std)})
            turned = [
                f", {name} with its sign turned round"
                for name, sign in zip((second, first), signs, strict=True)
                if sign < 0
            ]
            words = f"{first} and {second} are exchanged{''.join(turned)}"
            remedy = "exchange the two columns in all tables, or turn the sensor (wrench_sensor.T_antenna_sensor)"
            right = {**channels, first: as_first, second: as_second}
            diagnosis = Diagnosis("sensor_exchanged", words, remedy, "wrong")
            yield Explanation(diagnosis, odds - float(sum(sign < 0 for sign in signs)), partial(dict, right))


def _units_of_channels(channels: Channels) -> Iterator[Explanation[Channels]]:
    """Hypotheses of all forces, or all moments, in another unit."""
    forces = (
        ("mN", 1e3, "divide them by 1000"),
        ("gf", 1e3 / _G, "divide them by 101.97"),
        ("kgf", 1 / _G, "multiply them by 9.80665"),
        ("lbf", 0.224809, "multiply them by 4.44822"),
    )
    for kind, units in (("_N", forces), ("_Nm", _UNITS)):
        names = [name for name in channels if name.endswith(kind)]
        for unit, factor, remedy in units if names else ():
            changed = {name: (channels[name], factor, SETTINGS.unit_std * factor) for name in names}
            odds = _better(channels, changed) - 1.0
            words = f"{', '.join(names)} are as if they were read in {unit}"
            right = channels | {name: replace(channels[name], read=channels[name].read / factor) for name in names}
            diagnosis = Diagnosis("sensor_unit", words, f"{remedy}: they are in N·m or N", "wrong")
            yield Explanation(diagnosis, odds, partial(dict, right))


def _dead_channels(channels: Channels) -> Iterator[Explanation[Channels]]:
    """Hypotheses of a channel that does not follow the load."""
    for name, one in channels.items():
        if np.ptp(one.true) < SETTINGS.seen_std * one.std_Nm:
            continue
        odds = _better(channels, {name: (one, 0.0, 0.0)})
        words = f"{name} does not follow the loads: gain {one.gain()[0]:.3g} ± {one.gain()[1]:.2g} of what is expected"
        diagnosis = Diagnosis("sensor_not_connected", words, "check that channel's wires", "wrong")
        right = {other: each for other, each in channels.items() if other != name}
        yield Explanation(diagnosis, odds, partial(dict, right))


def channel_diagnoses(channels: Channels) -> list[Diagnosis]:
    """Diagnoses of a sensor of several axes, the likeliest first."""
    read = {
        name: one for name, one in channels.items() if np.isfinite(one.read).all() and len(one.read) >= SETTINGS.fewest
    }
    return diagnose(read, (_turned_channels, _exchanged_channels, _units_of_channels, _dead_channels))
