"""Possible places and shapes of the antenna in the picture."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vbaa_calib.camera import Camera
from vbaa_calib.core.polyline import arc_lengths, followed, normals, offsets_from, resample
from vbaa_calib.native import core

from .centreline import Centreline, Visibility
from .settings import SearchSettings

CLAMP_REACH_PX, CLAMP_TURN_RAD = 8.0, 0.12
"""How far off the clamp itself may be, and three deviations of its direction on a rig that is not calibrated."""
STARTS = np.zeros((6, 5))
STARTS[:, 3], STARTS[:, 4] = [0.0, 0.0, 0.7, -0.7, 0.7, -0.7], np.log([0.6, 0.3, 0.6, 0.6, 0.3, 0.3])
"""By how much a force bends the antenna towards the camera (rad), and where, in logarithms of its lengths, to begin
with; the first two in the picture alone."""
SHAPE_POINTS, LEAST_SHAPE_POINTS, SHAPE_SEGMENTS = 40, 12, 48
"""Most and fewest runs of points whose means are compared with a shape; its segments."""
DEPTH_RAD = 3.0
"""Prior standard deviation of the bend towards the camera, which perspective alone shows."""
SHAPE_RANK, WELL_SHAPED = 0.3, 0.05
"""So much less a line may be seen that has a shape of one unit of misfit less; a misfit that is not made better."""
USUAL_MISFIT, UNSURE_MISFIT, MUCH_SEEN, SHAPE_DOUBT = 0.08, 0.25, 0.72, 4.0
"""Most that lines have which lie on the antenna all along; most for one of which much is seen, but not surely; part of
a line of either polarity that must be seen for more; and its doubt for the square root of more, over `shape_px`."""
ASIDE_RAD, STRAY_PX = 0.05, (4.0, 2.0, 2.0, 1.0, 1.0, 0.7, 0.7)
"""Deviation of the bend towards the camera of the shape that is nearest to some points, which shows how long it is; and
distances at which one counts half as much, one round each."""
FROM_CLAMP, BENDS_MORE = 0.35, (3.0, 0.15)
"""Part of the length over which a line's direction at the clamp is measured, by a parabola; and by how much a contact
there may falsify it, over its turn: less for a line of either polarity."""


@dataclass(frozen=True, eq=False)
class FreeShape:
    """The free antenna in space, with the camera that sees it.

    Attributes
    ----------
    clamp_m : (3,) camera frame.
    axes : (3, 3) rows in the camera frame: along the antenna at its clamp, lateral in the picture, and the third.
    segments_m : (SHAPE_SEGMENTS, 3) equal ones from clamp to tip, along these axes.
    """

    camera: Camera
    clamp_m: np.ndarray
    axes: np.ndarray
    segments_m: np.ndarray

    @staticmethod
    def of(camera: Camera, points_m: np.ndarray) -> FreeShape:
        """The free shape from points (K, 3) from clamp to tip in the camera frame."""
        along = np.append(0.0, np.linalg.norm(np.diff(points_m, axis=0), axis=1).cumsum())
        at = np.linspace(0.0, along[-1], SHAPE_SEGMENTS + 1)
        points = np.stack([np.interp(at, along, values) for values in points_m.T], axis=1)
        segments = np.diff(points, axis=0)
        aside = np.cross(points[0], segments[0])
        axes = np.stack([segments[0], aside, np.cross(segments[0], aside)])
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        return FreeShape(camera, points[0], axes, segments @ axes.T)

    @cached_property
    def focal_px(self) -> float:
        """Mean focal length."""
        return 0.5 * float(self.camera.matrix[0, 0] + self.camera.matrix[1, 1])

    @property
    def clamp_px_per_m(self) -> float:
        """Magnification at the clamp, px per metre, for lengths perpendicular to the line of sight."""
        return self.focal_px / float(self.clamp_m[2])

    def misfit(
        self, points_px: np.ndarray, sigma_px: np.ndarray, allowed: tuple[float, float, float], enough: float
    ) -> float:
        """`Corridor.misfit` with allowances for shape (px), clamp position (px) and clamp angle (rad).

        0 where the lens does not show enough of the points.
        """
        seen, variance = self._shown(points_px, sigma_px, allowed[0])
        if len(seen) < LEAST_SHAPE_POINTS:
            return 0.0
        known = (allowed[1] / self.clamp_px_per_m, allowed[2], DEPTH_RAD)
        return float(core.search.nearest_shape(self, seen, variance, known, enough, STARTS)[0])

    def nearest(self, points_px: np.ndarray, sigma_px: np.ndarray, allowed: tuple[float, float, float]) -> np.ndarray:
        """`Corridor.nearest` with allowances for shape (px), clamp position (px) and clamp angle (rad)."""
        seen, variance = self._shown(points_px, sigma_px, allowed[0])
        if len(seen) < LEAST_SHAPE_POINTS:
            return np.empty((0, 2))
        known = (0.5 * allowed[1] / self.clamp_px_per_m, 0.5 * allowed[2], ASIDE_RAD)
        weight, starts, middle = np.ones(len(seen)), STARTS[:2], 0.5 * np.asarray(self.camera.image_size, float)
        for scale in STRAY_PX:
            _, shape = core.search.nearest_shape(self, seen, variance * weight, known, 0.0, starts)
            curve = core.search.bent(self, shape)
            along = self.focal_px * curve
            near = followed(along + middle, self.camera.image_size)
            if len(near) < 2:
                return near
            along = along if len(near) == len(along) else near - middle
            aside = offsets_from(resample(along, 1.0)[0], self.focal_px * seen)[1]
            weight, starts = 1.0 + (aside / scale) ** 2, np.array([shape])
        pixels, seen_here = self.camera.project(np.column_stack([curve, np.ones(len(curve))]))
        return followed(
            pixels[: len(seen_here) if seen_here.all() else int(seen_here.argmin())], self.camera.image_size
        )

    def _shown(self, points_px: np.ndarray, sigma_px: np.ndarray, shape_px: float) -> tuple[np.ndarray, np.ndarray]:
        """Means of runs of points that the lens can back-project, (M, 2) ideal normalized coordinates, and their
        variances (M,) including the shape's."""
        means, variance = core.search.means_of_runs(points_px, sigma_px, SHAPE_POINTS)
        seen, valid = self.camera.unproject_normalized(means)
        return seen[valid], (variance[valid] + shape_px**2) / self.focal_px**2


