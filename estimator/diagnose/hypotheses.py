"""The table of hypotheses about a recording: readings, pictures and rig that are not as reported."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from itertools import combinations, combinations_with_replacement
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from vbaa_calib.core.errors import Diagnosis, Severity
from vbaa_calib.diagnose.decision import DecisionSettings, Explanation, Hypothesis
from vbaa_calib.geometry import Pose
from vbaa_calib.rig import Rig, WrenchSensor
from vbaa_calib.session import READINGS as SENSED

from .changes import AGAIN, CHANGES, Change, axes_of, fitted
from .evidence import Case, Recorded
from .settings import RecordingSettings


class _Misread(NamedTuple):
    """A row of the table of mistakes: readings or pictures that are not as reported.

    correct : gives recorded frames with the mistake put right; None where it cannot have happened.
    log_density : logarithm of the ratio of a correct reading's probability density in the reported unit to that in its
        own, per frame.
    """

    name: str
    words: str
    remedy: str
    correct: Callable[[Recorded], Recorded | None]
    log_density: float = 0.0
    severity: Severity = "wrong"
    log_prior: float = 0.0  # against the other rows
    first: int = 0  # frame from which on it holds

    @property
    def of_moment(self) -> bool:
        """Whether the mistake concerns the moment."""
        return self.name.startswith("moment_")

    @property
    def may_begin(self) -> bool:
        """Whether it may have begun in the middle of a recording, and concerns each reading by itself."""
        return self.name in ("moment_sign", "moment_unit")

    @property
    def of_pictures(self) -> bool:
        """Whether the mistake concerns the pictures, not readings."""
        return self.name.startswith("picture_") or self.name == "points_exchanged"


def _moments(change: Callable[[np.ndarray], np.ndarray], recorded: Recorded) -> Recorded | None:
    readings = recorded.batch.readings_Nm
    if not np.isfinite(readings[:, 0]).any():
        return None
    return recorded.with_readings(readings_Nm=np.column_stack([change(readings[:, 0]), readings[:, 1:]]))


def _turned(angle_rad: float, recorded: Recorded) -> Recorded | None:
    """Hypothesis of a sensor that is turned about the antenna, by 90° if its moment is about z."""
    rig, readings = recorded.rig, recorded.batch.readings_Nm
    if rig.wrench_sensor is not None or not np.isfinite(readings[:, 0]).any():
        return None
    other = np.full_like(readings, np.nan)
    other[:, 1] = readings[:, 0]
    # its zero is as uncertain as of the sensor about y
    zero = list(rig.parameter_names).index("moment_offset_Nm")
    std_Nm = float(np.hypot(rig.moment_sensor.std_Nm, np.sqrt(rig.covariance[zero, zero])))
    sensor = WrenchSensor.about_z(replace(rig.moment_sensor, std_Nm=std_Nm))
    turn = Pose.from_rotvec(np.array([0.5 * np.pi - angle_rad, 0.0, 0.0]), np.zeros(3))
    return recorded.with_rig(replace(rig, wrench_sensor=replace(sensor, T_antenna_sensor=turn))).with_readings(
        readings_Nm=other
    )


def _absolute(recorded: Recorded) -> Recorded | None:
    """Hypothesis of a lost sign of the moment: the one that fits each frame better."""
    readings = recorded.batch.readings_Nm
    one_sided = readings[:, 0][np.isfinite(readings[:, 0])]
    if len(one_sided) < 3 or (one_sided.min() < 0.0 < one_sided.max()):
        return None
    turn = np.array([-1.0, *np.ones(readings.shape[1] - 1)])
    turned = recorded.with_readings(readings_Nm=readings * turn)
    better = turned.fit.cost < recorded.fit.cost
    return recorded.with_readings(readings_Nm=np.where(better[:, None], readings * turn, readings))


def _channels(first: int, second: int, sign: float, recorded: Recorded) -> Recorded | None:
    """Hypothesis of two exchanged channels of a sensor of several axes, or of one with its sign reversed."""
    readings = recorded.batch.readings_Nm.copy()
    if recorded.rig.wrench_sensor is None or not np.isfinite(readings[:, [first, second]]).any(axis=0).all():
        return None
    readings[:, [first, second]] = sign * readings[:, [second, first]]
    return recorded.with_readings(readings_Nm=readings)


def _joints(turn: np.ndarray, recorded: Recorded) -> Recorded | None:
    angles = np.stack([recorded.batch.pan_rad, recorded.batch.tilt_rad])
    pan, tilt = turn @ angles
    if max(np.abs(angles).max(), np.abs(pan).max(), np.abs(tilt).max()) < RecordingSettings.varies_rad:
        return None
    if max(np.abs(pan).max(), np.abs(tilt).max()) > 2.0 * np.pi:
        return None
    return recorded.with_readings(pan_rad=pan, tilt_rad=tilt)


def _frozen(recorded: Recorded) -> Recorded | None:
    """The recording with the tilt that fits each frame best, if both joint readings never change; None otherwise."""
    batch = recorded.batch
    if max(np.ptp(batch.pan_rad), np.ptp(batch.tilt_rad)) > 0.0:
        return None
    best = np.zeros(len(recorded))
    least = np.full(len(recorded), np.inf)
    for steps in RecordingSettings.tilts_rad:
        middle = best.copy()
        for step in steps:
            cost = recorded.with_readings(tilt_rad=middle + step).fit.cost
            best, least = np.where(cost < least, middle + step, best), np.minimum(cost, least)
    return recorded.with_readings(tilt_rad=best)


def _lagged(which: slice, rows: float, recorded: Recorded, all_reported: bool = False) -> Recorded | None:
    """Hypothesis of readings that belong to the picture so many rows earlier, interpolated linearly between rows.

    which : of all readings, pan and tilt. At either end of the recording joints are as reported, and so are the other
    readings if `all_reported`; else these are unknown there.
    """
    batch = recorded.batch
    now = np.column_stack([batch.readings_Nm, batch.pan_rad, batch.tilt_rad])
    series = np.concatenate([now[:, None], recorded.around[:, int(rows > 0.0)]], axis=1)
    if abs(rows) > series.shape[1] - 1:
        return None
    whole = min(int(abs(rows)), series.shape[1] - 2)
    there, part = series[:, whole], abs(rows) - whole
    there = there + part * (series[:, whole + 1] - there) if part else there
    beyond = ~np.isfinite(there[:, -2:])
    kept = np.hstack([np.tile(beyond[:, :1] & all_reported, (1, now.shape[1] - 2)), beyond])
    now[:, which] = np.where(kept, now, there)[:, which]
    return recorded.with_readings(readings_Nm=now[:, :-2], pan_rad=now[:, -2], tilt_rad=now[:, -1])


def _a_row_off(which: slice, rows: float, recorded: Recorded) -> Recorded | None:
    """Hypothesis of readings that belong to the picture of the row before (1.0) or after (−1.0); None where one of
    these kinds is not read, or does not vary. which : as of `_lagged`."""
    batch, moments = recorded.batch, np.isfinite(recorded.batch.readings_Nm[:, 0]).any()
    turned_rad = np.ptp(np.stack([batch.pan_rad, batch.tilt_rad]), axis=1).max()
    of_joints = which.stop is None
    if (which.start is None and not moments) or (of_joints and turned_rad < RecordingSettings.varies_rad):
        return None
    return _lagged(which, rows, recorded, all_reported=True)


def _tilted(angle_rad: float, recorded: Recorded) -> Recorded | None:
    """Hypothesis of a constant error of the tilt."""
    return recorded.with_readings(tilt_rad=recorded.batch.tilt_rad + angle_rad)


def _points(change: Callable[[np.ndarray, np.ndarray], np.ndarray], recorded: Recorded) -> Recorded | None:
    """Hypothesis of changed pixels (..., 2), in a picture of a size (2,)."""
    batch, size = recorded.batch, np.array(recorded.rig.camera.image_size, float)
    tip = batch.tip_px.copy()
    tip[:, :2] = change(tip[:, :2], size)
    return recorded.with_readings(points_px=change(batch.points_px, size), tip_px=tip)


def _enlarged(by: float, pixels: np.ndarray, _: np.ndarray) -> np.ndarray:
    """Pixels of the same picture, larger by a factor; its corner stays at (−0.5, −0.5)."""
    return (pixels + 0.5) * by - 0.5


def _rectified(recorded: Recorded) -> Recorded | None:
    """Hypothesis of pictures from which the distortion was removed before."""
    camera = recorded.rig.camera
    focal, centre = np.diag(camera.matrix)[:2], camera.matrix[:2, 2]

    def distorted(pixels: np.ndarray, _: np.ndarray) -> np.ndarray:
        flat = pixels.reshape(-1, 2)
        there = np.isfinite(flat).all(axis=1)
        found = np.full_like(flat, np.nan)
        rays = np.column_stack([(flat[there] - centre) / focal, np.ones(int(there.sum()))])
        found[there] = camera.project(rays)[0]
        return found.reshape(pixels.shape)

    changed = _points(distorted, recorded)
    if changed is None or not np.nanmax(np.abs(changed.batch.points_px - recorded.batch.points_px), initial=0.0) > 0.5:
        return None
    return changed


_UNITS = {
    1e-3: "in mN·m or N·mm",
    1e-2: "in N·cm",
    1e3: "in kN·m",
    0.1: "ten times too large",
    10.0: "ten times too small",
    100.0: "a hundred times too small",
    9.80665: "in kgf·m",
    9.80665e-2: "in kgf·cm",
    9.80665e-5: "in gf·cm",
    0.112985: "in lbf·in",
}
READINGS = (
    _Misread(
        "moment_sign",
        "the moment readings have the wrong sign",
        "change the sign of moment_Nm or --moment-axis, or exchange the sensor's leads",
        partial(_moments, np.negative),
    ),
    _Misread(
        "moment_absolute",
        "the moment readings have lost their sign",
        "record moment_Nm with its sign",
        _absolute,
        -np.log(2.0),
    ),
    *(
        _Misread(
            "moment_unit",
            f"the moment readings are {words}",
            f"multiply moment_Nm by {factor:.6g}: it is in N·m",
            partial(_moments, partial(np.multiply, factor)),
            float(np.log(factor)),
        )
        for factor, words in _UNITS.items()
    ),
    *(
        _Misread(
            "moment_axis",
            f"the moment is read about {'+' if sign > 0 else '−'}z, not about y",
            "turn the sensor by 90° about the antenna, or give --moment-axis",
            partial(_turned, sign * 0.5 * np.pi),
        )
        for sign in (1.0, -1.0)
    ),
    *(
        _Misread(
            "moment_channels",
            f"{first} and {second} are exchanged" if first != second else f"{first} has the wrong sign",
            "put each channel into its column as in the calibration",
            partial(_channels, a, b, -1.0 if a == b else 1.0),
        )
        for (a, first), (b, second) in combinations_with_replacement(enumerate(SENSED.values()), 2)
        if first.endswith("_Nm") == second.endswith("_Nm") and (a, b) != (0, 0)
    ),
    *(
        _Misread(name, words, remedy, partial(_joints, turn))
        for name, words, remedy, turn in (
            ("tilt_sign", "the tilt has the wrong sign", "change the sign of tilt_rad", np.diag([1.0, -1.0])),
            (
                "joints_exchanged",
                "pan and tilt are exchanged",
                "exchange the columns pan_rad and tilt_rad",
                np.eye(2)[::-1],
            ),
            (
                "joints_degrees",
                "the joint angles are in degrees",
                "give radians in pan_rad and tilt_rad",
                np.pi / 180 * np.eye(2),
            ),
            (
                "joints_degrees",
                "the joint angles were turned into radians twice",
                "give radians in pan_rad and tilt_rad",
                180 / np.pi * np.eye(2),
            ),
        )
    ),
    _Misread(
        "joints_frozen",
        "the joint readings stand still while the antenna moves",
        "connect the encoders, and record again",
        _frozen,
        -1.0,
    ),
    *(
        _Misread(
            name,
            f"{what} of the row {where}",
            "shift the column by a row",
            partial(_a_row_off, which, rows),
        )
        for name, what, which, sign in (
            ("moment_late", "each moment belongs to the picture", slice(-2), 1.0),
            ("joints_late", "the joint angles belong to the picture", slice(-2, None), 1.0),
            ("pictures_late", "each picture belongs to the readings", slice(None), -1.0),
        )
        for where, rows in (("before", sign), ("after", -sign))
    ),
    *(
        _Misread(
            "joint_offset",
            "the tilt is off by a degree",
            "set the encoders' zeros, calibrate again",
            partial(_tilted, angle_rad),
        )
        for angle_rad in (-RecordingSettings.joint_step_rad, RecordingSettings.joint_step_rad)
    ),
    *(
        _Misread(
            name, f"the pictures are {words}", "record the pictures as the camera takes them", partial(_points, change)
        )
        for name, words, change in (
            ("picture_mirrored", "mirrored left to right", lambda px, size: px * [-1.0, 1.0] + [size[0] - 1.0, 0.0]),
            ("picture_mirrored", "mirrored top to bottom", lambda px, size: px * [1.0, -1.0] + [0.0, size[1] - 1.0]),
            ("picture_turned", "turned by 180°", lambda px, size: size - 1.0 - px),
        )
    ),
    *(
        _Misread(
            "picture_scaled",
            f"the pixels are of {words} pictures",
            "use the calibration's size",
            partial(_points, partial(_enlarged, by)),
        )
        for words, by in (("half-size", 2.0), ("double-size", 0.5), ("two-thirds-size", 1.5), ("quarter-size", 4.0))
    ),
    _Misread(
        "points_exchanged",
        "u and v are exchanged",
        "exchange the columns u_px and v_px",
        partial(_points, lambda px, _: px[..., ::-1]),
    ),
    _Misread(
        "picture_rectified",
        "the pictures' distortion was taken out already",
        "calibrate with rectified pictures, too",
        _rectified,
    ),
)
"""What is not as reported. The first of two rows that do the same is named."""


def _explanations(case: Case) -> Iterator[Explanation[Case]]:
    """Alternative explanations of a recording: other readings or pictures, or a rig that has changed before or
    during it."""
    found = [*_moments_explained(case), *_others_explained(case)]
    yield from found
    yield from _errors_explained(case)
    if _explained(case, found):
        return
    # where many frames are lost, each takes long, and offsets are sought only where no change explains them
    for group in (_changes, _shifts_explained) if case.many_lost else (_shifts_explained, _changes):
        found = list(group(case))
        yield from found
        if case.many_lost and _explained(case, found):
            return


def _explained(case: Case, found: Sequence[Explanation[Case]]) -> bool:
    """Whether the likeliest of some explanations leaves no more than frames cost where all is as reported. That moments
    do not follow the antenna leaves nothing, and explains little: what it gains must say so."""
    best = max(found, key=attrgetter("log_odds"), default=None)
    if best is None or best.log_odds < DecisionSettings.least_log_odds or best.diagnosis.name == "moment_unexplained":
        return False
    if best.diagnosis.name in ("moment_dead", "moment_stuck"):
        return case.cost - best.log_odds < RecordingSettings.usual * len(case.recorded)
    return best.applied is not None and best.applied().usual


def _moments_explained(case: Case) -> Iterator[Explanation[Case]]:
    """Explanations by the moment readings: they say nothing, or their sign, unit, axis or order is not as reported."""
    recorded, std = case.recorded, case.recorded.rig.moment_sensor.std_Nm
    read = recorded.batch.readings_Nm[:, 0]
    there = np.isfinite(read)
    if there.sum() < RecordingSettings.fewest_moments:
        return
    without = recorded.without_moments
    constant = np.ptp(read[there]) <= 1e-3 * std
    none = 0.0 if constant else recorded.log_density_of_none
    gained = case.cost - case.cost_of(without, none) - RecordingSettings.vague * (not constant)
    yield Explanation(_useless(case, constant), gained, partial(case.explained_by, without))
    if constant:
        return
    expected, own = without.fit.moments
    # where the picture does not know the moment, a reading's unit is not for the frame to tell
    known = own < RecordingSettings.knows * float(np.ptp(read[there]))

    def costs(moments: np.ndarray) -> np.ndarray:
        """(F,) costs of moments by the pictures' predictions alone."""
        variance = std**2 + own**2
        off = np.where(there & np.isfinite(variance), (moments - expected) ** 2 / variance, 0.0)
        return np.minimum(0.5 * off, RecordingSettings.most)

    reported, likely = costs(read), list[tuple[float, _Misread, Recorded]]()
    some = np.arange(0, len(read), RecordingSettings.thinned)
    few, predicted = case.picked(some), np.isfinite(np.median(own[there]))
    for row in READINGS:
        corrected = row.correct(recorded) if row.of_moment else None
        if corrected is None or not _differs(corrected, recorded):
            continue
        if corrected.rig is recorded.rig and row.may_begin:
            each = reported - costs(corrected.batch.readings_Nm[:, 0]) + row.log_density * known
            likely += _later(recorded, row, corrected, each)
        # neighbours' moments fit as usual where most pictures allow a mirror image and predict none
        if not case.usual or (row.name == "moment_late" and not predicted):
            gained = few.cost - few.cost_of(corrected.picked(some), row.log_density * known[some])
        else:
            # about other axes the pictures' moments say nothing
            gained = float((reported - costs(corrected.batch.readings_Nm[:, 0])).sum())
        if gained > RecordingSettings.hinted:
            likely.append((gained, row, corrected))
    yield from _compared(case, likely, known)


