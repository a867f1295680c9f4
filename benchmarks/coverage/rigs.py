"""One draw of a rig: an antenna out of the priors, and everything that is measured of it, with fresh noise.

A calibration with priors is right about its uncertainty only over truths that scatter as the priors say. So the clamp,
the bow and the mass are drawn each time. Stiffness, gain and offset are drawn narrower than their priors, which are so
wide beside what the loads tell that they do not count. The shapes are the static rod's, which shares no code with the
model that is fitted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.boards import BOARD, FISHEYE, HD, LONG, MILD, SQUARE, TALL, WIDE, bent_corners, noisy_view
from vbaa_calib.antenna.rod import Rod, RodShape, sample_shape, solve_rod
from vbaa_calib.calibrate.antenna.session_rig import bow_std_per_m, nominal_parameters
from vbaa_calib.calibrate.antenna.settings import AntennaSettings
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.session import Load, NominalAntenna, Still, gravity_antenna
from vbaa_calib.simulate.plan import board_poses
from vbaa_calib.simulate.scene.lens import Lens, project
from vbaa_calib.simulate.scene.scene import IntrinsicsSpec, camera_pose

NOMINAL = NominalAntenna(length_m=0.24, diameter_m=0.8e-3, youngs_modulus_Pa=193e9, density_kg_m3=7900.0)
GRAVITY_WORLD_M_S2 = np.array([0.0, 0.0, -9.80665])
T_ANTENNA_JIG = Pose.from_rotvec(np.array([3.06, 0.03, 0.02]), np.array([0.035, 0.062, -0.004]))
"""The board in the jig: face up, a few millimetres below C, not quite parallel to it."""
_JIG_PICTURES = 4
_LOOKED_AT_M = np.array([0.12, 0.0, 0.0])
"""The point of the antenna frame on the camera's axis."""
_REACH_M = (0.24, 0.12)
"""Sides of the part of C that is judged: the antenna's length, and half of it to either side."""
GRID = (9, 5)
_LEAST_CORNERS = 12
_SEED = 20260


@dataclass(frozen=True, eq=False)
class CoverageRig:
    """What is true of a rig whatever the draw.

    Attributes
    ----------
    name, lens_model : of the rig; of the true lens, as `--model` takes it.
    lens : the true lens, by OpenCV alone.
    T_camera_board : true poses of the board in the pictures of the lens.
    T_antenna_camera : true pose of the camera.
    sagittas_m : (2,) bend of the board, in the pictures of the lens and in the jig.
    outliers : share of corners that are shifted, in both.
    """

    name: str
    lens_model: str
    lens: Lens
    T_camera_board: tuple[Pose, ...]
    T_antenna_camera: Pose
    sagittas_m: tuple[float, float] = (0.0, 0.0)
    outliers: float = 0.0

    @property
    def board_points_m(self) -> np.ndarray:
        """(C, 3) true corners in the board's frame."""
        return bent_corners(self.sagittas_m)

    def seen_corners(self, T_camera_board: Pose) -> tuple[np.ndarray, np.ndarray]:
        """Ids (N,) and true pixels (N, 2) of the corners inside the picture."""
        pixels = project(self.lens, T_camera_board @ self.board_points_m)
        ids = np.flatnonzero(self.inside(pixels))
        return ids, pixels[ids]

    def inside(self, pixels: np.ndarray) -> np.ndarray:
        """(N,) which pixels (N, 2) lie inside the picture, by a pixel; NaN does not."""
        return np.all((pixels > 1) & (pixels < np.array(self.lens.image_size) - 2), axis=1)

    def antenna_pixels(self, points_m: np.ndarray) -> np.ndarray:
        """(N, 2) true pixels of points (N, 3) in the antenna frame."""
        return project(self.lens, self.T_antenna_camera.inverse() @ points_m)

    def points_on_c(self) -> tuple[np.ndarray, np.ndarray]:
        """(M, 2) points of C within the antenna's reach that the picture shows, m, and their true pixels (M, 2)."""
        x, y = (np.linspace(0.0, side, count) for side, count in zip(_REACH_M, GRID, strict=True))
        points = np.stack(np.meshgrid(x, y - _REACH_M[1] / 2), axis=-1).reshape(-1, 2)
        pixels = self.antenna_pixels(np.column_stack([points, np.zeros(len(points))]))
        seen = self.inside(pixels)
        return points[seen], pixels[seen]


def coverage_rigs() -> list[CoverageRig]:
    """The rigs, always the same."""
    near, far, above = (0.14, 0.24), (0.24, 0.42), (0.6, 1.0, 0.36)
    spoilt: dict[str, Any] = {"sagittas_m": (5e-4, 0.0), "outliers": 0.05}
    return [
        _rig("f 900, 25 views", "opencv5", (HD, MILD), 25, near, above),
        _rig("long lens, f 2800, 22 views", "opencv5", (SQUARE, LONG), 22, far, (0.5, 0.8, 0.48)),
        _rig("wide, rational, f 590, 20 views", "rational", (HD, WIDE), 20, near, (0.6, 1.0, 0.28)),
        _rig("fisheye, f 420, 20 views", "fisheye", (TALL, FISHEYE), 20, (0.11, 0.2), (0.5, -0.9, 0.22)),
        _rig("f 900, 8 views", "opencv5", (HD, MILD), 8, near, above),
        _rig("f 900, 5 % outliers, bowed 0.5 mm", "opencv5", (HD, MILD), 25, near, above, **spoilt),
    ]


