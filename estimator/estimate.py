"""The estimator's door for users: centreline, moment and joint angles in, one contact out, with what it is worth."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from vbaa_calib.errors import InputError
from vbaa_calib.reprojection import robust_weights, see
from vbaa_calib.rig import Rig

from .contact import Contact, Measured
from .fit import COARSE_POINTS, Fit, evaluated, fit
from .scene import Scene
from .uncertainty import Spread, spread
from .verdict import Solved, judge

MODELS = {"elastica": 1, "rod": 3}
"""Rungs of the ladder, lowest first, with their sweeps over the equilibrium of moments (`antenna.shape.bend`)."""
HIGHEST = "rod"
SMALL = 1 / 3
"""A model's predicted bias is small when it is below this fraction of the standard deviation."""
FEWEST_POINTS = 5


class ContactEstimator:
    """Contacts from centrelines, for one calibrated rig.

    Parameters
    ----------
    rig : the calibrated rig.
    model : "elastica", "rod", or "auto" for the lowest rung whose predicted bias is small against the noise.
    """

    def __init__(self, rig: Rig, model: str = "auto") -> None:
        if model != "auto" and model not in MODELS:
            raise InputError(f"model is {model!r}", remedy=f"one of auto, {', '.join(MODELS)} is needed")
        self.rig = rig
        self.model = model

    def estimate(
        self,
        centreline_px: np.ndarray,
        *,
        moment: float,
        pan: float,
        tilt: float,
        sigma_px: np.ndarray | float | None = None,
    ) -> Contact:
        """One frame.

        Parameters
        ----------
        centreline_px : (N, 2) pixels on the antenna's centreline, in any order; rows with NaN are left out.
        moment : the sensor's reading, N·m.
        pan, tilt : joint angles, rad.
        sigma_px : standard deviation across the antenna, one or (N,); by default what the rig's own pictures showed.

        Raises
        ------
        InputError : wrong shapes, or numbers that are not finite.
        """
        points = np.asarray(centreline_px, float)
        if points.ndim != 2 or points.shape[1] != 2:
            raise InputError(f"centreline_px has shape {points.shape}", remedy="give (N, 2) pixels")
        if not np.isfinite([moment, pan, tilt]).all():
            raise InputError("moment, pan or tilt is not a finite number", remedy="give N·m and radians")
        sigma = np.asarray(self.rig.image.noise_px if sigma_px is None else sigma_px, float)
        if sigma.shape not in ((), points.shape[:1]):
            raise InputError(f"sigma_px has shape {sigma.shape}", remedy="give one number or (N,) of them")
        good = np.isfinite(points).all(axis=1)
        sigma = np.broadcast_to(sigma, points.shape[:1])[good]
        if not ((sigma > 0) & np.isfinite(sigma)).all():
            raise InputError("sigma_px is not everywhere positive and finite", remedy="give standard deviations in px")
        return self.measure(Measured(points[good], sigma, float(moment), float(pan), float(tilt)))

    def estimate_batch(
        self,
        centrelines_px: Sequence[np.ndarray],
        moments: Sequence[float],
        pans: Sequence[float],
        tilts: Sequence[float],
    ) -> list[Contact]:
        """B frames: centrelines (B, N, 2), or B arrays of their own lengths; moments, pans and tilts (B,).

        Raises InputError as `estimate` does, or when the four do not have one length.
        """
        lengths = [len(values) for values in (centrelines_px, moments, pans, tilts)]
        if len(set(lengths)) > 1:
            raise InputError(
                "centrelines, moments, pans and tilts number " + ", ".join(map(str, lengths)),
                remedy="give one of each for every frame",
            )
        return [
            self.estimate(points, moment=moment, pan=pan, tilt=tilt)
            for points, moment, pan, tilt in zip(centrelines_px, moments, pans, tilts, strict=True)
        ]

    def run(self, recording: Iterable[Measured]) -> Iterator[Contact]:
        """A recording frame by frame, in constant memory."""
        return map(self.measure, recording)

    def measure(self, measured: Measured, start: np.ndarray | None = None) -> Contact:
        """One frame that was checked already. `start` (3,): unknowns of a fit near the truth (`Fit.unknowns`)."""
        solved = self.solve(measured, start)
        if solved is None:
            why = f"only {len(measured.points_px)} usable centreline points"
            return Contact("no_antenna", why, self.model, False)
        return judge(solved, self.rig.kinematics.T_world_antenna(measured.pan_rad, measured.tilt_rad))

    def rough(self, measured: Measured) -> Fit | None:
        """The lowest rung's fit to a part of the points. None with too few of them."""
        scene = self._scene(measured).thinned(COARSE_POINTS)
        return fit(scene) if len(scene.seen) >= FEWEST_POINTS else None

    def solve(self, measured: Measured, start: np.ndarray | None = None) -> Solved | None:
        """The fit behind a contact, on the rung that was asked for or chosen. None with too few points."""
        scene = self._scene(measured)
        if len(scene.seen) < FEWEST_POINTS:
            return None
        result = fit(scene, start)
        worth = spread(result)
        reference = evaluated(replace(result.scene, sweeps=MODELS[HIGHEST]), result.unknowns, result.rig_steps)
        if self.model != "auto":
            return Solved(result, reference, worth, self.model, f"{self.model} was asked for")
        bias = predicted_bias(result, reference, worth)
        if bias <= SMALL:
            return Solved(result, reference, worth, self._lowest, f"{self._lowest}: its bias is {bias:.2f} std")
        result = fit(reference.scene, result.unknowns)
        why = f"{HIGHEST}: {self._lowest} would be {bias:.1f} std off"
        return Solved(result, result, spread(result), HIGHEST, why)

    @property
    def _lowest(self) -> str:
        return next(iter(MODELS)) if self.model == "auto" else self.model

    def _scene(self, measured: Measured) -> Scene:
        rotation = self.rig.kinematics.T_world_antenna(measured.pan_rad, measured.tilt_rad).rotation
        seen = see(self.rig.camera, measured.points_px, measured.sigma_px)
        gravity = rotation.T @ self.rig.gravity_world_m_s2
        return Scene(self.rig, seen, measured.moment_Nm, gravity, MODELS[self._lowest])


def predicted_bias(result: Fit, reference: Fit, worth: Spread) -> float:
    """How far, in standard deviations, a fit would move if its model were the reference's; infinite where unknown."""
    if not np.isfinite(worth.covariance).all():
        return np.inf
    weights = robust_weights(result.residuals)
    change = (reference.residuals - result.residuals) * weights
    move = -worth.joint[:3] @ ((result.jacobian * weights[:, None]).T @ change)
    return float(np.max(np.abs(move) / np.sqrt(np.diag(worth.covariance))))
