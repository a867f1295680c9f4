"""Evidence of some frames of a recording together for a rig and readings, as reported or as a hypothesis has them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from estimator.contact.inputs import Batch
from estimator.solver.frames import Frames
from estimator.solver.ladder import solve
from estimator.solver.linearised import free_antennas, linearised
from estimator.solver.numbers import FitNumbers
from estimator.solver.rig_arrays import UNKNOWNS, RigArrays
from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.core.least_squares import score_test
from vbaa_calib.geometry.covariance import variance_along
from vbaa_calib.rig import Rig

from .settings import RecordingSettings


@dataclass(frozen=True, eq=False)
class Recorded:
    """Some frames of a recording, with the readings of the rows around them.

    Attributes
    ----------
    rig : as calibrated, or as a hypothesis has it.
    batch : the F frames.
    around : (F, 2, K, 8) all readings, pan and tilt of the K rows before and of the K rows after, the nearest
        first; NaN where there is none.
    order : (F,) number of each frame in the recording.
    period_s : usual time between rows; NaN where they have none, or are no series in time.
    later : from which frame on the rig is another one, and that rig.
    """

    rig: Rig
    batch: Batch
    around: np.ndarray
    order: np.ndarray
    period_s: float = np.nan
    later: tuple[int, Rig] | None = None
    friction_rad: float = RecordingSettings.friction_rad

    def picked(self, rows: np.ndarray) -> Recorded:
        """Some of the frames, by their indices in order."""
        later = None if self.later is None else (int(np.sum(rows < self.later[0])), self.later[1])
        some = self.batch.picked(rows)
        return replace(self, batch=some, around=self.around[rows], order=self.order[rows], later=later)

    def __len__(self) -> int:
        return len(self.order)

    def with_readings(self, **columns: Any) -> Recorded:
        """The frames with changed columns of the batch."""
        return replace(self, batch=replace(self.batch, **columns))

    @cached_property
    def without_moments(self) -> Recorded:
        """The frames without the moment sensors' readings."""
        return self.with_readings(readings_Nm=np.full_like(self.batch.readings_Nm, np.nan))

    @property
    def log_density_of_none(self) -> float:
        """Log density of a moment that may lie anywhere in the range of the readings, relative to one that fits."""
        read, std = self.batch.readings_Nm[:, 0], self.rig.moment_sensor.std_Nm
        there = read[np.isfinite(read)]
        if not len(there):
            return 0.0
        spread = max(float(np.ptp(there)), std * RecordingSettings.varies_std)
        return -float(np.log(spread / (2.5 * std)))

    def with_rig(self, rig: Rig, first: int = 0) -> Recorded:
        """The frames with another rig from one frame on."""
        return replace(self, later=(first, rig)) if first else replace(self, rig=rig)

    @property
    def parts(self) -> list[tuple[np.ndarray, Rig]]:
        """Indices of the frames with the same rig, and that rig."""
        every = np.arange(len(self))
        if self.later is None:
            return [(every, self.rig)]
        first, rig = self.later
        both = (every[:first], self.rig), (every[first:], rig)
        return [(rows, own) for rows, own in both if len(rows)]

    @cached_property
    def fit(self) -> _Fitted:
        """The frames' independent fits, with their information on the rig."""
        return _Fitted(self)


# many hypotheses are about readings, and have the same rig
_arrays = lru_cache(maxsize=8)(RigArrays.from_rig)


