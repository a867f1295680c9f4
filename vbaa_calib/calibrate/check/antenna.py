"""Does the antenna bend, and the moment sensor read, as the rig predicts?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vbaa_calib.calibrate.antenna.problem import ANTENNA, GAIN, OFFSET
from vbaa_calib.calibrate.antenna.problem import RIG as LENS
from vbaa_calib.rig import Rig
from vbaa_calib.session import Load

from .finding import (
    HOLDS,
    Change,
    Evidence,
    Finding,
    Information,
    estimated_change,
    joint_covariance,
    judged,
    not_given,
    plus_minus,
)
from .stills import HeldStill, free_shape_moved_mm, loads_information, tip_std_mm

CLAMP, BOW, STIFFNESS = np.arange(6, 10), np.arange(10, 12), 12
FREE_SHAPE = np.concatenate([CLAMP, BOW])
FREE_FLOOR_MM = 0.1
STIFFNESS_FLOOR_PERCENT, GAIN_FLOOR_PERCENT = 0.5, 0.5
_SCALE = np.array([0.01] * 3 + [1e-3] * 3 + [1e-3] * 2 + [0.01] * 2 + [0.1] * 2 + [0.05, 0.2, 1e-3, 0.05])
"""Changes worth knowing of, for pose, antenna and gain; the offset's is ten times the sensor's noise."""
WRONG_ROW_STD = 5.0
UNSEEN_MM = 2.0
"""A direction in which the tip is known no better than this is one that the pictures do not show."""


@dataclass(frozen=True, eq=False)
class AntennaEvidence:
    """What the stills say, in the order in which it was asked; None where no still could tell.

    Attributes
    ----------
    free_shape : change of the six numbers of clamp and bow. clamp, bow : by themselves, the other held.
    stiffness : change of log EI. offset, gain : of the moment sensor.
    by_load : change of log EI that each load by itself asks for, and its standard deviation.
    """

    free: Sequence[HeldStill]
    loaded: Sequence[HeldStill]
    free_shape: Change | None
    clamp: Change | None
    bow: Change | None
    stiffness: Change | None
    offset: Change | None
    gain: Change | None
    by_load: Sequence[tuple[float, float]]


def check_antenna(rig: Rig, free: Sequence[HeldStill], loaded: Sequence[HeldStill]) -> AntennaEvidence:
    """Free shape, then stiffness, then offset, then gain; what has changed is let loose in the questions after it."""
    covariance = joint_covariance(rig)
    scale = np.concatenate([_SCALE, [10 * rig.moment_sensor.std_Nm], np.full(len(covariance) - LENS, 0.01)])
    loose: list[int] = []

    def ask(data: Information, wanted: Sequence[int] | np.ndarray) -> Change:
        return estimated_change(data, covariance, np.asarray(wanted), scale, loose)

    data = sum((held.points for held in free), Information.none(len(covariance)))
    shape = ask(data, FREE_SHAPE) if free else None
    clamp, bow = (ask(data, CLAMP), ask(data, BOW)) if free else (None, None)
    if shape is not None and _shape_evidence(rig, shape).level != HOLDS:
        loose += FREE_SHAPE.tolist()
    single = [ask(data + held.points, [STIFFNESS]) for held in loaded]
    # the points of the loads come in again with their readings, of which they share the errors
    bent = data + loads_information(rig, loaded, moments=False) if loaded else data
    stiffness = ask(bent, [STIFFNESS]) if loaded else None
    if stiffness is not None and _stiffness_evidence(stiffness).level != HOLDS:
        loose.append(STIFFNESS)
    read = [held for held in free if held.is_read]
    zero = sum((held.reading(rig) for held in read), Information.none(len(covariance)))
    offset = ask(bent + zero, [OFFSET]) if read else None
    if offset is None or _offset_evidence(rig, offset).level != HOLDS:
        loose.append(OFFSET)
    whole = data + zero + loads_information(rig, loaded, moments=True) if loaded else data
    gain = ask(whole, [GAIN]) if loaded else None
    by_load = [(float(change.step[0]), float(change.std[0])) for change in single]
    return AntennaEvidence(free, loaded, shape, clamp, bow, stiffness, offset, gain, by_load)


def antenna_findings(rig: Rig, found: AntennaEvidence, camera_known: bool) -> list[Finding]:
    """Four questions: free shape, stiffness, offset, gain."""
    return [_shape(rig, found, camera_known), _stiffness(found), _offset(rig, found), _gain(found)]


def loads_table(rig: Rig, found: AntennaEvidence) -> list[dict[str, Any]]:
    """A row per load: predicted against seen."""
    rows = []
    for held, (step, std) in zip(found.loaded, found.by_load, strict=True):
        load, residual = held.still, held.moment_residual_Nm(rig)
        assert isinstance(load, Load)
        wrong = abs(step) > max(WRONG_ROW_STD * std, 0.02) or abs(residual) > WRONG_ROW_STD * held.moment_std_Nm(rig)
        rows.append(
            {
                "image": held.name,
                "distance_mm": 1e3 * load.distance_m,
                "force_y_mN": 1e3 * load.force_y_N,
                "force_z_mN": 1e3 * load.force_z_N,
                "predicted_deflection_mm": 1e3 * held.deflection_m,
                # the deflection goes as 1 / EI
                "seen_deflection_mm": 1e3 * held.deflection_m * float(np.exp(-step)),
                "stiffness_percent": 100 * step,
                "stiffness_std_percent": 100 * std,
                "rms_std": held.rms_std,
                "moment_predicted_mNm": 1e3 * (load.moment_Nm - residual),
                "moment_read_mNm": 1e3 * load.moment_Nm,
                "moment_residual_mNm": 1e3 * residual,
                "look_at": bool(wrong),
            }
        )
    return rows


def free_table(rig: Rig, found: AntennaEvidence) -> list[dict[str, Any]]:
    """A row per picture of the free antenna, with its residuals along the antenna in fifty places."""
    rows = []
    for held in found.free:
        bins = np.linspace(0.0, rig.antenna.length_m, 51)
        index = np.digitize(held.arclength_m, bins)
        known = [number for number in range(1, len(bins)) if (index == number).sum() >= 2]
        rows.append(
            {
                "image": held.name,
                "tilt_deg": float(np.degrees(held.still.tilt_rad)),
                "rms_std": held.rms_std,
                "arclength_mm": [1e3 * float(np.median(held.arclength_m[index == number])) for number in known],
                "residual_mm": [float(np.median(held.residual_mm[index == number])) for number in known],
                "moment_read_mNm": 1e3 * held.still.moment_Nm if held.is_read else None,
                "moment_residual_mNm": 1e3 * held.moment_residual_Nm(rig) if held.is_read else None,
            }
        )
    return rows


def _shape_evidence(rig: Rig, change: Change) -> Evidence:
    moved = free_shape_moved_mm(rig, np.concatenate([change.sure, [0.0, 0.0, 0.0]]))
    return Evidence(change.distance_std, max(change.freedom, 1), moved, FREE_FLOOR_MM, "mm along the antenna")


def _stiffness_evidence(change: Change) -> Evidence:
    return Evidence(change.distance_std, 1, 100 * abs(float(change.step[0])), STIFFNESS_FLOOR_PERCENT, "% of EI")


def _offset_evidence(rig: Rig, change: Change) -> Evidence:
    floor = 1e3 * rig.moment_sensor.std_Nm
    return Evidence(change.distance_std, 1, 1e3 * abs(float(change.step[0])), floor, "mN·m")


def _shape(rig: Rig, found: AntennaEvidence, camera_known: bool) -> Finding:
    name, question = "free_antenna", "Does the free antenna lie where the rig predicts it?"
    change, clamp, bow = found.free_shape, found.clamp, found.bow
    if change is None or clamp is None or bow is None or change.freedom == 0:
        return not_given(name, question, "no picture of the free antenna (noload/)")
    evidence = _shape_evidence(rig, change)
    worst = max(float(np.abs(held.residual_mm).max()) for held in found.free)
    words = (
        f"off by {evidence.size:.2f} mm at the most" if evidence.size > 0 else "no difference beyond its uncertainty"
    )
    words += f"; single points lie within {worst:.2f} mm"
    if tip_std_mm(rig, change.covariance) > UNSEEN_MM:
        words += "; how far the tip lies along the line of sight does not show"
    if evidence.level == HOLDS:
        return judged(name, question, words, "", evidence)
    remedy = "straighten or replace the wire, then calibrate again"
    angles, bows = 1e3 * clamp.step[2:], bow.step
    if clamp.distance_std > bow.distance_std:
        words += f"; best explained by a clamp that turned: {angles[0]:+.1f} mrad about y, {angles[1]:+.1f} about z"
        remedy = "tighten the clamp, then calibrate again"
    else:
        words += f"; best explained by a bent wire: bow {bows[0]:+.3f} and {bows[1]:+.3f} per m"
    if not camera_known:
        remedy = "put a board into the jig and check again: the camera may have moved instead. If not, " + remedy
    return judged(name, question, words, remedy, evidence)


def _stiffness(found: AntennaEvidence) -> Finding:
    name, question = "stiffness", "Does the antenna bend as EI predicts?"
    change = found.stiffness
    if change is None or change.freedom == 0:
        return not_given(name, question, "no known loads (loads/)")
    words = (
        f"EI {plus_minus(100 * change.step[0], 100 * change.std[0])} % against the rig, by "
        f"{len(found.loaded)} load{'s' if len(found.loaded) > 1 else ''}"
    )
    remedy = "check the loads' mass and place first; then the clamp; then calibrate again"
    return judged(name, question, words, remedy, _stiffness_evidence(change))


def _offset(rig: Rig, found: AntennaEvidence) -> Finding:
    name, question = "sensor_offset", "Does the moment sensor read nothing where nothing is?"
    change = found.offset
    if change is None and found.free:
        return not_given(name, question, "no reading was given with the picture of the free antenna (--moment)")
    if change is None or change.freedom == 0:
        return not_given(name, question, "no picture of the free antenna (noload/)")
    words = f"offset {plus_minus(1e3 * change.step[0], 1e3 * change.std[0])} mN·m against the rig"
    remedy = (
        "let the sensor warm up, tare it, and calibrate again if the offset stays; a wire of another weight or length "
        "reads like this, too"
    )
    if _in_millis(rig, found):
        remedy = "the reading would fit in mN·m: give it in N·m (1 mN·m is 0.001), and check again"
    return judged(name, question, words, remedy, _offset_evidence(rig, change))


def _in_millis(rig: Rig, found: AntennaEvidence) -> bool:
    """Whether a thousandth of what was read is what the free antenna should read, and what was read is far from it."""
    read = np.array([held.still.moment_Nm for held in found.free if np.isfinite(held.still.moment_Nm)])
    sensor = rig.moment_sensor
    expected = np.array(
        [sensor.gain * held.moment_Nm + sensor.offset_Nm for held in found.free if np.isfinite(held.still.moment_Nm)]
    )
    noise = 10.0 * sensor.std_Nm + 0.1 * np.abs(expected)
    fits = np.abs(1e-3 * read - expected) < noise
    return bool(read.size and fits.all() and (np.abs(read - expected) > 100.0 * noise).all())


def _gain(found: AntennaEvidence) -> Finding:
    name, question = "sensor_gain", "Does the moment sensor read the loads as it did?"
    change = found.gain
    if change is None:
        return not_given(name, question, "no known loads (loads/)")
    if change.freedom == 0:
        return not_given(
            name, question, "the loads given do not show the gain: add one that leaves plane C (force_z_N)"
        )
    words = f"gain {plus_minus(change.step[0], change.std[0])} against the rig"
    evidence = Evidence(
        change.distance_std, 1, 100 * abs(float(change.step[0])), GAIN_FLOOR_PERCENT, "% of the reading"
    )
    remedy = "check the loads' signs and the sensor's wiring, then calibrate again"
    return judged(name, question, words, remedy, evidence)


assert ANTENNA.start == CLAMP[0]