def _useless(case: Case, constant: bool) -> Diagnosis:
    """Diagnosis of moments that are all alike, do not follow the pictures, or follow them in a way that none of the
    table's rows describes."""
    remedy = "connect the sensor and check its amplifier, or estimate with --no-moment"
    read, std = case.recorded.batch.readings_Nm[:, 0], case.recorded.rig.moment_sensor.std_Nm
    if constant:
        value = read[np.isfinite(read)][0]
        words = f"all moment readings are {value:.4g} N·m, which the pictures contradict"
        return Diagnosis("moment_stuck" if value else "moment_dead", words, remedy, "wrong")
    expected, own = case.recorded.without_moments.fit.moments
    known = np.isfinite(read) & (own < RecordingSettings.knows * float(np.nanmax(read) - np.nanmin(read)))
    if known.sum() < RecordingSettings.fewest_moments:
        words = "the moment readings contradict the pictures, in a way that none of the known causes explains"
        return Diagnosis("moment_unexplained", words, remedy, "wrong")
    alike = float(np.corrcoef(read[known], expected[known])[0, 1])
    off_std = float(np.median(np.abs(read - expected - np.median((read - expected)[known]))[known])) / std
    if abs(alike) > RecordingSettings.alike:
        words = (
            f"the moment readings differ from the pictures' by {off_std:.0f} standard deviations of their noise in "
            f"half of the frames, though they go with them (correlation {alike:.2f}), and none of the known causes "
            "explains that"
        )
        remedy = "look for hum, a filter, play or another range of the sensor, or estimate with --no-moment"
        return Diagnosis("moment_unexplained", words, remedy, "wrong")
    words = f"the moment readings do not follow the antenna (correlation {alike:.2f} with what the pictures show)"
    return Diagnosis("moment_dead", words, remedy, "wrong")


