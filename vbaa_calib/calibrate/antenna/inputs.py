"""The inputs of bundle adjustment: observations of the antenna, and priors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np

from vbaa_calib.antenna.taper import UNIFORM, Taper
from vbaa_calib.calibrate.lens.settings import LensSettings
from vbaa_calib.calibrate.lens.uncertainty import pixel_grid, projection_jacobian
from vbaa_calib.calibrate.pose.fusion import PoseEstimate
from vbaa_calib.camera import Camera
from vbaa_calib.detect.whisker.paint import Paint
from vbaa_calib.detect.whisker.profile import locking_std
from vbaa_calib.geometry import Pose
from vbaa_calib.geometry.covariance import independent_axes
from vbaa_calib.rig import WrenchSensor
from vbaa_calib.session import Drift, Load, LoadReadings, Still

EXACT = LoadReadings(0.0, 0.0)  # loads whose places and forces are exact


def reading_keys(load: Load) -> tuple[tuple[str, str], tuple[str, str]]:
    """Keys of a load's distance and weight: loads with equal keys share one reading error. The components of a force
    are rounded, so that one weight along y and along z has one key."""
    force = float(np.hypot(load.force_y_N, load.force_z_N))
    return ("distance", f"{load.distance_m:.6f}"), ("mass", f"{force:.3g}")


def _read(load: Load, further_m: float, heavier: float) -> Load:
    """The load with its distance increased by `further_m` and its force multiplied by `heavier`."""
    y_N, z_N = heavier * load.force_y_N, heavier * load.force_z_N
    return replace(load, distance_m=load.distance_m + further_m, force_y_N=y_N, force_z_N=z_N)


@dataclass(frozen=True, eq=False)
class ReadingGroups:
    """The K unknown reading errors of F static frames, in units of their standard deviations; equal readings share
    one."""

    std: np.ndarray  # (K,) m of a place, relative of a weight
    distance: np.ndarray  # (F,) index of the load's place among the K; −1 for none
    force: np.ndarray  # (F,) the same of its weight

    @property
    def count(self) -> int:
        """Number K of the unknown errors."""
        return len(self.std)

    @staticmethod
    def of(stills: Sequence[Still], known: LoadReadings) -> ReadingGroups:
        """Groups the uncertain readings of static frames."""
        stds: Mapping[str, float] = {"distance": known.distance_std_m, "mass": known.force_std_relative}
        numbers: dict[tuple[str, str], int] = {}
        found = {"distance": np.full(len(stills), -1), "mass": np.full(len(stills), -1)}
        for index, still in enumerate(stills):
            for key in reading_keys(still) if isinstance(still, Load) else ():
                if stds[key[0]] > 0:
                    found[key[0]][index] = numbers.setdefault(key, len(numbers))
        return ReadingGroups(np.array([stds[kind] for kind, _ in numbers]), found["distance"], found["mass"])

    def corrected(self, stills: Sequence[Still], errors: np.ndarray) -> list[Still]:
        """The static frames with their loads' distances and forces corrected by errors (K,)."""
        further, heavier = (each.tolist() for each in self.corrections(errors))
        return [
            _read(still, *off) if isinstance(still, Load) else still
            for still, *off in zip(stills, further, heavier, strict=True)
        ]

    def corrections(self, errors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """By how much (F,) in m loads lie further from the clamp than read, and how many times (F,) they are heavier,
        for errors (K,)."""
        # the last one, of index −1, is nobody's
        steps = np.append(errors * self.std, 0.0)
        return steps[self.distance], np.exp(steps[self.force])

    def ends(self, stills: Sequence[Still], at: np.ndarray, farthest_m: float) -> np.ndarray:
        """(K,) upper bounds of the errors, in standard deviations: with the others at `at` (K,), no load hangs farther
        from the clamp than `farthest_m`."""
        ends = np.full(self.count, np.inf)
        for still, place in zip(stills, self.distance, strict=True):
            if isinstance(still, Load) and place >= 0:
                room = at[place] + (farthest_m - still.distance_m) / self.std[place]
                ends[place] = min(ends[place], room)
        return ends

    def columns(self, index: int, by_distance: np.ndarray, by_log_force: np.ndarray) -> np.ndarray:
        """(..., K) Jacobian by the errors, from a frame's derivatives (...) by its load's distance (per m) and log
        force."""
        slopes = np.zeros((*np.shape(by_distance), self.count))
        for group, slope in ((self.distance[index], by_distance), (self.force[index], by_log_force)):
            if group >= 0:
                slopes[..., group] = slope * self.std[group]
        return slopes


@dataclass(frozen=True, eq=False)
class Observation:
    """One static frame: the measured centreline, the readings, and the load on the antenna, if any."""

    still: Still
    points_px: np.ndarray  # (N, 2) on the centreline
    sigma_px: np.ndarray  # (N,) their standard deviations across it
    gravity_m_s2: np.ndarray  # (3,) antenna frame
    paint: Paint = field(default_factory=Paint)  # what sets the antenna off from its background
    height: float = 0.0  # of its line above the background, grey levels
    tip_px: np.ndarray = field(default_factory=lambda: np.full(2, np.nan))  # (2,) the antenna's end; NaN where not seen
    tip_std_px: float = np.nan  # its deviation along the antenna
    # whether neighbouring points share most of their errors, also with other frames: their scatter hides these
    shared: bool = False
    look: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))  # (PLACES, C) mean colour from clamp to tip
    row_px: np.ndarray = field(default_factory=lambda: np.zeros(1))  # (N,) or (1,) as `Centreline.row_px`

    @cached_property
    def locking(self) -> np.ndarray:
        """(3,) systematic errors of the line due to the pixel grid, see `locking_std`."""
        return locking_std(self.points_px)

    def only(self, points: np.ndarray) -> Observation:
        """The observation reduced to the selected points (N,)."""
        own, row = self.sigma_px[points], np.broadcast_to(self.row_px, points.shape)[points]
        return replace(self, points_px=self.points_px[points], sigma_px=own, row_px=row)

    def std_px(self, noise_scale: float) -> np.ndarray:
        """(N,) standard deviations for a noise scale: `sigma_px`, plus the noise of the pixel rows, which the scale
        leaves unchanged."""
        return np.hypot(self.sigma_px, self.row_px / noise_scale)

    @property
    def load_N(self) -> np.ndarray:
        """(2,) force components y, z."""
        return np.array([self.still.force_y_N, self.still.force_z_N]) if isinstance(self.still, Load) else np.zeros(2)

    @property
    def loaded(self) -> bool:
        """Whether the antenna is loaded."""
        return bool(self.load_N.any())


