"""Six whole rigs with a known truth: what a calibration's standard deviations can be judged on.

A rig fixes the lens, where the board was held, how it lies in the jig and how the camera looks at the antenna. The
antenna itself and all noise are drawn anew each time (`coverage_draw`). Nothing is projected by the code under test.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from targets.board import BoardSpec
from targets.charuco import corner_points

from ..calibrate.board_flex import bend
from ..geometry import Pose
from ..session import NominalAntenna
from ..synth.board_poses import board_poses
from ..synth.lens import Lens, project
from ..synth.scene import IntrinsicsSpec, camera_pose

BOARD = BoardSpec(squares_x=11, squares_y=8, square_m=0.015, marker_m=0.011)
NOMINAL = NominalAntenna(length_m=0.24, diameter_m=0.8e-3, youngs_modulus_Pa=193e9, density_kg_m3=7900.0)
GRAVITY_WORLD_M_S2 = np.array([0.0, 0.0, -9.80665])
T_ANTENNA_JIG = Pose.from_rotvec(np.array([3.06, 0.03, 0.02]), np.array([0.035, 0.062, -0.004]))
"""The board in the jig: face up, a few millimetres below C, not quite parallel to it."""
JIG_PICTURES = 4
LOOKED_AT_M = np.array([0.12, 0.0, 0.0])
"""The point of the antenna frame on the camera's axis."""
REACH_M = (0.24, 0.12)
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
        return corner_points(BOARD) + (bend(BOARD) @ self.sagittas_m)[:, None] * np.array([0.0, 0.0, 1.0])

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
        x, y = (np.linspace(0.0, side, count) for side, count in zip(REACH_M, GRID, strict=True))
        points = np.stack(np.meshgrid(x, y - REACH_M[1] / 2), axis=-1).reshape(-1, 2)
        pixels = self.antenna_pixels(np.column_stack([points, np.zeros(len(points))]))
        seen = self.inside(pixels)
        return points[seen], pixels[seen]


def coverage_rigs() -> list[CoverageRig]:
    """The rigs, always the same."""
    mild = (900.0, 902.0, 645.0, 352.0, -0.12, 0.04, 4e-4, -3e-4, 0.0)
    long = (2800.0, 2804.0, 1015.0, 1032.0, -0.08, 0.15, 2e-4, 3e-4, 0.0)
    wide = (590.0, 591.0, 641.0, 356.2, 0.31, 0.025, 4e-4, -3e-4, 1e-3, 0.56, 0.061, 5e-3)
    fish = (420.0, 421.0, 641.0, 478.0, 0.05, -0.01, 0.003, -0.001)
    hd, square, tall = (1280, 720), (2048, 2048), (1280, 960)
    near, far = (0.14, 0.24), (0.24, 0.42)
    return [
        _rig("f 900, 25 views", "opencv5", hd, mild, 25, near, _looking_pose(0.6, 1.0, 0.36)),
        _rig("long lens, f 2800, 22 views", "opencv5", square, long, 22, far, _looking_pose(0.5, 0.8, 0.48)),
        _rig("wide, rational, f 590, 20 views", "rational", hd, wide, 20, near, _looking_pose(0.6, 1.0, 0.28)),
        _rig("fisheye, f 420, 20 views", "fisheye", tall, fish, 20, (0.11, 0.2), _looking_pose(0.5, -0.9, 0.22)),
        _rig("f 900, 8 views", "opencv5", hd, mild, 8, near, _looking_pose(0.6, 1.0, 0.36)),
        _rig(
            "f 900, 5 % outliers, bowed 0.5 mm", "opencv5", hd, mild, 25, near, _looking_pose(0.6, 1.0, 0.36),
            sagittas_m=(5e-4, 0.0), outliers=0.05,
        ),
    ]  # fmt: skip


def _looking_pose(incline_rad: float, azimuth_rad: float, away_m: float) -> Pose:
    """T_antenna_camera of a camera that looks at the antenna's middle, off C's normal towards an azimuth from x."""
    return camera_pose(incline_rad, azimuth_rad, 0.0, away_m, LOOKED_AT_M)


def _rig(
    name: str,
    lens_model: str,
    image_size: tuple[int, int],
    intrinsics: tuple[float, ...],
    views: int,
    distance_m: tuple[float, float],
    T_antenna_camera: Pose,
    sagittas_m: tuple[float, float] = (0.0, 0.0),
    outliers: float = 0.0,
) -> CoverageRig:
    fx, fy, cx, cy, *distortion = intrinsics
    matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    family = "fisheye" if lens_model == "fisheye" else "opencv"
    lens = Lens(family, image_size, matrix, np.array(distortion))
    poses = board_poses(lens, BOARD, IntrinsicsSpec(2 * views, distance_m, (0.2, 0.7)), np.random.default_rng(_SEED))
    rig = CoverageRig(name, lens_model, lens, (), T_antenna_camera, sagittas_m, outliers)
    kept = [pose for pose in poses if len(rig.seen_corners(pose)[0]) >= _LEAST_CORNERS][:views]
    return CoverageRig(name, lens_model, lens, tuple(kept), T_antenna_camera, sagittas_m, outliers)