def _later(
    recorded: Recorded, row: _Misread, corrected: Recorded, gained: np.ndarray
) -> list[tuple[float, _Misread, Recorded]]:
    """A mistake of the moments that holds from some frame on, if the frames gain (F,) more by it than by one from the
    first on, or none."""
    after = np.cumsum(gained[::-1])[::-1]
    first, less = int(np.argmax(after)), float(np.log(len(gained)))
    if not RecordingSettings.fewest_after <= first <= len(gained) - RecordingSettings.fewest_after:
        return []
    if after[first] - max(after[0], 0.0) < less + RecordingSettings.unlikely:  # than by all of it, or by none
        return []
    readings = np.where(
        np.arange(len(gained))[:, None] < first, recorded.batch.readings_Nm, corrected.batch.readings_Nm
    )
    words = f"{row.words}, from row {recorded.order[first]} on"
    since = row._replace(words=words, log_prior=row.log_prior - less, first=first)
    return [(float(after[first]), since, recorded.with_readings(readings_Nm=readings))]


def _in_time(powers: int, recorded: Recorded) -> np.ndarray | None:
    order = recorded.order - recorded.order[0]
    return np.power.outer(order / order[-1], np.arange(1, powers + 1)) if order[-1] else None


def _in_load(recorded: Recorded) -> np.ndarray:
    read = np.nan_to_num(recorded.batch.readings_Nm[:, 0])
    return np.power.outer(read / np.abs(read).max(), np.arange(1, 4))


