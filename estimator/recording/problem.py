"""All frames of a recording in one problem: each frame's contact is its own, the rig's errors are common to all.

About a state the compiled normal equations of every frame are taken apart into what is the frame's own (distance,
force, friction angle, errors of its line) and what frames share (steps along the rig's independent axes, errors of all
lines). The own part is eliminated by the Schur complement, so that the work grows with the number of frames alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from estimator.contact.inputs import Batch
from estimator.contact.settings import ContactSettings
from estimator.solver.linearised import LinearisedFrames, free_antennas, linearised
from estimator.solver.rig_arrays import LINE_ERRORS, UNKNOWNS, RigArrays
from vbaa_calib.antenna.rungs import REFERENCE
from vbaa_calib.antenna.shape import CONTACT
from vbaa_calib.core.arrays import Rows, spread_evenly
from vbaa_calib.core.robust import huber_weights
from vbaa_calib.native import core
from vbaa_calib.rig import Rig
from vbaa_calib.session import KnownObject

from .settings import RefineSettings


def _known_equations(
    known: KnownObject,
    found: LinearisedFrames,
    columns: np.ndarray,
    place: tuple[np.ndarray, np.ndarray],
    antenna_radius_m: np.ndarray,
    shift: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Information (B, K, K) and right side (B, K) from contacts known to lie on a straight pin or edge.

    With a the object's direction, t the antenna's tangent and n ∝ ± a × t, the contact point lies at (r + r_antenna)·n
    from the object's axis, whichever way it slid along it. Of the two equations across a, the one along t determines
    the contact distance.

    columns : (B, 6, K) derivatives of point and force; the last three are by the object's own place. place : rotations
    (B, 3, 3) and translations (B, 3) of the antenna frame. antenna_radius_m : (B,) at the contacts. shift : (3,) of
    the object's place, in deviations.
    """
    rotation, translation = place
    point, force = found.point_force[:, :3], found.point_force[:, 3:]
    world = np.einsum("bij,bj->bi", rotation, point) + translation
    tangent, force = (np.einsum("bij,bj->bi", rotation, each) for each in (found.tangents[:, :, CONTACT], force))
    normal = np.cross(known.direction, tangent)
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = normal / np.where(size > 1e-6, size, np.nan)
    normal *= np.where(np.sum(normal * force, axis=1, keepdims=True) < 0.0, -1.0, 1.0)
    apart = np.nan_to_num((known.radius_m + antenna_radius_m)[:, None] * normal)
    off = world - known.position_m - known.std_m * shift - apart
    across = np.linalg.svd(known.direction[None])[2][1:]
    rows = across @ rotation @ columns[:, :3]
    rows[:, :, -3:] -= known.std_m * across
    rows /= RefineSettings.object_round_m
    return np.swapaxes(rows, 1, 2) @ rows, -np.einsum(
        "bqk,bq->bk", rows, off @ across.T / RefineSettings.object_round_m
    )


@dataclass(frozen=True, eq=False)
class FrictionPrior(Rows):
    """Prior of the friction angles by Coulomb's law."""

    mean_rad: np.ndarray  # (B,)
    std_rad: np.ndarray  # (B,)


@dataclass(frozen=True, eq=False)
class State:
    """Values of all unknowns of a recording."""

    unknowns: np.ndarray  # (B, 4) of the frames as `rig_arrays.UNKNOWNS`
    # (S,) steps along the rig's R axes, the L common errors of all lines, a known object's place (3)
    shared: np.ndarray


@dataclass(frozen=True, eq=False)
class Equations(Rows):
    """Normal equations at a state, with each frame's own unknowns eliminated (Schur complement)."""

    own_covariance: np.ndarray  # (B, 4, 4) of the unknowns, with the shared errors known
    through: np.ndarray  # (B, 4, S) how the unknowns follow the shared steps (with the sign of `schur_complement`)
    step: np.ndarray  # (B, 4) with the shared steps as they are
    information: np.ndarray  # (B, S, S) of the shared steps by each frame, without prior
    side: np.ndarray  # (B, S)
    touch: np.ndarray  # (B, 6) contact point and force, antenna frame
    by_own: np.ndarray  # (B, 6, 4) derivatives of these
    by_shared: np.ndarray  # (B, 6, S)
    tangent: np.ndarray  # (B, 3) of the antenna at the contact
    reading: np.ndarray  # (B,) residual of the moment about y, in deviations
    sound: np.ndarray  # (B,) bool; the others left the model's domain, and say nothing
    # (B, 2) weight of the pictures by this state, and 0 where the antenna's end in them is another thing's
    trust: np.ndarray


