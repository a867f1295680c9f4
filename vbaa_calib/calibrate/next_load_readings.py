"""What a ruler's and a balance's errors do to EI, and what a further load would do to all of it.

The joint solve takes the loads as exact. How far their readings carry it off follows from its own linearisation: a
reading that is off by δ moves the residuals by c·δ, and the solution by H⁻¹Jᵀc·δ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..session import Load
from .diagnose.rows import DISTANCE_STEP_M, LOG_FORCE_STEP, StillRows, readings_altered
from .joint import JointSolution
from .joint_problem import ANTENNA
from .next_load_candidates import Candidate

LOG_STIFFNESS = ANTENNA.start + 6


@dataclass(frozen=True)
class ReadingErrors:
    """How well the loads' readings are known.

    Attributes
    ----------
    distance_std_m : of a place read off a ruler. mass_std_relative : of a weight.
    """

    distance_std_m: float = 5e-4
    mass_std_relative: float = 5e-3


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
    counts : (K,) how often each reading takes part.
    added : (C, 17 + P, 17 + P) information of each candidate, scaled. own : (C, K) its readings.
    """

    information: np.ndarray
    scale: np.ndarray
    pushes: np.ndarray
    groups: np.ndarray
    of_mass: np.ndarray
    counts: np.ndarray
    added: np.ndarray
    own: np.ndarray

    @staticmethod
    def of(joint: JointSolution, offered: Sequence[Candidate], readings: ReadingErrors) -> Planner:
        """From a joint solution and what could be hung next."""
        rows = StillRows.of(joint)
        information, _, scale = rows.solution.normal_equations()
        loads, pushes = _pushes_now(rows)
        added = []
        for one in offered:
            own = one.rows / scale
            added.append(own.T @ own)
            pushes += [own.T @ one.by_distance, own.T @ one.by_log_force]
        hung = [*loads, *(one.load for one in offered)]
        keys = [key for load in hung for key in _keys(load)]
        names = list(dict.fromkeys(keys))
        stds = [readings.distance_std_m, readings.mass_std_relative] * len(hung)
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
            counts=np.repeat([1.0, 0.0], [2 * len(loads), 2 * len(offered)]),
            added=np.array(added).reshape(-1, size, size),
            own=own,
        )

    def now(self) -> StiffnessErrors:
        """With the loads there are."""
        return self._errors(self.information[None], self.counts[None])[0]

    def after_each(self) -> list[StiffnessErrors]:
        """With each of the candidates hung besides."""
        return self._errors(self.information + self.added, self.counts + self.own)

    def after(self, index: int) -> Planner:
        """With this candidate hung."""
        fields = vars(self) | {
            "information": self.information + self.added[index],
            "counts": self.counts + self.own[index],
        }
        return Planner(**fields)

    def _errors(self, information: np.ndarray, counts: np.ndarray) -> list[StiffnessErrors]:
        unit = np.zeros((len(self.scale), 1))
        unit[LOG_STIFFNESS] = 1.0
        towards = np.linalg.solve(information, np.broadcast_to(unit, (len(information), *unit.shape)))[..., 0]
        noise = np.sqrt(towards[:, LOG_STIFFNESS]) / self.scale[LOG_STIFFNESS]
        squares = (((towards @ self.pushes) * counts) @ self.groups / self.scale[LOG_STIFFNESS]) ** 2
        place, mass = squares[:, ~self.of_mass].sum(axis=1) ** 0.5, squares[:, self.of_mass].sum(axis=1) ** 0.5
        return [StiffnessErrors(*map(float, row)) for row in zip(noise, place, mass, strict=True)]


def _keys(load: Load) -> tuple[tuple[str, str], tuple[str, str]]:
    """What a place and a weight are known by: equal numbers are the same one."""
    force = float(np.hypot(load.force_y_N, load.force_z_N))
    return ("distance", f"{load.distance_m:.4f}"), ("mass", f"{force:.3g}")


def _pushes_now(rows: StillRows) -> tuple[list[Load], list[np.ndarray]]:
    """The loads that took part, and two pushes each: by distance, by log force."""
    joint, solution = rows.joint, rows.solution
    observations = joint.problem.observations
    which = [
        index for index, one in enumerate(observations) if isinstance(one.still, Load) and rows.moments[index] >= 0
    ]
    if not which:
        return [], []
    _, _, scale = solution.normal_equations()
    weighted = solution.jacobian * (solution.weights**2)[:, None] / scale
    nearer = -rows.altered([readings_altered(one)[0] for one in observations], DISTANCE_STEP_M)
    heavier = rows.altered([readings_altered(one)[1] for one in observations], LOG_FORCE_STEP)
    loads, pushes = [], []
    for index in which:
        mask = rows.of_stills([index])
        load = observations[index].still
        assert isinstance(load, Load)
        loads.append(load)
        pushes.append(weighted[mask].T @ nearer[mask])
        pushes.append(weighted[mask].T @ heavier[mask])
    return loads, pushes