def _in_joints(recorded: Recorded) -> np.ndarray | None:
    angles = np.column_stack([recorded.batch.pan_rad, recorded.batch.tilt_rad])
    angles = angles[:, np.ptp(angles, axis=0) > RecordingSettings.joints_rad]
    return (angles - angles.mean(axis=0)) / np.ptp(angles, axis=0) if angles.size else None


def _in_direction(recorded: Recorded) -> np.ndarray | None:
    change = recorded.batch.readings_Nm[:, 0] - recorded.around[:, 0, 0, 0]
    return np.sign(np.nan_to_num(change))[:, None] if np.isfinite(recorded.period_s) else None


def _level(rig: Rig) -> list[int]:
    """The two axes of the world about which gravity can tilt."""
    return np.flatnonzero(np.arange(3) != np.abs(rig.gravity_world_m_s2).argmax()).tolist()


def _gravity_turned(values: np.ndarray, recorded: Recorded) -> Recorded | None:
    """Hypothesis of gravity that is turned about the two level axes of the world."""
    rig, turn_rad = recorded.rig, np.zeros(3)
    turn_rad[_level(rig)] = values
    gravity = Pose.from_rotvec(turn_rad, np.zeros(3)).rotation @ rig.gravity_world_m_s2
    return recorded.with_rig(replace(rig, gravity_world_m_s2=gravity)) if gravity.any() else None


