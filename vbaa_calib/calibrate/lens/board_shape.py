"""The shape of a printed board: how far it is bent, twisted, stretched and sheared, solved for with the lens."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from targets.board import Board, BoardPoints, BoardWithIds, corner_points

from .settings import LensSettings

SHAPE = 5  # numbers that describe a board's shape (`BoardShape`)
SHAPE_NAMES = ("bow_x_m", "bow_y_m", "twist_m", "stretch", "shear")
STRETCH = SHAPE_NAMES.index("stretch")


@dataclass(frozen=True, eq=False)
class BoardShape:
    """Deviations of a printed board from a flat print with square squares.

    Attributes
    ----------
    nominal_m : (C, 3) the corners as drawn, in the board frame.
    parameters : (5,) bow along x and along y and twist, m, of the board's outer corners: the rise along z (away from
        the viewer) is bow·(u² − 1/3) and twist·u·v, with u and v = ±1 at the outer corners; stretch, by which the print
        is longer along x than along y, relative; shear, rad, by which the angle from x to y is less than a right one.
    covariance : (5, 5), with the lens and all poses free and the prior counted.
    by_lens : (5, 4 + k) how the parameters follow those of the lens they were solved with; None where they do not.
    """

    nominal_m: np.ndarray
    parameters: np.ndarray
    covariance: np.ndarray
    by_lens: np.ndarray | None = None

    @staticmethod
    def flat(nominal_m: np.ndarray) -> BoardShape:
        """The shape of a board exactly as drawn."""
        return BoardShape(nominal_m, np.zeros(SHAPE), np.zeros((SHAPE, SHAPE)))

    @staticmethod
    def unseen(board: Board) -> BoardShape:
        """Prior shape of a board without pictures: flat, with the standard deviations of usual prints and mounts."""
        prior = ShapePrior.of(board)
        return BoardShape(corner_points(board), prior.mean, np.diag(prior.std**2))

    @staticmethod
    def solved(nominal_m: np.ndarray, parameters: np.ndarray, covariance: np.ndarray) -> BoardShape:
        """The shape solved with a lens, from its parameters (5,) and the joint covariance (4 + k + 5, 4 + k + 5) of
        lens and shape."""
        lens, std = covariance[:-SHAPE, :-SHAPE], np.sqrt(np.diag(covariance)[:-SHAPE])
        # coefficients that are fixed have no variance, and square pixels one focal length
        scale = np.where(std > 0.0, std, 1.0)
        inverse = np.linalg.pinv(lens / np.outer(scale, scale), 1e-10)
        by_lens = covariance[-SHAPE:, :-SHAPE] / scale @ inverse / scale
        return BoardShape(nominal_m, parameters, covariance[-SHAPE:, -SHAPE:], by_lens)

    @property
    def std(self) -> np.ndarray:
        """(5,) standard deviations."""
        return np.sqrt(np.diag(self.covariance).clip(0.0))

    @property
    def points_m(self) -> np.ndarray:
        """(C, 3) corners of the deformed board, in the board frame."""
        return self.nominal_m + deformations(self.nominal_m) @ self.parameters

    @property
    def _clear(self) -> np.ndarray:
        """(5,) mask of the parameters that are significant and large enough to matter."""
        least = np.array(
            [LensSettings.shape_per_extent * _extent_m(self.nominal_m)] * 3 + [LensSettings.shape_share] * 2
        )
        return np.abs(self.parameters) > np.maximum(LensSettings.shape_clear * self.std, least)

    @property
    def scale_doubt(self) -> float:
        """Relative standard deviation of a stretched print's scale: it is unknown which of its sides is correct."""
        return 0.5 * abs(float(self.parameters[STRETCH])) if self._clear[STRETCH] else 0.0

    @property
    def findings(self) -> tuple[str, ...]:
        """Significant deviations from a flat print, in words; empty for a board that counts as flat."""
        words = [
            *(f"{name} by {{:+.2f}} ± {{:.2f}} mm" for name in ("bowed along x", "bowed along y", "twisted")),
            "longer along x than along y by {:+.2f} ± {:.2f} %",
            "sheared by {:+.2f} ± {:.2f} mrad",
        ]
        units = (1e3, 1e3, 1e3, 1e2, 1e3)
        numbers = zip(words, units, self.parameters, self.std, self._clear, strict=True)
        return tuple(text.format(unit * value, unit * std) for text, unit, value, std, there in numbers if there)

    def to_dict(self) -> dict[str, Any]:
        """The mapping `board_shape` of camera.json."""
        return {
            "parameters": dict(zip(SHAPE_NAMES, self.parameters.tolist(), strict=True)),
            "std": dict(zip(SHAPE_NAMES, self.std.tolist(), strict=True)),
            "covariance": self.covariance.tolist(),
        }


def deformations(nominal_m: np.ndarray) -> np.ndarray:
    """(C, 3, 5) displacement of each corner (C, 3), m, per unit of each shape parameter."""
    plane = nominal_m[:, :2]
    low, high = plane.min(axis=0), plane.max(axis=0)
    half = 0.5 * (high - low)
    u, v = ((plane - 0.5 * (low + high)) / np.where(half > 0.0, half, 1.0)).T
    x, y = plane.T
    moved = np.zeros((len(plane), 3, SHAPE))
    # zero in the mean: the board's frame stays in its mean plane; a single row has no bow
    for index, (place, width) in enumerate(zip((u, v), half, strict=True)):
        moved[:, 2, index] = place**2 - 1.0 / 3.0 if width > 0.0 else 0.0
    moved[:, 2, 2] = u * v
    moved[:, 0, 3], moved[:, 1, 3] = 0.5 * x, -0.5 * y
    moved[:, 0, 4], moved[:, 1, 4] = 0.5 * y, 0.5 * x
    return moved


def _extent_m(nominal_m: np.ndarray) -> float:
    return float(np.ptp(nominal_m[:, :2], axis=0).max())


@dataclass(frozen=True, eq=False)
class ShapePrior:
    """Prior of a board's shape: Student's t distributions with means (5,) and scales (5,)."""

    mean: np.ndarray
    std: np.ndarray

    @staticmethod
    def of(board: Board | BoardPoints) -> ShapePrior:
        """Prior of usual prints and mounts; with the stretch that was measured on the board, if any."""
        bow_m = LensSettings.bow_per_extent * _extent_m(corner_points(board))
        mean, std = np.zeros(SHAPE), np.array([bow_m, bow_m, bow_m, LensSettings.stretch_std, LensSettings.shear_std])
        if isinstance(board, BoardWithIds) and board.stretch_std is not None:
            mean[STRETCH], std[STRETCH] = board.stretch, board.stretch_std
        return ShapePrior(mean, std)

    def rows(self, shape: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (5,) of the prior as iteratively reweighted least squares uses them, and their negative
        derivatives (5,) by the shape."""
        off = (shape - self.mean) / self.std
        weights = np.sqrt((LensSettings.shape_tail + 1.0) / (LensSettings.shape_tail + off**2))
        return -weights * off, weights / self.std
