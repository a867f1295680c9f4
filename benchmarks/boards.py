"""What the synthetic calibrations share: lenses, the board, noisy views of it, and the error of a lens in mm on C."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from targets.board import BoardSpec, corner_points
from vbaa_calib.calibrate.lens.bundle import Bundle, Observation, refine
from vbaa_calib.calibrate.lens.information import bend
from vbaa_calib.calibrate.lens.models import LENS_MODELS, PROJECTIONS, LensModel, camera_of
from vbaa_calib.camera import Camera
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.geometry import Pose

BOARD = BoardSpec(squares_x=11, squares_y=8, square_m=0.015, marker_m=0.011)
HD, SQUARE, TALL, VGA = (1280, 720), (2048, 2048), (1280, 960), (640, 480)
MILD = np.array([900.0, 902.0, 645.0, 352.0, -0.12, 0.04, 4e-4, -3e-4, 0.0])
LONG = np.array([2800.0, 2804.0, 1015.0, 1032.0, -0.08, 0.15, 2e-4, 3e-4, 0.0])
WIDE = np.array([590.0, 591.0, 641.0, 356.2, 0.31, 0.025, 4e-4, -3e-4, 1e-3, 0.56, 0.061, 5e-3])
BARREL = np.array([520.0, 521.0, 325.0, 236.0, -0.32, 0.14, 5e-4, -4e-4, -0.03])
FISHEYE = np.array([420.0, 421.0, 641.0, 478.0, 0.05, -0.01, 0.003, -0.001])
"""fx, fy, cx, cy and distortion in OpenCV's order; five coefficients, eight (WIDE), or its fisheye's four."""
_CORNER_PX = 0.15
"""Standard deviation of a corner, per axis."""
_OUTLIER_PX = (2.0, 20.0)


def bent_corners(sagittas_m: tuple[float, float]) -> np.ndarray:
    """(C, 3) corners of the board bent by so much along its two axes, in its frame."""
    return corner_points(BOARD) + (bend(BOARD) @ sagittas_m)[:, None] * np.array([0.0, 0.0, 1.0])


def noisy_view(
    name: str, ids: np.ndarray, pixels: np.ndarray, size: tuple[int, int], outliers: float, rng: np.random.Generator
) -> tuple[BoardView, np.ndarray]:
    """A view of corners (N,) at true pixels (N, 2), a share of them 2 to 20 px off, and which (N,) are not."""
    noisy = pixels + _CORNER_PX * rng.normal(size=pixels.shape)
    wrong = rng.random(len(ids)) < outliers
    angle, length = rng.uniform(0, 2 * np.pi, len(ids)), rng.uniform(*_OUTLIER_PX, len(ids))
    noisy[wrong] += (length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1))[wrong]
    return BoardView(name, ids, noisy, size, np.arange(40)), ~wrong


@dataclass(frozen=True, eq=False)
class Optics:
    """A camera with its true lens.

    lens : name of the true lens model. intrinsics : (4 + k,) its true parameters.
    """

    name: str
    lens: str
    image_size: tuple[int, int]
    intrinsics: np.ndarray

    @property
    def model(self) -> LensModel:
        """The true lens model."""
        return LENS_MODELS[self.lens]

    @property
    def camera(self) -> Camera:
        """The true camera."""
        return camera_of(self.model, self.intrinsics, self.image_size)


@dataclass(frozen=True, eq=False)
class Rig(Optics):
    """How the board is shown to a camera: how many views, the share of outlying corners, the board's bend (2,) m."""

    views: int
    outliers: float = 0.0
    sagittas_m: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Draw:
    """One set of noisy views of a rig, with the truth.

    poses : (V, 6) true rotation vectors rad and translations m of the board's frame.
    good : per view (N,), which corners are no outliers.
    """

    rig: Rig
    views: list[BoardView]
    poses: np.ndarray
    good: list[np.ndarray]


def rigs() -> list[Rig]:
    """The five rigs of the published comparison."""
    return [
        Rig("f 900, mild barrel, 25 views", "opencv5", HD, MILD, 25),
        Rig("f 2800, 22 views", "opencv5", SQUARE, LONG, 22),
        Rig("wide rational f 590, 20 views", "rational", HD, WIDE, 20),
        Rig("f 900, 8 views", "opencv5", HD, MILD, 8),
        Rig("f 900, 5 % outliers, bowed 0.5 mm", "opencv5", HD, MILD, 25, 0.05, (5e-4, 0.0)),
    ]