def _rig(
    name: str,
    model: str,
    optics: tuple[tuple[int, int], np.ndarray],
    views: int,
    distance_m: tuple[float, float],
    looking: tuple[float, float, float],
    **spoilt: Any,
) -> CoverageRig:
    """`optics` : the picture's size and intrinsics (4 + k,). `looking` : the camera's incline and azimuth, rad, and its
    distance from the antenna's middle, m."""
    size, (fx, fy, cx, cy, *distortion) = optics
    matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    lens = Lens("fisheye" if model == "fisheye" else "opencv", size, matrix, np.array(distortion))
    poses = board_poses(lens, BOARD, IntrinsicsSpec(2 * views, distance_m, (0.2, 0.7)), np.random.default_rng(_SEED))
    rig = CoverageRig(name, model, lens, (), camera_pose(*looking[:2], 0.0, looking[2], _LOOKED_AT_M), **spoilt)
    kept = [pose for pose in poses if len(rig.seen_corners(pose)[0]) >= _LEAST_CORNERS]
    return replace(rig, T_camera_board=tuple(kept[:views]))


CENTRELINE_PX, TIP_PX, MOMENT_NM = 0.1, 0.1, 2e-5
"""Standard deviations of a centreline point and of the tip, per axis, and of a moment reading."""
ENDS = 7
"""Seed of the tips, beside a draw's own."""
_LOG_STIFFNESS_SPREAD, _GAIN_SPREAD, _OFFSET_SPREAD_NM = 0.05, 0.05, 5e-4
"""Of the true values, where they are narrower than the priors."""
_TILTS_RAD = (0.0, 0.5, -0.4, 0.9, -0.8)
_HANGING = ((0.12, 0.0, 0.09), (0.15, 0.5, -0.07), (0.18, -0.4, 0.05), (0.21, 0.9, -0.04), (0.235, -0.8, 0.03))
"""Known loads: distance from the clamp m, tilt rad, force N; each hung once along y and once along z."""
_BEGIN = 0.01


@dataclass(frozen=True, eq=False)
class Seen:
    """One still: the antenna's centreline (N, 2) px, and gravity (3,) in the antenna frame."""

    still: Still
    points_px: np.ndarray
    gravity_m_s2: np.ndarray
    tip_px: np.ndarray


@dataclass(frozen=True, eq=False)
class Draw:
    """What a calibration is given, and the truth.

    Attributes
    ----------
    views, jig_views : of the board by hand and in the jig. stills : of the free and the loaded antenna.
    truth : (11,) antenna parameters, gain, offset: `RIG_PARAMETERS` after the pose.
    tip_m : how far beyond the antenna's length its visible end lies.
    """

    rig: CoverageRig
    views: list[BoardView]
    jig_views: list[BoardView]
    stills: list[Seen]
    truth: np.ndarray
    tip_m: float


def draw(rig: CoverageRig, seed: tuple[int, ...]) -> Draw:
    """One draw; the same seed gives the same."""
    rng = np.random.default_rng(seed)
    truth = drawn_truth(rng)
    T_camera_jig = rig.T_antenna_camera.inverse() @ T_ANTENNA_JIG
    ends = np.random.default_rng((*seed, ENDS))
    tip_m = (NOMINAL.tip_std_m or 0.0) * float(ends.normal())

    def view(name: str, T_camera_board: Pose) -> BoardView:
        ids, pixels = rig.seen_corners(T_camera_board)
        return noisy_view(name, ids, pixels, rig.lens.image_size, rig.outliers, rng)[0]

    return Draw(
        rig=rig,
        views=[view(f"{index:02d}.png", pose) for index, pose in enumerate(rig.T_camera_board)],
        jig_views=[view(f"jig_{index}.png", T_camera_jig) for index in range(_JIG_PICTURES)],
        stills=_stills(rig, truth, rng, tip_m, ends),
        truth=truth,
        tip_m=tip_m,
    )


def true_rod(truth: np.ndarray) -> Rod:
    """The antenna of parameters (11,), a wire with ν = 0.3."""
    y, z, about_y, about_z, bow_y, bow_z, log_stiffness, log_mass = truth[:8]
    stiffness = np.exp(log_stiffness)
    clamp = Pose(Rotation.from_rotvec([0.0, about_y, about_z]).as_matrix(), np.array([0.0, y, z]))
    return Rod(NOMINAL.length_m, stiffness, stiffness / 1.3, np.exp(log_mass), clamp, np.array([bow_y, bow_z]))