def _lagged_by(which: slice, values: np.ndarray, recorded: Recorded) -> Recorded | None:
    """Hypothesis of `_lagged` readings, by values (1,) in rows."""
    return _lagged(which, float(values[0]), recorded)


ERRORS = (
    *(
        Change(
            name,
            {"rows": RecordingSettings.lag_step},
            f"the {words}",
            "take stamps of one clock, unfiltered, or give --clock-offset",
            "s",
            starts=tuple(range(1, RecordingSettings.lag_most + 1)),
            changed=partial(_lagged_by, which),
            part="",
        )
        for name, words, which in (
            ("clock_offset", "readings are {} their pictures: the clocks differ", slice(None)),
            ("moment_late", "moments are {} their pictures: the sensor's delay or clock", slice(-2)),
        )
    ),
    Change(
        "joint_offset",
        {"tilt_rad": RecordingSettings.joint_step_rad},
        "the tilt is off by {}",
        "set the encoders' zeros, calibrate again",
        "°",
        starts=tuple(np.geomspace(4.0 * RecordingSettings.joint_step_rad, RecordingSettings.joint_most_rad, 5)),
        changed=lambda angle, recorded: _tilted(-float(angle[0]), recorded),
        part="base",
    ),
    Change(
        "moment_turned",
        {"sensor_about_x_rad": RecordingSettings.turn_step_rad},
        "the moment sensor has been turned about the antenna by {}",
        AGAIN,
        "°",
        RecordingSettings.turn_least_rad,
        starts=tuple(np.linspace(RecordingSettings.turn_step_rad, RecordingSettings.turn_most_rad, 4)),
        changed=lambda angle, recorded: _turned(float(angle[0]), recorded),
        part="sensor",
    ),
    Change(
        "gravity_tilted",
        dict.fromkeys(("about_first_rad", "about_second_rad"), RecordingSettings.gravity_step_rad),
        "gravity is tilted by {} against the rig's gravity_world",
        "level the base, set the encoders' zeros, or calibrate again",
        "°",
        RecordingSettings.gravity_least_rad,
        starts=tuple(np.linspace(0.0, RecordingSettings.gravity_most_rad, 4)[1:]),
        changed=_gravity_turned,
        part="base",
    ),
    *(
        Change(
            "moment_drift",
            {"moment_offset_Nm": RecordingSettings.error_std},
            f"the moment sensor's zero walks by {{}} standard deviations of its noise during the recording{how}",
            "zero it again before a recording, or give --track-zero",
            "standard deviations",
            RecordingSettings.varies_std,
            by=partial(_in_time, powers),
            part="sensor",
        )
        for powers, how in ((1, ""), (3, ", not evenly"))
    ),
    Change(
        "moment_nonlinear",
        {"moment_offset_Nm": RecordingSettings.error_std},
        "the moments are not in proportion to the pictures', by up to {} standard deviations of its noise",
        "use the sensor where it is linear",
        "standard deviations",
        RecordingSettings.varies_std,
        by=_in_load,
        part="sensor",
    ),
    Change(
        "moment_by_joints",
        {"moment_offset_Nm": RecordingSettings.error_std},
        "the moment sensor's zero changes with the joints, by {} standard deviations of its noise: a cable "
        "pulls, or weight hangs behind the sensor",
        "let the cable move with the sensor",
        "standard deviations",
        RecordingSettings.varies_std,
        by=_in_joints,
        part="sensor",
    ),
    Change(
        "moment_hysteresis",
        {"moment_offset_Nm": RecordingSettings.error_std},
        "the moments stay behind the pictures', by {} standard deviations of its noise, whichever way they change",
        "look for friction or play at clamp and sensor",
        "standard deviations",
        RecordingSettings.varies_std,
        by=_in_direction,
        part="sensor",
    ),
)
"""Constant offsets, and errors of the moment that follow time, load, joints or direction."""


def _errors_explained(case: Case) -> Iterator[Explanation[Case]]:
    """Explanations by errors of the moment that follow something else, fitted with all frames together."""
    recorded, settings = case.recorded, RecordingSettings
    read = recorded.batch.readings_Nm[:, 0]
    varies = np.ptp(read[np.isfinite(read)]) if np.isfinite(read).sum() >= settings.fewest_moments else 0.0
    axes, which = axes_of(recorded.rig, CHANGES)
    zero = which[[row.name for row in CHANGES].index("moment_zero")]
    if varies <= 1e-3 * recorded.rig.moment_sensor.std_Nm or not len(zero):
        return
    for row in ERRORS:
        by = None if row.by is None else row.by(recorded)
        if by is None:
            continue
        if case.usual and max(case.gained(np.repeat(zero, by.shape[1]), by), default=0.0) < settings.promising:
            continue
        found = fitted(case, row, axes[:, zero])
        size = 0.0 if found is None else settings.error_std * float(np.ptp(by @ found.steps))
        if found is not None and size > row.least:
            diagnosis = Diagnosis(row.name, row.words.format(f"{size:.0f}"), row.remedy, row.severity)
            odds = found.log_odds - settings.unlikely
            yield Explanation(diagnosis, odds, partial(case.explained_by, found.recorded))