@dataclass(frozen=True, eq=False)
class RecordingProblem:
    """Joint least-squares problem of B contacts and F frames of the free antenna, each seen by all cameras."""

    rig: Rig  # as calibrated
    axes: np.ndarray  # (17 + P, R) of the rig's errors (`RigArrays`), including the drift since the calibration
    touching: Batch  # what was measured in the B contacts,
    free: Batch  # and in the F frames
    free_s: np.ndarray  # (F,)
    friction_rad: float  # unit of the friction angle among the unknowns
    fixed_at_tip: np.ndarray  # (B,) bool, distances that are fixed at the tip
    friction: FrictionPrior  # what is known of the friction angles
    time_s: np.ndarray  # (B,) NaN where not known
    known: KnownObject | None = None  # the object that is touched, where it is known

    def picked(self, rows: np.ndarray, most_free: int) -> RecordingProblem:
        """The problem with only these contacts, and at most `most_free` free frames."""
        quiet = spread_evenly(len(self.free), most_free)
        return replace(
            self,
            touching=self.touching.picked(rows),
            free=self.free.picked(quiet),
            free_s=self.free_s[quiet],
            fixed_at_tip=self.fixed_at_tip[rows],
            friction=self.friction.picked(rows),
            time_s=self.time_s[rows],
        )

    @staticmethod
    def _with_lines(arrays: RigArrays) -> RigArrays:
        """The arrays with the next Legendre polynomials as further errors of the lines, common to all frames and too
        small for a single one to show."""
        drift, line = arrays.rig.drift, arrays.line
        part = drift.line_px / max(math.hypot(drift.line_px, drift.light_px), 1e-300)
        return replace(arrays, line=np.hstack([line, part * line[:, : RefineSettings.finer_errors]]))

    @cached_property
    def lines(self) -> int:
        """Number L of error terms of the detected lines of one frame, all cameras together."""
        return self._with_lines(RigArrays.from_rig(self.rig, self.friction_rad)).line.size

    @property
    def size(self) -> int:
        """Number S of shared steps."""
        return self.axes.shape[1] + self.lines + (0 if self.known is None else 3)

    def rig_at(self, shared: np.ndarray) -> Rig:
        """The rig after the shared steps (S,), of which the first R are its own."""
        return self.rig.moved(self.axes @ shared[: self.axes.shape[1]])

    def arrays_at(self, shared: np.ndarray) -> RigArrays:
        """The rig after the shared steps in the solver's form; its axes are unchanged."""
        arrays = RigArrays.from_rig(self.rig_at(shared), self.friction_rad)
        return replace(self._with_lines(arrays), axes=self.axes)

    def equations(self, state: State, trust: np.ndarray | None = None) -> Equations:
        """Normal equations of the contacts, linearised at a state.

        trust : (B, 2) fixed weights, as `Equations.trust`. By default, and where NaN, they follow from the state, and
        jump where a frame's scatter or end passes a threshold.
        """
        rig = self.arrays_at(state.shared), self._split()
        begins = range(0, max(len(self.touching), 1), RefineSettings.chunk)
        parts = [self._of_chunk(*rig, state, slice(begin, begin + RefineSettings.chunk), trust) for begin in begins]
        return Equations.joined(parts)

    def free_equations(self, state: State) -> tuple[np.ndarray, np.ndarray]:
        """Information (F, S, S) and right side (F, S) of the frames of the free antenna on the shared steps."""
        own, size = self.lines, self.size
        information, side = [np.zeros((0, size, size))], [np.zeros((0, size))]
        arrays, split = self.arrays_at(state.shared), self._split()[UNKNOWNS:]
        mine, others = slice(UNKNOWNS, UNKNOWNS + own), slice(UNKNOWNS + own, None)
        for begin in range(0, len(self.free), RefineSettings.chunk):
            found = free_antennas(self.free.picked(slice(begin, begin + RefineSettings.chunk)).frames(arrays))
            steps = found.information.shape[1]
            whole = split.T @ (found.information - np.eye(steps)) @ split
            right = found.side @ split
            whole[:, mine, mine] += np.eye(own)
            through = np.linalg.solve(whole[:, mine, mine], whole[:, mine, others])
            information.append(whole[:, others, others] - whole[:, others, mine] @ through)
            side.append(right[:, others] - np.einsum("bks,bk->bs", through, right[:, mine]))
        return np.concatenate(information), np.concatenate(side)

    def _split(self) -> np.ndarray:
        """(4 + R + L, 4 + L + S) matrix from own and shared unknowns to a frame's unknowns, rig steps and errors of
        its lines. Of a line's errors one part is the frame's own and another is common to all frames, as by a lamp
        that moved; those of the finer polynomials are common."""
        rig, count = self.axes.shape[1], self.lines
        own, shared = UNKNOWNS + rig, UNKNOWNS + count
        split = np.zeros((own + count, shared + self.size))
        split[:UNKNOWNS, :UNKNOWNS] = np.eye(UNKNOWNS)
        split[UNKNOWNS:own, shared : shared + rig] = np.eye(rig)
        if count:
            drift = self.rig.drift
            whole = np.hypot(drift.line_px, drift.light_px)
            finer = np.arange(count) % (LINE_ERRORS + RefineSettings.finer_errors) >= LINE_ERRORS
            split[own:, UNKNOWNS:shared] = np.diag(np.where(finer, 0.0, drift.line_px / whole))
            common = slice(shared + rig, shared + rig + count)
            split[own:, common] = np.diag(np.where(finer, 1.0, drift.light_px / whole))
        return split

    @staticmethod
    def _data(found: LinearisedFrames, unknowns: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Information and right side of the measurements alone, without the solver's priors. ends : (B,) 0 where the
        antenna's end is something else's."""
        whole, side = found.information.copy(), found.side.copy()
        diagonal = np.arange(whole.shape[1])
        whole[:, diagonal, diagonal] -= found.prior
        side[:, :UNKNOWNS] += found.prior[:, :UNKNOWNS] * unknowns
        end, off = found.readings[:, 2], found.residual[:, 2]
        weight = np.where(ends > 0.0, 0.0, huber_weights(off))
        whole -= (weight[:, None] * end)[:, :, None] * end[:, None]
        side -= (weight * off)[:, None] * end
        return whole, side

    def _of_chunk(
        self, arrays: RigArrays, split: np.ndarray, state: State, rows: slice, trust: np.ndarray | None
    ) -> Equations:
        """The equations of some rows; the arguments as those of `equations`."""
        unknowns, batch, prior = state.unknowns[rows], self.touching.picked(rows), self.friction.picked(rows)
        own, shared = slice(0, UNKNOWNS + self.lines), slice(UNKNOWNS + self.lines, None)
        found = linearised(batch.frames(arrays), REFERENCE, unknowns)
        trusted = _trust(batch, found)
        kept = trusted if trust is None else np.where(np.isnan(trust[rows]), trusted, trust[rows])
        scale, ends = kept.T
        whole, side = self._data(found, unknowns, ends)
        whole, side = scale[:, None, None] * (split.T @ whole @ split), scale[:, None] * (side @ split)
        touch_columns = found.columns @ split
        if self.known is not None:
            place = self.rig.kinematics.world_antenna(batch.pan_rad, batch.tilt_rad)
            radius_m = self.rig.antenna.radius_at(unknowns[:, 0] * arrays.length_m)
            more = _known_equations(self.known, found, touch_columns, place, radius_m, state.shared[-3:])
            whole, side = whole + more[0], side + more[1]
        diagonal = np.arange(UNKNOWNS + self.lines)
        weight, pull = np.zeros((2, len(unknowns), len(diagonal)))
        weight[:, 1:3] = found.prior[:, 1:3]
        pull[:, 1:3] = -found.prior[:, 1:3] * unknowns[:, 1:3]
        ratio = self.friction_rad / prior.std_rad
        weight[:, 3] = ratio**2
        pull[:, 3] = ratio**2 * (prior.mean_rad / self.friction_rad - unknowns[:, 3])
        weight[:, UNKNOWNS:] = 1.0
        whole[:, diagonal, diagonal] += weight
        side[:, own] += pull
        sound = np.isfinite(whole).all(axis=(1, 2)) & np.isfinite(side).all(axis=1)
        sound &= _determined(np.where(sound[:, None, None], whole[:, own, own], 0.0))
        whole[~sound], side[~sound] = np.eye(whole.shape[1]), 0.0
        mine = whole[:, own, own]
        fixed = mine.copy()
        # a distance that is fixed at the tip
        fixed[self.fixed_at_tip[rows], 0, 0] += 1e12 * np.maximum(mine[self.fixed_at_tip[rows], 0, 0], 1.0)
        scale = 1.0 / np.sqrt(np.einsum("bii->bi", fixed))
        inverse = np.linalg.inv(fixed * scale[:, :, None] * scale[:, None, :]) * scale[:, :, None] * scale[:, None, :]
        through = inverse @ whole[:, own, shared]
        step = np.einsum("bij,bj->bi", inverse, side[:, own])
        information = sound[:, None, None] * (whole[:, shared, shared] - whole[:, shared, own] @ through)
        # a distance at the tip gets the deviation that it would have if it were free, and how far off it would be then
        free = np.linalg.inv(mine * scale[:, :, None] * scale[:, None, :]) * scale[:, :, None] * scale[:, None, :]
        to_free = np.einsum("bij,bj->bi", free, side[:, own])
        to_free *= (self.fixed_at_tip[rows] & (to_free[:, 0] < 0.0))[:, None]
        free = free + to_free[:, :, None] * to_free[:, None, :]
        return Equations(
            own_covariance=free[:, :UNKNOWNS, :UNKNOWNS],
            through=through[:, :UNKNOWNS],
            step=step[:, :UNKNOWNS],
            information=0.5 * (information + np.swapaxes(information, 1, 2)),
            side=side[:, shared] - np.einsum("bks,bk->bs", through, side[:, own]),
            touch=found.point_force,
            by_own=touch_columns[:, :, :UNKNOWNS],
            by_shared=touch_columns[:, :, shared],
            tangent=found.tangents[:, :, CONTACT],
            reading=found.residual[:, 0],
            sound=sound,
            trust=trusted,
        )


def _trust(taken: Batch, found: LinearisedFrames) -> np.ndarray:
    """(B, 2) weights `Equations.trust`: of the points, below 1 where they scatter more than noise does; and of the
    antenna's end, 1 where that can be the antenna's, else 0."""
    points = np.maximum(np.isfinite(taken.points_px).all(axis=-1).sum(axis=1), 1)
    scatter = np.where(points > 1, found.excess, 1.0)  # a camera that saw nothing has none
    more = scatter > 1.0 + core.solver.EXCESS_SCATTER / np.sqrt(points)
    return np.stack(
        [
            np.where(more, 1.0 / np.maximum(scatter, 1.0), 1.0),
            np.abs(found.residual[:, 2]) <= ContactSettings.outlying_end,
        ],
        axis=1,
    )


def _determined(information: np.ndarray) -> np.ndarray:
    """(B,) mask of the normal equations (B, K, K) that are solvable within rounding."""
    diagonal = np.einsum("bii->bi", information)
    positive = (diagonal > 0.0).all(axis=1)
    scale = 1.0 / np.sqrt(np.where(positive[:, None], diagonal, 1.0))
    return positive & (np.linalg.eigvalsh(information * scale[:, :, None] * scale[:, None, :])[:, 0] > 1e-13)
