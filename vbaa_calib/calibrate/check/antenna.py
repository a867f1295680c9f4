"""Free shape, stiffness and moment sensor against new pictures: residuals, and changes since the calibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from vbaa_calib.antenna.shape import CONTACT, bend
from vbaa_calib.calibrate.antenna.inputs import EXACT, Observation, Prior
from vbaa_calib.calibrate.antenna.problem import ANTENNA, GAIN, LOG_STIFFNESS, OFFSET, Problem
from vbaa_calib.calibrate.antenna.problem import RIG as LENS
from vbaa_calib.core.arrays import neighbours
from vbaa_calib.core.least_squares import ScoreTest, change_test, products
from vbaa_calib.core.robust import finite_or_none, mad_std
from vbaa_calib.rig import RIG_STEPS, Rig
from vbaa_calib.rig.reprojection import feet, image_curves
from vbaa_calib.session import Drift, Load, LoadReadings, Still

from .finding import HOLDS, Discrepancy, Finding, judged, plus_minus, unanswered
from .settings import CheckSettings

_POINTS = slice(-1)  # rows of a `CheckedStill` by its points; the last is its moment's
_FREE_SHAPE = ANTENNA.start + np.arange(6)  # places among `RIG_PARAMETERS`: the clamp's four, the bow's two
_SCALE = np.array([0.01] * 3 + [1e-3] * 3 + [1e-3] * 2 + [0.01] * 2 + [0.1] * 2 + [0.05, 0.2, 1e-3, 0.05])
"""Noticeable changes of pose, antenna and gain; the offset's is ten times the sensor's noise."""
_NO_FREE = "no picture of the free antenna (noload/)"  # why a question is left open
_NO_LOADS = "no known loads (loads/)"  # the same
_NUMBERS = {
    "stiffness": ("EI {} % against the rig", 100.0, 100.0, "% of EI"),
    "sensor_offset": ("offset {} mN·m against the rig", 1e3, 1e3, "mN·m"),
    "sensor_gain": ("gain {} against the rig", 1.0, 100.0, "% of the reading"),
}
"""Words on a change, the factor of the number in them, and factor and unit of its size."""


@dataclass(frozen=True, eq=False)
class CheckedStill:
    """One picture of the antenna with N points, and its prediction by the rig."""

    still: Still
    arclength_m: np.ndarray  # (N,) where each point lies along the predicted antenna
    residual_mm: np.ndarray  # (N,) its distance from it there
    residuals: np.ndarray  # (N + 1,) of points and moment (NaN where not read), observed less predicted, in deviations
    jacobian: np.ndarray  # (N + 1, 17 + P) of the predictions by the rig's parameters, in deviations
    by_readings: np.ndarray  # (N + 1, K) by the errors of all loads' places and weights, each in its deviations
    by_line: np.ndarray  # (N + 1, 3) by the common errors of the picture's points
    moment_residual_Nm: float  # reading less prediction
    moment_std_Nm: float  # of that, by the sensor's noise and the uncertainty of place and weight
    deflection_m: float  # predicted at the load, against the free antenna; 0 without a load

    def common(self) -> dict[str, Any]:
        """The entry of check.json that every picture has: its name, and its points' rms residual in standard
        deviations."""
        name = self.still.image.name if self.still.image else "?"
        return {"image": name, "rms_std": float(np.sqrt((self.residuals[_POINTS] ** 2).mean()))}


def check_stills(rig: Rig, observations: Sequence[Observation], readings: LoadReadings = EXACT) -> list[CheckedStill]:
    """Every static frame with the rig's prediction. readings : uncertainty of the loads' distances and weights."""
    sensor, noise, view = rig.moment_sensor, rig.image.noise_scale, rig.T_antenna_camera.inverse()
    mean = np.concatenate([rig.antenna.parameters, [sensor.gain, sensor.offset_Nm]])
    # steps along its axes are steps of the lens' parameters, of one that counts as exact, too
    unit = np.eye(len(rig.camera.parameter_names))
    lens = replace(rig.camera, covariance=unit)
    drift = Drift(line_px=rig.drift.line_px)
    several = rig.wrench_sensor
    prior = Prior((), rig.T_antenna_camera, lens, mean, np.ones(len(mean)), readings, drift=drift, fixed_axes=unit)
    prior = replace(prior, taper=rig.antenna.taper)
    if several is not None:
        prior = replace(prior, sensor=several, sensor_std=np.ones(3 + 2 * len(several.gain)))
    problem = Problem.of(observations, prior, rig.antenna.length_m, sensor.std_Nm)
    problem, at = replace(problem, noise_scale=noise), problem.begin
    curves = problem.curves(at[None, ANTENNA])
    free = problem.unloaded.curves(at[None, ANTENNA])
    deflections_m = np.linalg.norm(curves.points_m[:, CONTACT] - free.points_m[:, CONTACT], axis=1)
    checked = []
    for index, (observation, (misfits, slopes)) in enumerate(zip(observations, problem.by_still(at), strict=True)):
        own, points = curves.picked(np.array([index])), problem.seen_at_lens[index]
        # points that lie where their neighbours do
        count = min(CheckSettings.neighbours, len(misfits) - 1)
        off = misfits[_POINTS] - np.sort(neighbours(misfits[_POINTS], count, "edge"))[:, count // 2]
        near = np.append(np.abs(off) <= CheckSettings.outlying_point * max(mad_std(off), 0.2), True)
        # points: distances from the prediction, which moves the other way; moment: the prediction less the reading
        sign = np.append(-np.ones(near.sum() - 1), 1.0)[:, None]
        residuals = -sign[:, 0] * misfits[near]
        points = points.picked(near[_POINTS])
        foot = feet(points, image_curves(own, view))
        depth = np.interp(foot, own.arclength_m[0], (view @ own.points_m[0])[:, 2])
        # the geometric mean over directions stands for the deviation along the normal: pixels are all but square
        across = np.sqrt(np.sqrt(np.linalg.det(points.covariance).clip(0.0))) * noise
        by_readings = sign * slopes[near][:, problem.readings]
        checked.append(
            CheckedStill(
                still=observation.still,
                arclength_m=foot,
                residual_mm=1e3 * residuals[_POINTS] * across * depth,
                residuals=residuals,
                jacobian=sign * slopes[near][:, : problem.lens.stop],
                by_readings=by_readings,
                by_line=np.vstack([problem.line_modes(index)[near[_POINTS]], np.zeros(3)]),
                moment_residual_Nm=float(residuals[-1]) * sensor.std_Nm,
                moment_std_Nm=sensor.std_Nm * float(np.linalg.norm([1.0, *by_readings[-1]])),
                deflection_m=float(deflections_m[index]) if isinstance(observation.still, Load) else 0.0,
            )
        )
    return checked


def check_antenna(
    rig: Rig, frames: Sequence[CheckedStill], camera_known: bool
) -> tuple[tuple[Finding, ...], dict[str, Any]]:
    """Checks free shape, stiffness, offset and gain, in this order; each estimate uses the changes found before it.
    camera_known : whether the camera's pose was checked with a board."""
    free = [one for one in frames if not isinstance(one.still, Load)]
    loaded = [one for one in frames if isinstance(one.still, Load)]
    covariance = rig.joint_covariance
    count = len(covariance)
    sensor = rig.moment_sensor
    scale = np.concatenate([_SCALE, [10 * sensor.std_Nm if sensor.exists else 1.0], np.full(count - LENS, 0.01)])
    changed: list[int] = []

    def change(data: np.ndarray, wanted: Sequence[int] | np.ndarray) -> ScoreTest:
        return change_test(data, covariance, np.asarray(wanted), scale, changed)

    data = _information(free, _POINTS, count)
    shape = _shape_finding(
        rig, free, [change(data, which) for which in (_FREE_SHAPE, _FREE_SHAPE[:4], _FREE_SHAPE[4:])], camera_known
    )
    changed += _FREE_SHAPE.tolist() if shape.is_bad else []
    by_load = [change(data + _information([one], _POINTS, count), [LOG_STIFFNESS]) for one in loaded]
    # the points of the loads come in again with their readings, of which they share the errors
    bent = data + _information(loaded, _POINTS, count)
    remedy = "check the loads' mass and place first; then the clamp; then calibrate again"
    stiffness = _number_finding("stiffness", change(bent, [LOG_STIFFNESS]) if loaded else _NO_LOADS, _NO_LOADS, remedy)
    if stiffness.evidence is not None:
        stiffness = replace(stiffness, words=f"{stiffness.words}, by {len(loaded)} load{'s' * (len(loaded) > 1)}")
    changed += [LOG_STIFFNESS] if stiffness.is_bad else []
    read = [one for one in free if np.isfinite(one.still.moment_Nm)]
    zero = _information(read, slice(-1, None), count)  # by the moments
    document = {
        "noload": [_free_row(rig.antenna.length_m, one) for one in free],
        "loads": [
            _load_row(one, float(own.values[0]), float(own.std[0])) for one, own in zip(loaded, by_load, strict=True)
        ],
    }
    if not sensor.exists:
        return (shape, stiffness), document
    unread = "no reading was given with the picture of the free antenna (--moment)" if free else _NO_FREE
    found = change(bent + zero, [OFFSET]) if read else unread
    offset = _number_finding("sensor_offset", found, _NO_FREE, _offset_remedy(rig, read), 1e3 * sensor.std_Nm)
    changed += [OFFSET] if not read or offset.is_bad else []
    found = change(data + zero + _information(loaded, slice(None), count), [GAIN]) if loaded else _NO_LOADS
    hidden = "the given loads do not show the gain: add one that leaves plane C (force_z_N)"
    remedy = "check the loads' signs and the sensor's wiring, then calibrate again"
    gain = _number_finding("sensor_gain", found, hidden, remedy)
    return (shape, stiffness, offset, gain), document