def _others_explained(case: Case) -> Iterator[Explanation[Case]]:
    """Explanations by joints and pictures that are not as reported, compared by few frames first."""
    likely = list[tuple[float, _Misread, Recorded]]()
    for row, gained in _tried(case):
        of_shift = row.name == "joint_offset" and not case.usual  # its value is sought
        if gained > RecordingSettings.hinted and not of_shift and (whole := row.correct(case.recorded)) is not None:
            likely.append((gained, row, whole))
    yield from _compared(case, likely)


def _put_right(row: Change, values: np.ndarray, recorded: Recorded) -> Recorded | None:
    """The recording with an offset (K,) of a row taken out; None where it cannot be."""
    return None if row.changed is None else row.changed(values, recorded)


def _sized(row: Change, recorded: Recorded, values: np.ndarray, std: float) -> str:
    """An offset (K,) in words, with its standard deviation, both in rows or radians."""
    size = float(np.linalg.norm(values))
    if row.unit == "s":
        period_s = recorded.period_s
        return f"{size * period_s:.3g} ± {std * period_s:.1g} s {'before' if values[0] > 0.0 else 'behind'}"
    if len(values) == 1:
        return f"{np.degrees(values[0]):+.3g} ± {np.degrees(std):.1g}°"
    each = zip(np.degrees(values), _level(recorded.rig), strict=True)
    about = ", ".join(f"{angle:+.2g}° about {'xyz'[axis]}" for angle, axis in each)
    return f"{np.degrees(size):.3g} ± {np.degrees(std):.1g}° ({about})"


def _shifts_explained(case: Case) -> Iterator[Explanation[Case]]:
    """Explanations by a constant offset, where the frames cost more than usual."""
    settings = RecordingSettings
    if case.usual:
        return
    # frames that nothing explains take long: half of them are enough to find it
    sought = case.picked(np.arange(0, len(case.recorded), 2)) if case.many_lost else case
    calm = sought.picked(_interpolable(sought.recorded))
    for row in ERRORS:
        if row.changed is None:
            continue
        if (in_time := row.unit == "s") and not np.isfinite(case.recorded.period_s):
            continue  # between frames of their own a reading means nothing
        found = [(sought, *_least_cost(sought, row))]
        if in_time and abs(found[0][1][0]) < 1.0:
            # a part of a row may show better without the frames between which moments do not change evenly
            found.append((calm, *_least_cost(calm, row._replace(starts=(1.0,)))))
        some, values, covariance, gained = max(found, key=lambda each: each[-1])
        corrected, few = _put_right(row, values, case.recorded), _put_right(row, values, some.recorded)
        size = float(np.linalg.norm(values))
        std = float(np.sqrt(values @ covariance @ values)) / max(size, 1e-12)
        if corrected is None or few is None or not size > max(2.0 * std, row.least):
            continue
        if case.many_lost:
            gained += case.cost - case.with_missing(corrected).cost - some.cost + some.with_missing(few).cost
            some, few = case, corrected
        gained -= some.of_one(some.with_missing(few))
        if few.rig.wrench_sensor is not None and some.recorded.rig.wrench_sensor is None:
            # its zero, as uncertain in each frame by itself, must not make up for noise
            spread = float(few.rig.wrench_sensor.std[0]) / few.rig.moment_sensor.std_Nm
            gained -= len(few) * float(np.log(spread))
        largest = float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))
        words = row.words.format(_sized(row, case.recorded, values, largest))
        diagnosis = Diagnosis(row.name, words, row.remedy, "wrong")
        yield Explanation(diagnosis, gained - settings.unlikely, partial(case.explained_by, corrected))


def _interpolable(recorded: Recorded) -> np.ndarray:
    """Indices of the frames between which moments can be interpolated; of all where these are hardly any."""
    bend = np.abs(recorded.around[:, :, 0, 0].sum(axis=1) - 2.0 * recorded.batch.readings_Nm[:, 0])
    rows = np.flatnonzero(~(bend > RecordingSettings.bends_std * recorded.rig.moment_sensor.std_Nm))
    return rows if len(rows) >= RecordingSettings.fewest else np.arange(len(recorded))