class _Fitted:
    """Fits of recorded frames, each as the free antenna or one contact, whichever is likelier."""

    def __init__(self, recorded: Recorded) -> None:
        self.recorded = recorded
        self.numbers = FitNumbers.empty(len(recorded))
        self.points = np.zeros(len(recorded))
        self.parts = []
        for rows, rig in recorded.parts:
            frames = recorded.batch.picked(rows).frames(_arrays(rig, recorded.friction_rad))
            self.parts.append((rows, frames))
            self.points[rows] = frames.usable.sum(axis=-1)
            self.numbers.put(rows, solve(frames, RUNGS[-1], minima_only=True))
        numbers = self.numbers
        touched = numbers.cost + self.points * np.log(np.maximum(numbers.scatter, 1.0))
        alone = touched + np.maximum(numbers.evidence, 0.0)
        lost = ~numbers.finite | np.isfinite(numbers.left_px) | ~np.isfinite(touched)
        self.touched = np.where(lost, np.inf, touched + RecordingSettings.contact)
        self.alone = np.where(np.isfinite(alone) & ~lost, alone, np.inf)

    @property
    def steps(self) -> int:
        """Number R of the rig's axes."""
        return self.parts[0][1].rig_arrays.axes.shape[1]

    @property
    def free(self) -> np.ndarray:
        """(F,) mask of the frames that the free antenna explains as well as a contact."""
        return np.asarray(self.alone <= self.touched)

    @property
    def cost(self) -> np.ndarray:
        """(F,) cost of each frame alone; infinite where nothing explains it."""
        return np.minimum(self.alone, self.touched)

    @cached_property
    def moments(self) -> tuple[np.ndarray, np.ndarray]:
        """(F,) predicted moments about y, and their standard deviations without the sensor's noise, for frames that
        were fitted without it. Infinite where the picture allows a mirror image."""
        expected, own = np.full((2, len(self.recorded)), np.inf)
        for rows, frames in self.parts:
            expected[rows], own[rows] = self._moments(rows, frames)
        return expected, own

    def _moments(self, rows: np.ndarray, frames: Frames) -> tuple[np.ndarray, np.ndarray]:
        weak, free, arrays = 1e-6, self.free[rows, None], frames.rig_arrays
        frames = frames.with_available(weak, frames.ends)
        size, std = UNKNOWNS + arrays.steps, arrays.std[0]
        unknowns = np.where(free, [0.5, 0.0, 0.0, 0.0], self.numbers.unknowns[rows])
        found = linearised(frames, RUNGS[-1], unknowns)
        slopes, information = found.readings[:, 0, :size] / weak, found.information
        fixed = np.where(free & (np.arange(size) < UNKNOWNS), 1e12, 0.0)
        information = information + fixed[:, :, None] * np.eye(size)
        sound = np.isfinite(information).all(axis=(1, 2)) & np.isfinite(slopes).all(axis=1)
        inverse = np.linalg.inv(np.where(sound[:, None, None], information, np.eye(size)))
        variance = variance_along(inverse, slopes)
        sound &= np.isfinite(self.cost[rows]) & (self.free[rows] | ~self.numbers.ambiguous[rows])
        return -std * found.residual[:, 0] / weak, np.where(sound, std * np.sqrt(np.maximum(variance, 0.0)), np.inf)

    def shared(self, more: np.ndarray, as_free: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """(F, S, S) information and (F, S) score of each frame on the rig's R axes and `more` (17 + P, Q) ones,
        without priors, with the frame's own unknowns eliminated. as_free : (F,) mask of the frames that count as
        free."""
        free, count = self.free if as_free is None else as_free, self.steps + more.shape[1]
        information, score = np.zeros((len(free), count, count)), np.zeros((len(free), count))
        for part, frames in self.parts:
            arrays = frames.rig_arrays
            wide = replace(arrays, axes=np.ascontiguousarray(np.hstack([arrays.axes, more])))
            for own, touched in ((free[part], False), (~free[part], True)):
                if own.any():
                    some = replace(frames.picked(np.flatnonzero(own)), rig_arrays=wide)
                    information[part[own]], score[part[own]] = self._about_rig(part[own], some, touched)
        return information, score

    def _about_rig(self, rows: np.ndarray, frames: Frames, touched: bool) -> tuple[np.ndarray, np.ndarray]:
        """`shared` for some frames that are all free, or all touched."""
        count = frames.rig_arrays.axes.shape[1]
        if touched:
            found = linearised(frames, RUNGS[-1], self.numbers.unknowns[rows])
            whole, side, kept = found.information.copy(), found.side, np.arange(UNKNOWNS, UNKNOWNS + count)
            whole[:, kept, kept] -= found.prior[:, kept]
        else:
            alone = free_antennas(frames)
            whole, side, kept = alone.information.copy(), alone.side, np.arange(count)
            whole[:, kept, kept] -= 1.0
        own = np.setdiff1d(np.arange(whole.shape[1]), kept)
        scale = np.maximum(self.numbers.scatter[rows], 1.0) ** -2.0
        left, right = _eliminated(whole, side, kept, own)
        sound = np.isfinite(left).all(axis=(1, 2)) & np.isfinite(right).all(axis=1)
        left = np.where(sound[:, None, None], scale[:, None, None] * left, 0.0)
        return left, np.where(sound[:, None], scale[:, None] * right, 0.0)


def _eliminated(
    whole: np.ndarray, side: np.ndarray, kept: np.ndarray, own: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Normal equations (B, K, K), (B, K) of the unknowns `kept`, with the others eliminated."""
    if not len(own):
        return whole[:, kept[:, None], kept], side[:, kept]
    diagonal = np.einsum("bii->bi", whole)[:, own]
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    inner = whole[:, own[:, None], own] * scale[:, :, None] * scale[:, None, :]
    across = whole[:, own[:, None], kept] * scale[:, :, None]
    good = np.asarray(np.isfinite(inner).all(axis=(1, 2)))
    inverse = np.linalg.pinv(np.where(good[:, None, None], inner, np.eye(len(own))), 1e-12, True)
    through = inverse @ across
    left = whole[:, kept[:, None], kept] - np.swapaxes(across, 1, 2) @ through
    right = side[:, kept] - np.einsum("bok,bo->bk", through, side[:, own] * scale)
    good &= np.isfinite(left).all(axis=(1, 2))
    return np.where(good[:, None, None], left, np.nan), np.where(good[:, None], right, np.nan)


@dataclass(frozen=True, eq=False)
class _Weighed:
    """The joint explanation of frames with one rig.

    Attributes
    ----------
    costs : (F,) above that of each frame's best explanation, at most `RecordingSettings.most`.
    steps : (R,) of the rig's axes, in their standard deviations.
    each : (F, S, S), (F, S) information and score of each frame about the rig's axes and those asked for, weighted,
        without prior.
    """

    costs: np.ndarray
    steps: np.ndarray
    each: tuple[np.ndarray, np.ndarray]

    @property
    def cost(self) -> float:
        """Cost of all frames and of the rig's steps."""
        return float(self.costs.sum() + 0.5 * self.steps @ self.steps)

    def about_others(self, by: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Information (Q, Q) and score (Q,) on the additional axes, with the rig's own eliminated.

        by : (F, Q) how much of a step along each a frame has; None: all of it.
        """
        size, (information, pull) = len(self.steps), self.each
        share = np.ones((len(pull), pull.shape[1] - size)) if by is None else by
        across = np.einsum("fq,fqr->qr", share, information[:, size:, :size])
        own = np.einsum("fq,fp,fqp->qp", share, share, information[:, size:, size:])
        whole, side = information[:, :size, :size].sum(axis=0), pull[:, :size].sum(axis=0)
        through = np.linalg.solve(whole + np.eye(size), np.column_stack([across.T, side]))
        left = own - across @ through[:, :-1]
        return 0.5 * (left + left.T), (share * pull[:, size:]).sum(axis=0) - across @ through[:, -1]


def weighed(
    fits: _Fitted,
    best: np.ndarray,
    scale: np.ndarray,
    more: np.ndarray | None = None,
    as_free: np.ndarray | None = None,
    log_density: float | np.ndarray = 0.0,
) -> _Weighed:
    """The frames' joint explanation, robustly. best, scale : (F,) least cost of each frame, and its noise scale.

    more : (18 + P, Q) further axes about which information is wanted. as_free : as `_Fitted.shared`. log_density : of a
    frame's readings in the reported unit over that in their own; a frame that nothing explains has none.
    """
    settings, size = RecordingSettings, fits.steps
    none = np.zeros((len(fits.parts[0][1].rig_arrays.axes), 0))
    information, score = fits.shared(none if more is None else more, as_free)
    own, pull = information[:, :size, :size], score[:, :size]
    cost = fits.cost if as_free is None else np.where(as_free, fits.alone, fits.touched)
    # of the frame by itself the rig had its prior: here all frames have it together
    alone = 0.5 * np.einsum("bs,bs->b", pull, np.linalg.solve(own + np.eye(size), pull[..., None])[..., 0])
    base = np.where(np.isfinite(cost), (cost + alone - best) / scale, np.inf)

    def costs_at(steps: np.ndarray) -> np.ndarray:
        return np.asarray(base + (0.5 * np.einsum("bij,i,j->b", own, steps, steps) - pull @ steps) / scale)

    def clipped(steps: np.ndarray) -> np.ndarray:
        return np.minimum(np.maximum(costs_at(steps), 0.0) - log_density, settings.most)

    steps, weights = np.zeros(size), np.ones(len(cost))
    for _ in range(settings.reweightings):
        costs = costs_at(steps)
        # where all are far off, those that are less so lead to the others
        usual = max(settings.most, float(np.median(costs[np.isfinite(costs)]))) if np.isfinite(costs).any() else 1.0
        weights = np.where(np.isfinite(costs), 1.0 / (1.0 + np.maximum(costs, 0.0) / usual) ** 2, 0.0) / scale
        before = steps
        steps = np.linalg.solve(np.einsum("b,bij->ij", weights, own) + np.eye(size), weights @ pull)
        if np.abs(steps - before).max(initial=0.0) < 1e-3:
            break

    # far from where the frames are linear, steps may lead nowhere
    if not clipped(steps).sum() + 0.5 * steps @ steps < clipped(0.0 * steps).sum():
        steps = 0.0 * steps
    each = weights[:, None, None] * information, weights[:, None] * score
    return _Weighed(clipped(steps), steps, each)


@dataclass(frozen=True, eq=False)
class Case:
    """Recorded frames as reported, with which any explanation of them is compared.

    best, scale : (F,) least cost of each frame, with a rig that may have changed in everything and without its moment;
        and by how much its points scatter more than their standard deviations say, squared.
    free : (F,) bool, frames that the free antenna of such a rig explains; all where there are hardly any.
    axes : (18 + P, Q) along which the rig may have changed.
    """

    recorded: Recorded
    best: np.ndarray
    scale: np.ndarray
    free: np.ndarray
    axes: np.ndarray

    @staticmethod
    def of(recorded: Recorded, axes: np.ndarray) -> Case:
        """The case of frames with a rig that may have changed along axes (18 + P, Q)."""
        expected = 0.5 * np.maximum(recorded.fit.points, 1.0)
        rig = recorded.rig
        wide = rig.with_covariance(rig.covariance_with_tip + axes @ axes.T)
        changed = recorded.without_moments.with_rig(wide).fit
        least = np.minimum(changed.cost, recorded.fit.cost)
        free = changed.free & np.isfinite(changed.alone)
        best = np.where(np.isfinite(least), least, expected)
        if free.sum() < RecordingSettings.fewest_after:
            free = np.ones_like(free)
        return Case(recorded, best, np.clip(best / expected, 1.0, None), free, axes)

    def explained_by(self, recorded: Recorded) -> Case:
        """The case of the same frames with other readings, or another rig."""
        return replace(self, recorded=recorded)

    def picked(self, rows: np.ndarray) -> Case:
        """The case restricted to some of the frames."""
        best, scale, free = self.best[rows], self.scale[rows], self.free[rows]
        return replace(self, recorded=self.recorded.picked(rows), best=best, scale=scale, free=free)

    @cached_property
    def reported(self) -> _Weighed:
        """The fit with everything as reported."""
        return weighed(self.recorded.fit, self.best, self.scale, self.axes)

    @property
    def frees(self) -> list[np.ndarray]:
        """Alternative masks (F,) of the frames that may be free on a changed rig: those of `free`, and, where many
        are unexplained, all."""
        return [self.free, np.ones_like(self.free)] if self.many_lost and not self.free.all() else [self.free]

    @cached_property
    def as_free(self) -> list[_Weighed]:
        """The joint explanation with the free antenna in each of `frees`, in which a common change stands out at any
        distance from the rig."""
        return [weighed(self.recorded.fit, self.best, self.scale, self.axes, free) for free in self.frees]

    def by_one(self, axes: np.ndarray, first: int) -> list[np.ndarray]:
        """Candidate changes (K,) along axes (18 + P, K): for each single frame from `first` on the change with which it
        shows the free antenna; sorted by how well the other frames agree with it, to first order."""
        size = self.recorded.fit.steps
        every, unit = np.ones(len(self.recorded), bool), np.eye(size + axes.shape[1])
        information, score = (each[first:] for each in self.recorded.fit.shared(axes, every))
        inverse = np.linalg.inv(information + unit)
        steps = np.einsum("jst,jt->js", inverse, score)
        left = score - np.einsum("jst,it->ijs", information, steps)
        apart = np.minimum(0.5 * np.einsum("ijs,jst,ijt->ij", left, inverse, left), RecordingSettings.most)
        best = np.argsort(apart.sum(axis=1) + 0.5 * (steps**2).sum(axis=1))[: RecordingSettings.seeds]
        return [steps[one, size:] for one in best.tolist()]

    @property
    def sound(self) -> bool:
        """Whether the frames' common cost is as small as if everything were as reported."""
        return self.cost < RecordingSettings.sound_cost * len(self.recorded)

    @property
    def usual(self) -> bool:
        """Whether the frames' cost is that of most recordings in which everything is as reported."""
        return self.cost < RecordingSettings.usual * len(self.recorded)

    @property
    def beyond_usual(self) -> float:
        """Log odds that something is wrong, whatever it is, over all being as reported."""
        settings = RecordingSettings
        return self.cost - settings.usual * len(self.recorded) - settings.vague

    @cached_property
    def changed(self) -> bool:
        """Whether the rig seems to have changed along any of its axes, to first order."""
        each, whole = range(self.axes.shape[1]), self.since(0, 1)
        return any(one > RecordingSettings.suspicious for axis in each for one in self.gained(np.array([axis]), whole))

    @property
    def splits(self) -> list[int]:
        """Frames from which on the rig may have changed: the first one, and those at which frames cease to be
        explained."""
        count, settings = len(self.recorded), RecordingSettings
        if not self.many_lost:
            return [0, *np.unique(np.linspace(0, count, settings.splits + 2)[1:-1].astype(int)).tolist()]
        excess = np.cumsum((self.reported.costs - 2.0 * settings.sound_cost)[::-1])[::-1]
        first = int(np.argmax(excess))
        return [first, 0] if settings.fewest_after <= first <= count - settings.fewest_after else [0]

    @property
    def many_lost(self) -> bool:
        """Whether more frames are unexplained than chance and second contacts account for."""
        return float(np.mean(self.lost)) > RecordingSettings.lost

    @property
    def lost(self) -> np.ndarray:
        """(F,) mask of the frames that nothing explains."""
        return np.asarray(self.reported.costs > 0.9 * RecordingSettings.most)

    def since(self, first: int, count: int) -> np.ndarray:
        """(F, count) how much of as many steps a frame has that hold from the frame `first` on."""
        return np.repeat(np.arange(len(self.recorded))[:, None] >= first, count, axis=1).astype(float)

    def gained(self, columns: np.ndarray, by: np.ndarray) -> Iterator[float]:
        """First-order log evidence of a change along these axes (K indices), of which each frame has as much as `by`
        (F, K) says. Where the frames fit worse than usual, a second value for the part that most frames share."""
        for together in (self.reported,) if self.usual else (self.reported, *self.as_free):
            size = len(together.steps)
            which = np.append(np.arange(size), size + columns)
            information, score = together.each
            some = replace(together, each=(information[:, which[:, None], which], score[:, which]))
            found = score_test(*some.about_others(by), 1.0)
            if found is not None:
                yield found.log_evidence

    @property
    def cost(self) -> float:
        """The cost with everything as reported."""
        return self.reported.cost

    def cost_of(self, other: Recorded, log_density: float | np.ndarray = 0.0) -> float:
        """The cost of the same frames with other readings, or another rig."""
        return self.together(other, log_density).cost

    def together(self, other: Recorded, log_density: float | np.ndarray = 0.0) -> _Weighed:
        """The joint explanation of the same frames with other readings, or another rig."""
        return weighed(other.fit, self.best, self.scale, log_density=log_density)

    def with_missing(self, other: Recorded) -> _Weighed:
        """The joint explanation of the same frames with other readings, of which some may be missing."""
        lost = np.isfinite(self.recorded.batch.readings_Nm[:, 0]) & np.isnan(other.batch.readings_Nm).all(axis=1)
        return self.together(other, lost * self.recorded.log_density_of_none)

    def gained_by(self, other: Recorded, log_density: float | np.ndarray = 0.0) -> float:
        """By how much the frames cost less with other readings or another rig, apart from the frame that gains most."""
        found = self.together(other, log_density)
        return self.cost - found.cost - self.of_one(found)

    def of_one(self, found: _Weighed) -> float:
        """Largest decrease of a single frame's cost by another explanation; 0 where there is only one frame.

        Hypotheses about all frames do not count it: the fit of one frame may just have ended in another minimum."""
        return float(np.max(self.reported.costs - found.costs, initial=0.0)) if len(found.costs) > 1 else 0.0
