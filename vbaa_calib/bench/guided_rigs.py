"""Rigs on which pictures of the board are taken for the lens, where suggested or at random."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from targets.board import BoardSpec

from ..calibrate.lens_models import LENS_MODELS, camera_of
from ..calibrate.next_view import WorkPlane
from ..camera import Camera
from ..synth.scene import PictureSpec

GOAL_MM = 0.1
_SHEET = BoardSpec(squares_x=11, squares_y=8, square_m=0.015, marker_m=0.011)
_CARD = BoardSpec(squares_x=6, squares_y=5, square_m=0.025, marker_m=0.019)
_DIM = PictureSpec(1.2, 6.0, 12.0, 0.35, 0.3, 0.35, 0.3, 0.2, 0.4, 0.0)


@dataclass(frozen=True, eq=False)
class Rig:
    """A camera, its true lens, a board, and plane C: 240 x 120 mm at 0.4 m, tilted by 35°.

    Attributes
    ----------
    lens : name of the true lens model. intrinsics : (4 + k,) its true parameters.
    sigma_px : deviation of a corner per axis, where corners are projected. picture : how pictures come about where
        they are rendered and the board is found in them; None where corners are projected.
    every : whether all ways to choose poses are compared, or the suggested and random ones alone.
    """

    name: str
    lens: str
    image_size: tuple[int, int]
    intrinsics: np.ndarray
    board: BoardSpec
    sigma_px: float
    picture: PictureSpec | None = None
    every: bool = False

    @property
    def camera(self) -> Camera:
        """The true camera."""
        return camera_of(LENS_MODELS[self.lens], self.intrinsics, self.image_size)

    @property
    def plane(self) -> WorkPlane:
        """Plane C, as the user describes it."""
        return WorkPlane.about(0.4, float(np.radians(35.0)), 0.24)


def rigs() -> list[Rig]:
    """Two that are hard on the lens, one of them rendered too, and an easy one."""
    barrel = np.array([520.0, 521.0, 325.0, 236.0, -0.32, 0.14, 5e-4, -4e-4, -0.03])
    wide = np.array([590.0, 591.0, 641.0, 356.2, 0.31, 0.025, 4e-4, -3e-4, 1e-3, 0.56, 0.061, 5e-3])
    mild = np.array([900.0, 902.0, 645.0, 352.0, -0.12, 0.04, 4e-4, -3e-4, 0.0])
    vga, hd = (640, 480), (1280, 720)
    return [
        Rig("VGA, barrel, 15 cm board, 0.3 px", "opencv5", vga, barrel, _CARD, 0.3, every=True),
        Rig("VGA, barrel, 15 cm board, rendered", "opencv5", vga, barrel, _CARD, 0.0, _DIM),
        Rig("wide rational, 15 cm board, 0.3 px", "rational", hd, wide, _CARD, 0.3),
        Rig("f 900, A4 board, 0.15 px", "opencv5", hd, mild, _SHEET, 0.15),
    ]