def _least_cost(case: Case, row: Change) -> tuple[np.ndarray, np.ndarray, float]:
    """Values (K,) of an offset at which the frames cost least, their covariance (K, K), and the log evidence for them,
    by parabolas."""
    few = case.picked(np.arange(0, len(case.recorded), RecordingSettings.thinned))
    step, farthest, none = next(iter(row.std.values())), row.starts[-1], np.zeros(len(row.std))

    def cost(values: np.ndarray, case: Case = case) -> float:
        corrected = _put_right(row, values, case.recorded)
        beforehand = float(np.log1p((values / step) ** 2).sum())
        return np.inf if corrected is None else case.with_missing(corrected).cost + beforehand

    starts = np.kron(row.starts, np.eye(len(row.std))).reshape(len(row.std), -1).T
    by_free = [] if row.unit == "s" else [_by_free(case, row, share) for share in (0.5, 1.0)]
    likely = sorted((none, *starts, *-starts, *by_free), key=partial(cost, case=few))
    values = min(likely[: RecordingSettings.followed], key=cost)
    best, information, covariance = cost(values), np.eye(len(values)), np.eye(len(values))  # of a step
    part = 1.0
    for _ in range(RecordingSettings.iterations):
        if (found := _bottom(cost, values, best, part * step)) is not None:
            move, bend = found
            if bend is not None:
                size, axes = np.linalg.eigh(bend)
                information = (axes * np.maximum(size, 1.0) / part**2) @ axes.T
                # what the frames do not determine is as uncertain as beforehand
                covariance = (axes / np.maximum(size / part**2, 1.0)) @ axes.T
            near = np.clip(values + move, -farthest, farthest)
        # at the end of what the readings cover there is no way
        gained = -np.inf if found is None else best - (there := cost(near))
        if gained > 0.0:
            values, best = near, there
        part *= 1.0 if gained > RecordingSettings.gain else 0.5
        # what cannot be reported need not be found exactly
        if part < (0.02 if case.cost - best > DecisionSettings.least_log_odds else 0.25):
            break
    evidence = case.cost - best - 0.5 * float(np.linalg.slogdet(information)[1])
    return values, step**2 * covariance, evidence


def _by_free(case: Case, row: Change, share: float) -> np.ndarray:
    """Values (K,) of an offset at which a part of the likely free frames, those that fit better, costs least as free
    ones: smooth at any distance."""
    free = case.recorded.picked(np.flatnonzero(case.free))
    values, step, most = np.zeros(len(row.std)), next(iter(row.std.values())), row.starts[-1]
    for _ in range(RecordingSettings.rounds):
        alone = np.zeros(0) if (corrected := _put_right(row, values, free)) is None else corrected.fit.alone
        some = free.picked(np.sort(np.argsort(alone)[: int(np.ceil(share * len(alone)))]))

        def cost(values: np.ndarray, some: Recorded = some) -> float:
            corrected = _put_right(row, values, some)
            return np.inf if corrected is None else float(corrected.fit.alone.sum())

        here = cost(values) if len(some) else np.inf
        found = _bottom(cost, values, here, step) if np.isfinite(here) else None
        ways = [] if found is None else [np.clip(values + part * found[0], -most, most) for part in (1.0, 0.5, 0.25)]
        values, before = next((way for way in ways if cost(way) < here), values), values
        if values is before:
            break
    return values


def _bottom(
    cost: Callable[[np.ndarray], float], values: np.ndarray, here: float, step: float
) -> tuple[np.ndarray, np.ndarray | None] | None:
    """The way (K,) to the bottom of a parabola through costs a step around some values, and its second derivatives
    (K, K) per step; a step downhill where it has no bottom, and None; None where there is no cost."""
    ways = step * np.eye(len(values))
    low, high = (np.array([cost(values + sign * way) for way in ways]) for sign in (-1.0, 1.0))
    if not np.isfinite([here, *low, *high]).all():
        return None
    bend = np.diag(low + high - 2.0 * here)
    for i, j in combinations(range(len(values)), 2):
        bend[i, j] = bend[j, i] = cost(values + ways[i] + ways[j]) - high[i] - high[j] + here
    size, axes = np.linalg.eigh(bend)
    downhill = axes.T @ (0.5 * (low - high))
    steps = np.where(size > 0.0, np.clip(downhill / np.maximum(size, 1.0), -2.0, 2.0), np.sign(downhill))
    return step * (axes @ steps), bend if size[0] > 0.0 else None


@lru_cache(maxsize=1)
def _tried(case: Case) -> list[tuple[_Misread, float]]:
    """Rows about joints and pictures that the least bent frames could distinguish, and the gains by each."""
    few, calm, found = case.picked(_least_bent(case)), case.sound and not case.changed, []
    for row in READINGS:
        if row.of_moment or (row.of_pictures and calm):
            continue
        corrected = row.correct(few.recorded)
        if corrected is not None and _differs(corrected, few.recorded):
            found.append((row, few.cost - few.cost_of(corrected, row.log_density)))
    return found


def unseen_joints(case: Case) -> list[str]:
    """Possible mistakes of the joint angles, in words, that the recording cannot reveal, because it fits about as well
    with them."""
    gained, few = dict(_tried(case)), case.picked(_least_bent(case))
    names = ("tilt_sign", "joints_exchanged", "joints_late", "joint_offset")
    joints = [row for row in READINGS if row.name in names and row.correct(few.recorded) is not None]
    # a row that looks the same was not tried
    unseen = [row for row in joints if gained.get(row, 0.0) > -RecordingSettings.suspicious]
    # a degree is hardly ever seen: alone it is no news, unless more is not seen, either
    news = any(row.name != "joint_offset" for row in unseen) or (bool(unseen) and _far_unseen(few))
    return list(dict.fromkeys(row.words for row in unseen)) if news else []


def _far_unseen(few: Case) -> bool:
    """Whether some frames cannot rule out an error of the tilt that shifts contact points in the world by much."""
    far = [_tilted(sign * RecordingSettings.joint_far_rad, few.recorded) for sign in (-1.0, 1.0)]
    return any(few.cost - few.cost_of(each) > -RecordingSettings.suspicious for each in far if each is not None)


