"""Two contacts in one frame: places, forces and their covariance, and the decision between two contacts and one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import combinations, pairwise
from typing import Any

import numpy as np

from estimator.solver.frames import Frames
from estimator.solver.rig_arrays import RigArrays
from estimator.table.contacts import Contact
from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.core.least_squares import Rules, levenberg_marquardt
from vbaa_calib.core.robust import huber_losses, huber_weights, mad_std
from vbaa_calib.native import core
from vbaa_calib.rig import Rig

from .inputs import Batch
from .status import OK

NEAR, FAR = 0, 4
"""Where the four unknowns of the nearer and the farther contact begin: distance in antenna lengths, force along the
clamp's y and z in `RigArrays.force_unit_N`, friction angle in its prior's standard deviations."""


@dataclass(frozen=True)
class _TwoContactsSettings:
    """Settings of the search for two contacts, and thresholds from which a frame has them."""

    places: int = 8  # places of a contact, evenly over the antenna, that are tried in pairs before fits begin
    likely: int = 12  # of these pairs, the best ones where deflections are small, are looked into
    tries: int = 3  # steps in which the forces of each pair are found
    starts: int = 12  # pairs from which fits begin at most, the best ones
    together: int = 3  # so many first, and further ones while none of them explains the frame
    first_steps: int = 10  # of the fits that begin there
    steps: int = 8  # Runge–Kutta steps of each of the rod's three parts: within 1e-7 of its length
    nearest: float = 0.03  # in antenna lengths: contacts are so far from the clamp and from each other, at least
    bend: float = 0.3  # prior standard deviation of the tip's deflection by each force, in antenna lengths
    bend_at_first: float = 0.05  # the same while pairs are searched: what no camera sees does not lead astray
    difference: float = 1e-4  # finite differences of the unknowns
    axis_step: float = 0.1  # of the rig's axes, in standard deviations
    rounds: int = 3  # linearisations of the rig's errors, at most
    converged: float = 1e-2  # such a round that lowers the cost by less is the last
    gain: float = 25.0  # decrease of the cost by the second contact, at least: as `ContactSettings.second_contact`
    clear: float = 4.0  # multiple of this gain in cost above which one contact is not fitted further
    promises: float = 10.0  # times the next step's gain, with which that cost must remain out of reach
    force_std: float = 6.0  # each force is so many of its standard deviations, at least
    distance: float = 0.05  # standard deviation of a place in antenna lengths, at most: as `ContactSettings.low_signal`
    alternative: float = 4.5  # another pair of places counts as equally good when its cost is so little higher
    apart_std: float = 3.0  # and its places are so many standard deviations away
    misfit: float = 1.15  # rms of the residuals over the scatter of neighbours, at most: beyond it the shape is wrong
    determined: float = (
        0.25  # a force's component counts as determined with this part of its prior's deviation, at most
    )


@dataclass(frozen=True, eq=False)
class _TouchedTwice:
    """K rods with two contacts each: nodes (K, M, 3) and unit tangents (K, M, 3), antenna frame; forces (K, 2, 3) of
    the contacts; (K, 7) force and moment about the origin of all loads, and 1; arc lengths (K, M)."""

    points_m: np.ndarray
    tangents: np.ndarray
    forces_N: np.ndarray
    wrench: np.ndarray
    arclength_m: np.ndarray
    solution: np.ndarray


@dataclass(frozen=True, eq=False)
class _TwoContactFit:
    """State of the minimisation.

    unknowns : (8,). residuals : (M,) of points, readings and the forces' priors, in their standard deviations.
    columns : (M, 8) their predictions' derivatives. errors : (R,) of the rig and the found line, which are solved for
    together with the unknowns, in their standard deviations. left : (M,) residuals without the effect of these errors.
    cost : robust, priors included. foot : (N,) node coordinate of each point's foot. normal : (N, 2) of the curve
        there, px.
    """

    unknowns: np.ndarray
    residuals: np.ndarray
    columns: np.ndarray
    errors: np.ndarray
    left: np.ndarray
    cost: float
    foot: np.ndarray
    normal: np.ndarray
    shape: _TouchedTwice


@dataclass(frozen=True, eq=False)
class _Pair:
    """The best pair of contacts of a frame.

    unknowns : (8,) see `NEAR`. points_m, forces_N : (2, 3) antenna frame. tangents : (2, 3) unit. residuals : (K,) of
    the readings, in their standard deviations. covariance : (14, 14) of distance (m), point and force of the nearer
    contact, and then of the farther one. free_m : (2, 3) the same places of the free antenna. gain : decrease of the
    cost against one contact. misfit : of the points, over the scatter of neighbours. other : distances (2,) m of
    another pair that explains the frame about as well; None without. unmoved : number of the rig's errors with an
    unknown effect on this pair.
    """

    unknowns: np.ndarray
    points_m: np.ndarray
    forces_N: np.ndarray
    tangents: np.ndarray
    residuals: np.ndarray
    covariance: np.ndarray
    free_m: np.ndarray
    gain: float
    misfit: float
    length_m: float
    other: np.ndarray | None
    unmoved: int

    @property
    def distances_m(self) -> np.ndarray:
        """(2,) arc lengths from the clamp."""
        return self.length_m * self.unknowns[[NEAR, FAR]]

    @property
    def std(self) -> np.ndarray:
        """(2, 7) standard deviations of distance, point and force."""
        return np.sqrt(np.diag(self.covariance)).reshape(2, 7)

    def doubt(self, settings: _TwoContactsSettings) -> str:
        """The reason why the frame does not determine two contacts, in words; empty where it does."""
        near, far = 1e3 * self.distances_m
        pair = f"two contacts, at {near:.0f} and {far:.0f} mm"
        own = [self.covariance[7 * k + 5 : 7 * k + 7, 7 * k + 5 : 7 * k + 7] for k in range(2)]
        sizes = [
            np.sqrt(each @ np.linalg.solve(spread, each))
            for each, spread in zip(self.forces_N[:, 1:], own, strict=True)
        ]
        if not self.misfit < settings.misfit:
            return (
                f"nor do two: the best ones, at {near:.0f} and {far:.0f} mm, leave {self.misfit:.1f} times the scatter"
            )
        if not self.gain > settings.gain:
            return f"{pair}, explain no more than one does"
        if self.other is not None:
            there = " and ".join(f"{1e3 * each:.0f}" for each in self.other)
            return f"{pair}, explain it about as well as two at {there} mm"
        if not (self.std[:, 0] < settings.distance * self.length_m).all():
            return f"{pair}, explain it, but a place is known only to {1e3 * self.std[:, 0].max():.1f} mm"
        if self.unmoved:
            return f"{pair}, explain it, but with {self.unmoved} errors of the rig the antenna has no equilibrium there"
        if not min(sizes) > settings.force_std:
            return f"{pair}, explain it, but one of them hardly presses"
        return ""


@lru_cache(maxsize=4)
def _moved_rigs(arrays: RigArrays) -> list[list[tuple[float, Rig, np.ndarray]]]:
    """A rig moved along each of its independent axes, in either direction: the step in standard deviations, the rig,
    and its sensors' matrix from wrench to readings (R, 7)."""
    several, step, rows = [], _TwoContactsSettings.axis_step, len(arrays.std)
    for axis in arrays.axes.T:
        rigs = [(side, arrays.rig.moved(side * axis)) for side in (step, -step)]
        several.append([(side, rig, RigArrays.from_rig(rig, 0.0, False).by_wrench[:rows]) for side, rig in rigs])
    return several


