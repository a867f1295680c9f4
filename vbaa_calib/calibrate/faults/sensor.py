"""The moment sensor against what the pictures and the known loads say it had to read."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vbaa_calib.calibrate.antenna.bundle_adjustment import JointSolution
from vbaa_calib.calibrate.antenna.residual_checks import Estimate
from vbaa_calib.core.errors import Diagnosis
from vbaa_calib.core.robust import mad_std

LEAST_SPREAD_STD = 30.0
"""The moments must spread by this many of the sensor's deviations, for its gain to be judged."""
UNITS = (
    ("N·mm", 1e3, "divide the readings by 1000"),
    ("mN·m", 1e3, "divide the readings by 1000"),
    ("N·cm", 1e2, "divide the readings by 100"),
    ("kgf·m", 1 / 9.80665, "multiply the readings by 9.80665"),
    ("kgf·cm", 100 / 9.80665, "divide the readings by 10.197"),
    ("gf·cm", 1e5 / 9.80665, "divide the readings by 10197"),
    ("kN·m", 1e-3, "multiply the readings by 1000"),
    ("decimetres for metres", 1e1, "divide the readings by 10"),
)
UNIT_REACH = 0.15
"""Logarithm within which a gain is taken for a unit's: an honest sensor is that good before it is calibrated."""
USUAL_GAIN = (0.5, 2.0)
DEAD_GAIN = 0.1
EXPLAINED = 0.5
"""Part of the readings' spread that a working sensor's gain and offset explain at least."""
GAIN_SURE = 4.0


@dataclass(frozen=True, eq=False)
class Readings:
    """What was read and what had to be.

    Attributes
    ----------
    read_Nm, true_Nm : (F,). std_Nm : of the sensor's noise, as the session says.
    gain, offset_Nm : the line through them that half of them lie nearest to.
    gain_std : of it, by the scatter about the line.
    """

    read_Nm: np.ndarray
    true_Nm: np.ndarray
    std_Nm: float
    gain: float
    offset_Nm: float
    gain_std: float

    @staticmethod
    def of(joint: JointSolution, std_Nm: float) -> Readings | None:
        """Of the stills that took part; None with fewer than 3, or where no moment was read."""
        _, moments = joint.problem.evaluate(joint.solution.parameters)
        kept = joint.kept
        read = np.array([one.still.moment_Nm for one in joint.noted])[kept]
        true = moments[kept, 0]
        if len(read) < 3 or not np.isfinite(read).all():
            return None
        gain, offset = _line(true, read)
        scatter = max(mad_std(read - gain * true - offset), std_Nm)
        spread = float(np.sqrt(((true - true.mean()) ** 2).sum()))
        return Readings(read, true, std_Nm, gain, offset, scatter / max(spread, 1e-12))

    @property
    def spread_std(self) -> float:
        """Range of the true moments in the sensor's deviations."""
        return float(np.ptp(self.true_Nm) / self.std_Nm)


def sensor_diagnoses(
    joint: JointSolution, std_Nm: float, drift: Estimate | None, per: str, moments_known: bool = True
) -> list[Diagnosis]:
    """What is wrong with the sensor, the most telling first; at most one of wiring, sign and unit.

    Parameters
    ----------
    drift : of its readings, N·m `per` s or row; None where it is not known.
    moments_known : the loads are what was noted. If not, a sensor that is not connected is all that can be told.
    """
    readings = Readings.of(joint, std_Nm)
    if readings is None or readings.spread_std < LEAST_SPREAD_STD:
        return []
    if not moments_known:
        dead = _unconnected(readings)
        return [] if dead is None else [dead]
    for judged in (
        _unconnected(readings),
        _unrelated(readings),
        _sign(readings),
        _unit(readings),
    ):
        if judged is not None:
            return [judged]
    if drift is not None and abs(drift.in_std) > GAIN_SURE and _fits(readings):
        return [
            Diagnosis(
                "sensor_drift",
                f"the moment readings run off by {1e3 * drift.value:.2g} ± {1e3 * drift.std:.2g} mN·m per {per}: the "
                "moment sensor drifts, or a few readings are wrong",
                "let it warm up, zero it again before a recording, and check that it is not at the end of its range",
            )
        ]
    return []