def draw(rig: Rig, seed: int) -> Draw:
    """Views of a rig, their noise, poses and outliers all from the seed."""
    rng = np.random.default_rng(seed)
    found = Draw(rig, [], np.empty((0, 6)), [])
    poses: list[np.ndarray] = []
    while len(found.views) < rig.views:
        vector = _pose(rig, rng).vector
        pixels = PROJECTIONS[rig.model.camera_model](bent_corners(rig.sagittas_m), vector, rig.intrinsics)[0]
        seen = np.flatnonzero(np.all((pixels > 0) & (pixels < np.array(rig.image_size) - 1), axis=1))
        if len(seen) >= 20:
            name = f"{len(poses):02d}.png"
            view, right = noisy_view(name, seen, pixels[seen], rig.image_size, rig.outliers, rng)
            found.views.append(view)
            found.good.append(right)
            poses.append(vector)
    return replace(found, poses=np.array(poses))


def _pose(rig: Rig, rng: np.random.Generator) -> Pose:
    """The board tilted by up to 40°, filling about half of the picture, its middle anywhere in it."""
    centre, extent = corner_points(BOARD).mean(axis=0), (BOARD.squares_x - 2) * BOARD.square_m
    width, height = rig.image_size
    distance = rng.uniform(0.9, 1.5) * extent * rig.intrinsics[0] / (0.6 * width)
    direction = rng.uniform(0, 2 * np.pi)
    axis = np.array([np.cos(direction), np.sin(direction), 0.0])
    tilt = Pose.from_rotvec(rng.uniform(0.3, 1.0) * np.radians(40.0) * axis, np.zeros(3))
    rotation = (tilt @ Pose.from_rotvec(np.array([0.0, 0.0, rng.uniform(-0.6, 0.6)]), np.zeros(3))).rotation
    offset = rng.uniform(-0.33, 0.33, 2) * np.array([width, height]) / rig.intrinsics[0]
    return Pose(rotation, distance * np.array([*offset, 1.0]) - rotation @ centre)


_SIDES_M, _GRID = (0.24, 0.12), (13, 7)
_T_CAMERA_PLANE = Pose.from_rotvec(np.array([0.0, np.radians(35.0), 0.0]), np.array([0.0, 0.0, 0.4]))
"""Plane C: 240 x 120 mm at 0.4 m, tilted by 35°."""
_NOWHERE_M = 0.1
"""What a pixel counts that has no ray, and the most that any does."""


def error_mm(camera: Camera, truth: Camera, from_jig: bool = False) -> float:
    """Rms distance on C between points and where the camera puts their pixels, mm.

    The pose of C is the true one; with `from_jig` it is solved with this camera from the same points without noise, as
    a board in the jig gives it, which takes up much of a lens' error. Points outside the true picture do not count; a
    pixel that has no ray counts as 100 mm.
    """
    x, y = (np.linspace(-0.5, 0.5, count) * side for count, side in zip(_GRID, _SIDES_M, strict=True))
    T_camera_plane, points = _T_CAMERA_PLANE, np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    space = np.column_stack([points, np.zeros(len(points))])
    pixels, valid = truth.project(T_camera_plane @ space)
    inside = valid & truth.in_picture(pixels)
    if from_jig:
        T_camera_plane = pose_by(camera, T_camera_plane, Observation(space[inside], pixels[inside]))
    return rms_on_plane_mm(camera, T_camera_plane, points[inside], pixels[inside])


def rms_on_plane_mm(camera: Camera, T_camera_plane: Pose, points_m: np.ndarray, pixels: np.ndarray) -> float:
    """Rms distance between points (M, 2) on a plane and where the camera puts their pixels (M, 2), 100 mm at most."""
    rays, seen = camera.unproject(pixels)
    normal, origin = T_camera_plane.rotation[:, 2], T_camera_plane.translation_m
    with np.errstate(all="ignore"):
        hits = rays * ((normal @ origin) / (rays @ normal))[:, None]
    off = np.linalg.norm((hits - origin) @ T_camera_plane.rotation[:, :2] - points_m, axis=1)
    kept = np.where(seen & np.isfinite(off), np.minimum(off, _NOWHERE_M), _NOWHERE_M)
    return 1e3 * float(np.sqrt(np.mean(kept**2)))


def pose_by(camera: Camera, start: Pose, board: Observation) -> Pose:
    """T_camera_board as this camera has it, by corners exactly seen."""
    model = LensModel("any", camera.model, len(camera.distortion), (), None)
    pose = refine(Bundle.start(model, camera.parameters, start.vector[None]).poses_only, [board]).poses[0]
    return Pose.from_rotvec(pose[:3], pose[3:])