def _information(frames: Sequence[CheckedStill], rows: slice, count: int) -> np.ndarray:
    """Normal equations of rows of static frames by `count` parameters of the rig; loads that share a distance or
    weight share its error, and the points of one line share theirs."""
    if not frames:
        return products(np.zeros((0, count)), np.zeros(0))
    jacobian = np.vstack([one.jacobian[rows] for one in frames])
    residuals = np.concatenate([one.residuals[rows] for one in frames])
    by_readings = np.vstack([one.by_readings[rows] for one in frames])
    last = 3 * (len(frames) - 1)
    by_lines = [np.pad(one.by_line[rows], ((0, 0), (3 * i, last - 3 * i))) for i, one in enumerate(frames)]
    return products(jacobian, residuals, np.hstack([by_readings, np.vstack(by_lines)]))


def _shape_finding(rig: Rig, free: Sequence[CheckedStill], changes: Sequence[ScoreTest], camera_known: bool) -> Finding:
    """The finding on the free shape. changes : of clamp and bow jointly, and of each with the other fixed."""
    shape, clamp, bow = changes
    if shape.freedom == 0:
        return unanswered("free_antenna", _NO_FREE)
    step = np.concatenate([shape.clear(CheckSettings.significant), [0.0, 0.0, 0.0]])
    before_m, after_m = _free_points_m(rig, np.stack([np.zeros_like(step), step]))
    moved_mm = 1e3 * float(np.linalg.norm(after_m - before_m, axis=1).max())
    evidence = Discrepancy(
        shape.distance_std, shape.freedom, moved_mm, CheckSettings.free_floor_mm, "mm along the antenna"
    )
    words = f"off by at most {moved_mm:.2f} mm" if moved_mm > 0 else "no difference beyond its uncertainty"
    largest_mm = max(float(np.abs(one.residual_mm).max()) for one in free)
    words += f"; single points lie within {largest_mm:.2f} mm"
    if _tip_std_mm(rig, shape.covariance) > CheckSettings.unseen_mm:
        words += "; the tip's position along the line of sight is not visible"
    if evidence.level == HOLDS:
        return judged("free_antenna", words, "", evidence)
    if clamp.distance_std > bow.distance_std:
        about_y, about_z = 1e3 * clamp.values[2:]
        words += f"; best explained by a clamp that turned: {about_y:+.1f} mrad about y, {about_z:+.1f} about z"
        remedy = "tighten the clamp, then calibrate again"
    else:
        words += f"; best explained by a bent wire: bow {bow.values[0]:+.3f} and {bow.values[1]:+.3f} per m"
        remedy = "straighten or replace the wire, then calibrate again"
    if not camera_known:
        remedy = "put a board into the jig and check again: the camera may have moved instead. If not, " + remedy
    return judged("free_antenna", words, remedy, evidence)


