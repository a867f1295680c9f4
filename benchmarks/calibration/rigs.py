"""Five synthetic rigs with exactly known corners: what a lens solve can be judged on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from targets.board import BoardSpec, corner_points
from vbaa_calib.calibrate.lens.board_flex import bend
from vbaa_calib.calibrate.lens.models import LENS_MODELS, PROJECTIONS, LensModel, camera_of
from vbaa_calib.camera import Camera
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.geometry import Pose

BOARD = BoardSpec(squares_x=11, squares_y=8, square_m=0.015, marker_m=0.011)
SIGMA_PX = 0.15
_TILT_RAD = np.radians(40.0)
_OUTLIER_PX = (2.0, 20.0)


@dataclass(frozen=True, eq=False)
class Rig:
    """A camera, its true lens, and how the board is shown to it.

    Attributes
    ----------
    lens : name of the true lens model. intrinsics : (4 + k,) its true parameters. views : how many.
    outliers : share of corners that are shifted by 2 to 20 px. sagittas_m : (2,) bend of the board.
    """

    name: str
    lens: str
    image_size: tuple[int, int]
    intrinsics: np.ndarray
    views: int
    outliers: float = 0.0
    sagittas_m: tuple[float, float] = (0.0, 0.0)

    @property
    def model(self) -> LensModel:
        """The true lens model."""
        return LENS_MODELS[self.lens]

    @property
    def camera(self) -> Camera:
        """The true camera."""
        return camera_of(self.model, self.intrinsics, self.image_size)


@dataclass(frozen=True, eq=False)
class Draw:
    """One set of noisy views of a rig, with the truth.

    Attributes
    ----------
    views : what a solver is given. poses : (V, 6) true rotation vectors rad and translations m of the board's frame.
    good : per view (N,), which corners are no outliers.
    """

    rig: Rig
    views: list[BoardView]
    poses: np.ndarray
    good: list[np.ndarray]


def rigs() -> list[Rig]:
    """The five rigs of the published comparison."""
    mild = np.array([900.0, 902.0, 645.0, 352.0, -0.12, 0.04, 4e-4, -3e-4, 0.0])
    long = np.array([2800.0, 2804.0, 1015.0, 1032.0, -0.08, 0.15, 2e-4, 3e-4, 0.0])
    wide = np.array([590.0, 591.0, 641.0, 356.2, 0.31, 0.025, 4e-4, -3e-4, 1e-3, 0.56, 0.061, 5e-3])
    hd, square = (1280, 720), (2048, 2048)
    return [
        Rig("f 900, mild barrel, 25 views", "opencv5", hd, mild, 25),
        Rig("f 2800, 22 views", "opencv5", square, long, 22),
        Rig("wide rational f 590, 20 views", "rational", hd, wide, 20),
        Rig("f 900, 8 views", "opencv5", hd, mild, 8),
        Rig("f 900, 5 % outliers, bowed 0.5 mm", "opencv5", hd, mild, 25, 0.05, (5e-4, 0.0)),
    ]


def draw(rig: Rig, seed: int) -> Draw:
    """Views of a rig, their noise, poses and outliers all from the seed."""
    rng = np.random.default_rng(seed)
    points = corner_points(BOARD) + (bend(BOARD) @ rig.sagittas_m)[:, None] * np.array([0.0, 0.0, 1.0])
    views: list[BoardView] = []
    poses, good = [], []
    while len(views) < rig.views:
        vector = _pose(rig, rng).vector
        pixels = PROJECTIONS[rig.model.camera_model](points, vector, rig.intrinsics)[0]
        seen = np.flatnonzero(np.all((pixels > 0) & (pixels < np.array(rig.image_size) - 1), axis=1))
        if len(seen) < 20:
            continue
        noisy = pixels[seen] + SIGMA_PX * rng.normal(size=(len(seen), 2))
        wrong = rng.random(len(seen)) < rig.outliers
        angle, length = rng.uniform(0, 2 * np.pi, len(seen)), rng.uniform(*_OUTLIER_PX, len(seen))
        noisy[wrong] += (length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1))[wrong]
        views.append(BoardView(f"{len(views):02d}.png", seen, noisy, rig.image_size, np.arange(40)))
        poses.append(vector)
        good.append(~wrong)
    return Draw(rig, views, np.array(poses), good)


def _pose(rig: Rig, rng: np.random.Generator) -> Pose:
    """The board tilted by up to 40°, filling about half of the picture, its middle anywhere in it."""
    centre, extent = corner_points(BOARD).mean(axis=0), (BOARD.squares_x - 2) * BOARD.square_m
    width, height = rig.image_size
    distance = rng.uniform(0.9, 1.5) * extent * rig.intrinsics[0] / (0.6 * width)
    direction = rng.uniform(0, 2 * np.pi)
    tilt = Pose.from_rotvec(
        rng.uniform(0.3, 1.0) * _TILT_RAD * np.array([np.cos(direction), np.sin(direction), 0.0]), np.zeros(3)
    )
    rotation = (tilt @ Pose.from_rotvec(np.array([0.0, 0.0, rng.uniform(-0.6, 0.6)]), np.zeros(3))).rotation
    offset = rng.uniform(-0.33, 0.33, 2) * np.array([width, height]) / rig.intrinsics[0]
    return Pose(rotation, distance * np.array([*offset, 1.0]) - rotation @ centre)
