"""Validation of users' measurements, and their conversion to one form."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, TypedDict, cast

import numpy as np

from estimator.solver.frames import Frames, frames_from_pixels
from estimator.solver.linearised import bend
from estimator.solver.numbers import FitNumbers
from estimator.solver.rig_arrays import RigArrays
from estimator.table.contacts import Measured
from vbaa_calib.camera.from_plane import pixels_on_plane
from vbaa_calib.core.arrays import ANGLE_REMEDY, MOMENT_REMEDY, PLAUSIBLE, Rows, as_floats, check_each, spread_evenly
from vbaa_calib.core.errors import InputError, quoted
from vbaa_calib.core.polyline import offsets_from, resample
from vbaa_calib.detect.whisker.centreline import too_short
from vbaa_calib.detect.whisker.corridor import pixels
from vbaa_calib.native import core
from vbaa_calib.rig import Rig
from vbaa_calib.session import READINGS

from .settings import ContactSettings
from .status import unexplained

Values = Sequence[float | None] | np.ndarray | None
"""A number for every frame, None where there is none."""


Lines = np.ndarray | Sequence[np.ndarray]
"""(B, N, 2) pixels, or B arrays (N_i, 2)."""


class FrameOptions(TypedDict, total=False):
    """Optional measurements: centrelines in metres in place of pixels, (N, 2) on plane C, with covariances (N, 2, 2)
    m² or (2, 2) for all points; a wrench sensor's readings other than the moments about y and z, by column; and
    whether contacts get their derivatives."""

    plane_xy_m: Any
    covariance_m2: Any
    readings: Any
    jacobian: bool


@dataclass(frozen=True, eq=False)
class Batch(Rows):
    """The validated measurements of B frames.

    Attributes
    ----------
    points_px, sigma_px : (B, N, 2), (B, N) along the longer side of each frame's points, missing ones last.
    readings_Nm : (B, 6) as `session.READINGS`, N·m or N; NaN where there is none.
    tip_px : (B, 3) the antenna's end and its deviation along the antenna; NaN where it is not known.
    pan_rad, tilt_rad : (B,) joint angles.
    outside_points : (B,) number of points that are left out because they lie outside the picture.
    start : (B, 4) initial unknowns, NaN where there are none; None without any.
    errors_Nm : (B, 6) standard deviations of the readings in addition to the sensors' noise; None without any.
    joint_errors_rad : (B, 2) deviations of pan and tilt; None without any.
    covariance_shape : (B, N, 2, 2) covariance of each point over sigma_px²; None: the same in every direction.
    order : (B, N) where each point was listed; None: as it is here.
    camera : (B, N) index of the rig's camera that sees each point, with one camera's points after another's; None for a
        rig with one camera. tip_camera : (B,) index of the one that sees the end. seen : (B, V) number of points that
        each camera sees; fewer than `ContactSettings.fewest_points` are left out.
    time_s : (B,) of a recording. sigma_factor : as `Measured.sigma_factor`, of all of them.
    """

    points_px: np.ndarray
    sigma_px: np.ndarray
    readings_Nm: np.ndarray
    tip_px: np.ndarray
    pan_rad: np.ndarray
    tilt_rad: np.ndarray
    outside_points: np.ndarray
    start: np.ndarray | None = None
    errors_Nm: np.ndarray | None = None
    joint_errors_rad: np.ndarray | None = None
    covariance_shape: np.ndarray | None = None
    order: np.ndarray | None = None
    camera: np.ndarray | None = None
    tip_camera: np.ndarray | None = None
    seen: np.ndarray | None = None
    time_s: np.ndarray | None = None
    sigma_factor: float = 1.0

    @property
    def point_counts(self) -> np.ndarray:
        """(B,) number of points of each frame."""
        return np.asarray(np.isfinite(self.points_px[..., 0]).sum(axis=1))

    def weights(self, rig_arrays: RigArrays) -> np.ndarray | None:
        """(B, S) ratios of the sensors' noise to the readings' total standard deviation; None where there is noise
        alone."""
        std = rig_arrays.std[rig_arrays.sensors]
        return None if self.errors_Nm is None else std / np.hypot(std, self.errors_Nm[:, : len(std)])

    def pixels(self, rig_arrays: RigArrays) -> tuple[Any, ...]:
        """The arguments of the core's `frames_from_pixels`, for one rig."""
        rotation, _ = (rig := rig_arrays.rig).kinematics.world_antenna(self.pan_rad, self.tilt_rad)
        cameras = () if self.camera is None or self.tip_camera is None else (self.camera, self.tip_camera)
        points_px, tip_px = np.ascontiguousarray(self.points_px), np.ascontiguousarray(self.tip_px)
        gravity = rig.gravity_world_m_s2 @ rotation
        return rig_arrays, points_px, self.sigma_px, np.ascontiguousarray(self.readings_Nm), tip_px, gravity, *cameras

    def frames(self, rig_arrays: RigArrays) -> Frames:
        """The frames in the solver's form, for one rig."""
        frames = frames_from_pixels(*self.pixels(rig_arrays))
        if self.covariance_shape is not None:
            slopes = self.sigma_px[..., None, None] * self.slopes(rig_arrays.rig)
            spread = slopes @ self.covariance_shape @ np.swapaxes(slopes, -1, -2)
            spread = np.stack([spread[..., 0, 0], spread[..., 0, 1], spread[..., 1, 1]], axis=-1)
            frames.covariance[...] = np.where(frames.usable[..., None] > 0.0, spread, frames.covariance)
        weights = self.weights(rig_arrays)
        if weights is not None:
            frames.available[:, rig_arrays.sensors] *= (
                weights  # each residual, and its derivatives, in its own deviations
            )
        return frames

    def slopes(self, rig: Rig) -> np.ndarray:
        """(B, N, 2, 2) derivatives of the points' ideal coordinates by their pixels."""
        if self.camera is None:
            return rig.camera.normalized_with_slopes(self.points_px)[1]
        slopes = np.full((*self.camera.shape, 2, 2), np.nan)
        for index, one in enumerate(rig.cameras.values()):
            own = self.camera == index
            slopes[own] = one.camera.normalized_with_slopes(self.points_px[own])[1]
        return slopes

    @staticmethod
    def _of_cameras(parts: Sequence[Batch]) -> Batch:
        """Frames of several cameras, from one batch for each; everything but the points is the first one's."""
        count, wide = len(parts[0].points_px), [part.points_px.shape[1] for part in parts]

        def together(values: Callable[[Batch], np.ndarray]) -> np.ndarray:
            return np.concatenate([values(part) for part in parts], axis=1)

        points = together(lambda part: part.points_px)
        camera = np.tile(np.repeat(np.arange(len(parts)), wide), (count, 1))
        seen = np.column_stack([part.point_counts for part in parts])
        if (seen < ContactSettings.fewest_points).any():
            points[np.take_along_axis(seen, camera, 1) < ContactSettings.fewest_points] = np.nan
        order = shape = None
        if any(part.order is not None for part in parts):
            before = dict(zip(map(id, parts), np.cumsum([0, *wide]), strict=False))
            listed = np.arange(max(wide))
            order = together(
                lambda part: (
                    before[id(part)]
                    + (np.tile(listed[: part.points_px.shape[1]], (count, 1)) if part.order is None else part.order)
                )
            )
        if any(part.covariance_shape is not None for part in parts):
            same = np.eye(2)
            shape = together(
                lambda part: (
                    np.broadcast_to(same, (*part.sigma_px.shape, 2, 2))
                    if part.covariance_shape is None
                    else part.covariance_shape
                )
            )
        tips = np.stack([part.tip_px for part in parts], axis=1)
        tip_camera = np.argmax(np.isfinite(tips).all(axis=2), axis=1)
        return replace(
            parts[0],
            points_px=points,
            sigma_px=together(lambda part: part.sigma_px),
            tip_px=tips[np.arange(count), tip_camera],
            outside_points=np.sum([part.outside_points for part in parts], axis=0),
            covariance_shape=shape,
            order=order,
            camera=camera,
            tip_camera=tip_camera,
            seen=seen,
        )

    @property
    def last_s(self) -> float:
        """Time of the last frame; NaN where that is not known."""
        return math.nan if self.time_s is None else max(self.time_s.tolist())

    def started(self, warm: np.ndarray | None) -> Batch:
        """The frames with initial unknowns (4,) for those without any of their own."""
        if warm is None:
            return self
        start = np.full((len(self), 4), np.nan) if self.start is None else self.start
        return replace(self, start=np.where(np.isfinite(start).all(axis=1, keepdims=True), start, warm))

    def measured(self, row: int) -> Measured:
        """One frame as it was measured, of one camera."""
        there = np.isfinite(self.points_px[row]).all(axis=1)
        read: dict[str, Any] = dict(zip(READINGS.values(), self.readings_Nm[row].tolist(), strict=True))
        return Measured(
            self.points_px[row, there],
            self.sigma_px[row, there],
            **read,
            pan_rad=float(self.pan_rad[row]),
            tilt_rad=float(self.tilt_rad[row]),
            time_s=math.nan if self.time_s is None else float(self.time_s[row]),
            tip_px=self.tip_px[row],
            outside_points=int(self.outside_points[row]),
            sigma_factor=self.sigma_factor,
        )

    @staticmethod
    def padded(parts: Sequence[Batch]) -> Batch:
        """The frames of several batches, at least one, of `of_lines`."""
        wide = max(part.points_px.shape[1] for part in parts)
        return Batch.joined(
            [
                replace(
                    part,
                    points_px=np.pad(part.points_px, ((0, 0), (0, more), (0, 0)), constant_values=np.nan),
                    sigma_px=np.pad(part.sigma_px, ((0, 0), (0, more)), constant_values=1.0),
                )
                if (more := wide - part.points_px.shape[1])
                else part
                for part in parts
            ]
        )

    @staticmethod
    def of_lines(rig: Rig, points: np.ndarray, counts: np.ndarray, columns: Mapping[str, np.ndarray]) -> Batch:
        """The frames of a recording of one camera, from the points (P, 3) of their lines, u_px, v_px and sigma_px,
        frame by frame, how many (B,) each has, and the columns (B,) of the table by name, checked as `Measured`."""
        row, most = np.repeat(np.arange(len(counts)), counts), 4 * sum(rig.camera.image_size)
        if (lost := outside(points[:, :2], rig.camera.image_size)).any():
            points, row = points[~lost], row[~lost]
        counts, lines = np.bincount(row, minlength=len(counts)), counts
        if counts.max(initial=0) >= most:  # as in `of`
            place = np.arange(len(points)) - (np.cumsum(counts) - counts)[row]
            kept = place % (1 + counts // most)[row] == 0
            points, row = points[kept], row[kept]
        left = np.bincount(row, minlength=len(counts))
        there = np.arange(left.max(initial=0)) < left[:, None]
        pixels, sigma = np.full((*there.shape, 2), np.nan), np.ones(there.shape)
        pixels[there], sigma[there] = points[:, :2], points[:, 2]
        pixels, sigma, *_ = _in_order(rig, pixels, sigma, None)
        read = np.column_stack([columns[name] for name in READINGS.values()])
        if not rig.moment_sensor.exists:
            read[:, 0] = np.nan
        joints, nothing = (columns["pan_rad"], columns["tilt_rad"]), np.full((len(counts), 3), np.nan)
        return Batch(pixels, sigma, read, nothing, *joints, lines - counts, time_s=columns["time_s"])

    @staticmethod
    def of(rig: Rig, several: Sequence[Measured]) -> Batch:
        """The batch of validated frames."""
        if rig.others:
            ones = [replace(rig, others={}), *rig.others.values()]
            own = [several, *([each.of_camera(name) for each in several] for name in rig.others)]
            return Batch._of_cameras([Batch.of(one, part) for one, part in zip(ones, own, strict=True)])
        # one frame of far more points than its picture has place for would make room for as many in all of a batch
        steps = [1 + len(each.points_px) // (4 * sum(rig.camera.image_size)) for each in several]
        points = _padded([each.points_px[::n] for each, n in zip(several, steps, strict=True)], np.nan)
        sigma = _padded([each.sigma_px[::n] for each, n in zip(several, steps, strict=True)], 1.0)
        numbers = np.array([[*each.readings, each.pan_rad, each.tilt_rad] for each in several])
        if not rig.moment_sensor.exists:
            numbers[:, 0] = np.nan
        starts = np.array([each.start for each in several])
        known = np.isfinite(starts).all(axis=1).any()
        shape = None
        if any(each.covariance_shape is not None for each in several):
            shapes = [np.tile(np.eye(2), (len(each.sigma_px), 1, 1)) for each in several]
            for row, each in enumerate(several):
                shapes[row] = shapes[row] if each.covariance_shape is None else each.covariance_shape
            shape = _padded([own[::n] for own, n in zip(shapes, steps, strict=True)], np.nan)
        points, sigma, shape, outside, order = _in_order(rig, points, sigma, shape)
        outside += [each.outside_points for each in several]
        tips = np.array([_end(each.tip_px) for each in several])
        columns = ([each.moment_errors_Nm for each in several], [each.joint_errors_rad for each in several])
        errors, joint_errors = (column if column.any() else None for column in map(np.array, columns))
        angles, start = (numbers[:, -2], numbers[:, -1]), starts if known else None
        numbers, time_s = numbers[:, :-2], np.array([each.time_s for each in several], float)
        more = errors, joint_errors, shape, order
        return Batch(points, sigma, numbers, tips, *angles, outside, start, *more, time_s=time_s)

    @staticmethod
    def checked(
        rig: Rig,
        centrelines_px: Lines | Mapping[str, Lines] | None,
        readings: dict[str, Values],
        joints: dict[str, Values],
        sigma_px: np.ndarray | float | Mapping[str, np.ndarray | float] | None,
        plane: Mapping[str, Any],
    ) -> Batch:
        """The batch from users' arguments: centrelines, moments about y and z, further readings, pan and tilt.
        Raises InputError."""
        if rig.others:
            return Batch._of_cameras(_by_camera(rig, centrelines_px, readings, joints, sigma_px, plane))
        points, own, shape = _lines(rig, centrelines_px, sigma_px, plane.get("plane_xy_m"), plane.get("covariance_m2"))
        moments = {name: _column(name, values, len(points)) for name, values in readings.items()}
        angles = {name: _column(name, values, len(points)) for name, values in joints.items()}
        for name, values in angles.items():
            check_each(values, PLAUSIBLE.angle_rad, name, ANGLE_REMEDY, missing="")
        for name, values in moments.items():
            check_each(values, PLAUSIBLE.moment_Nm, name, f"{MOMENT_REMEDY}, or None where there is no reading")
        sigma = _deviations(points, own if sigma_px is None else cast(Any, sigma_px))
        no_tips = np.full((len(points), 3), np.nan)
        points, sigma, shape, outside, order = _in_order(rig, points, sigma, shape)
        pan, tilt = angles.values()
        columns = np.full((len(points), len(READINGS)), np.nan)
        for place, (name, values) in enumerate(moments.items()):
            known = list(READINGS.values())
            if place > 1 and name not in known:
                raise InputError(f"there is no reading {name!r}", remedy=f"one of {', '.join(known)} is needed")
            columns[:, known.index(name) if place > 1 else place] = values
        if not rig.moment_sensor.exists:
            columns[:, 0] = np.nan
        return Batch(points, sigma, columns, no_tips, pan, tilt, outside, covariance_shape=shape, order=order)


def _by_camera(
    rig: Rig,
    centrelines_px: Any,
    readings: dict[str, Values],
    joints: dict[str, Values],
    sigma_px: Any,
    plane: Mapping[str, Any],
) -> list[Batch]:
    """Each camera's measurements, by name. Raises InputError."""
    names = ", ".join(rig.cameras)
    remedy = f"give {{name: (N, 2) pixels}} of some of its cameras: {names}"
    if plane.get("plane_xy_m") is not None:
        raise InputError("plane_xy_m does not say of which camera", remedy=f"give centrelines: {remedy}")
    if not isinstance(centrelines_px, Mapping) or not centrelines_px:
        raise InputError(f"the rig has several cameras, the centreline is {quoted(centrelines_px)}", remedy=remedy)
    for named in (centrelines_px, sigma_px if isinstance(sigma_px, Mapping) else {}):
        if unknown := sorted(map(str, named.keys() - rig.cameras.keys())):
            raise InputError(f"there is no camera {unknown[0]}", where="rig", remedy=remedy)
    count = len(next(iter(centrelines_px.values())))
    parts = []
    for name, one in rig.cameras.items():
        lines = centrelines_px.get(name, np.full((count, 0, 2), np.nan))
        sigma = sigma_px.get(name) if isinstance(sigma_px, Mapping) else sigma_px
        parts.append(Batch.checked(one, lines, readings, joints, sigma if name in centrelines_px else None, plane))
    return parts


def outside(points_px: np.ndarray, image_size: tuple[int, int]) -> np.ndarray:
    """(...) mask of the points (..., 2) outside a picture (width, height): a tracker's errors, or u and v exchanged.

    Those at most a twentieth of its longer side off count as inside: curves through a tracker's points go on a little.
    """
    half = 0.5 * np.asarray(image_size, float)
    far = np.abs(points_px - half) > half + 0.05 * max(image_size)
    return far.any(axis=-1) & np.isfinite(points_px).all(axis=-1) if far.any() else far[..., 0]


@dataclass(frozen=True)
class OutlierSettings:
    """Thresholds of gross errors among a frame's points, and settings of the measured scatter of the others."""

    px: float = 3.0  # of a point that lies off: where points are precise, a wrong shape is no gross error
    most: float = 0.2  # with this part of the points, or more, the frame shows something else
    neighbours: int = 11  # points along the antenna, itself in the middle, whose median tells where they lie
    precise: float = 0.1  # a point's standard deviation counts as this part of the frame's median, at least
    jump_std: float = 3.0  # of the points' standard deviations, at least: the medians are twice as exact as a point
    jump_ratio: float = 5.0  # to the frame's usual difference of such medians: a wrong shape differs everywhere
    returns: float = 0.5  # part of a stretch's distance by which the line may lie elsewhere behind it than before
    scatter_frames: int = 32  # lines, spread over a recording, that determine its scatter to a few per cent
    few_frames: int = 6  # lines, most, that decide first whether the usual standard deviation may be too small
    frames_a_line: int = 100  # frames for each line that is looked at: more lines would take as long as the contacts
    fewest_lines: int = 5  # of which it can be told what they share
    scatter_points: int = 32  # a line with fewer is left out: smoothing takes too much of it
    intervals: int = 8  # of the smooth curve, a cubic spline: a touched antenna's third derivative jumps
    per_interval: int = 8  # points of a line, at least, in each of them
    lonely: float = 5.0  # times as far from its neighbours as is usual, a point is not on a line with them
    rounds: int = 6  # fits of the smooth curve, the last one without gross errors
    gross_std: float = 5.0  # farther from the curve, in the line's own scatter, a point is a gross error
    surely_std: float = 4.0  # where no point of a line is so far from the first fit, there is no gross error
    surely_points: int = 200  # points of such a line, at least: the fit to few follows each
    lags: int = 8  # neighbours, at most, that share errors; what spans more is part of the curve
    significant: float = 2.5  # standard errors from which a correlation of neighbours counts
    slow: float = 0.25  # part of the slowest errors, at least, that the curve may not have taken
    tolerated: float = 1.5  # ratio of scatter to stated standard deviations beyond which these are too small


def point_scatter(
    lines_px: Sequence[np.ndarray], sigma_px: Sequence[np.ndarray], settings: OutlierSettings = OutlierSettings()
) -> float:
    """Ratio of the scatter of centrelines' points about smooth curves to their standard deviations; NaN where too
    little is visible.

    lines_px : (N, 2) of each frame, in any order. sigma_px : (N,) of each. Where neighbours share errors, the mean of
    many is less exact than that of as many independent ones: the factor counts that in.
    """
    chosen = spread_evenly(len(lines_px), settings.scatter_frames)
    lines, sigma = ([np.asarray(each[row], float) for row in chosen] for each in (lines_px, sigma_px))
    return float(core.search.point_scatter(lines, sigma, settings))


def shared_share(
    lines_px: Sequence[np.ndarray], sigma_px: Sequence[np.ndarray], settings: OutlierSettings = OutlierSettings()
) -> float:
    """Share, 0 to 1, of the points' scatter about smooth curves that is the same in all lines, as from a kink."""
    about = core.search.off_smooth_curve
    found = [about(points, sigma, settings) for points, sigma in zip(lines_px, sigma_px, strict=True)]
    lines = [each for each in found if len(each)]
    if len(lines) < settings.fewest_lines:
        return 0.0
    places = np.linspace(0.0, 1.0, settings.scatter_points)
    profiles = np.array([np.interp(places, np.linspace(0.0, 1.0, len(off)), off) for off in lines])
    mean, noise = profiles.mean(axis=0), profiles.std(axis=0, ddof=1)
    # of independent errors the mean has this much
    same = float(np.mean(mean**2 - noise**2 / len(lines)))
    return float(np.clip(same / max(float(np.mean(profiles**2)), 1e-12), 0.0, 1.0))


def without_outliers(
    batch: Batch, frames: Frames, fitted: FitNumbers, rung: str, solved: Callable[[Frames], FitNumbers]
) -> Frames:
    """Refit frames with gross errors among their points without these, if one contact explains the rest. Returns the
    frames as used.

    Where little of the antenna is seen, one point far from there turns the fit in spite of its small weight; so do many
    that lie off to the same side.
    """
    usable, settings, rig = frames.usable, OutlierSettings(), frames.rig_arrays.rig
    every, nothing = usable.sum(axis=1), dict[int, object]()  # was found in a row, by what
    ones = [rig, *rig.others.values()]  # each camera's; of the one that saw the farthest point gross errors are sought
    # many together only relative to a fit that no single one has turned, nor the worst of them
    for least_std, which in (
        *[(ContactSettings.outlying_std, _alone)] * len(ones),
        *[(core.solver.STRETCH_STD, _stretch)] * 2,
    ):
        off = (fitted.farthest > least_std) & ((which is _alone) | (fitted.jump > ContactSettings.jump))
        suspicious = np.flatnonzero(off).tolist()
        rows = np.array([row for row in suspicious if nothing.get(row) is not which], int)
        if not len(rows):
            continue
        nothing |= dict.fromkeys(rows.tolist(), which)
        some = replace(frames.picked(rows), usable=usable[rows])
        nodes_m, left = bend(some, rung, fitted.unknowns[rows, None]).points_m, some.usable.copy()
        for row, nodes, own in zip(rows, nodes_m, left, strict=True):
            points_px, camera = np.where(own[:, None], batch.points_px[row], np.nan), fitted.farthest_camera[row]
            mine = slice(None) if batch.camera is None else np.flatnonzero(batch.camera[row] == camera)
            own[mine] *= ~_outliers(ones[camera], nodes, points_px[mine], batch.sigma_px[row, mine], which)
        count = (every[rows] - left.sum(axis=1)).astype(int)
        fewer = (left.sum(axis=1) < some.usable.sum(axis=1)) & (count < settings.most * every[rows])
        if not fewer.any():
            continue
        again = solved(replace(some.picked(fewer), usable=left[fewer]))
        again.outliers[:] = count[fewer]
        better = (again.evidence < ContactSettings.contact_evidence) | ~unexplained(again)
        changed = rows[fewer][better]
        fitted.put(changed, again.picked(better))
        usable = usable.copy() if usable is frames.usable else usable
        usable[changed] = left[fewer][better]
        for row in changed.tolist():
            del nothing[row]
    return frames if usable is frames.usable else replace(frames, usable=usable)


def _outliers(
    rig: Rig,
    nodes_m: np.ndarray,
    points_px: np.ndarray,
    sigma_px: np.ndarray,
    which: Callable[[np.ndarray, np.ndarray], np.ndarray],
) -> np.ndarray:
    """(N,) mask of the points (N, 2), with standard deviations (N,), that are gross errors by their distance across
    an antenna's nodes (M, 3), antenna frame, in order along it."""
    found = np.zeros(len(points_px), bool)
    path = pixels(rig.camera, rig.T_antenna_camera.inverse(), nodes_m)
    there = np.flatnonzero(np.isfinite(points_px).all(axis=1))
    if too_short(path) or len(there) < OutlierSettings.neighbours:
        return found
    nearest, across = offsets_from(resample(path, 1.0)[0], points_px[there])
    order = np.argsort(nearest, kind="stable")
    found[there[order]] = which(across[order], sigma_px[there[order]])
    return found


def _alone(across_px: np.ndarray, sigma_px: np.ndarray) -> np.ndarray:
    """(N,) mask of the points that lie far from their neighbours; several that lie off together are a shape."""
    off = np.abs(across_px - _medians(across_px))
    return np.asarray(off > np.maximum(ContactSettings.outlying_std * sigma_px, OutlierSettings.px))


def _medians(values: np.ndarray) -> np.ndarray:
    """(N,) running median of each of values (N,) and its neighbours."""
    several, beyond = OutlierSettings.neighbours, OutlierSettings.neighbours // 2
    mirrored = np.concatenate([values[beyond:0:-1], values, values[-2 : -beyond - 2 : -1]])
    return np.asarray(core.search.running_medians(mirrored, several))


def _stretch(across_px: np.ndarray, sigma_px: np.ndarray) -> np.ndarray:
    """(N,) mask of points that lie off to one side together, between two jumps of the line, or between a jump and
    its end."""
    settings, count = OutlierSettings(), len(across_px)
    off, side = np.zeros(count, bool), min(core.solver.SIDE, max(count // 12, 4))
    if count < 4 * side:
        return off
    medians = core.search.running_medians(across_px, side)
    jumps = medians[side:] - medians[:-side]  # at points side, side + 1, …
    size = np.abs(jumps)
    least = max(settings.jump_std * float(np.median(sigma_px)), settings.jump_ratio * float(np.median(size)))
    ends = {0, count}
    nothing = np.full(side, -np.inf)
    for one_way in (jumps, -jumps):
        highest = core.search.running_maxima(np.concatenate([nothing, one_way, nothing]), 2 * side + 1)
        ends |= set((np.flatnonzero((one_way >= least) & (one_way == highest)) + side).tolist())
    # what is off in the middle of a line decides whether it is the middle that is, or an end
    spans = sorted(combinations(sorted(ends), 2), key=lambda span: (span[0] == 0) + (span[1] == count))
    for begin, end in spans:
        near = slice(max(begin - side, 0), end + side)
        middle = begin > 0 and end < count
        most = settings.most * count if middle else 0.5 * (settings.most * count + side)
        if end - begin >= most or off[near].any():
            continue
        level = float(np.median(across_px[begin:end]))
        outside = [float(medians[at]) for at in (begin - side, end) if 0 <= at < len(medians)]
        around = float(np.mean(outside))
        if abs(level - around) < least or np.ptp(outside) > settings.returns * abs(level - around):
            continue
        off[near] = np.abs(across_px[near] - level) < np.abs(across_px[near] - around)
    return off


def _end(tip_px: np.ndarray) -> np.ndarray:
    """(3,) the antenna's end and its standard deviation, no less than a detector can reach. Raises InputError."""
    end = np.asarray(tip_px, float)
    if end.shape != (3,) or end[2] <= 0.0:
        raise InputError(f"tip_px is {tip_px!r:.60}", remedy="give u, v and their deviation along the antenna, px")
    return end if not end[2] < ContactSettings.least_end_px else np.array([*end[:2], ContactSettings.least_end_px])


def _points(lines: Any, name: str = "centrelines_px", remedy: str = "give (N, 2) pixels for every frame") -> np.ndarray:
    """(B, N, 2) array of centrelines of equal or different lengths, padded with NaN. Raises InputError."""
    if getattr(lines, "ndim", 0) == 3 and lines.shape[2] == 2:
        return check_each(as_floats(lines, name, remedy), PLAUSIBLE.pixel_px, name, remedy, "infinite")
    if not isinstance(lines, Iterable) or isinstance(lines, Mapping):
        raise InputError(f"{name} is {quoted(lines)}", remedy=remedy)
    lines = [as_floats(line, name, remedy) for line in lines]
    for line in lines:
        if line.ndim != 2 or line.shape[1] != 2:
            raise InputError(f"a centreline has shape {line.shape}", remedy=remedy)
        check_each(line, PLAUSIBLE.pixel_px, name, remedy, "infinite")
    return _padded(lines, np.nan) if lines else np.empty((0, 0, 2))


def _lines(
    rig: Rig, centrelines_px: Any, sigma_px: Any, plane_xy_m: Any = None, covariance_m2: Any = None
) -> tuple[np.ndarray, np.ndarray | float, np.ndarray | None]:
    """Pixels (B, N, 2) of centrelines in pixels or on plane C; their standard deviations, one or (B, N), and the
    shapes of their covariances (B, N, 2, 2) as in `pixels_on_plane`. Raises InputError."""
    if (centrelines_px is None) == (plane_xy_m is None):
        how_many = "neither" if plane_xy_m is None else "both"
        raise InputError(f"pixels and plane_xy_m: {how_many}", remedy="give one of them")
    if covariance_m2 is not None and (plane_xy_m is None or sigma_px is not None):
        raise InputError("covariance_m2 is not of pixels", remedy="give it with plane_xy_m and without sigma_px")
    if plane_xy_m is None:
        points = _points(centrelines_px)
        return points, _absent_px(rig, points, sigma_px), None
    several = isinstance(plane_xy_m, Iterable) and not hasattr(plane_xy_m, "ndim")
    lines = list(plane_xy_m) if several and not isinstance(plane_xy_m, Mapping) else plane_xy_m
    points = _points(lines, "plane_xy_m", "give (N, 2) m on plane C for every frame, of one camera")
    if isinstance(covariance_m2, list | tuple) and all(getattr(own, "ndim", 0) == 3 for own in covariance_m2):
        remedy = "give (N, 2, 2) m² for every frame, or (2, 2) for all points"
        parts = [as_floats(own, "covariance_m2", remedy) for own in covariance_m2]
        if [own.shape for own in parts] != [(len(line), 2, 2) for line in lines]:
            raise InputError("covariance_m2 has other lengths than plane_xy_m", remedy=remedy)
        covariance_m2 = _padded(parts, np.nan) if parts else np.eye(2)
    pixels, own, shape = pixels_on_plane(rig.camera, rig.T_antenna_camera, points, covariance_m2)
    return pixels, _absent_px(rig, pixels, sigma_px) if own is None else own, shape


def _absent_px(rig: Rig, lines_px: np.ndarray, sigma_px: Any) -> float:
    """Standard deviation, px, of the points of lines (B, N, 2) where none is stated: what the rig's own pictures
    showed, or their scatter if that is far larger."""
    usual, settings = rig.image.noise_px, OutlierSettings()
    if sigma_px is not None:
        return usual

    def scatter_of(most: int) -> float:
        chosen = lines_px[spread_evenly(len(lines_px), most)]
        lines = np.where(outside(chosen, rig.camera.image_size)[..., None], np.nan, chosen)
        return point_scatter(list(lines), list(np.ones(chosen.shape[:2])), settings)

    few = int(np.clip(len(lines_px) // settings.frames_a_line, 1, settings.few_frames))
    # near the limit a few lines do not decide
    if scatter_of(few) < (1.0 + settings.tolerated) / 2 * usual:
        return usual
    scatter = scatter_of(settings.scatter_frames)
    return scatter if scatter > settings.tolerated * usual else usual


def _padded(several: Sequence[np.ndarray], missing: float) -> np.ndarray:
    """(B, N, ...) array of B arrays (N_b, ...), padded with `missing`."""
    if len(several) == 1:
        return several[0][None]
    whole = np.full((len(several), max(map(len, several)), *several[0].shape[1:]), missing)
    for row, each in zip(whole, several, strict=True):
        row[: len(each)] = each
    return whole


def _column(name: str, values: Values, count: int) -> np.ndarray:
    """(count,) floats, NaN for missing ones. Raises InputError."""
    if values is None:
        return np.full(count, np.nan)
    numbers = as_floats(values, name, "give a number for every frame")
    if numbers.shape != (count,):
        what = f"{name} has shape {numbers.shape}, the centrelines number {count}"
        raise InputError(what, remedy="give a number for every frame")
    return numbers


def _deviations(points_px: np.ndarray, sigma_px: np.ndarray | float) -> np.ndarray:
    """(B, N) standard deviations of points (B, N, 2) from one, (B, 1) or (B, N). Raises InputError where a point has
    none."""
    sigma = as_floats(sigma_px, "sigma_px", "give standard deviations in px")
    positive = sigma.size > 0 and sigma.min() > 0.0 and sigma.max() < np.inf
    try:
        sigma = np.broadcast_to(sigma, points_px.shape[:2])
    except ValueError:
        raise InputError(f"sigma_px has shape {sigma.shape}", remedy="give one number or one for each point") from None
    if not positive and not ((sigma > 0) & np.isfinite(sigma))[np.isfinite(points_px).all(axis=-1)].all():
        raise InputError("sigma_px is not everywhere positive and finite", remedy="give standard deviations in px")
    return sigma


def _in_order(
    rig: Rig, points_px: np.ndarray, sigma_px: np.ndarray, shape: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None, np.ndarray, np.ndarray | None]:
    """Points (B, N, 2), standard deviations (B, N) and shapes of covariances (B, N, 2, 2) sorted along the longer
    side of each frame's points, missing ones last; the number (B,) of points outside the picture, which count as
    missing; and each point's original index (B, N), None if unchanged.

    The initialization takes means of neighbours: it must not depend on the order in which the points were listed.
    """
    size, missing = rig.camera.image_size, np.zeros(len(points_px), int)
    _, disordered, *extents = core.solver.places(np.ascontiguousarray(points_px), False)
    if any(least < 0.0 or most > side for (least, most), side in zip(extents, size, strict=True)):
        lost = outside(points_px, size)
        points_px, missing = np.where(lost[..., None], np.nan, points_px), lost.sum(axis=1)
        disordered = core.solver.places(np.ascontiguousarray(points_px), False)[1]
    rows, listed = np.flatnonzero(disordered), None
    if len(rows):
        order = np.argsort(core.solver.places(np.ascontiguousarray(points_px[rows]), True)[0], axis=1)
        listed = np.tile(np.arange(points_px.shape[1]), (len(points_px), 1))
        listed[rows] = order
        points_px, sigma_px = points_px.copy(), np.array(sigma_px)
        points_px[rows] = np.take_along_axis(points_px[rows], order[..., None], 1)
        sigma_px[rows] = np.take_along_axis(sigma_px[rows], order, 1)
        if shape is not None:
            shape = shape.copy()
            shape[rows] = np.take_along_axis(shape[rows], order[..., None, None], 1)
    return points_px, _no_less(points_px, sigma_px), shape, missing, listed


def _no_less(points_px: np.ndarray, sigma_px: np.ndarray) -> np.ndarray:
    """(B, N) standard deviations of points (B, N, 2), bounded below by the frame's others: no single point may
    decide, for it may be a gross error."""
    one_for_all = not any(sigma_px.strides)
    if one_for_all or not sigma_px.size or sigma_px.min() >= OutlierSettings.precise * sigma_px.max():
        return sigma_px
    sigma_px = np.array(sigma_px)
    for sigma, there in zip(sigma_px, np.isfinite(points_px).all(axis=2), strict=True):
        # NumPy's median loads its masked arrays, for a hundredth of a short command's time
        least = OutlierSettings.precise * core.search.median(sigma[there]) if there.any() else 0.0
        np.maximum(sigma, least, out=sigma)
    return sigma_px