def _tip_std_mm(rig: Rig, covariance: np.ndarray) -> float:
    """Standard deviation in mm of the free tip in its worst direction, from the covariance (6, 6) of clamp and bow."""
    steps = RIG_STEPS[ANTENNA]
    tips = _free_points_m(rig, np.vstack([np.zeros(9), np.diag(steps)[:6]]))[:, -1]
    slopes = ((tips[1:] - tips[0]) / steps[:6, None]).T
    return 1e3 * float(np.sqrt(np.linalg.eigvalsh(slopes @ covariance @ slopes.T)[-1]))


def _free_points_m(rig: Rig, steps: np.ndarray) -> np.ndarray:
    """Points (S, nodes, 3) m of the weightless free antenna with its parameters changed by steps (S, 9)."""
    zero, parameters = np.zeros((len(steps), 3)), rig.antenna.parameters + steps
    return bend(
        parameters, rig.antenna.length_m, zero, np.full(len(steps), 0.1), zero[:, 1:], taper=rig.antenna.taper
    ).points_m


def _number_finding(
    name: str, change: ScoreTest | str, hidden: str, remedy: str, floor: float = CheckSettings.number_floor_percent
) -> Finding:
    """The finding on one parameter. change : its change, or the reason why there is none. hidden : why the data may
    not determine it."""
    if isinstance(change, str) or change.freedom == 0:
        return unanswered(name, change if isinstance(change, str) else hidden)
    template, printed, factor, unit = _NUMBERS[name]
    words = template.format(plus_minus(printed * change.values[0], printed * change.std[0]))
    return judged(
        name, words, remedy, Discrepancy(change.distance_std, 1, factor * abs(float(change.values[0])), floor, unit)
    )


