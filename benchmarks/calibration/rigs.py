"""Five synthetic rigs with exactly known corners, on which lens solves are judged."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.boards import BOARD, HD, LONG, MILD, SQUARE, WIDE, bent_corners, noisy_view
from targets.board import corner_points
from vbaa_calib.calibrate.lens.models import LENS_MODELS, PROJECTIONS, LensModel, camera_of
from vbaa_calib.camera import Camera
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.geometry import Pose

_TILT_RAD = np.radians(40.0)


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
    points = bent_corners(rig.sagittas_m)
    views: list[BoardView] = []
    poses, good = [], []
    while len(views) < rig.views:
        vector = _pose(rig, rng).vector
        pixels = PROJECTIONS[rig.model.camera_model](points, vector, rig.intrinsics)[0]
        seen = np.flatnonzero(np.all((pixels > 0) & (pixels < np.array(rig.image_size) - 1), axis=1))
        if len(seen) >= 20:
            name = f"{len(views):02d}.png"
            view, right = noisy_view(name, seen, pixels[seen], rig.image_size, rig.outliers, rng)
            views.append(view)
            poses.append(vector)
            good.append(right)
    return Draw(rig, views, np.array(poses), good)


def _pose(rig: Rig, rng: np.random.Generator) -> Pose:
    """The board tilted by up to 40°, filling about half of the picture, its middle anywhere in it."""
    centre, extent = corner_points(BOARD).mean(axis=0), (BOARD.squares_x - 2) * BOARD.square_m
    width, height = rig.image_size
    distance = rng.uniform(0.9, 1.5) * extent * rig.intrinsics[0] / (0.6 * width)
    direction = rng.uniform(0, 2 * np.pi)
    axis = np.array([np.cos(direction), np.sin(direction), 0.0])
    tilt = Pose.from_rotvec(rng.uniform(0.3, 1.0) * _TILT_RAD * axis, np.zeros(3))
    rotation = (tilt @ Pose.from_rotvec(np.array([0.0, 0.0, rng.uniform(-0.6, 0.6)]), np.zeros(3))).rotation
    offset = rng.uniform(-0.33, 0.33, 2) * np.array([width, height]) / rig.intrinsics[0]
    return Pose(rotation, distance * np.array([*offset, 1.0]) - rotation @ centre)
