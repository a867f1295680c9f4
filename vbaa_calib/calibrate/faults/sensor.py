"""The moment sensor's readings against the moments that pictures and known loads predict."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment
from vbaa_calib.calibrate.antenna.residual_checks import Estimate
from vbaa_calib.core.errors import Diagnosis
from vbaa_calib.core.robust import mad_std

_LEAST_SPREAD_STD = 30.0
"""Range of the moments, in the sensor's deviations, from which its gain can be judged."""
_UNITS = (
    ("N·mm", 1e3, "divide the readings by 1000"),
    ("mN·m", 1e3, "divide the readings by 1000"),
    ("N·cm", 1e2, "divide the readings by 100"),
    ("kgf·m", 1 / 9.80665, "multiply the readings by 9.80665"),
    ("kgf·cm", 100 / 9.80665, "divide the readings by 10.197"),
    ("gf·cm", 1e5 / 9.80665, "divide the readings by 10197"),
    ("kN·m", 1e-3, "multiply the readings by 1000"),
    ("decimetres for metres", 1e1, "divide the readings by 10"),
)
_UNIT_REACH = 0.15
"""Logarithm within which a gain is a unit's: an honest sensor is that good before it is calibrated."""
_USUAL_GAIN = (0.5, 2.0)
_DEAD_GAIN = 0.1
_EXPLAINED = 0.5
"""Part of the readings' spread that a working sensor's gain and offset explain at least."""
_SIGNIFICANT_STD = 4.0


@dataclass(frozen=True, eq=False)
class _Readings:
    """Readings (F,), the moments (F,) that they should be, and the robust line through both.

    gain_std : of the gain, by the scatter about the line.
    """

    read_Nm: np.ndarray
    true_Nm: np.ndarray
    gain: float
    offset_Nm: float
    gain_std: float

    @staticmethod
    def of(joint: BundleAdjustment, std_Nm: float) -> _Readings | None:
        """Of the stills that took part; None with fewer than 3, or where no moment was read."""
        _, moments = joint.problem.evaluate(joint.solution.parameters)
        kept = joint.kept
        read = np.array([one.still.moment_Nm for one in joint.noted])[kept]
        true = moments[kept, 0]
        if len(read) < 3 or not np.isfinite(read).all():
            return None
        # Theil and Sen's medians
        i, j = np.triu_indices(len(true), 1)
        far = np.abs(true[j] - true[i]) > 0.2 * np.ptp(true)
        gain = float(np.median((read[j] - read[i])[far] / (true[j] - true[i])[far]))
        offset = float(np.median(read - gain * true))
        scatter = max(mad_std(read - gain * true - offset), std_Nm)
        spread = float(np.sqrt(((true - true.mean()) ** 2).sum()))
        return _Readings(read, true, gain, offset, scatter / max(spread, 1e-12))

    @property
    def follow(self) -> bool:
        """Whether the line explains the readings' spread, by medians."""
        about = np.median(np.abs(self.read_Nm - np.median(self.read_Nm)))
        left = np.median(np.abs(self.read_Nm - self.gain * self.true_Nm - self.offset_Nm))
        return float(1.0 - left / max(about, 1e-15)) > _EXPLAINED

    @property
    def units(self) -> list[tuple[str, str]]:
        """Units, with their remedies, in which the gain would be 1."""
        if self.gain <= 0:
            return []
        return [(unit, remedy) for unit, factor, remedy in _UNITS if abs(np.log(self.gain / factor)) < _UNIT_REACH]


def sensor_diagnoses(
    joint: BundleAdjustment, std_Nm: float, drift: Estimate | None, per: str, moments_known: bool
) -> list[Diagnosis]:
    """What is wrong with the sensor; at most one of wiring, sign, unit and drift.

    drift : of its readings, N·m `per` s or row; None where it is not known.
    moments_known : the loads are what was noted. If not, only an unconnected sensor can be recognised.
    """
    readings = _Readings.of(joint, std_Nm)
    if readings is None or float(np.ptp(readings.true_Nm) / std_Nm) < _LEAST_SPREAD_STD:
        return []
    gain, std, follow, units = readings.gain, readings.gain_std, readings.follow, readings.units
    spread = f"while the true moments span {1e3 * np.ptp(readings.true_Nm):.3g} mN·m"
    known = f"gain {gain:.3g} ± {std:.2g}"
    weak = abs(gain) < max(_DEAD_GAIN, _SIGNIFICANT_STD * std) and not (follow and units)
    far = follow and gain > 0 and not _USUAL_GAIN[0] < gain < _USUAL_GAIN[1]
    words = f"the moment sensor's gain is {gain:.4g} ± {std:.2g}"
    drifts = drift is not None and abs(drift.in_std) > _SIGNIFICANT_STD and follow
    moved = "" if drift is None else f"{1e3 * drift.value:.2g} ± {1e3 * drift.std:.2g} mN·m per {per}"
    rules = (
        (
            np.ptp(readings.read_Nm) <= 1e-3 * std_Nm,
            "sensor_not_connected",
            f"all {len(readings.read_Nm)} moment readings are {readings.read_Nm[0]:.4g} N·m, {spread}",
            "connect the sensor, or leave moment_Nm to what it reads, not to a zero typed in",
        ),
        (
            moments_known and (weak or np.ptp(readings.read_Nm) < _SIGNIFICANT_STD * 2 * std_Nm),
            "sensor_not_connected",
            f"the moment readings do not follow the loads: {known}, {spread}",
            "check that the sensor is connected, sits between clamp and base, and that each row has its own reading",
        ),
        (
            moments_known and follow and gain <= -_SIGNIFICANT_STD * std,
            "sensor_sign",
            f"the moment sensor reads with the wrong sign: {known}",
            "exchange its two leads, or change the sign of moment_Nm in all tables, the recording's too",
        ),
        (
            moments_known and far and bool(units),
            "sensor_unit",
            f"{words}, as if it were read in {' or '.join(unit for unit, _ in units)}",
            f"{units[0][1] if units else ''}: moment_Nm is in N·m",
        ),
        (
            moments_known and far,
            "sensor_gain",
            f"{words}, far from 1",
            "check its calibration and the unit of moment_Nm",
        ),
        (
            moments_known and drifts,
            "sensor_drift",
            f"the moment readings drift by {moved}, or a few readings are wrong",
            "let it warm up, zero it again before a recording, and check that it is not at the end of its range",
        ),
    )
    grave = ("sensor_not_connected", "sensor_unit")
    return [Diagnosis(name, said, remedy, name in grave) for holds, name, said, remedy in rules if holds][:1]
