"""Many estimates of known contacts: error over bound, bias, coverage."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from estimator import ContactEstimator
from vbaa_calib.antenna.rungs import RUNGS

from .scenes import Scenes

QUANTITIES = ("l", "f_y", "f_z")
_REGION = 0.95


@dataclass(frozen=True, eq=False)
class Estimates:
    """Of B frames; rows without numbers are NaN.

    Attributes
    ----------
    values, std : (B, 3) l in m, f_y and f_z in N. force_N : (B, 3).
    status, model : (B,) words.
    """

    values: np.ndarray
    std: np.ndarray
    force_N: np.ndarray
    status: np.ndarray
    model: np.ndarray

    @property
    def numbered(self) -> np.ndarray:
        """(B,) which frames came with numbers."""
        return np.isfinite(self.values).all(axis=1) & np.isfinite(self.std).all(axis=1)

    def share(self, status: str) -> float:
        """Of the frames, with that status."""
        return float((self.status == status).mean())


def estimate(scenes: Scenes, model: str, friction_std_rad: float) -> Estimates:
    """Every frame by the estimator, given the points' true deviation and the friction to expect."""
    if not len(scenes):
        nothing, words = np.zeros((0, 3)), np.zeros(0, str)
        return Estimates(nothing, nothing, nothing, words, words)
    contacts = ContactEstimator(scenes.rig, model=model, friction=friction_std_rad).estimate_batch(
        scenes.points_px, scenes.moment_Nm, scenes.pan_rad, scenes.tilt_rad, sigma_px=scenes.sigma_px
    )
    return Estimates(
        values=np.column_stack([contacts.distance_m, contacts.force_N[:, 1:]]),
        std=np.column_stack([contacts.distance_std_m, contacts.force_std_N[:, 1:]]),
        force_N=contacts.force_N,
        status=contacts.status,
        model=np.array(RUNGS)[contacts.numbers.rung],
    )


def truth(scenes: Scenes) -> np.ndarray:
    """(B, 3) true l, f_y and f_z."""
    return np.concatenate([scenes.distance_m[:, None], scenes.force_N[:, 1:]], axis=1)


@dataclass(frozen=True)
class Quality:
    """Of one quantity over the draws of one scene, or over many scenes.

    Attributes
    ----------
    of_bound : rms error over the bound's. bias : mean error over the sampled standard deviation.
    covered : share of the 95 % intervals that hold the truth.
    """

    of_bound: float
    bias: float
    covered: float


def quality(errors: np.ndarray, predicted_std: np.ndarray, bound_std: np.ndarray | float) -> Quality:
    """Of errors (D,) with predicted deviations (D,) and bounds () or (D,); NaN with fewer than two."""
    if len(errors) < 2:
        return Quality(np.nan, np.nan, np.nan)
    inside = np.abs(errors) <= norm.isf((1 - _REGION) / 2) * predicted_std
    # in deviations, so that scenes of different size count alike
    scaled = errors / bound_std
    return Quality(
        of_bound=float(np.sqrt(np.mean(scaled**2))),
        bias=float(scaled.mean() / scaled.std(ddof=1)),
        covered=float(inside.mean()),
    )


def standard_errors(draws: float) -> Quality:
    """What `quality` scatters by from noise alone, for draws of an efficient estimator."""
    spread = float(np.sqrt(_REGION * (1 - _REGION) / draws))
    return Quality(float(1 / np.sqrt(2 * draws)), float(1 / np.sqrt(draws)), spread)
