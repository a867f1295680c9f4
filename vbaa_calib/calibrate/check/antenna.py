"""Free shape, stiffness and moment sensor: their changes since the calibration, estimated from new pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np

from vbaa_calib.calibrate.antenna.problem import ANTENNA, GAIN, OFFSET
from vbaa_calib.calibrate.antenna.problem import RIG as LENS
from vbaa_calib.rig import Rig
from vbaa_calib.session import Load

from .change import Change, Information, estimate_change, joint_covariance
from .finding import HOLDS, Checked, Evidence, Finding, judged, not_given, plus_minus
from .stills import BOTH, MOMENT, POINTS, CheckedStill, free_shape_moved_mm, information, tip_std_mm

_CLAMP, _BOW, _STIFFNESS = (ANTENNA.start + np.arange(4), ANTENNA.start + np.arange(4, 6), ANTENNA.start + 6)
_FREE_SHAPE = np.concatenate([_CLAMP, _BOW])
_FREE_FLOOR_MM = 0.1
_STIFFNESS_FLOOR_PERCENT, _GAIN_FLOOR_PERCENT = 0.5, 0.5
_SCALE = np.array([0.01] * 3 + [1e-3] * 3 + [1e-3] * 2 + [0.01] * 2 + [0.1] * 2 + [0.05, 0.2, 1e-3, 0.05])
"""Noticeable changes of pose, antenna and gain; the offset's is ten times the sensor's noise."""
_WRONG_ROW_STD = 5.0
_UNSEEN_MM = 2.0
"""Standard deviation of the tip in a direction that the pictures do not show."""


_NO_FREE, _NO_LOADS = "no picture of the free antenna (noload/)", "no known loads (loads/)"
_NUMBERS = {
    "stiffness": ("EI {} % against the rig", 100.0, 100.0, "% of EI"),
    "sensor_offset": ("offset {} mN·m against the rig", 1e3, 1e3, "mN·m"),
    "sensor_gain": ("gain {} against the rig", 1.0, 100.0, "% of the reading"),
}
"""What is said of a change, the factor of the number in it, and factor and unit of its size."""


def check_antenna(rig: Rig, stills: Sequence[CheckedStill], camera_known: bool) -> Checked:
    """Free shape, then stiffness, then offset, then gain; what has changed is free in the estimates after it.

    camera_known : the camera's pose was checked by a board.
    """
    free = [one for one in stills if not isinstance(one.still, Load)]
    loaded = [one for one in stills if isinstance(one.still, Load)]
    covariance = joint_covariance(rig)
    scale = np.concatenate([_SCALE, [10 * rig.moment_sensor.std_Nm], np.full(len(covariance) - LENS, 0.01)])
    changed: list[int] = []

    def change(data: Information, wanted: Sequence[int] | np.ndarray) -> Change:
        return estimate_change(data, covariance, np.asarray(wanted), scale, changed)

    data = information(free, POINTS, len(covariance))
    shape = _shape_finding(rig, free, [change(data, which) for which in (_FREE_SHAPE, _CLAMP, _BOW)], camera_known)
    changed += _FREE_SHAPE.tolist() if shape.is_bad else []
    by_load = [change(data + information([one], POINTS, len(covariance)), [_STIFFNESS]) for one in loaded]
    # the points of the loads come in again with their readings, of which they share the errors
    bent = data + information(loaded, POINTS, len(covariance))
    remedy = "check the loads' mass and place first; then the clamp; then calibrate again"
    found = change(bent, [_STIFFNESS]) if loaded else _NO_LOADS
    stiffness = _number_finding("stiffness", found, _NO_LOADS, _STIFFNESS_FLOOR_PERCENT, remedy)
    if stiffness.evidence is not None:
        stiffness = replace(stiffness, words=f"{stiffness.words}, by {len(loaded)} load{'s' * (len(loaded) > 1)}")
    changed += [_STIFFNESS] if stiffness.is_bad else []
    read = [one for one in free if one.has_moment]
    zero = information(read, MOMENT, len(covariance))
    unread = "no reading was given with the picture of the free antenna (--moment)" if free else _NO_FREE
    found, floor = change(bent + zero, [OFFSET]) if read else unread, 1e3 * rig.moment_sensor.std_Nm
    offset = _number_finding("sensor_offset", found, _NO_FREE, floor, _offset_remedy(rig, read))
    changed += [OFFSET] if not read or offset.is_bad else []
    found = change(data + zero + information(loaded, BOTH, len(covariance)), [GAIN]) if loaded else _NO_LOADS
    hidden = "the given loads do not show the gain: add one that leaves plane C (force_z_N)"
    remedy = "check the loads' signs and the sensor's wiring, then calibrate again"
    gain = _number_finding("sensor_gain", found, hidden, _GAIN_FLOOR_PERCENT, remedy)
    rows = [_load_row(one, float(own.step[0]), float(own.std[0])) for one, own in zip(loaded, by_load, strict=True)]
    document = {"noload": [_free_row(rig.antenna.length_m, one) for one in free], "loads": rows}
    return Checked((shape, stiffness, offset, gain), document)


def _shape_finding(rig: Rig, free: Sequence[CheckedStill], changes: Sequence[Change], camera_known: bool) -> Finding:
    """changes : of clamp and bow together, and of each with the other fixed."""
    shape, clamp, bow = changes
    if shape.freedom == 0:
        return not_given("free_antenna", _NO_FREE)
    moved_mm = free_shape_moved_mm(rig, np.concatenate([shape.significant, [0.0, 0.0, 0.0]]))
    evidence = Evidence(shape.distance_std, shape.freedom, moved_mm, _FREE_FLOOR_MM, "mm along the antenna")
    words = f"off by at most {moved_mm:.2f} mm" if moved_mm > 0 else "no difference beyond its uncertainty"
    largest_mm = max(float(np.abs(one.residual_mm).max()) for one in free)
    words += f"; single points lie within {largest_mm:.2f} mm"
    if tip_std_mm(rig, shape.covariance) > _UNSEEN_MM:
        words += "; how far the tip lies along the line of sight does not show"
    if evidence.level == HOLDS:
        return judged("free_antenna", words, "", evidence)
    remedy = "straighten or replace the wire, then calibrate again"
    if clamp.distance_std > bow.distance_std:
        about_y, about_z = 1e3 * clamp.step[2:]
        words += f"; best explained by a clamp that turned: {about_y:+.1f} mrad about y, {about_z:+.1f} about z"
        remedy = "tighten the clamp, then calibrate again"
    else:
        words += f"; best explained by a bent wire: bow {bow.step[0]:+.3f} and {bow.step[1]:+.3f} per m"
    if not camera_known:
        remedy = "put a board into the jig and check again: the camera may have moved instead. If not, " + remedy
    return judged("free_antenna", words, remedy, evidence)


def _number_finding(name: str, change: Change | str, hidden: str, floor: float, remedy: str) -> Finding:
    """change : of one number; or why there is none. hidden : why the data may not show it."""
    if isinstance(change, str) or change.freedom == 0:
        return not_given(name, change if isinstance(change, str) else hidden)
    words, shown, factor, unit = _NUMBERS[name]
    said = words.format(plus_minus(shown * change.step[0], shown * change.std[0]))
    size = factor * abs(float(change.step[0]))
    return judged(name, said, remedy, Evidence(change.distance_std, 1, size, floor, unit))


def _offset_remedy(rig: Rig, stills: Sequence[CheckedStill]) -> str:
    """stills : of the free antenna, with their readings."""
    read = np.array([one.still.moment_Nm for one in stills])
    expected = read - [one.moment_residual_Nm for one in stills]
    noise = 10.0 * rig.moment_sensor.std_Nm + 0.1 * np.abs(expected)
    if (np.abs(1e-3 * read - expected) < noise).all() and (np.abs(read - expected) > 100.0 * noise).all():
        return "the reading would fit in mN·m: give it in N·m (1 mN·m is 0.001), and check again"
    return (
        "let the sensor warm up, tare it, and calibrate again if the offset stays; a wire of another weight or length "
        "reads like this, too"
    )


def _load_row(one: CheckedStill, step: float, std: float) -> dict[str, Any]:
    """A load in check.json: prediction against observation. step, std : change of log EI by it alone."""
    load, residual = cast(Load, one.still), one.moment_residual_Nm
    wrong = abs(step) > max(_WRONG_ROW_STD * std, 0.02) or abs(residual) > _WRONG_ROW_STD * one.moment_std_Nm
    return {
        "image": one.name,
        "distance_mm": 1e3 * load.distance_m,
        "force_y_mN": 1e3 * load.force_y_N,
        "force_z_mN": 1e3 * load.force_z_N,
        "predicted_deflection_mm": 1e3 * one.deflection_m,
        # the deflection goes as 1 / EI
        "seen_deflection_mm": 1e3 * one.deflection_m * float(np.exp(-step)),
        "stiffness_percent": 100 * step,
        "stiffness_std_percent": 100 * std,
        "rms_std": one.rms_std,
        "moment_predicted_mNm": 1e3 * (load.moment_Nm - residual),
        "moment_read_mNm": 1e3 * load.moment_Nm,
        "moment_residual_mNm": 1e3 * residual,
        "look_at": bool(wrong),
    }


def _free_row(length_m: float, one: CheckedStill) -> dict[str, Any]:
    """A picture of the free antenna in check.json, with its residuals in fifty places along the antenna."""
    edges = np.linspace(0.0, length_m, 51)
    place = np.digitize(one.arclength_m, edges)
    bins = [place == index for index in range(1, len(edges)) if (place == index).sum() >= 2]
    return {
        "image": one.name,
        "tilt_deg": float(np.degrees(one.still.tilt_rad)),
        "rms_std": one.rms_std,
        "arclength_mm": [1e3 * float(np.median(one.arclength_m[inside])) for inside in bins],
        "residual_mm": [float(np.median(one.residual_mm[inside])) for inside in bins],
        "moment_read_mNm": 1e3 * one.still.moment_Nm if one.has_moment else None,
        "moment_residual_mNm": 1e3 * one.moment_residual_Nm if one.has_moment else None,
    }