@dataclass(frozen=True, eq=False)
class Corridor:
    """The region of the picture in which the antenna can be.

    Attributes
    ----------
    axis_px : (M, 2) the free antenna from clamp to tip, pixels.
    reach_px : (M,) how far to either side it can be at each of these points.
    width_px : the antenna's width, half way. taper : part of it by which it is broader at its tip than at its clamp.
    clamp_px, clamp_rad : how far from the axis, and at what angle to it, the antenna may leave its clamp.
    shape_px : root mean square distance by which it may differ from its free shape, bent by a force; None without a
    calibrated rig: its free shape is unknown then.
    free : its free shape in space.
    """

    axis_px: np.ndarray
    reach_px: np.ndarray
    width_px: float
    clamp_px: float = CLAMP_REACH_PX
    clamp_rad: float = CLAMP_TURN_RAD
    shape_px: float | None = None
    free: FreeShape | None = None
    taper: float = 0.0

    def aside(self, points_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates of points (N, 2) along the axis, and along its normals, (N,) px."""
        fine, along = resample(self.axis_px, 1.0)
        nearest, distance = offsets_from(fine, points_px)
        return along[nearest], distance

    def misfit(self, points_px: np.ndarray, sigma_px: np.ndarray, enough: float = 1.0) -> float:
        """Distance of points (N, 2), with standard deviations (N,), beginning at the clamp, from the nearest
        possible antenna.

        The sum of the squares of offset and turn at the clamp and of the distance from the shape, over what is allowed
        each: more than 1 is no antenna. Points beyond the tip are as far off as they are from it. The shape is the free
        antenna's, bent to any side by a force at any place; the first one found that is `enough`, or less, is not made
        better.
        """
        assert self.shape_px is not None
        assert self.free is not None
        return self.free.misfit(points_px, sigma_px, (self.shape_px, self.clamp_px, self.clamp_rad), enough)

    def nearest(self, points_px: np.ndarray, sigma_px: np.ndarray) -> np.ndarray:
        """(K, 2) the possible antenna, bent laterally in the picture, that is nearest to points (N, 2) with standard
        deviations (N,), some of which may be something else's; (0, 2) where there are too few."""
        assert self.shape_px is not None
        assert self.free is not None
        return self.free.nearest(points_px, sigma_px, (self.shape_px, self.clamp_px, self.clamp_rad))


def _reject_beside_clamp(line: Centreline, where: Corridor, changing: bool) -> Centreline:
    """The centreline, rejected where it does not leave the clamp along the free antenna.

    A cantilever bends away from its free shape slowly; a cable or an edge that passes its clamp is straight there.
    """
    if not line.found or len(where.axis_px) < 2:
        return line
    start, part_px = where.axis_px[0], FROM_CLAMP * float(arc_lengths(where.axis_px)[-1])
    # along the line itself, since a strongly bent one soon leaves the axis; its guide, which noise makes no longer
    guide = np.hypot(*(line.guide_px[0] - start)) + arc_lengths(line.guide_px)
    along = guide[line.visibility == Visibility.SEEN] / part_px
    first = along < 1.0
    if first.sum() < LEAST_SHAPE_POINTS:
        return line
    across = (line.points_px[first] - start) @ normals(where.axis_px)[0]
    bend, slope, offset = np.polyfit(along[first], across, 2)
    spread = 2.0 * core.search.median(line.sigma_px[first])
    turn = (abs(slope) - BENDS_MORE[changing] * abs(2.0 * bend)) / part_px - spread * FROM_CLAMP / (0.1 * part_px)
    if np.hypot(offset / (where.clamp_px + spread), max(turn, 0.0) / where.clamp_rad) > 1.0:
        aside = np.degrees(np.arctan(abs(slope) / part_px))
        return line.with_verdict(
            "no_antenna",
            f"what could be the antenna passes the clamp by {abs(offset):.0f} px, {aside:.0f}° from its axis (a cable, "
            "an edge; or the clamp is not where it is said to be)",
        )
    return line


def of_antennas_shape(line: Centreline, where: Corridor, changing: bool) -> Centreline:
    """The centreline, rejected where no antenna can have its shape.

    On a calibrated rig a line must be the free antenna bent by a force: a cable bends elsewhere than at the clamp, and
    a line that goes over to an object's edge has a kink. A line of either polarity (`changing`) is more easily
    something else: unless much of it is seen, or its shape is likely, it must also leave the clamp as the antenna does
    and fit better than usual; unless much of it is surely a line, not an edge, it must fit better, too. On a rig that
    is not calibrated every line must leave the clamp as the antenna does.
    """
    little = changing and line.seen < MUCH_SEEN and not line.odds >= SearchSettings.likely_odds
    line = _reject_beside_clamp(line, where, changing) if little or where.shape_px is None else line
    if where.shape_px is None or not line.found:
        return line
    unsure = changing and line.seen * line.sure < MUCH_SEEN
    most = USUAL_MISFIT if little else UNSURE_MISFIT if unsure else 1.0
    if where.misfit(line.points_px, line.sigma_px, most) <= most:
        return line
    return line.with_verdict(
        "no_antenna",
        "what could be the antenna is not its free shape bent by a force (an object's edge, a cable; or the rig has "
        "moved since its calibration)",
    )


def less_sure(line: Centreline, where: Corridor) -> Centreline:
    """The centreline, on a calibrated rig with standard deviations increased by the deviation of its shape from an
    antenna's."""
    if where.shape_px is None or not line.found:
        return line
    misfit = where.misfit(line.points_px, line.sigma_px, USUAL_MISFIT)
    return line.doubted(SHAPE_DOUBT * where.shape_px * float(np.sqrt(max(misfit - USUAL_MISFIT, 0.0))))


def better_shaped(line: Centreline, other: Centreline, where: Corridor) -> Centreline:
    """The one of two lines that is more visible, more certain and shaped more like an antenna.

    Where the antenna is faint, one that goes on along a cable or an edge near it has a kink there.
    """
    if not other.found or not line.found:
        return line if line.found else other
    rank = [one.likely - SHAPE_RANK * where.misfit(one.points_px, one.sigma_px, WELL_SHAPED) for one in (line, other)]
    return line if rank[0] >= rank[1] else other
