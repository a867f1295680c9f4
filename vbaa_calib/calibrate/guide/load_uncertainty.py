"""What a ruler's and a balance's errors do to EI, and what a further load would do to all of it.

The joint solve takes the loads as exact. How far their readings carry it off follows from its own linearisation: a
reading that is off by δ moves the residuals by c·δ, and the solution by H⁻¹Jᵀc·δ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment
from vbaa_calib.calibrate.antenna.inputs import reading_keys
from vbaa_calib.calibrate.antenna.problem import ANTENNA
from vbaa_calib.calibrate.faults.linearized import StillRows
from vbaa_calib.session import Load, LoadReadings

from .load_candidates import Candidate

LOG_STIFFNESS = ANTENNA.start + 6


@dataclass(frozen=True)
class StiffnessErrors:
    """Relative standard deviations of EI: by the pictures' noise, by the places, by the weights."""

    noise: float
    distance: float
    mass: float

    @property
    def readings(self) -> float:
        """By places and weights together."""
        return float(np.hypot(self.distance, self.mass))

    @property
    def whole(self) -> float:
        """By everything."""
        return float(np.hypot(self.noise, self.readings))


@dataclass(frozen=True, eq=False)
class Planner:
    """EI's errors now, and after further loads.

    A weight that hangs twice is off by the same both times, and so is a place that is used twice: their errors do not
    average out.

    Attributes
    ----------
    information : (17 + P, 17 + P) of the joint solve, scaled.
    scale : (17 + P,) what was taken out of it.
    pushes : (17 + P, K) Jᵀc of every reading: of the loads there are, then of the candidates, in scaled parameters;
        times the reading's standard deviation.
    groups : (K, G) which readings are the same weight or the same place. of_mass : (G,) which of these are weights.
    grams : (K / 2, 2, 2) cᵀc of each still's two readings, times their standard deviations.
    counts : (K,) how often each reading takes part.
    added : (C, 17 + P, 17 + P) information of each candidate, scaled. own : (C, K) its readings.
    weighed : the solve knows that the readings are uncertain, and weighs the loads by it.
    """

    information: np.ndarray
    scale: np.ndarray
    pushes: np.ndarray
    groups: np.ndarray
    of_mass: np.ndarray
    grams: np.ndarray
    counts: np.ndarray
    added: np.ndarray
    own: np.ndarray
    weighed: bool

    @staticmethod
    def of(
        joint: BundleAdjustment, offered: Sequence[Candidate], readings: LoadReadings, weighed: bool = False
    ) -> Planner:
        """From a joint solution and what could be hung next."""
        rows = StillRows.of(joint)
        information, _, scale = rows.solution.normal_equations()
        loads, pushes, grams = _pushes_now(rows)
        stds_once = np.array([readings.distance_std_m, readings.force_std_relative])
        added = []
        for one in offered:
            own = one.rows / scale
            added.append(own.T @ own)
            pushes += [own.T @ one.by_distance, own.T @ one.by_log_force]
            both = np.column_stack([one.by_distance, one.by_log_force])
            grams.append(both.T @ both)
        hung = [*loads, *(one.load for one in offered)]
        keys = [key for load in hung for key in reading_keys(load)]
        names = list(dict.fromkeys(keys))
        stds = np.tile(stds_once, len(hung))
        size, count = len(scale), len(keys)
        groups = np.zeros((count, len(names)))
        groups[np.arange(count), [names.index(key) for key in keys]] = 1.0
        own = np.zeros((len(offered), count))
        for index in range(len(offered)):
            own[index, 2 * (len(loads) + index) : 2 * (len(loads) + index) + 2] = 1.0
        return Planner(
            information=information,
            scale=scale,
            pushes=np.column_stack(pushes) * stds if count else np.zeros((size, 0)),
            groups=groups,
            of_mass=np.array([name[0] == "mass" for name in names], bool),
            grams=np.array(grams).reshape(-1, 2, 2) * np.outer(stds_once, stds_once),
            counts=np.repeat([1.0, 0.0], [2 * len(loads), 2 * len(offered)]),
            added=np.array(added).reshape(-1, size, size),
            own=own,
            weighed=weighed,
        )

    def unweighed(self) -> Planner:
        """For a solve that takes the readings as exact."""
        return replace(self, weighed=False)

    def now(self) -> StiffnessErrors:
        """With the loads there are."""
        return self._errors(self.information[None], self.counts[None])[0]

    def after_each(self) -> list[StiffnessErrors]:
        """With each of the candidates hung besides."""
        return self._errors(self.information + self.added, self.counts + self.own)

    def after(self, index: int) -> Planner:
        """With this candidate hung."""
        information = self.information + self.added[index]
        return replace(self, information=information, counts=self.counts + self.own[index])

    def _errors(self, information: np.ndarray, counts: np.ndarray) -> list[StiffnessErrors]:
        unit = np.zeros((len(self.scale), 1))
        unit[LOG_STIFFNESS] = 1.0
        towards = np.linalg.solve(information, np.broadcast_to(unit, (len(information), *unit.shape)))[..., 0]
        noise = np.sqrt(towards[:, LOG_STIFFNESS]) / self.scale[LOG_STIFFNESS]
        if self.weighed:
            mass = self._weighed(information, counts, self.of_mass)
            whole = self._weighed(information, counts, np.ones(len(self.of_mass), bool))
            place = np.sqrt(np.maximum(whole**2 - mass**2, 0.0))
            mass = np.sqrt(np.maximum(mass**2 - noise**2, 0.0))
        else:
            squares = (((towards @ self.pushes) * counts) @ self.groups / self.scale[LOG_STIFFNESS]) ** 2
            place, mass = squares[:, ~self.of_mass].sum(axis=1) ** 0.5, squares[:, self.of_mass].sum(axis=1) ** 0.5
        return [StiffnessErrors(*map(float, row)) for row in zip(noise, place, mass, strict=True)]

    def _weighed(self, information: np.ndarray, counts: np.ndarray, which: np.ndarray) -> np.ndarray:
        """(C,) standard deviations of EI where these groups of readings are solved for, with what is known of them."""
        groups = self.groups[:, which]
        size, count = len(self.scale), groups.shape[1]
        whole = np.zeros((len(information), size + count, size + count))
        whole[:, :size, :size] = information
        mixed = (self.pushes * counts[:, None, :]) @ groups
        whole[:, :size, size:], whole[:, size:, :size] = mixed, np.swapaxes(mixed, 1, 2)
        pairs = groups.reshape(len(groups) // 2, 2, count)
        each = np.einsum("kag,kab,kbh->kgh", pairs, self.grams, pairs)
        whole[:, size:, size:] = np.eye(count) + np.einsum("ck,kgh->cgh", counts[:, ::2], each)
        unit = np.zeros((size + count, 1))
        unit[LOG_STIFFNESS] = 1.0
        towards = np.linalg.solve(whole, np.broadcast_to(unit, (len(whole), *unit.shape)))
        return np.asarray(np.sqrt(towards[:, LOG_STIFFNESS, 0]) / self.scale[LOG_STIFFNESS])


def _pushes_now(rows: StillRows) -> tuple[list[Load], list[np.ndarray], list[np.ndarray]]:
    """The loads that took part, two pushes each, by distance and by log force, and their (2, 2) products."""
    joint, solution = rows.joint, rows.solution
    observations = joint.problem.observations
    which = [
        index for index, one in enumerate(observations) if isinstance(one.still, Load) and rows.moments[index] >= 0
    ]
    if not which:
        return [], [], []
    _, _, scale = solution.normal_equations()
    weighted = solution.jacobian * (solution.weights**2)[:, None] / scale
    nearer, heavier = rows.by_load()
    further = -nearer
    loads, pushes, grams = [], [], []
    for index in which:
        mask = rows.of_stills([index])
        # as it was noted: what it was corrected to is no number that another load can share
        load = joint.noted[index].still
        assert isinstance(load, Load)
        loads.append(load)
        both = np.column_stack([further[mask], heavier[mask]]) * solution.weights[mask, None]
        grams.append(both.T @ both)
        pushes.append(weighted[mask].T @ further[mask])
        pushes.append(weighted[mask].T @ heavier[mask])
    return loads, pushes, grams