def drawn_truth(rng: np.random.Generator) -> np.ndarray:
    """(11,) antenna parameters, gain and offset."""
    std = (
        [AntennaSettings.clamp_offset_std_m] * 2
        + [AntennaSettings.clamp_angle_std_rad] * 2
        + [bow_std_per_m(NOMINAL.length_m)] * 2
    )
    spread = np.array(
        [
            *std,
            _LOG_STIFFNESS_SPREAD,
            AntennaSettings.log_mass_std,
            AntennaSettings.clamp_give_std_m,
            _GAIN_SPREAD,
            _OFFSET_SPREAD_NM,
        ]
    )
    return np.concatenate([nominal_parameters(NOMINAL), [1.0, 0.0]]) + spread * rng.normal(size=11)


@dataclass(frozen=True, eq=False)
class Bent:
    """F antennas under weight and load, whose clamp gives way; what is seen turns with it.

    shape : by the rod, in the clamp's own frame. held : how far the clamp gives way to the moment that it holds.
    clamp_yz_m : (2,) where it is. readings_Nm : (F,) of the moment sensor, without noise.
    """

    shape: RodShape
    held: Rotation
    clamp_yz_m: np.ndarray
    readings_Nm: np.ndarray

    @staticmethod
    def of(truth: np.ndarray, gravity: np.ndarray, hung: np.ndarray) -> Bent:
        """By parameters (11,) as of `Draw.truth`, gravity (F, 3), and loads (F, 4): distance and force."""
        rod = true_rod(truth)
        moment = solve_rod(rod, gravity, hung[:, 0], hung[:, 1:]).clamp_moment_Nm
        held = Rotation.from_rotvec(truth[8] / np.exp(truth[6]) * moment * [0.0, 1.0, 1.0])
        # the clamp turns: as if weight and load turned the other way, and then all that is seen with the clamp
        shape = solve_rod(rod, held.inv().apply(gravity), hung[:, 0], held.inv().apply(hung[:, 1:]))
        gain, offset = truth[9:]
        return Bent(shape, held, truth[:2], offset - gain * held.apply(shape.clamp_moment_Nm)[:, 1])

    def pixels(self, rig: CoverageRig, index: int, arclength_m: np.ndarray) -> np.ndarray:
        """(N, 2) true pixels of one antenna at arc lengths (N,), m."""
        one = RodShape(*(values[index : index + 1] for values in vars(self.shape).values()))
        points, clamp = sample_shape(one, arclength_m[None])[0][0], np.append(0.0, self.clamp_yz_m)
        return rig.antenna_pixels(clamp + self.held[index].apply(points - clamp))

    def tip_px(self, rig: CoverageRig, index: int, tip_m: float) -> np.ndarray:
        """(2,) true pixel of one antenna's visible end, so far beyond its length; NaN outside the picture."""
        near = 1e-3
        before, end = self.pixels(rig, index, np.array([NOMINAL.length_m - near, NOMINAL.length_m]))
        tip_px = end + tip_m / near * (end - before)
        return tip_px if rig.inside(tip_px[None])[0] else np.full(2, np.nan)

    def line_px(self, rig: CoverageRig, index: int) -> np.ndarray:
        """(N, 2) true pixels of one antenna's centreline, about one pixel apart, as far as the picture shows it."""
        way = np.diff(self.pixels(rig, index, np.linspace(_BEGIN, 1.0, 60) * NOMINAL.length_m), axis=0)
        count = int(np.nansum(np.linalg.norm(way, axis=1))) + 1
        pixels = self.pixels(rig, index, np.linspace(_BEGIN, 1.0, count) * NOMINAL.length_m)
        return pixels[rig.inside(pixels)]


def _stills(
    rig: CoverageRig, truth: np.ndarray, rng: np.random.Generator, tip_m: float, ends: np.random.Generator
) -> list[Seen]:
    stills: list[Still] = [Still(image=None, pan_rad=0.0, tilt_rad=tilt, moment_Nm=0.0) for tilt in _TILTS_RAD]
    stills += [
        Load(None, 0.0, tilt, 0.0, distance_m=distance, force_y_N=force * along_y, force_z_N=force * (1.0 - along_y))
        for distance, tilt, force in _HANGING
        for along_y in (1.0, 0.0)
    ]
    gravity = gravity_antenna(Kinematics(), GRAVITY_WORLD_M_S2, stills)
    loads = [(s.distance_m, 0.0, s.force_y_N, s.force_z_N) if isinstance(s, Load) else (0.1, 0, 0, 0) for s in stills]
    bent = Bent.of(truth, gravity, np.array(loads, float))
    readings = bent.readings_Nm + MOMENT_NM * rng.normal(size=len(stills))
    seen = []
    for index, still in enumerate(stills):
        pixels = bent.line_px(rig, index)
        pixels = pixels + CENTRELINE_PX * rng.normal(size=pixels.shape)
        tip_px = bent.tip_px(rig, index, tip_m) + TIP_PX * ends.normal(size=2)
        seen.append(Seen(replace(still, moment_Nm=float(readings[index])), pixels, gravity[index], tip_px))
    return seen
