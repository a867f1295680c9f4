"""EI of a rod from its line in one photograph; its uncertainty includes scale, gravity's direction and camera tilt."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.polyline import arc_lengths

from .bending import Bending, Loading, PhotoView, fit_bending, free_law, linear_law
from .centreline import RodLine

_CAMERA_LENGTHS = 2.0  # the camera's supposed distance in lengths of the rod, for the perspective of a tilt


@dataclass(frozen=True)
class PhotoSetting:
    """What is known of the photographs beside the rod's line."""

    length_m: float | None = None  # of the rod, from clamp to tip; None where marks give the scale
    marks_px: np.ndarray | None = None  # two marks (2, 2) in the plane of the rod
    marks_m: float = 0.0  # their distance
    down_rad: float = 0.0  # gravity's direction, from down the picture towards its right side
    weight_N_m: float | None = None  # None for EI per weight, or for a load beside which the weight is nothing
    load_N: float = 0.0
    load_m: float | None = None  # place of the load along the rod; None for its tip
    straight: bool = False  # the free rod is straight
    scale_std: float = 0.01  # relative
    down_std_rad: float = np.radians(1.0)
    tilt_std_rad: float = np.radians(3.0)

    @property
    def per_weight(self) -> bool:
        """Whether EI comes out per weight, in m³."""
        return self.weight_N_m is None and self.load_N == 0.0


@dataclass(frozen=True, eq=False)
class PhotoStiffness:
    """EI, or EI per weight, and moment against curvature."""

    inverse: float  # 1/EI
    inverse_std: float  # with all deviations
    interval: tuple[float, float]  # 95 % of EI; infinite at the upper end where the line gives no bound
    shares: dict[str, float]  # relative standard deviation of EI by cause
    views: list[PhotoView]  # as fitted
    linear: Bending  # fit of one EI
    free: Bending  # fit of curvature as any smooth function of the moment
    curvature: np.ndarray  # (K,) of the free fit
    curvature_std: np.ndarray  # (K,)
    curved_p: float  # probability of a relation so far from a straight line if it is one

    @property
    def determined(self) -> bool:
        """Whether the line tells an EI: its interval has two ends."""
        return bool(np.isfinite(self.interval[1]))


def solve_photo(lines: Sequence[RodLine], setting: PhotoSetting) -> PhotoStiffness:
    """EI from the line of the bent rod and, if there is a second line, of the unloaded one: hanging as before without
    its load, or lying flat where there was none but its weight.

    Raises InputError where no bending is seen, or load and scale are impossible.
    """
    if not all(line.tip_inside for line in lines):
        raise InputError("the rod's tip is not in the picture", remedy="photograph all of it, or say where: --tip U,V")
    views = _views(lines, setting)
    linear = fit_bending(views, linear_law(views, setting.straight))
    laws, departures = free_law(views)
    free = fit_bending(views, laws)
    inverse = float(linear.weights @ linear.values[:, 0])

    def again(changed: PhotoSetting, turn: tuple[float, float] = (0.0, 0.0)) -> float:
        """By what share 1/EI would change."""
        other = _views(lines, changed, turn)
        fit = fit_bending(other, linear_law(other, changed.straight))
        return float(fit.weights @ fit.values[:, 0]) / inverse - 1.0

    tilt = setting.tilt_std_rad
    about = [(-tilt, 0.0), (tilt, 0.0)], [(0.0, -tilt), (0.0, tilt)]
    downs = [replace(setting, down_rad=setting.down_rad + sign * setting.down_std_rad) for sign in (-1.0, 1.0)]
    power = 2.0 if setting.weight_N_m is None and setting.load_N else 3.0
    shares = {
        "scale": power * setting.scale_std,
        "gravity": _rms([again(each) for each in downs]),
        "tilt": float(np.linalg.norm([_rms([again(setting, turn) for turn in pair]) for pair in about])),
    }
    other = float(np.sqrt(sum(share**2 for share in shares.values())))
    own = float(linear.moments_of(np.eye(linear.values.shape[1])[:1])[1][0])
    low, high = linear.quantiles((0.025, 0.975), other)
    if high <= 0.0 and not _bends(views[0], lines[0], inverse):
        high = -low
    if high <= 0.0:
        raise InputError(
            "the rod bends against its load", remedy="is the clamped end taken for the tip, or gravity not down?"
        )
    curvature, curvature_std = free.moments_of(laws[0])
    return PhotoStiffness(
        inverse,
        float(np.hypot(own, other * inverse)),
        (1.0 / high, 1.0 / low if low > 0.0 else np.inf),
        {"line": own / abs(inverse), **shares},
        views,
        linear,
        free,
        curvature,
        curvature_std,
        free.p_value(departures),
    )


def _bends(view: PhotoView, line: RodLine, inverse: float, least_px: float = 0.2) -> bool:
    """Whether so much 1/EI bends a rod by more than its edges are known to, beyond how it lies and points."""
    _, effect, free, _ = view.rows
    offsets = effect @ (view.moment * inverse)
    offsets -= free @ np.linalg.lstsq(free, offsets, rcond=None)[0]
    return bool(_rms(offsets.tolist()) * line.length_px > least_px * float(arc_lengths(view.curve_m)[-1]))


def _rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _views(lines: Sequence[RodLine], setting: PhotoSetting, turn: tuple[float, float] = (0.0, 0.0)) -> list[PhotoView]:
    """The lines in metres, on the supposition that the rod's plane is turned about the picture's axes by `turn`."""
    views = []
    down = (float(np.sin(setting.down_rad)), float(np.cos(setting.down_rad)))
    weight = setting.weight_N_m if setting.weight_N_m is not None else float(setting.per_weight)
    for index, line in enumerate(lines):
        middle, far = line.centre_px, _CAMERA_LENGTHS * line.length_px
        points, curve = (_turned(each - middle, turn, far) for each in (line.points_px, line.curve_px))
        length = float(np.hypot(*np.diff(curve, axis=0).T).sum())
        if setting.marks_px is not None:
            scale = setting.marks_m / float(
                np.hypot(*np.diff(_turned(setting.marks_px - middle, turn, far), axis=0)[0])
            )
        else:
            scale = (setting.length_m or 0.0) / length
        share = 1.0 if setting.load_m is None else setting.load_m / (scale * length)
        if share > 1.02:
            what = f"the load at {setting.load_m:g} m is beyond the tip, at {scale * length:.3g} m"
            raise InputError(what, remedy="give --distance along the rod, from the clamp, in metres")
        loading = Loading(down, weight, setting.load_N, min(share, 1.0))
        if index:  # without its load, or lying flat
            loading = Loading(down, weight if setting.load_N else 0.0)
        views.append(PhotoView(scale * points, scale * curve, loading))
    return views


def _turned(points: np.ndarray, turn: tuple[float, float], far: float) -> np.ndarray:
    """(N, 2) places in a plane turned about the vertical and the level axis that a camera so far off sees at points."""
    for axis, angle in enumerate(turn):
        if angle:
            place = points[:, axis] * far / (far * np.cos(angle) - points[:, axis] * np.sin(angle))
            rest = points[:, 1 - axis] * (far + place * np.sin(angle)) / far
            points = np.stack([place, rest] if axis == 0 else [rest, place], axis=1)
    return points