def _line(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Slope and offset that the most points follow, by Theil and Sen's medians."""
    i, j = np.triu_indices(len(x), 1)
    far = np.abs(x[j] - x[i]) > 0.2 * np.ptp(x)
    slope = float(np.median((y[j] - y[i])[far] / (x[j] - x[i])[far]))
    return slope, float(np.median(y - slope * x))


def _explained(readings: Readings) -> float:
    """Part of the readings' spread that the line explains, by medians."""
    about = np.median(np.abs(readings.read_Nm - np.median(readings.read_Nm)))
    left = np.median(np.abs(readings.read_Nm - readings.gain * readings.true_Nm - readings.offset_Nm))
    return float(1.0 - left / max(about, 1e-15))


def _fits(readings: Readings) -> bool:
    return _explained(readings) > EXPLAINED


def _span(readings: Readings) -> str:
    return f"the true moments span {1e3 * np.ptp(readings.true_Nm):.3g} mN·m"


def _unconnected(readings: Readings) -> Diagnosis | None:
    if np.ptp(readings.read_Nm) > 1e-3 * readings.std_Nm:
        return None
    return Diagnosis(
        "sensor_not_connected",
        f"all {len(readings.read_Nm)} moment readings are {readings.read_Nm[0]:.4g} N·m, while {_span(readings)}",
        "connect the sensor, or leave moment_Nm to what it reads, not to a zero typed in",
        grave=True,
    )


def _unrelated(readings: Readings) -> Diagnosis | None:
    weak = abs(readings.gain) < max(DEAD_GAIN, GAIN_SURE * readings.gain_std)
    unit = any(abs(np.log(abs(readings.gain) / factor)) < UNIT_REACH for _, factor, _ in UNITS if readings.gain > 0)
    noise = np.ptp(readings.read_Nm) < GAIN_SURE * 2 * readings.std_Nm
    if not (noise or (weak and not _fits(readings)) or (weak and not unit)):
        return None
    return Diagnosis(
        "sensor_not_connected",
        f"the moment readings do not follow the loads: gain {readings.gain:.3g} ± {readings.gain_std:.2g}, while "
        f"{_span(readings)}",
        "check that the sensor is connected, sits between clamp and base, and that each row has its own reading",
        grave=True,
    )


def _sign(readings: Readings) -> Diagnosis | None:
    if readings.gain > -GAIN_SURE * readings.gain_std or not _fits(readings):
        return None
    return Diagnosis(
        "sensor_sign",
        f"the moment sensor reads with the wrong sign: gain {readings.gain:.3g} ± {readings.gain_std:.2g}",
        "exchange its two leads, or turn the sign of moment_Nm round in all tables, the recording's too",
    )


def _unit(readings: Readings) -> Diagnosis | None:
    gain = readings.gain
    if USUAL_GAIN[0] < gain < USUAL_GAIN[1] or gain <= 0 or not _fits(readings):
        return None
    near = [(unit, remedy) for unit, factor, remedy in UNITS if abs(np.log(gain / factor)) < UNIT_REACH]
    words = f"the moment sensor's gain is {gain:.4g} ± {readings.gain_std:.2g}"
    if not near:
        return Diagnosis("sensor_gain", f"{words}, far from 1", "check its calibration and the unit of moment_Nm")
    units = " or ".join(unit for unit, _ in near)
    return Diagnosis(
        "sensor_unit", f"{words}, as if it were read in {units}", f"{near[0][1]}: moment_Nm is in N·m", True
    )


def drift_of(checks_drift_per_s: Estimate | None, per_row: Estimate | None) -> tuple[Estimate | None, str]:
    """The drift that is known, and what it is per."""
    return (checks_drift_per_s, "s") if checks_drift_per_s is not None else (per_row, "row")
