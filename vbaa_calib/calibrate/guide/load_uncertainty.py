"""Uncertainty of EI by pictures, places and weights, now and after further loads.

A place or weight that is off by δ moves the residuals of the bundle adjustment by c·δ, and its solution by H⁻¹Jᵀc·δ.
The solve knows that they are uncertain, and weighs the loads by it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment
from vbaa_calib.calibrate.antenna.inputs import reading_keys
from vbaa_calib.calibrate.antenna.problem import ANTENNA
from vbaa_calib.calibrate.faults.linearized import StillRows
from vbaa_calib.session import Load, LoadReadings

from .load_candidates import LoadCandidate

_LOG_STIFFNESS = ANTENNA.start + 6


@dataclass(frozen=True)
class StiffnessStd:
    """Relative standard deviations of EI: by the pictures' noise, by the places, by the weights, by everything."""

    noise: float
    distance: float
    mass: float
    total: float


@dataclass(frozen=True, eq=False)
class StiffnessForecast:
    """Uncertainty of EI now, and after further loads.

    A weight that hangs twice is off by the same both times, and so is a place that is used twice: their errors do not
    average out.

    information : (17 + P, 17 + P) of the joint solve, in parameters scaled by `scale` (17 + P,).
    sensitivity : (17 + P, K) Jᵀc of every place and weight, of the present loads, then of the candidates, in scaled
        parameters; times its standard deviation.
    groups : (K, G) which of them are the same weight or the same place. of_mass : (G,) which of these are weights.
    grams : (K / 2, 2, 2) cᵀc of each still's place and weight, times their standard deviations.
    counts : (K,) how often each takes part.
    added : (C, 17 + P, 17 + P) information of each candidate, scaled. own : (C, K) its place and weight.
    """

    information: np.ndarray
    scale: np.ndarray
    sensitivity: np.ndarray
    groups: np.ndarray
    of_mass: np.ndarray
    grams: np.ndarray
    counts: np.ndarray
    added: np.ndarray
    own: np.ndarray

    @staticmethod
    def of(joint: BundleAdjustment, candidates: Sequence[LoadCandidate], readings: LoadReadings) -> StiffnessForecast:
        """From a joint solution and the loads that could be hung next."""
        rows = StillRows.of(joint)
        solution, slopes = rows.solution, rows.by_load()
        information, _, scale = solution.normal_equations()
        jacobians = [one.jacobian / scale for one in candidates]
        weighted = solution.jacobian * (solution.weights**2)[:, None] / scale
        sensitivity, grams = [np.zeros((len(scale), 0))], []
        for index, both in slopes.items():
            mask = rows.of_stills([index])
            sensitivity.append(weighted[mask].T @ both)
            both = both * solution.weights[mask, None]
            grams.append(both.T @ both)
        for one, jacobian in zip(candidates, jacobians, strict=True):
            sensitivity.append(jacobian.T @ one.by_readings)
            grams.append(one.by_readings.T @ one.by_readings)
        # as noted: corrected numbers cannot be shared with another load
        present = [cast(Load, joint.noted[index].still) for index in slopes]
        hung = [*present, *(one.load for one in candidates)]
        keys = [key for load in hung for key in reading_keys(load)]
        names = list(dict.fromkeys(keys))
        std = np.array([readings.distance_std_m, readings.force_std_relative])
        return StiffnessForecast(
            information=information,
            scale=scale,
            sensitivity=np.hstack(sensitivity) * np.tile(std, len(hung)),
            groups=np.array([[name == key for name in names] for key in keys], float).reshape(len(keys), len(names)),
            of_mass=np.array([name[0] == "mass" for name in names], bool),
            grams=np.array(grams).reshape(-1, 2, 2) * np.outer(std, std),
            counts=np.repeat([1.0, 0.0], [2 * len(present), 2 * len(candidates)]),
            added=np.array([rows.T @ rows for rows in jacobians]).reshape(-1, *information.shape),
            own=np.repeat(np.eye(len(hung))[len(present) :], 2, axis=1),
        )

    def now(self) -> StiffnessStd:
        """With the present loads."""
        return self._std(self.information[None], self.counts[None])[0]

    def after_each(self) -> list[StiffnessStd]:
        """With each of the candidates besides."""
        return self._std(self.information + self.added, self.counts + self.own)

    def after(self, index: int) -> StiffnessForecast:
        """With this candidate hung."""
        return replace(self, information=self.information + self.added[index], counts=self.counts + self.own[index])

    def _std(self, information: np.ndarray, counts: np.ndarray) -> list[StiffnessStd]:
        none, every = np.zeros(len(self.of_mass), bool), np.ones(len(self.of_mass), bool)
        noise, mass, total = (self._with(information, counts, which) for which in (none, self.of_mass, every))
        place = np.sqrt(np.maximum(total**2 - mass**2, 0.0))
        mass = np.sqrt(np.maximum(mass**2 - noise**2, 0.0))
        return [StiffnessStd(*row) for row in np.column_stack([noise, place, mass, total]).tolist()]

    def _with(self, information: np.ndarray, counts: np.ndarray, which: np.ndarray) -> np.ndarray:
        """(C,) standard deviations of EI where these groups are solved for, under their priors."""
        groups = self.groups[:, which]
        size, count = len(self.scale), groups.shape[1]
        joint = np.zeros((len(information), size + count, size + count))
        joint[:, :size, :size] = information
        mixed = (self.sensitivity * counts[:, None, :]) @ groups
        joint[:, :size, size:], joint[:, size:, :size] = mixed, np.swapaxes(mixed, 1, 2)
        pairs = groups.reshape(len(groups) // 2, 2, count)
        each = np.einsum("kag,kab,kbh->kgh", pairs, self.grams, pairs)
        joint[:, size:, size:] = np.eye(count) + np.einsum("ck,kgh->cgh", counts[:, ::2], each)
        unit = np.zeros((len(joint), size + count, 1))
        unit[:, _LOG_STIFFNESS] = 1.0
        variance = np.linalg.solve(joint, unit)[:, _LOG_STIFFNESS, 0]
        return np.asarray(np.sqrt(variance) / self.scale[_LOG_STIFFNESS])