def _offset_remedy(rig: Rig, frames: Sequence[CheckedStill]) -> str:
    """Remedy for a changed offset, from the free antenna's frames and their readings."""
    read = np.array([one.still.moment_Nm for one in frames])
    expected = read - [one.moment_residual_Nm for one in frames]
    noise = 10.0 * rig.moment_sensor.std_Nm + 0.1 * np.abs(expected)
    if (np.abs(1e-3 * read - expected) < noise).all() and (np.abs(read - expected) > 100.0 * noise).all():
        return "the reading would fit in mN·m: give it in N·m (1 mN·m is 0.001), and check again"
    return (
        "let the sensor warm up, tare it, and calibrate again if the offset stays; a wire of another weight or length "
        "reads like this, too"
    )


def _load_row(one: CheckedStill, step: float, std: float) -> dict[str, Any]:
    """One load's entry of check.json: prediction and observation. step, std : change of log EI from this load alone."""
    load, residual = cast(Load, one.still), one.moment_residual_Nm
    wrong = (
        abs(step) > max(CheckSettings.wrong_row * std, 0.02)
        or abs(residual) > CheckSettings.wrong_row * one.moment_std_Nm
    )
    return one.common() | {
        "distance_mm": 1e3 * load.distance_m,
        "force_y_mN": 1e3 * load.force_y_N,
        "force_z_mN": 1e3 * load.force_z_N,
        "predicted_deflection_mm": 1e3 * one.deflection_m,
        # the deflection goes as 1 / EI
        "seen_deflection_mm": 1e3 * one.deflection_m * float(np.exp(-step)),
        "stiffness_percent": 100 * step,
        "stiffness_std_percent": 100 * std,
        "moment_predicted_mNm": finite_or_none(1e3 * (load.moment_Nm - residual)),
        "moment_read_mNm": finite_or_none(1e3 * load.moment_Nm),
        "moment_residual_mNm": finite_or_none(1e3 * residual),
        "look_at": bool(wrong),
    }


def _free_row(length_m: float, one: CheckedStill) -> dict[str, Any]:
    """One no-load picture's entry of check.json, with its residuals at fifty places along the antenna."""
    edges = np.linspace(0.0, length_m, 51)
    place = np.digitize(one.arclength_m, edges)
    bins = [place == index for index in range(1, len(edges)) if (place == index).sum() >= 2]
    return one.common() | {
        "tilt_deg": float(np.degrees(one.still.tilt_rad)),
        "arclength_mm": [1e3 * float(np.median(one.arclength_m[inside])) for inside in bins],
        "residual_mm": [float(np.median(one.residual_mm[inside])) for inside in bins],
        "moment_read_mNm": finite_or_none(1e3 * one.still.moment_Nm),
        "moment_residual_mNm": finite_or_none(1e3 * one.moment_residual_Nm),
    }