class _TwoContactFrame:
    """One frame of a rig with an antenna touched twice."""

    def __init__(self, arrays: RigArrays, frames: Frames, points_px: np.ndarray, sigma_px: np.ndarray) -> None:
        there = np.flatnonzero((frames.usable[0] > 0.0) & np.isfinite(points_px).all(axis=1))
        there = there[np.argsort(frames.camera[0, there], kind="stable")]
        self.arrays, self.rig, self.settings = arrays, arrays.rig, _TwoContactsSettings()
        self.points_px, self.sigma_px = points_px[there], sigma_px[there]
        ends = np.searchsorted(frames.camera[0, there], np.arange(len(arrays.rig.cameras) + 1))
        self.of_camera = [slice(first, last) for first, last in pairwise(ends)]
        """Which of the points each camera sees."""
        self.gravity = frames.gravity_m_s2[0]
        # the antenna's end is not used
        self.available = np.where(np.arange(len(arrays.std)) == core.solver.END, 0.0, frames.available[0])
        self.reading = frames.reading[0] / arrays.std
        self.by_rig = np.zeros((len(self.points_px) + len(self.reading) + 4, 0))
        self.unmoved = 0  # axes of the rig along which there is no equilibrium
        self.prior, self.bend = np.array([0.0, 0.0, 0.0, 1.0] * 2), _TwoContactsSettings.bend

    def shape(self, unknowns: np.ndarray, rig: Rig, start: np.ndarray | None = None) -> _TouchedTwice | None:
        """Rods with unknowns (K, 8), neighbours of the first; None where they have no equilibrium. start : (5,) a
        solution nearby."""
        rod, settings = rig.antenna.rod, self.settings
        friction = self.arrays.friction_rad
        unit = self.arrays.force_unit_N
        loads = np.empty((len(unknowns), 11))
        loads[:, :3] = self.gravity
        for place, first in ((3, NEAR), (7, FAR)):
            loads[:, place] = unknowns[:, first] * rod.length_m
            loads[:, place + 1 : place + 3] = unit * unknowns[:, first + 1 : first + 3]
            loads[:, place + 3] = np.clip(friction * unknowns[:, first + 3], -1.4, 1.4)
        parts, solved = [], np.zeros((1, 5)) if start is None else start[None]
        for some in (loads[:1], loads[1:]):  # these are neighbours of the first
            starts = np.repeat(solved, len(some), axis=0)
            parts.append(core.antenna.solve_touched_twice(rod.numbers, some, rod.clamp_give_m, starts, settings.steps))
            solved = parts[0][1]
        nodes, solution, left = map(np.concatenate, zip(*parts, strict=True))
        if not (left < 1e-6).all():
            return None
        turn, lever = rod.T_antenna_clamp.rotation, rod.T_antenna_clamp.translation_m
        per_length = rod.bending_stiffness_Nm2 / rod.length_m
        forces = np.stack(
            [
                np.column_stack([per_length / rod.length_m * solution[:, 3 + k], loads[:, 4 + 4 * k : 6 + 4 * k]])
                @ turn.T
                for k in range(2)
            ],
            axis=1,
        )
        total = forces.sum(axis=1) + rod.mass_kg * self.gravity
        moment = per_length * solution[:, :3] + np.cross(lever, total)
        wrench = np.column_stack([total, moment, np.ones(len(total))])
        bounds = np.column_stack([np.zeros(len(loads)), loads[:, 3], loads[:, 7], np.full(len(loads), rod.length_m)])
        share = np.arange(settings.steps) / settings.steps
        arcs = [bounds[:, k, None] + (bounds[:, k + 1] - bounds[:, k])[:, None] * share for k in range(3)]
        arclength = np.column_stack([*arcs, bounds[:, 3]])
        return _TouchedTwice(nodes[:, :, 0], nodes[:, :, 1], forces, wrench, arclength, solution)

    def pictures(self, points_m: np.ndarray, rig: Rig) -> np.ndarray:
        """(V, ..., 2) pixels of points (..., 3) in the antenna frame by each camera; NaN behind it or beyond its
        lens."""
        several = []
        for one in rig.cameras.values():
            pixels, valid = one.camera.project(one.T_antenna_camera.inverse() @ points_m)
            several.append(np.where(valid[..., None], pixels, np.nan))
        return np.array(several)

    def across(self, moved: np.ndarray, foot: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """(K, N) displacements (V, K, M, 2) px of nodes along the normals (N, 2) at feet (N,), in units of the
        points' standard deviations."""
        there = [_along(each, foot[own]) for each, own in zip(moved, self.of_camera, strict=True)]
        return np.asarray((np.concatenate(there, axis=1) * normal).sum(axis=-1) / self.sigma_px)

    def readings(self, wrench: np.ndarray) -> np.ndarray:
        """(K, R) predicted sensor readings, in standard deviations, from wrenches (K, 7)."""
        return np.asarray(self.available * (wrench @ self.arrays.by_wrench[: len(self.available)].T))

    def fit(
        self,
        unknowns: np.ndarray,
        free: Sequence[int],
        start: np.ndarray | None = None,
        errors: np.ndarray | None = None,
    ) -> _TwoContactFit | None:
        """Residuals and Jacobian at unknowns, of which `free` are solved for. errors : of the rig, or none."""
        step = self.settings.difference
        trials = np.tile(unknowns, (1 + len(free), 1))
        signs = np.array([-1.0 if one in (NEAR, FAR) else 1.0 for one in free])
        trials[1 + np.arange(len(free)), free] += step * signs
        shape = self.shape(trials, self.rig, start)
        if shape is None:
            return None
        ahead_m = shape.points_m[:1] + 1e-6 * shape.tangents[:1]
        pixels = self.pictures(np.concatenate([shape.points_m, ahead_m]), self.rig)
        if not np.isfinite(pixels).all():
            return None
        pixels, ahead = pixels[:, :-1], pixels[:, -1]
        feet = [
            core.search.feet_on(each[0], 1e6 * (there - each[0]), shape.arclength_m[0], self.points_px[own])
            for each, there, own in zip(pixels, ahead, self.of_camera, strict=True)
        ]
        foot, distance, normal = (np.concatenate(parts) for parts in zip(*feet, strict=True))
        moved = self.across(pixels[:, 1:] - pixels[:, :1], foot, normal)
        columns = np.zeros((len(foot) + len(self.reading) + 4, 8))
        read, bent = self.readings(shape.wrench), self._bends(trials)
        for row, (column, sign) in enumerate(zip(free, signs / step, strict=True)):
            columns[: len(foot), column] = sign * moved[row]
            changes = np.concatenate([read[1 + row] - read[0], bent[1 + row] - bent[0]])
            columns[len(foot) :, column] = sign * changes
        residuals = np.concatenate([distance / self.sigma_px, self.available * self.reading - read[0], -bent[0]])
        if errors is None or len(errors) != self.by_rig.shape[1]:
            errors = np.zeros(self.by_rig.shape[1])
        left = residuals - self.by_rig @ errors
        cost = huber_losses(left).sum() + 0.5 * float(errors @ errors + self.prior @ unknowns**2)
        return _TwoContactFit(unknowns, residuals, columns, errors, left, float(cost), foot, normal, shape)

    def _bends(self, unknowns: np.ndarray) -> np.ndarray:
        """(K, 4) small deflections of the tip due to the components of either force, in units of their prior
        standard deviations."""
        unit = 0.01 / self.bend
        weights = [unit * place**2 * (3.0 - place) / 2.0 for place in unknowns[:, [NEAR, FAR]].T]
        return np.column_stack([weights[0], weights[0], weights[1], weights[1]]) * unknowns[:, [1, 2, 5, 6]]

    def descended(
        self, unknowns: np.ndarray, free: Sequence[int], iterations: int = 40, errors: np.ndarray | None = None
    ) -> _TwoContactFit | None:
        """The local minimum of the cost from these unknowns, and errors of rig and detected line, which are solved
        for, too."""
        forces, places = np.isin(np.arange(8), (1, 2, 5, 6)), np.isin(free, (NEAR, FAR))
        first = None
        for share in (1.0, 0.5, 0.2):  # small deflections' forces may be too large for any rod
            first = first or self.fit(np.where(forces, share * unknowns, unknowns), free, errors=errors)
        if first is None:
            return None

        def step(at: _TwoContactFit, damping: float) -> tuple[np.ndarray, float]:
            information, pull, mixed, own, pull_of_rig = self._equations(at, at.columns[:, free])
            information += np.diag(self.prior[free])
            pull -= (self.prior * at.unknowns)[free]
            # a place at its limit that would go further stays
            away = self._limited(at.unknowns, free, 1e-9 * np.sign(pull)) == at.unknowns
            pull = np.where(away[free] & places, 0.0, pull)
            damped = information + damping * np.diag(np.diag(information) + 1e-9)
            damped[pull == 0.0, :] = damped[:, pull == 0.0] = 0.0
            damped[pull == 0.0, pull == 0.0] = 1.0
            move = np.linalg.solve(damped, pull)
            by_rig = np.linalg.solve(own, pull_of_rig) if len(own) else pull_of_rig
            promise = move @ pull - 0.5 * move @ information @ move + 0.5 * pull_of_rig @ by_rig
            return np.append(move, by_rig - np.linalg.solve(own, mixed @ move)), float(promise)

        def moved(at: _TwoContactFit, move: np.ndarray) -> _TwoContactFit | None:
            unknowns = self._limited(at.unknowns, free, move[: len(free)])
            return self.fit(unknowns, free, at.shape.solution[0], at.errors + move[len(free) :])

        # the valleys are bent: after a step that failed, and one that did not, the next needs nearly the same damping
        rules = Rules(iterations, standstill=1e-2, takes_last=True, damping=1e-2, growth=3.0, relief=0.5)
        return levenberg_marquardt(first, step, moved, rules)[0]

    def _equations(self, at: _TwoContactFit, columns: np.ndarray) -> tuple[np.ndarray, ...]:
        """Information (F, F) and right side (F,) of the residuals by columns (M, F), with the rig's errors
        marginalised; mixed information (R, F), and information (R, R) and right side (R,) of these errors."""
        weights = huber_weights(at.left)
        weighted, of_rig = weights[:, None] * columns, weights[:, None] * self.by_rig
        mixed, own = self.by_rig.T @ weighted, np.eye(self.by_rig.shape[1]) + self.by_rig.T @ of_rig
        pull_of_rig = of_rig.T @ at.left - at.errors
        by_mixed = np.linalg.solve(own, mixed)
        information = columns.T @ weighted - mixed.T @ by_mixed
        return information, weighted.T @ at.left - by_mixed.T @ pull_of_rig, mixed, own, pull_of_rig

    def _limited(self, unknowns: np.ndarray, free: Sequence[int], move: np.ndarray) -> np.ndarray:
        """The unknowns after a move, limited so that the contacts stay on the antenna, in order and apart."""
        found, apart = unknowns.copy(), self.settings.nearest
        found[list(free)] += move
        found[NEAR] = np.clip(found[NEAR], max(apart, 0.5 * unknowns[NEAR]), 1.0 - apart)
        found[FAR] = np.clip(found[FAR], found[NEAR] + apart, 1.0)
        return found

    @cached_property
    def nuisances(self) -> list[list[tuple[float, Rig, np.ndarray]]]:
        """The rig moved along each of its independent axes, in either direction, with the step in standard
        deviations and its sensors' readings by the wrench. Computed once for an estimator's rig."""
        return _moved_rigs(self.arrays)

    def rig_slopes(self, at: _TwoContactFit) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of the predictions (M, R + L) and of the outputs (14, R + L) by the rig's axes and the
        detected line's own errors, in their standard deviations."""
        base = self.pictures(at.shape.points_m, self.rig)[:, :1]
        read, outputs = self.readings(at.shape.wrench[:1])[0], self.outputs(at.shape, 0, at.unknowns)
        columns, moved_outputs = [], []
        self.unmoved = 0
        for sides in self.nuisances:
            tried = ((*side, self.shape(at.unknowns[None], side[1], at.shape.solution[0])) for side in sides)
            step, rig, by_wrench, shape = next(
                (one for one in tried if one[3] is not None), (1.0, self.rig, None, None)
            )
            if shape is None or by_wrench is None:
                # without an equilibrium to either side nobody knows what this error does
                self.unmoved += 1
                columns.append(np.zeros(len(at.residuals)))
                moved_outputs.append(np.zeros(14))
                continue
            across = self.across(self.pictures(shape.points_m, rig) - base, at.foot, at.normal)[0]
            changes = self.available * (shape.wrench[0] @ by_wrench.T) - read
            columns.append(np.concatenate([across, changes, np.zeros(4)]) / step)
            moved_outputs.append((self.outputs(shape, 0, at.unknowns) - outputs) / step)
        along = 2.0 * np.interp(at.foot, np.arange(base.shape[2]), at.shape.arclength_m[0]) / self.arrays.length_m - 1.0
        shapes = (np.ones(len(along)), along, 1.5 * along**2 - 0.5)
        cameras = zip(self.rig.cameras.values(), self.arrays.line, self.of_camera, strict=True)
        for rig, own, which in cameras:
            line_px = np.hypot(rig.drift.line_px, rig.drift.light_px)
            for legendre in shapes[: len(own)]:
                column = np.zeros(len(at.residuals))
                column[which] = line_px * legendre[which] / self.sigma_px[which]
                columns.append(column)
                moved_outputs.append(np.zeros(14))
        if not columns:
            return np.zeros((len(at.residuals), 0)), np.zeros((14, 0))
        return np.array(columns).T, np.array(moved_outputs).T

    def outputs(self, shape: _TouchedTwice, row: int, unknowns: np.ndarray) -> np.ndarray:
        """(14,) distance, point and force of either contact."""
        parts: list[Any] = []
        for k, first in enumerate((NEAR, FAR)):
            parts += [[unknowns[first] * self.arrays.length_m], shape.points_m[row, (k + 1) * self.settings.steps]]
            parts += [shape.forces_N[row, k]]
        return np.concatenate(parts)

    def marginal(self, at: _TwoContactFit, free: Sequence[int]) -> tuple[_TwoContactFit, np.ndarray, np.ndarray]:
        """The fit with derivatives by the rig at its minimum, the joint covariance (F + R, F + R) of unknowns and
        rig errors, and the derivatives (14, R) of the outputs by the latter."""
        before = self.by_rig
        for _ in range(self.settings.rounds):
            self.by_rig, outputs = self.rig_slopes(at)
            again = self.fit(at.unknowns, free, at.shape.solution[0], at.errors)
            further = self.descended(at.unknowns, free, errors=at.errors) if again is not None else None
            if again is None or further is None:
                break
            gained, at = again.cost - further.cost, further
            if gained < self.settings.converged:
                break
        whole = np.column_stack([at.columns[:, free], self.by_rig])
        prior = np.append(self.prior[list(free)], np.ones(self.by_rig.shape[1]))
        information = whole.T @ (huber_weights(at.left)[:, None] * whole) + np.diag(prior)
        self.by_rig = before
        return at, np.linalg.pinv(information, hermitian=True), outputs

    def single_cost(self, one: np.ndarray, enough: float) -> float:
        """The cost of the best single contact near unknowns (4,), with the rig's errors free; infinite without one.
        A minimisation predicted to end far above `enough` is broken off."""
        unknowns = np.concatenate([[self.settings.nearest, 0.0, 0.0, 0.0], np.nan_to_num(one)])
        unknowns[FAR] = np.clip(unknowns[FAR], 2.0 * self.settings.nearest, 1.0)
        free = [4, 5, 6, 7] if self.arrays.friction_rad > 0.0 else [4, 5, 6]
        fit = self.descended(unknowns, free, self.settings.first_steps)
        if fit is None:
            return np.inf
        before, self.by_rig = self.by_rig, self.rig_slopes(fit)[0]
        rough = self.descended(fit.unknowns, free, self.settings.first_steps)
        if rough is not None:
            information, pull, _, own, of_rig = self._equations(rough, rough.columns[:, free])
            information += np.diag(self.prior[free])
            pull -= (self.prior * rough.unknowns)[free]
            promise = pull @ np.linalg.solve(information, pull) + of_rig @ np.linalg.solve(own, of_rig)
            if rough.cost - self.settings.promises * 0.5 * promise > enough:
                return rough.cost
        self.by_rig = before
        return self.marginal(fit, free)[0].cost

    def starts(self) -> list[_TwoContactFit]:
        """Initial values: the pairs of places that explain most with their best forces, the best first."""
        settings, places = self.settings, self.settings.places
        straight = np.array([0.5, 0, 0, 0, 1.0, 0, 0, 0])
        if (free := self.fit(straight, [])) is None:
            return []
        self.by_rig = self.rig_slopes(free)[0]
        if (free := self.fit(straight, [])) is None:
            return []
        rig, base, arcs = self.rig, free.shape.points_m[0], free.shape.arclength_m[0]
        turn = rig.antenna.rod.T_antenna_clamp.rotation
        bent, read = [], []
        for place in np.arange(1, places + 1) / places:
            at_m = place * self.arrays.length_m
            near = np.minimum(arcs, at_m)
            deflection = near**2 * (3.0 * np.maximum(arcs, at_m) - near) / 6.0 / rig.antenna.stiffness_Nm2
            for axis in (1, 2):
                force = self.arrays.force_unit_N * turn[:, axis]
                moved = self.pictures(base + 1e-3 * deflection[:, None] * force, rig) - self.pictures(base, rig)
                bent.append(1e3 * self.across(moved[:, None], free.foot, free.normal)[0])
                wrench = np.concatenate([force, np.cross([at_m, 0.0, 0.0], force), [0.0]])
                read.append(self.readings(wrench[None])[0])
        design = np.column_stack([np.array(bent), np.array(read)]).T
        design = np.vstack([design, np.zeros((4, design.shape[1]))])
        products, pulls = self._equations(free, design)[:2]
        tried = []
        for near, far in combinations(range(places), 2):
            own = [2 * near, 2 * near + 1, 2 * far, 2 * far + 1]
            weights = self._bends(np.array([[(near + 1) / places, 1, 1, 0, (far + 1) / places, 1, 1, 0]]))[0]
            matrix = products[np.ix_(own, own)] + np.diag(weights**2)
            forces = np.linalg.solve(matrix, pulls[own])
            gained = float(forces @ pulls[own])
            unknowns = np.array([(near + 1) / places, *forces[:2], 0.0, (far + 1) / places, *forces[2:], 0.0])
            tried.append((gained, unknowns))
        # at large deflections other forces explain most, and other places
        tried = sorted(tried, key=lambda one: -one[0])[: settings.likely]
        fits = [self.descended(unknowns, [1, 2, 5, 6], settings.tries) for _, unknowns in tried]
        return sorted((fit for fit in fits if fit is not None), key=lambda fit: fit.cost)[: settings.starts]


def _along(values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(K, N, 2) values at node coordinates (N,), interpolated linearly from those at nodes (K, M, 2)."""
    before = np.clip(at.astype(int), 0, values.shape[1] - 2)
    share = (at - before)[:, None]
    return np.asarray((1.0 - share) * values[:, before] + share * values[:, before + 1])


def _misfit(at: _TwoContactFit) -> tuple[float, float]:
    """Rms of the points' residuals relative to the scatter of neighbouring ones, and this scatter, at least 1."""
    left = at.left[: len(at.foot)]
    scatter = max(float(mad_std(np.diff(left)) / np.sqrt(2.0)) if len(left) > 2 else 1.0, 1.0)
    return float(np.sqrt(np.mean(huber_weights(at.left)[: len(left)] * left**2))) / scatter, scatter


def _best_pair(
    arrays: RigArrays, frames: Frames, points_px: np.ndarray, sigma_px: np.ndarray, one: np.ndarray
) -> _Pair | None:
    """The best two contacts of the first frame of `frames`, with points (N, 2) px and their standard deviations
    (N,).

    one : (4,) unknowns of the best single contact, which the gain is counted from. None where no fit was found.
    """
    model = _TwoContactFrame(arrays, frames, points_px, sigma_px)
    settings, every = model.settings, list(range(8)) if arrays.friction_rad > 0.0 else [0, 1, 2, 4, 5, 6]
    model.bend = settings.bend_at_first
    starts, found = model.starts(), list[_TwoContactFit]()
    for first in range(0, len(starts), settings.together):
        for start in starts[first : first + settings.together]:
            model.bend = settings.bend_at_first
            pair = model.descended(start.unknowns, every, settings.first_steps)
            model.bend = settings.bend
            if pair is not None and (fit := model.descended(pair.unknowns, every)) is not None:
                found.append(fit)
        found.sort(key=lambda fit: fit.cost)
        if found and _misfit(found[0])[0] < settings.misfit:
            break
    if not found:
        return None
    at, covariance, by_rig = model.marginal(found[0], every)
    unmoved, (misfit, scatter) = model.unmoved, _misfit(at)
    # the derivatives of the outputs by the unknowns
    step, unknowns = settings.difference, at.unknowns
    trials = np.tile(unknowns, (1 + len(every), 1))
    trials[1 + np.arange(len(every)), every] -= step
    shape = model.shape(trials, model.rig, at.shape.solution[0])
    if shape is None:
        return None
    values = np.array([model.outputs(shape, row, trial) for row, trial in enumerate(trials)])
    slopes = np.column_stack([((values[0] - values[1:]) / step).T, by_rig])
    whole = scatter**2 * slopes @ covariance @ slopes.T
    std = np.sqrt(np.diag(whole))[[0, 7]] / model.arrays.length_m
    other = None
    for fit in found[1:]:
        places = fit.unknowns[[NEAR, FAR]]
        if (np.abs(places - unknowns[[NEAR, FAR]]) > settings.apart_std * std).any():
            again = model.marginal(fit, every)
            away = np.abs(again[0].unknowns[[NEAR, FAR]] - unknowns[[NEAR, FAR]]) > settings.apart_std * std
            if away.any() and again[0].cost < at.cost + settings.alternative * scatter**2:
                other = again[0].unknowns[[NEAR, FAR]] * model.arrays.length_m
                break
    enough = at.cost + settings.clear * settings.gain * scatter**2
    gain = (model.single_cost(one, enough) - at.cost) / scatter**2
    contacts = [settings.steps, 2 * settings.steps]
    free = model.shape(unknowns[None] * ~np.isin(np.arange(8), (1, 2, 5, 6)), model.rig)
    return _Pair(
        unknowns=unknowns,
        points_m=shape.points_m[0, contacts],
        forces_N=shape.forces_N[0],
        tangents=shape.tangents[0, contacts],
        residuals=at.left[len(at.foot) :][: len(model.reading)],
        covariance=whole,
        free_m=shape.points_m[0, contacts] if free is None else free.points_m[0, contacts],
        gain=float(gain),
        misfit=misfit,
        length_m=model.arrays.length_m,
        other=other,
        unmoved=unmoved,
    )


def both_contacts(one: Contact, unknowns: np.ndarray, arrays: RigArrays, batch: Batch) -> list[Contact]:
    """Both contacts of a frame that no single one explains, the nearer one first, where the frame determines them;
    else the single one, with them in its reason. unknowns : (4,) of the single one."""
    settings = _TwoContactsSettings()
    pair = _best_pair(arrays, batch.frames(arrays), batch.points_px[0], batch.sigma_px[0], unknowns)
    if pair is None or (doubt := pair.doubt(settings)):
        return [one if pair is None else replace(one, reason=f"{one.reason}; {doubt}")]
    rig, angles = arrays.rig, (batch.pan_rad[:1], batch.tilt_rad[:1])
    (turn,), (shift,) = rig.kinematics.world_antenna(*angles)
    contacts = []
    for k, first in enumerate((NEAR, FAR)):
        own = pair.covariance[7 * k : 7 * k + 7, 7 * k : 7 * k + 7]
        std, place = np.sqrt(np.diag(own)), pair.unknowns[first]
        # the tip's prior deflection as a force at this place
        widest = settings.bend / 0.01 / (place**2 * (3.0 - place) / 2.0) * arrays.force_unit_N
        known = np.append(True, std[5:] < settings.determined * widest)
        force = np.where(known, pair.forces_N[k], np.nan)
        other = 1e3 * pair.distances_m[1 - k]
        missing = [f"f_{axis}" for axis, there in zip("yz", known[1:], strict=True) if not there]
        words = f"one of two contacts, the other at {other:.1f} mm: the cost of one alone is {pair.gain:.0f} higher"
        contacts.append(
            Contact(
                status=OK,
                in_contact=True,
                model=RUNGS[-1],
                reason="; ".join([words, *([f"{' and '.join(missing)} not determined"] if missing else [])]),
                distance_m=float(pair.distances_m[k]),
                distance_std_m=float(std[0]),
                point_antenna_m=pair.points_m[k],
                point_world_m=turn @ pair.points_m[k] + shift,
                covariance_world_m2=turn @ own[1:4, 1:4] @ turn.T,
                force_N=force,
                force_std_N=np.where(known, std[4:], np.nan),
                force_covariance_yz_N2=float(own[5, 6]) if known.all() else np.nan,
                force_world_N=turn @ force,
                tangent_world=turn @ pair.tangents[k],
                deflection_m=pair.points_m[k] - pair.free_m[k],
                moment_residual_Nm=_moment_residual(arrays, batch, pair),
                friction_angle_rad=float(pair.unknowns[first + 3] * arrays.friction_rad),
                friction_prior_rad=arrays.friction_rad,
                evidence=float(one.evidence) + pair.gain,
                outside_points=one.outside_points,
            )
        )
    return contacts


def _moment_residual(arrays: RigArrays, batch: Batch, pair: _Pair) -> float:
    """Measured moment less that of both contacts, N·m; NaN without a reading."""
    sensor = arrays.rig.moment_sensor
    if not (sensor.exists and np.isfinite(batch.readings_Nm[0, 0])):
        return np.nan
    return float(pair.residuals[0] * arrays.std[0] / sensor.gain)
