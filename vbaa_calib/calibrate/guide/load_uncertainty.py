"""Uncertainty of EI by pictures, places and weights, now and after further loads.

A place or weight that is off by δ moves the residuals of the bundle adjustment by c·δ, and its solution by H⁻¹Jᵀc·δ.
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
    """Relative standard deviations of EI: by the pictures' noise, by the places, by the weights."""

    noise: float
    distance: float
    mass: float

    @property
    def readings(self) -> float:
        """By places and weights together."""
        return float(np.hypot(self.distance, self.mass))

    @property
    def total(self) -> float:
        """By everything."""
        return float(np.hypot(self.noise, self.readings))


@dataclass(frozen=True, eq=False)
class StiffnessForecast:
    """Uncertainty of EI now, and after further loads.

    A weight that hangs twice is off by the same both times, and so is a place that is used twice: their errors do not
    average out.

    Attributes
    ----------
    information : (17 + P, 17 + P) of the joint solve, in parameters scaled by `scale` (17 + P,).
    sensitivity : (17 + P, K) Jᵀc of every place and weight, of the present loads, then of the candidates, in scaled
        parameters; times its standard deviation.
    groups : (K, G) which of them are the same weight or the same place. of_mass : (G,) which of these are weights.
    grams : (K / 2, 2, 2) cᵀc of each still's place and weight, times their standard deviations.
    counts : (K,) how often each takes part.
    added : (C, 17 + P, 17 + P) information of each candidate, scaled. own : (C, K) its place and weight.
    weighed : the solve knows that places and weights are uncertain, and weighs the loads by it.
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
    weighed: bool

    @staticmethod
    def of(
        joint: BundleAdjustment, candidates: Sequence[LoadCandidate], readings: LoadReadings, weighed: bool = False
    ) -> StiffnessForecast:
        """From a joint solution and the loads that could be hung next."""
        rows = StillRows.of(joint)
        information, _, scale = rows.solution.normal_equations()
        loads, sensitivity, grams = _of_present_loads(rows)
        std = np.array([readings.distance_std_m, readings.force_std_relative])
        added = []
        for one in candidates:
            jacobian = one.jacobian / scale
            added.append(jacobian.T @ jacobian)
            sensitivity += [jacobian.T @ column for column in one.by_readings.T]
            grams.append(one.by_readings.T @ one.by_readings)
        hung = [*loads, *(one.load for one in candidates)]
        keys = [key for load in hung for key in reading_keys(load)]
        names = list(dict.fromkeys(keys))
        size, count = len(scale), len(keys)
        groups = np.zeros((count, len(names)))
        groups[np.arange(count), [names.index(key) for key in keys]] = 1.0
        present = 2 * len(loads)
        return StiffnessForecast(
            information=information,
            scale=scale,
            sensitivity=np.column_stack(sensitivity) * np.tile(std, len(hung)) if count else np.zeros((size, 0)),
            groups=groups,
            of_mass=np.array([name[0] == "mass" for name in names], bool),
            grams=np.array(grams).reshape(-1, 2, 2) * np.outer(std, std),
            counts=np.repeat([1.0, 0.0], [present, 2 * len(candidates)]),
            added=np.array(added).reshape(-1, size, size),
            own=np.hstack([np.zeros((len(candidates), present)), np.repeat(np.eye(len(candidates)), 2, axis=1)]),
            weighed=weighed,
        )

    def now(self) -> StiffnessStd:
        """With the present loads."""
        return self._std(self.information[None], self.counts[None])[0]

    def after_each(self) -> list[StiffnessStd]:
        """With each of the candidates besides."""
        return self._std(self.information + self.added, self.counts + self.own)

    def after(self, index: int) -> StiffnessForecast:
        """With this candidate hung."""
        information = self.information + self.added[index]
        return replace(self, information=information, counts=self.counts + self.own[index])

    def _std(self, information: np.ndarray, counts: np.ndarray) -> list[StiffnessStd]:
        column = _stiffness_column(information)
        noise = np.sqrt(column[:, _LOG_STIFFNESS]) / self.scale[_LOG_STIFFNESS]
        if self.weighed:
            mass = self._weighed_std(information, counts, self.of_mass)
            total = self._weighed_std(information, counts, np.ones(len(self.of_mass), bool))
            place = np.sqrt(np.maximum(total**2 - mass**2, 0.0))
            mass = np.sqrt(np.maximum(mass**2 - noise**2, 0.0))
        else:
            squares = (((column @ self.sensitivity) * counts) @ self.groups / self.scale[_LOG_STIFFNESS]) ** 2
            place, mass = squares[:, ~self.of_mass].sum(axis=1) ** 0.5, squares[:, self.of_mass].sum(axis=1) ** 0.5
        return [StiffnessStd(*map(float, row)) for row in zip(noise, place, mass, strict=True)]

    def _weighed_std(self, information: np.ndarray, counts: np.ndarray, which: np.ndarray) -> np.ndarray:
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
        return np.asarray(np.sqrt(_stiffness_column(joint)[:, _LOG_STIFFNESS]) / self.scale[_LOG_STIFFNESS])


def _stiffness_column(information: np.ndarray) -> np.ndarray:
    """(C, n) column of log EI of the inverse of each information (C, n, n)."""
    unit = np.zeros((information.shape[1], 1))
    unit[_LOG_STIFFNESS] = 1.0
    return np.linalg.solve(information, np.broadcast_to(unit, (len(information), *unit.shape)))[..., 0]


def _of_present_loads(rows: StillRows) -> tuple[list[Load], list[np.ndarray], list[np.ndarray]]:
    """The loads that took part, Jᵀc by distance and by log force of each, and their (2, 2) products cᵀc."""
    joint, solution = rows.joint, rows.solution
    noted = joint.noted
    which = [index for index, one in enumerate(noted) if isinstance(one.still, Load) and rows.moments[index] >= 0]
    if not which:
        return [], [], []
    _, _, scale = solution.normal_equations()
    weighted = solution.jacobian * (solution.weights**2)[:, None] / scale
    nearer, heavier = rows.by_load()
    sensitivity, grams = [], []
    for index in which:
        mask = rows.of_stills([index])
        both = np.column_stack([-nearer[mask], heavier[mask]])
        sensitivity += [weighted[mask].T @ column for column in (-nearer[mask], heavier[mask])]
        both = both * solution.weights[mask, None]
        grams.append(both.T @ both)
    # as noted: corrected numbers cannot be shared with another load
    return [cast(Load, noted[index].still) for index in which], sensitivity, grams
