"""`vbaa bench recording`: recordings refined as one, and frame by frame, against the truth and against their bound.

Recordings are the static rod's with Coulomb friction (`benchmarks.object.scenes`); each draw has a rig that is off by
one draw of its calibration's covariance, and noise of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np

from benchmarks.estimator.setup import drawn_truth
from benchmarks.harness import Draws, Findings, Options, column, covered, picked, rms, row_of, table, timed
from benchmarks.object.scenes import RIGID, SETUP, SOFT, Recorded, contacts, played
from estimator.recording import refine
from estimator.recording.problem import FrictionPrior
from estimator.recording.refined import _begun as begun
from estimator.table.contacts import ContactTable, Measured
from vbaa_calib.core.console import progress
from vbaa_calib.rig import Rig

_WORSE = 0.2
"""Deviations by which a refined distance may be farther off than the frame-wise one."""
_KNOWN_ANGLE_RAD = 1e-3
"""The bound's friction angle: known."""
PLAYED = 296
"""Frames of a recording as it is played; longer ones repeat it with other noise, shorter ones are its first frames."""


@dataclass(frozen=True)
class Cell:
    """An object under one condition, and how many frames touch it."""

    case: str
    stiffness_N_m: float
    friction: float
    frames: int = PLAYED


CELLS = (
    *(Cell(name, RIGID, mu) for name in ("sphere", "cylinder") for mu in (0.0, 0.1, 0.3, 0.6)),
    Cell("box edge", RIGID, 0.3),
    Cell("free form", RIGID, 0.3),
    Cell("sphere", SOFT, 0.3),
    Cell("cylinder", SOFT, 0.1),
    Cell("sphere", RIGID, 0.3, 60),
    Cell("cylinder", RIGID, 0.3, 60),
    Cell("sphere", RIGID, 0.1, 2000),
    Cell("cylinder", RIGID, 0.3, 2000),
)


def _square(errors: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum(errors**2, axis=-1)))) if len(errors) else float("nan")


@dataclass(frozen=True)
class RecordingRow:
    """One cell over its draws; of the contact points in the world, rms. `bound` : of the recording, with the friction
    angle known. `worse` : share of frames that are farther off than frame by frame by more than 0.2 deviations.

    *_covered : shares of 95 % intervals that contain the truth, over rigs. `unrefined` : share of draws that were not
        refined.
    """

    object: str = column("object")
    stiffness_N_m: float = column("k N/m", ".0f")
    friction: float = column("μ", ".1f")
    recorded: int = column("frames", "d")
    draws: int = column("draws", "d", of=len)
    framewise_mm: float = column("frame-wise mm", ".2f", of=lambda d: 1e3 * _square(d.point_m))
    refined_mm: float = column("refined mm", ".2f", of=lambda d: 1e3 * _square(d.refined_m))
    ratio: float = column("ratio", ".2f", of=lambda d: _square(d.refined_m) / _square(d.point_m))
    of_bound: float = column("× bound", ".2f", of=lambda d: _square(d.refined_m) / rms(d.bound_m))
    point_covered: float = column("point covered %", ".1f", 100.0, of=lambda d: covered(d.point_off))
    distance_covered: float = column("l covered %", ".1f", 100.0, of=lambda d: covered(d.distance_off))
    force_covered: float = column("f covered %", ".1f", 100.0, of=lambda d: covered(d.force_off))
    worse: float = column("worse %", ".1f", 100.0, of=lambda d: float(d.worse.mean()))
    foreign: float = column("foreign", ".1f", of=lambda d: float(d.foreign.mean()))
    unrefined: float = column("unrefined %", ".0f", 100.0, of=lambda d: float(d.unrefined.mean()))
    mu_determined: float = column("μ determined", ".2f", of=lambda d: float(d.mu_determined.mean()))
    mu_covered: float = column("covered", ".2f", of=lambda d: float(d.mu_covered.mean()))
    frame_ms: float = column("ms a frame", ".2f", of=lambda d: 1e3 * float(d.seconds.sum()) / float(d.frames.sum()))


def lengthened(recorded: Recorded, frames: int) -> Recorded:
    """The first frames of a recording, or the recording over and over, without noise yet."""
    rows, turns = np.arange(frames) % len(recorded), np.arange(frames) // len(recorded)
    pause = recorded.time_s[-1] + 1.0
    taken = {name: getattr(recorded, name)[rows] for name in ("pan_rad", "tilt_rad", "centrelines_px", "moment_Nm")}
    return replace(
        recorded,
        **taken,
        time_s=recorded.time_s[rows] + pause * turns,
        stroke=recorded.stroke[rows] + (recorded.stroke.max() + 1) * turns,
        T_world_antenna=[recorded.T_world_antenna[row] for row in rows.tolist()],
        truth=picked(recorded.truth, rows),
    )


def measured(recorded: Recorded) -> list[Measured]:
    """What the frames offer to a fit."""
    sigma = np.full(recorded.centrelines_px.shape[1], recorded.sigma_px)
    columns = recorded.moment_Nm, recorded.pan_rad, recorded.tilt_rad, recorded.time_s
    return [
        Measured(line, sigma, float(moment), float(pan), float(tilt), time_s=float(at))
        for line, moment, pan, tilt, at in zip(recorded.centrelines_px, *columns, strict=True)
    ]


