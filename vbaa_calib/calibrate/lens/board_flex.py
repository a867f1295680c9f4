"""A board that is not flat: two sagittas, solved with the lens when the views require it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from targets.board import BoardSpec, corner_points
from vbaa_calib.core.robust import chi_square, chi_square_p
from vbaa_calib.detect.board.corners import BoardView

from .bundle import FLEX, Bundle, Observation, refine
from .information import information
from .validation import excess_in_errors, held_out_squares, rms_over

_SIGNIFICANCE = 1e-3
_GAIN = 3.0
_LARGEST_PER_EXTENT = 0.05


@dataclass(frozen=True, eq=False)
class Bend:
    """A board's shape as a solve found it: sagittas (2,) m along x and y (`BoardFlex`), their covariance (2, 2) m²."""

    sagittas_m: np.ndarray
    covariance_m2: np.ndarray


@dataclass(frozen=True, eq=False)
class BoardFlex:
    """How far the board is bent, and whether the lens was solved with it.

    sagittas_m : (2,) along the board's x and y: how far the outer corners lie behind the middle (+z, away from the
        viewer), with their covariance (2, 2), None where the views leave them open.
    p_value : chance of sagittas this large on a flat board.
    flat_held_out_rms_px, bent_held_out_rms_px : error on held-out views; None where the sagittas are not significant.
    used : whether the lens was solved with a bent board. reason : why, in words.
    """

    sagittas_m: np.ndarray
    covariance_m2: np.ndarray | None
    p_value: float
    flat_held_out_rms_px: float | None
    bent_held_out_rms_px: float | None
    used: bool
    reason: str

    @property
    def std_m(self) -> np.ndarray | None:
        """(2,) standard deviations of the sagittas; None where the views leave them open."""
        return None if self.covariance_m2 is None else np.sqrt(np.diag(self.covariance_m2))

    @property
    def bend(self) -> Bend | None:
        """The shape that the lens was solved with; None where that was a flat board."""
        return Bend(self.sagittas_m, self.covariance_m2) if self.used and self.covariance_m2 is not None else None

    @property
    def sagitta_mm(self) -> float:
        """How far the board's most raised and most sunken corners lie apart."""
        return 1e3 * float(np.abs(self.sagittas_m).sum())


def bend(spec: BoardSpec) -> np.ndarray:
    """(corner_count, 2) rise along z of each corner for a metre of each sagitta: u² − 1/3, u = ±1 at the outer corners.

    Their mean over the board is nil, so that the board's frame stays in its mean plane.
    """
    plane = corner_points(spec)[:, :2]
    low, high = plane.min(axis=0), plane.max(axis=0)
    half = 0.5 * (high - low)
    centred = (plane - 0.5 * (low + high)) / np.where(half > 0.0, half, 1.0)
    return np.where(half > 0.0, centred**2 - 1.0 / 3.0, 0.0)


def observations_of(views: Sequence[BoardView], spec: BoardSpec) -> list[Observation]:
    """The corners of views beside the board points they show."""
    points, rise = corner_points(spec), bend(spec)
    return [Observation(points[view.ids], view.corners_px, rise[view.ids]) for view in views]


def judge_flex(bundle: Bundle, observations: Sequence[Observation], square_pixels: bool = False) -> BoardFlex:
    """Whether the views require a bent board: significant, better on held-out views, and not absurd.

    bundle : a solution of the lens, with or without a bent board.
    """
    bent = refine(bundle.freed(square_pixels, flex=True), observations)
    sagittas, known = bent.sagittas_m, information(bent, observations)
    if known is None:
        return BoardFlex(sagittas, None, 1.0, None, None, False, "the views do not tell a bent board from a flat one")
    spread = known.covariance[-FLEX:, -FLEX:]
    p_value = chi_square_p(chi_square(sagittas, spread), FLEX)
    if p_value > _SIGNIFICANCE:
        reason = f"a flat board explains the corners (chance of this much by noise: {p_value:.2g})"
        return BoardFlex(sagittas, spread, p_value, None, None, False, reason)
    flat = refine(bundle.freed(square_pixels, flex=False), observations)
    without = information(flat, observations)
    assert without is not None, "a flat board leaves open no more than a bent one"
    squares = [held_out_squares(flat, observations, without), held_out_squares(bent, observations, known)]
    (flat_rms, bent_rms), gain = (rms_over(errors, observations) for errors in squares), excess_in_errors(*squares)
    errors = f"{bent_rms:.3f} px on held-out views against {flat_rms:.3f} px flat, {gain:.1f} standard errors"
    extent = max(float(np.ptp(view.points_m[:, :2], axis=0).max()) for view in observations)
    most, used = np.abs(sagittas).max(), False
    if most > _LARGEST_PER_EXTENT * extent:
        reason = f"{1e3 * most:.1f} mm is more than a board bends: another error looks like it"
    elif gain <= _GAIN:
        reason = f"a bent board does not predict views clearly better ({errors})"
    else:
        reason, used = f"it predicts views better ({errors})", True
    return BoardFlex(sagittas, spread, p_value, flat_rms, bent_rms, used, reason)