@dataclass(frozen=True, eq=False)
class Prior:
    """Prior distribution of pose, lens, antenna and sensors, before the static frames are used."""

    poses: Sequence[PoseEstimate]  # the camera's pose by one or several methods
    start: Pose  # camera pose from which the solution's steps are counted
    camera: Camera  # one without a covariance counts as exact
    mean: np.ndarray  # (11,) of the antenna's parameters, gain and offset
    std: np.ndarray  # (11,)
    readings: LoadReadings = EXACT  # how well the loads' places and forces are known
    tip_std_m: float | None = None  # how well the visible end is known to lie at the antenna's length; None: not used
    drift: Drift = field(default_factory=Drift)  # of which lines' errors count here: line_px, light_px and lock_px
    diameter_m: float = 0.0  # the antenna's, at its clamp
    taper: Taper = UNIFORM  # how the antenna changes along it, as stated
    log_tip_std: float = 0.0  # how well the logarithm of the tip's diameter over the clamp's is known; 0: exactly
    lens_share: float = 1.0  # part of its standard deviations by which the lens may be off in the solve
    sensor: WrenchSensor | None = None  # what is read other than the moment about y, as stated
    sensor_std: np.ndarray = field(default_factory=lambda: np.zeros(0))  # (W,) of its parameters
    fixed_axes: np.ndarray | None = None  # (P, P) for `lens_axes`, in place of those of the lens' covariance

    @cached_property
    def lens_shares(self) -> np.ndarray:
        """(P,) lengths of `lens_axes` in standard deviations of the lens: below `lens_share` along axes that move the
        picture nonlinearly."""
        return np.zeros(0) if self.camera.covariance is None else self.lens_share * _linear_axes(self.camera)[1]

    @cached_property
    def lens_axes(self) -> np.ndarray:
        """(P, P) independent directions of the lens's covariance as columns, each `lens_shares` standard deviations
        long; (0, 0) for an exact lens."""
        if self.fixed_axes is not None:
            return self.fixed_axes
        return np.zeros((0, 0)) if self.camera.covariance is None else _linear_axes(self.camera)[0] * self.lens_shares


@lru_cache(maxsize=4)
def _linear_axes(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Independent axes (P, P) of a lens's covariance, one standard deviation long, and the share (P,) of each within
    which the projection is linear and the visible region unchanged.

    Where the board's views leave a rational or wide lens open the covariance is an extrapolation: a small part of a
    standard deviation along one axis leads to a lens that folds inside the picture.
    """
    assert camera.covariance is not None
    axes, shares = independent_axes(camera.covariance), np.ones(len(camera.covariance))
    pixels = pixel_grid(camera.image_size, LensSettings.grid).reshape(-1, 2)
    slopes, (rays, valid) = projection_jacobian(camera, pixels), camera.unproject(pixels)
    valid &= np.isfinite(slopes).all(axis=(-1, -2))
    pixels, rays, slopes = pixels[valid], rays[valid], slopes[valid]
    if not len(pixels):
        return axes, shares

    def linear(step: np.ndarray) -> bool:
        seen, inside = camera.moved(step).project(rays)
        moved = slopes @ step
        allowed = LensSettings.bend * np.linalg.norm(moved) + LensSettings.negligible_px * np.sqrt(len(pixels))
        return bool(inside.all() and np.linalg.norm(seen - pixels - moved) <= allowed)

    turned = axes @ np.linalg.svd((slopes @ axes).reshape(2 * len(pixels), -1), full_matrices=False)[2].T
    for index, axis in enumerate(turned.T):
        near = (share for share in LensSettings.shares if linear(share * axis) and linear(-share * axis))
        shares[index] = next(near, LensSettings.shares[-1])
    return (axes, shares) if (shares == 1.0).all() else (turned, shares)