def _least_bent(case: Case) -> np.ndarray:
    """Indices of the frames that may contain the free antenna."""
    evidence = case.recorded.fit.numbers.evidence
    bent = np.argsort(np.where(np.isfinite(evidence), evidence, np.inf))
    return np.sort(bent[: RecordingSettings.screened])


def _compared(
    case: Case, likely: list[tuple[float, _Misread, Recorded]], known: np.ndarray | None = None
) -> Iterator[Explanation[Case]]:
    """The likeliest of some rows, by all frames. known : (F,) mask of the frames in which a reading's density
    counts."""
    counts = np.ones(len(case.recorded)) if known is None else known
    ranked = sorted(likely, key=lambda each: -each[0])
    unranked = sum(np.isinf(each[0]) for each in ranked)
    for _, row, corrected in ranked[: unranked + RecordingSettings.followed]:
        concerned = counts * (np.arange(len(counts)) >= row.first)
        gained = case.gained_by(corrected, row.log_density * concerned) + row.log_prior
        found = Diagnosis(row.name, row.words, row.remedy, row.severity)
        begin = int(case.recorded.order[row.first]) if row.first else 0
        odds = gained - RecordingSettings.unlikely
        yield Explanation(found, odds, partial(case.explained_by, corrected), first=begin)


def _differs(corrected: Recorded, recorded: Recorded) -> bool:
    """Whether any visible quantity is different."""
    a, b, noise = corrected.batch, recorded.batch, recorded.rig.moment_sensor.std_Nm
    return bool(
        corrected.rig is not recorded.rig
        or (np.isfinite(a.readings_Nm) != np.isfinite(b.readings_Nm)).any()
        or np.nanmax(np.abs(a.readings_Nm - b.readings_Nm), initial=0.0) > noise
        or not np.array_equal(a.points_px, b.points_px, equal_nan=True)
        or _sag_differs(corrected, recorded)
    )


def _sag_differs(corrected: Recorded, recorded: Recorded) -> bool:
    """Whether other joint angles change the antenna's sag by more than a part of the points' scatter, or of the
    moment's noise."""
    rig, batch = recorded.rig, recorded.batch
    pull = [
        np.einsum("bji,j->bi", rig.kinematics.world_antenna(one.pan_rad, one.tilt_rad)[0], rig.gravity_world_m_s2)
        for one in (corrected.batch, batch)
    ]
    change = np.abs(pull[0] - pull[1])
    # what pulls along the antenna bends it as much as its own slope lets it
    across = float(np.max(np.hypot(change[:, 1], change[:, 2]) + 0.3 * change[:, 0], initial=0.0))
    antenna, distance_m = rig.antenna, float(np.linalg.norm(rig.T_antenna_camera.translation_m))
    load = antenna.mass_per_length_kg_m * across
    sag_px = load * antenna.length_m**4 / (8.0 * antenna.stiffness_Nm2) * rig.camera.matrix[0, 0] / distance_m
    seen_px = float(np.nanmedian(batch.sigma_px[np.isfinite(batch.points_px).all(axis=-1)]))
    return sag_px > RecordingSettings.visible * seen_px or (
        0.5 * load * antenna.length_m**2 > RecordingSettings.visible * rig.moment_sensor.std_Nm
    )


def _changes(case: Case) -> Iterator[Explanation[Case]]:
    """Explanations by a rig that has changed since its calibration, or from some frame of the recording on."""
    settings = RecordingSettings
    axes, which = axes_of(case.recorded.rig, CHANGES)
    batch = case.recorded.batch
    turned_rad = np.ptp(np.stack([batch.pan_rad, batch.tilt_rad]), axis=1).max()
    # without moments, EI shows in how the antenna sags, and that needs the joints
    sags = np.isfinite(batch.readings_Nm).any() or turned_rad > settings.varies_rad
    rows = [
        (row, own)
        for row, own in zip(CHANGES, which, strict=True)
        if len(own) and (sags or "log_stiffness_Nm2" not in row.std)
    ]
    places = case.splits
    fair = float(np.log(max(len(places) - 1, 2)))
    ranked = [
        (gained - (fair if first else 0.0), first, row, own)
        for first in places
        for row, own in rows
        for gained in case.gained(own, case.since(first, len(own)))
    ]
    ranked.sort(key=lambda each: -each[0])
    if ranked and case.lost.mean() > settings.hopeless:
        scaled = next((each for each in ranked if each[2].starts), ranked[0])
        ranked.insert(0, (np.inf, *scaled[1:]))
    followed: list[Change] = []
    # far from where the frames are linear, first order does not rank the rows
    most = len(rows) if case.many_lost else settings.followed
    for gained, first, row, own in ranked:
        if gained < settings.promising or len(followed) >= most or row in followed:
            continue
        followed.append(row)
        found = fitted(case, row, axes[:, own], first)
        if found is None or abs(found.size) < row.least:
            continue
        begin = int(case.recorded.order[first]) if first else 0
        since = f", from row {begin} on" if first else ""
        diagnosis = Diagnosis(row.name, found.words + since, row.remedy, row.severity)
        odds = found.log_odds - settings.unlikely + row.log_prior - (fair if first else 0.0)
        yield Explanation(diagnosis, odds, partial(case.explained_by, found.recorded), first=begin)


TABLE: tuple[Hypothesis[Case], ...] = (_explanations,)