def _true_table(given: ContactTable, recorded: Recorded) -> ContactTable:
    """The contacts as they are."""
    truth = recorded.truth
    along = (truth.force_world_N * truth.tangent_world).sum(axis=1)
    angle = -np.arcsin(along / np.maximum(np.linalg.norm(truth.force_world_N, axis=1), 1e-12))
    return replace(
        given,
        distance_m=truth.distance_m,
        force_y_N=truth.force_antenna_N[:, 1],
        force_z_N=truth.force_antenna_N[:, 2],
        friction_angle_rad=np.nan_to_num(angle),
    )


def bound_m(
    table: ContactTable, recorded: Recorded, lines: Sequence[Measured], rows: np.ndarray, other: Rig | None = None
) -> np.ndarray:
    """(P,) the joint Cramér–Rao bound of the contact points in these rows, their three coordinates together: about the
    true contacts and the true rig, with the friction angle known. other : a second camera's true rig, called other."""
    known = FrictionPrior(np.zeros(len(rows)), np.full(len(rows), _KNOWN_ANGLE_RAD))
    at = _true_table(table, recorded)
    prior = replace(recorded.true, covariance=recorded.given.covariance)
    prior = prior if other is None else replace(prior, others={"other": other})
    problem, state = begun(at, prior, lines, rows, None)
    known = FrictionPrior(problem.friction_rad * state.unknowns[:, 3], known.std_rad)
    problem = replace(problem, friction=known)
    equations = problem.equations(state)
    free, _ = problem.free_equations(state)
    total = equations.information.sum(axis=0) + free.sum(axis=0) + np.eye(problem.size)
    modes = (equations.by_shared - equations.by_own @ equations.through)[:, :3] @ np.linalg.cholesky(
        np.linalg.inv(total)
    )
    own = equations.by_own[:, :3] @ equations.own_covariance @ np.swapaxes(equations.by_own[:, :3], 1, 2)
    return np.asarray(np.sqrt(np.einsum("bii->b", own) + (modes**2).sum(axis=(1, 2))))


def judge(recorded: Recorded) -> SimpleNamespace:
    """Estimate a recording frame by frame, refine it, and compare both with the truth, as `RecordingRow` takes it: of
    the P frames that were refined errors point_m and refined_m (P, 3), their bound, and what holds the truth."""
    found = contacts(recorded)
    lines = measured(recorded)
    as_one, seconds = timed(lambda: refine(found, recorded.given, lines))
    truth = recorded.truth
    rows = np.flatnonzero((as_one.refined | bool(as_one.reason)) & found.located & truth.in_contact)
    before, after = found.picked(rows), as_one.contacts.picked(rows)
    point = truth.point_world_m[rows]
    off, close = before.point_world_m - point, after.point_world_m - point
    std = np.sqrt(np.einsum("bii->bi", after.covariance_world_m2))
    l_before, l_after = before.distance_m - truth.distance_m[rows], after.distance_m - truth.distance_m[rows]
    force = np.stack([after.force_y_N, after.force_z_N], axis=1) - truth.force_antenna_N[rows, 1:]
    force_std = np.stack([after.force_y_std_N, after.force_z_std_N], axis=1)
    rub = as_one.friction
    return SimpleNamespace(
        frames=np.array([float(len(recorded))]),
        point_m=off,
        refined_m=close,
        bound_m=bound_m(found, recorded, lines, rows),
        point_off=close / std,
        distance_off=l_after / after.distance_std_m,
        force_off=force / force_std,
        worse=np.abs(l_after) - np.abs(l_before) > _WORSE * before.distance_std_m,
        foreign=float(as_one.foreign.sum()),
        mu_determined=rub is not None and rub.determined,
        mu_covered=rub is not None and bool(rub.interval[0] <= recorded.object.friction <= rub.interval[1]),
        unrefined=bool(as_one.reason),
        seconds=seconds,
    )


def run(draws: int, seed: int, cells: Sequence[Cell] = CELLS) -> list[RecordingRow]:
    """All cells with so many draws each, of rig and noise."""
    rows = []
    for number, cell in enumerate(progress(cells, "recordings", len(cells))):
        recorded = lengthened(played(cell.case, cell.stiffness_N_m, cell.friction), cell.frames)
        judged = []
        for index in range(draws):
            rng = np.random.default_rng((seed, number, index))
            judged.append(judge(recorded.noisy(rng, drawn_truth(replace(SETUP, exact=False).rig(), rng))))
        stiffness = cell.stiffness_N_m if np.isfinite(cell.stiffness_N_m) else np.nan
        what = cell.case, stiffness, cell.friction, cell.frames
        rows.append(row_of(RecordingRow, Draws(judged), *what))
    return rows


QUICK = (CELLS[1], CELLS[6])


def measure(options: Options) -> Findings:
    """Every cell; a draw is one rig and recording."""
    rows = run(options.draws, options.seed, QUICK if options.quick else CELLS)
    ratios, bounds = [row.ratio for row in rows], [row.of_bound for row in rows]
    return Findings(
        table(rows, "contact points refined and frame by frame, rms over rigs"),
        {"recording.csv": rows},
        numbers={"rows": rows},
        headline=f"points {min(ratios):.2f} to {max(ratios):.2f} of frame-wise, {max(bounds):.2f} × the bound at most",
    )
