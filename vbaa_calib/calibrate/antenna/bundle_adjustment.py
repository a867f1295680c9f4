"""Bundle adjustment of camera pose, antenna, moment sensor and lens, from no-load frames and known loads.

Everything is solved at once: a tilted clamp looks like a tilted camera, a bowed wire like a heavier one. What the
pictures cannot separate is constrained by priors, and shows in the covariance. The posterior of the board's pictures,
of lens and camera pose, is the prior here. Several cameras are first solved each by itself, for what is wrong with its
pictures, and then together.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.polynomial import legendre

from vbaa_calib.antenna.shape import PARAMETERS
from vbaa_calib.camera import Camera
from vbaa_calib.core.arrays import neighbours
from vbaa_calib.core.errors import InputError, SolveError
from vbaa_calib.core.least_squares import CHANCE_SCATTER, Linearised, Rules, disagreement, disagreement_p, minimise
from vbaa_calib.core.robust import MAD_SCALE, chi_square, huber_weights, mad_std
from vbaa_calib.detect.whisker.profile import LINE_MODES
from vbaa_calib.geometry import Pose
from vbaa_calib.rig import Tip, WrenchSensor
from vbaa_calib.rig.reprojection import see
from vbaa_calib.session import Still

from .inputs import Observation, Prior, ReadingGroups
from .problem import GAIN, LOG_STIFFNESS, OFFSET, POSE, RIG, Evaluation, LensLost, Problem
from .settings import AntennaSettings


def _descended(problem: Problem, start: np.ndarray, evaluated: Evaluation, standstill: float) -> Linearised:
    """Minimises the robust cost from a start, moved within the bounds. evaluated : the result of `Problem.evaluate`
    at the start."""
    if (start <= problem.upper).all():
        return _minimised(problem, Linearised(start, *problem.residuals(start, evaluated), problem.certain), standstill)
    return _minimised(problem, problem.linearised(np.minimum(start, problem.upper)), standstill)


def _minimised(problem: Problem | _Cameras, first: Linearised, standstill: float) -> Linearised:
    """Minimises the robust cost from its linearisation at a start. standstill : the largest step, in standard
    deviations, at which it has converged."""

    def evaluate(parameters: np.ndarray) -> Linearised | None:
        try:
            trial = problem.linearised(parameters)
        except ValueError:
            # the antenna is wound up until it has no shape
            return None
        return trial if trial.is_finite else None

    # The slopes are finite differences, zero a little off the minimum: a smaller rise is none.
    rules = Rules(iterations=40, standstill=standstill, takes_last=True, may_rise=1e-3)
    at, promise, exhausted = minimise(evaluate, first, rules, problem.upper)
    return replace(at, converged=promise < (AntennaSettings.enough if exhausted else standstill))


def _fitting(
    problem: Problem, solution: Linearised, distances: Sequence[np.ndarray], kept: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Inlier mask (F,) of the static frames, and the rms residual (F,) of each one's points in scaled standard
    deviations, by a solution from the kept frames. Each frame is tested with its own readings free where no other
    kept frame shares them, because nothing else determines their errors; the other parameters vary within their
    covariance."""
    groups, readings = problem.groups, problem.lens.stop
    rms, needed, root = np.empty(len(distances)), np.zeros(len(distances)), solution.covariance_root()
    for index, block in enumerate(distances):
        others = kept & (np.arange(len(kept)) != index)
        mine = [group for group in (groups.distance, groups.force) if not (others & (group == group[index])).any()]
        own = readings + np.array([group[index] for group in mine if group[index] >= 0], int)
        rest = np.setdiff1d(np.arange(len(root)), own)
        rows = problem.without_line(index, np.column_stack([block[:, 0], problem.by_all(block)])) / problem.noise_scale
        left, slopes = rows[:, 0], rows[:, 1:]
        columns = np.hstack([slopes[:, own], slopes[:, rest] @ root[rest]])
        errors = np.concatenate([solution.parameters[own], np.zeros(len(root))])
        step = -np.linalg.solve(np.eye(len(errors)) + columns.T @ columns, columns.T @ left + errors)
        rms[index] = np.sqrt(((left + columns @ step) ** 2).mean())
        needed[index] = np.linalg.norm((errors + step)[: len(own)])
    return (rms < max(AntennaSettings.outlying_frame * np.median(rms), 1.0)) & (
        needed < AntennaSettings.outlying_reading
    ), rms


def _frame_disagreements(
    problem: Problem, solution: Linearised, distances: Sequence[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """χ² and degrees of freedom, both (F,), of each static frame's disagreement with the others, by line and moment;
    0 for excluded frames. distances : see `Problem.evaluate`."""
    kept = np.flatnonzero(problem.kept)
    bounds = np.cumsum([0, *(len(distances[index]) for index in kept.tolist())])
    rows = [np.append(np.arange(*ends), bounds[-1] + n) for n, ends in enumerate(pairwise(bounds))]
    square, freedom = np.zeros((2, len(problem.kept)))
    square[kept], freedom[kept] = _disagreements(solution, rows)
    return square, freedom


def _disagreements(solution: Linearised, rows: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """χ² and degrees of freedom, both (G,), of the disagreement between each group of residuals (by its rows) and all
    other residuals of a solution."""
    jacobian, residuals = (solution.jacobian.T * solution.weights).T, solution.residuals * solution.weights
    total, beforehand = jacobian.T @ jacobian, jacobian[solution.measured :]
    # in units of what is known beforehand
    unit = 1.0 / np.sqrt(np.maximum((beforehand**2).sum(axis=0), 1e-12 * np.diag(total)))
    own = [(jacobian[each] * unit, residuals[each]) for each in rows]
    information = np.array([slopes.T @ slopes for slopes, _ in own])
    pull = np.array([-slopes.T @ off for slopes, off in own])
    return disagreement(information, pull, total * np.outer(unit, unit))


def _scatter_of(square: np.ndarray, freedom: np.ndarray) -> float:
    """Scale factor, at least 1, by which the frames' disagreements exceed what noise explains: the root of the total
    χ² over its degrees of freedom and `CHANCE_SCATTER`."""
    return float(np.sqrt(max(square.sum() / max(freedom.sum(), 1.0) / CHANCE_SCATTER, 1.0)))


def _widened(problem: Problem) -> Problem:
    """The problem for the covariance: a group of correlated pictures counts as one picture."""
    alike = _alike([one for one, fits in zip(problem.observations, problem.kept, strict=True) if fits])
    return problem if alike == 1.0 else replace(problem, noise_scale=problem.noise_scale * float(np.sqrt(alike)))


def _scattered(final: Linearised, scatter: float) -> Linearised:
    """The linearised problem with the measured residuals' standard deviations multiplied by `scatter`; priors
    unchanged."""
    trust = np.where(np.arange(len(final.residuals)) < final.measured, 1.0 / scatter, 1.0)
    return replace(final, residuals=trust * final.residuals, jacobian=trust[:, None] * final.jacobian)


def _undisturbed(residuals: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Masks (N,) of the points of each line that lie outside disturbed stretches, from their residuals (N,)."""
    means = list[np.ndarray]()
    for off in residuals:
        basis = legendre.legvander(np.linspace(-1.0, 1.0, len(off)), AntennaSettings.disturbed_degree)
        remainder, weights = off, np.ones(len(off))
        for _ in range(20):
            remainder = off - basis @ np.linalg.lstsq(basis * weights[:, None], off * weights, rcond=None)[0]
            # on residuals, not on their squares: a stretch that is far off hardly pulls
            weights = huber_weights(remainder)
        runs = neighbours(remainder, AntennaSettings.run, "symmetric")
        means.append(runs.sum(axis=1) / np.sqrt(AntennaSettings.run))
    usual = max(float(np.median([mad_std(one) for one in means])), 1.0)
    good = []
    for one in means:
        sizes = np.abs(one) / usual
        around = sizes > AntennaSettings.disturbed_around
        stretch = np.cumsum(np.diff(around, prepend=False))
        clear = around & np.isin(stretch, stretch[sizes > AntennaSettings.disturbed_clear])
        found = np.any(neighbours(clear, AntennaSettings.run, "symmetric"), axis=1)
        local = (
            len(found) >= 4 * AntennaSettings.run
            and found.mean() <= AntennaSettings.disturbed_most
            and mad_std(sizes[~found]) <= AntennaSettings.disturbed_around
        )
        good.append(~found if local else np.ones(len(found), bool))
    return good


def _without_disturbed(problem: Problem, parameters: np.ndarray, evaluated: Evaluation) -> Problem:
    """The problem without the disturbed stretches of its lines (a reflection, a crossing cable)."""
    observations = list(problem.observations)
    undisturbed = _undisturbed([block[:, 0] / problem.noise_scale for block in evaluated.points])
    for index, (one, good) in enumerate(zip(problem.observations, undisturbed, strict=True)):
        if len(good) == len(one.points_px) and not good.all():
            observations[index] = one.only(good)
    return replace(problem, observations=observations, seen_at_lens=()).relinearised(parameters)


@dataclass(frozen=True, eq=False)
class BundleAdjustment:
    """The solved rig.

    Attributes
    ----------
    problem, solution : the problem, its loads as solved for, and its linearisation at the minimum.
    final : the linearisation with all further uncertainties that the covariance contains.
    noted : the observations with the loads as they were noted, without the points that were left out.
    disturbed : (F,) number of points left out, in stretches where something next to the antenna displaces its line.
    parameters : (17,) `RIG_PARAMETERS`; the pose's six are steps from the prior's start.
    camera : the lens solved from all pictures together, with its covariance.
    covariance : (17 + P, 17 + P) of `RIG_PARAMETERS`, the pose's part about the solved pose, and of the lens.
    scatter : ratio, at least 1, of the pictures' scatter to that which their noise explains; in the covariance.
    point_rms : (F,) of each observation's points, in their scaled standard deviations.
    moment_residuals_Nm : (F,) reading less prediction.
    sensor : the solved sensor of everything but the moment about y, with its covariance; None without one.
    tip : where the antenna's visible end lies, from the pictures; None where it was not seen, or not used.
    tip_gap_std : distance of the visible ends from the length by all other data, in standard deviations; NaN without
        any.
    """

    problem: Problem
    noted: Sequence[Observation]
    disturbed: Sequence[int]
    solution: Linearised
    final: Linearised
    parameters: np.ndarray
    T_antenna_camera: Pose
    camera: Camera
    covariance: np.ndarray
    scatter: float
    point_rms: np.ndarray
    moment_residuals_Nm: np.ndarray
    sensor: WrenchSensor | None = None
    tip: Tip | None = None
    tip_gap_std: float = np.nan

    @property
    def noise_scale(self) -> float:
        """Ratio of the centreline points' scatter about the model to their stated standard deviations."""
        return self.problem.noise_scale

    @property
    def kept(self) -> np.ndarray:
        """(F,) mask of the static frames that were used; the others are outliers."""
        return self.problem.kept

    @property
    def alike(self) -> float:
        """Number of correlated pictures of a kind (with a load, without) that carry the information of one."""
        kept = [one for one, fits in zip(self.noted, self.kept, strict=True) if fits]
        return _alike(kept)

    @staticmethod
    def together(cameras: Mapping[str, BundleAdjustment]) -> dict[str, BundleAdjustment]:
        """Solve several cameras in one problem that shares antenna, loads and sensors. Starts from each camera's own
        adjustment (by name, of the same static frames); returns one `BundleAdjustment` a camera with its pose and
        lens and the common antenna, sensors and tip, with their covariance. Outliers and fit statistics are those of
        the separate adjustments.

        Raises
        ------
        InputError : they are of different antennas.
        SolveError : it does not converge.
        """
        return _together(cameras)

    def forecast(self, rows: np.ndarray) -> np.ndarray:
        """Predicted `covariance` (17 + P, 17 + P) after N further observations. rows : (N, size + E) their Jacobian by
        all parameters and by E further errors of unit deviation, in units of the observations' standard deviations."""
        root = _own_units(self.problem, _root(self.problem, self._condensed.with_rows(rows)))[0]
        return np.asarray(root @ root.T)

    @cached_property
    def _condensed(self) -> Linearised:
        """`final` reduced by QR to as many rows as parameters, with the same normal equations."""
        triangle, count = np.linalg.qr(self.final.jacobian * self.final.weights[:, None])[1], self.problem.size
        return replace(self.final, residuals=np.zeros(count), jacobian=triangle, certain=count)

    @property
    def log_tip(self) -> float:
        """Logarithm of the ratio of the solved tip diameter to the one in session.yaml."""
        return self.problem.log_tip(self.solution.parameters)

    @property
    def sensor_gain_offset(self) -> tuple[float, float]:
        """Gain and offset (N·m) of the moment sensor."""
        return float(self.parameters[GAIN]), float(self.parameters[OFFSET])


def adjust_bundle(
    observations: Sequence[Observation], prior: Prior, length_m: float, moment_std_Nm: float
) -> BundleAdjustment:
    """Solve camera pose, antenna, moment sensor and lens from static frames. Raises SolveError when it does not
    converge.

    In passes: each weighs the points by their scatter in the one before, and leaves out frames that lie much further
    off than the others. Where the lens folds within its covariance, its prior is narrowed. Where points share their
    errors, all frames with a load count as one, and so do all without: the light is the same in all.
    """
    sees, shares = prior.camera.valid_region().image_fraction, list(AntennaSettings.lens_shares)
    failure = SolveError("the lens that the pictures require folds inside the picture: calibrate it from more views")
    while shares:
        try:
            found = _solved(observations, replace(prior, lens_share=shares.pop(0)), length_m, moment_std_Nm)
        except LensLost:
            continue
        except SolveError as error:
            # before the static frames count as the cause, once more with a lens that all but stays
            shares, failure = shares[-1:], error
            continue
        if found.camera.valid_region().image_fraction >= sees - AntennaSettings.sees_less:
            return found
    raise failure


def _too_few(fits: np.ndarray, loaded: np.ndarray) -> bool:
    """Whether so few of the static frames fit (F,) that the model must be wrong, not the frames."""
    kinds = [fits[loaded == kind] for kind in (False, True)]
    return any(
        (~own).sum() > max(1, int(AntennaSettings.most_contradict * len(own)))
        or own.sum() < min(AntennaSettings.fewest_of_a_kind, len(own))
        for own in kinds
    )


def _initial(problem: Problem) -> np.ndarray:
    """Initial parameters: the prior's mean, with the EI that explains the pictures of loads best."""
    if not any(one.loaded for one in problem.observations):
        return problem.begin
    found = []
    for off in np.linspace(-3.0, 3.0, AntennaSettings.tried_stiffnesses):
        at = problem.begin
        at[LOG_STIFFNESS] += off * problem.prior.std[LOG_STIFFNESS - 6]
        try:
            found.append((float(np.log1p(problem.misfits(at) ** 2).sum()), at))
        except ValueError:
            # so soft an antenna has no shape
            continue
    return min(found, key=lambda one: one[0])[1] if found else problem.begin


def _in_passes(problem: Problem, judged: bool = True) -> tuple[Problem, Linearised, Evaluation, np.ndarray] | None:
    """Solves in passes, each with the points' scatter measured by the previous pass and without the frames that did
    not fit it. Returns the problem, its solution, the prediction there, and each frame's rms residual (F,) in
    standard deviations.

    judged : leave out frames that contradict the others, too; None where these are too many.
    """
    parameters = _initial(problem)
    least = 1.0 if np.mean([one.shared for one in problem.observations]) > 0.5 else 0.0
    loaded = np.array([one.loaded for one in problem.observations])
    strange = np.zeros(len(loaded), bool)
    evaluated, disturbed, stuck = problem.evaluate(parameters), True, 0
    rms = np.full(len(loaded), np.nan)
    for turn in range(AntennaSettings.passes + 1):
        kept = problem.kept
        scaled = [problem.in_own_std(i, evaluated.points[i][:, 0]) for i in np.flatnonzero(kept).tolist()]
        scale = max(noise_scale(scaled), least)
        change = abs(scale / problem.noise_scale - 1.0)
        problem = replace(problem, noise_scale=scale)
        exact = change < AntennaSettings.exact_from or turn == AntennaSettings.passes
        solution = _descended(
            problem, parameters, evaluated, AntennaSettings.standstill if exact else AntennaSettings.roughly
        )
        parameters = solution.parameters
        stuck = stuck + 1 if not solution.converged and scale > AntennaSettings.hopeless else 0
        if stuck > AntennaSettings.hopeless_passes:
            break
        problem = problem.relinearised(parameters)
        evaluated = problem.evaluate(parameters)
        if disturbed and change < AntennaSettings.exact_from:
            # once, where the rig is all but known
            disturbed, problem = False, _without_disturbed(problem, parameters, evaluated)
            evaluated = problem.evaluate(parameters)
            continue
        fits, rms = _fitting(problem, solution, evaluated.points, kept)
        # frames near the limit must not come and go for ever; the last pass leaves none out
        fits = kept if turn == AntennaSettings.passes else fits & kept if turn > AntennaSettings.passes // 2 else fits
        if judged and change < AntennaSettings.exact_from and (fits == kept).all():
            p = disagreement_p(*_frame_disagreements(problem, solution, evaluated.points))
            worst = int(np.argmin(p))
            if p[worst] < AntennaSettings.contradicts:
                strange[worst] = True
        fits &= ~strange
        if strange.any() and _too_few(fits, loaded):
            return None
        problem = replace(problem, kept=fits)
        if change < AntennaSettings.last_change and (fits == kept).all():
            break
    return problem, solution, evaluated, rms


def _solved(
    observations: Sequence[Observation], prior: Prior, length_m: float, moment_std_Nm: float
) -> BundleAdjustment:
    problem = Problem.of(observations, prior, length_m, moment_std_Nm)
    found = _in_passes(problem) or _in_passes(problem, judged=False)
    assert found is not None
    problem, solution, evaluated, rms = found
    parameters = solution.parameters
    if not solution.converged:
        raise SolveError("bundle adjustment of camera pose, antenna and sensor did not converge")
    tried, gap_std = _with_tips(problem, solution)
    if len(tried.tips):
        with_tips = _at_tips(tried, parameters)
        if with_tips is not None:
            problem, solution, evaluated = with_tips
            parameters = solution.parameters
    final = solution if (wider := _widened(problem)) is problem else wider.linearised(parameters)
    scatter = _scatter_of(*_frame_disagreements(problem, solution, evaluated.points))
    final = _scattered(final, scatter)
    root = _root(problem, final)
    return BundleAdjustment(
        problem=problem,
        solution=solution,
        final=final,
        **_in_units(problem, parameters, root),
        noted=tuple(
            replace(one, points_px=used.points_px, sigma_px=used.sigma_px, row_px=used.row_px)
            for one, used in zip(observations, problem.observations, strict=True)
        ),
        disturbed=tuple(
            len(one.points_px) - len(used.points_px)
            for one, used in zip(observations, problem.observations, strict=True)
        ),
        scatter=scatter,
        point_rms=rms,
        moment_residuals_Nm=problem.moment_residuals_Nm(parameters, evaluated.moments),
        tip=_tip(problem, evaluated, root),
        tip_gap_std=gap_std,
    )


def _alike(observations: Sequence[Observation]) -> float:
    """Number of correlated pictures of a kind that carry the information of one."""
    return max(sum(one.shared for one in observations) / max(len({one.loaded for one in observations}), 1), 1.0)


def _root(problem: Problem, final: Linearised) -> np.ndarray:
    """Square root R (size, size + P) of the covariance of all parameters: R·Rᵀ."""
    root = final.covariance_root()
    # the lens may be off by all its standard deviation, whatever share the solve had: the solution follows its prior
    rest = root @ root[problem.lens].T * np.sqrt(problem.prior.lens_shares**-2 - 1.0)
    return np.hstack([root, rest])


def _in_units(problem: Problem, parameters: np.ndarray, root: np.ndarray) -> dict[str, Any]:
    """Pose, lens, antenna and sensors of a `BundleAdjustment` in SI units, from the problem's parameters (17 + P + K
    + L + W,) and a square root (17 + P + K + L + W, …) of their covariance."""
    scaled, own = _own_units(problem, root)
    covariance, camera, sensor = scaled @ scaled.T, problem.camera(parameters), problem.wrench_sensor(parameters)
    return {
        "parameters": parameters[:RIG],
        "T_antenna_camera": problem.pose(parameters),
        "camera": camera if len(covariance) == RIG else replace(camera, covariance=covariance[RIG:, RIG:]),
        "covariance": covariance,
        "sensor": None if sensor is None else replace(sensor, covariance=own @ np.vstack([scaled, own]).T),
    }


def _own_units(problem: Problem, root: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two square roots of covariances in SI units, from one (size, …) of the parameters': rows of `RIG_PARAMETERS`
    and lens, and rows of a wrench sensor's parameters."""
    scaled = np.concatenate([root[:RIG], problem.prior.lens_axes @ root[RIG : problem.lens.stop]])
    return scaled, (problem.prior.sensor_std * root[problem.sensor].T).T


def _with_tips(problem: Problem, solution: Linearised) -> tuple[Problem, float]:
    """The problem with the antenna's visible ends, where they agree with each other and with the rest; and the
    distance of their common end from the stated length, in standard deviations."""
    std_m = problem.prior.tip_std_m
    seen = np.array([bool(np.isfinite([*one.tip_px, one.tip_std_px]).all()) for one in problem.observations])
    camera = problem.camera(solution.parameters)
    which = np.flatnonzero(seen & problem.kept)
    ends = [problem.observations[index] for index in which.tolist()]
    # where the lens has an inverse
    which = which[[len(see(camera, one.tip_px[None], np.array([one.tip_std_px]))) > 0 for one in ends]]
    if std_m is None or not len(which):
        return problem, np.nan
    tried = replace(problem, tips=which).relinearised(solution.parameters)
    found = tried.evaluate(solution.parameters)
    slopes = tried.by_all(found.tips)
    known = slopes @ solution.covariance() @ slopes.T
    off = found.tips[:, 0]
    # what all of them share is judged together
    agree = np.abs(off - np.median(off)) <= AntennaSettings.outlying_tip * np.sqrt(1.0 + np.diag(known))
    if agree.mean() <= 0.5:
        return problem, np.inf
    mean = agree / agree.sum()
    common = std_m * found.by_length
    gap_std = float(mean @ off / np.sqrt(mean @ (np.eye(len(off)) + np.outer(common, common) + known) @ mean))
    if not abs(gap_std) <= AntennaSettings.tips_contradict:
        return problem, gap_std
    return replace(problem, tips=which[agree]).relinearised(solution.parameters), gap_std


def _at_tips(problem: Problem, parameters: np.ndarray) -> tuple[Problem, Linearised, Evaluation] | None:
    """Solves again with the antenna's visible ends, starting from the solution without; None where it does not
    converge."""
    try:
        solution = _descended(problem, parameters, problem.evaluate(parameters), AntennaSettings.standstill)
        problem = problem.relinearised(solution.parameters)
    except LensLost:
        return None
    return (problem, solution, problem.evaluate(solution.parameters)) if solution.converged else None


def _tip(problem: Problem, evaluated: Evaluation, root: np.ndarray) -> Tip | None:
    """Position of the antenna's end from the pictures that show it, and its joint covariance with rig and wrench
    sensor, from a square root of the covariance of all parameters."""
    std_m = problem.prior.tip_std_m
    if not len(problem.tips) or std_m is None:
        return None
    by_length = evaluated.by_length
    variance = 1.0 / (std_m**-2 + by_length @ by_length)
    # residual = seen less predicted: an end further out lies by_length · offset off
    offset = -variance * by_length @ evaluated.tips[:, 0]
    by_rig = -variance * by_length @ problem.by_all(evaluated.tips)
    across = by_rig @ root @ root.T
    common = np.concatenate(_own_units(problem, across))
    return Tip(float(offset), float(np.sqrt(variance + across @ by_rig)), common)


def noise_scale(residuals: Sequence[np.ndarray]) -> float:
    """Ratio of the points' effective standard deviation, when many are averaged, to the stated one: the median over the
    lines (N,), so that a single line with overstated deviations does not matter.

    Also measured on means of runs of neighbours, which reveal errors that neighbours share; each line's offset, slope
    and curvature are fitted.
    """
    found = []
    for points in residuals:
        spreads = [mad_std(points)]
        for size in AntennaSettings.scatter_runs:
            runs = points[: len(points) // size * size].reshape(-1, size).mean(axis=1)
            freed = np.sqrt(size * len(runs) / max(len(runs) - LINE_MODES, 1))
            spreads.append(MAD_SCALE * freed * float(np.median(np.abs(runs))) if len(runs) > 2 * LINE_MODES else 0.0)
        found.append(spreads)
    return float(max(*np.median(found, axis=0), 0.2))


def _rows_of_table(frames: Sequence[Still]) -> list[tuple[str, int]]:
    """Keys that identify a static frame in every camera: its readings, and its number among equal ones."""
    seen: Counter[str] = Counter()
    found = []
    for row in (repr(replace(one, image=None)) for one in frames):
        found.append((row, seen[row]))
        seen[row] += 1
    return found


@dataclass(frozen=True, eq=False)
class _Cameras:
    """The problems of several cameras as one, in the form that `_minimised` takes.

    Its parameters (Q,): antenna and moment sensor; in standard deviations the errors of the loads' readings, the taper
    and a wrench sensor, then those of the visible end's distance from the length and those common to the cameras'
    poses; finally pose, lens and light of each camera.

    problems : one per camera. places : per camera the indices of its parameters among the Q. reads : per camera a mask
        of its kept static frames with readings that no earlier camera has. tip, common : slices of the errors of the
        visible end and of those common to the poses.
    """

    problems: Sequence[Problem]
    places: Sequence[np.ndarray]
    reads: Sequence[np.ndarray]
    tip_std_m: float
    tip: slice
    common: slice
    size: int

    @staticmethod
    def of(alone: Sequence[BundleAdjustment]) -> _Cameras:
        """The joint problem of several cameras, from each one's own bundle adjustment and without its outliers."""
        first = alone[0].problem
        with_tip = all(one.tip is not None for one in alone)
        counts = Counter(estimate.way for one in alone for estimate in one.problem.prior.poses)
        columns = [e.common.shape[1] for one in alone for e in one.problem.prior.poses if counts[e.way] > 1]
        groups = ReadingGroups.of([each.still for one in alone for each in one.noted], first.prior.readings)
        ends = np.cumsum(
            [(RIG - 6), groups.count, first.taper.stop - first.taper.start, len(first.prior.sensor_std), with_tip]
        )
        readings, taper, sensor, tip = (slice(*pair) for pair in pairwise(ends.tolist()))
        common = slice(tip.stop, size := tip.stop + max(columns, default=0))
        problems, places, reads, used, at = [], [], [], set[tuple[str, int]](), 0
        for one in alone:
            problem = one.problem if with_tip else one.problem.without_tips()
            place = np.zeros(problem.size, int)
            place[POSE.stop : RIG] = np.arange(RIG - 6)
            place[problem.taper], place[problem.sensor] = np.r_[taper], np.r_[sensor]
            every = slice(at, at := at + len(one.noted))
            for mine, all_of_them in ((problem.groups.distance, groups.distance), (problem.groups.force, groups.force)):
                place[problem.readings.start + mine[mine >= 0]] = readings.start + all_of_them[every][mine >= 0]
            for own in (POSE, problem.lens, problem.light):
                count = own.stop - own.start
                place[own] = np.arange(size, size := size + count)
            rows = _rows_of_table([each.still for each in one.noted])
            reads.append(np.array([row not in used for row in rows])[problem.kept])
            used.update(row for row, kept in zip(rows, problem.kept.tolist(), strict=True) if kept)
            # what estimates of one way have in common is unknown: weights of 1 in all hold for any correlation
            poses = [
                replace(estimate, covariance=estimate.covariance - estimate.common @ estimate.common.T)
                if estimate.common.size and counts[estimate.way] > 1
                else replace(estimate, covariance=counts[estimate.way] * estimate.covariance, common=np.zeros((6, 0)))
                for estimate in problem.prior.poses
            ]
            prior = replace(problem.prior, poses=poses, tip_std_m=None)
            noise_Nm = max(each.problem.moment_std_Nm for each in alone)
            problems.append(replace(problem, prior=prior, moment_std_Nm=noise_Nm))
            places.append(place)
        return _Cameras(problems, places, reads, first.prior.tip_std_m or 0.0, tip, common, size)

    @property
    def upper(self) -> np.ndarray:
        """(Q,) upper bounds of the parameters."""
        ends = np.full(self.size, np.inf)
        for problem, place in zip(self.problems, self.places, strict=True):
            np.minimum.at(ends, place, problem.upper)
        return ends

    def relinearised(self, parameters: np.ndarray) -> _Cameras:
        """The problem with each camera's part relinearised at the parameters. Raises LensLost."""
        each = zip(self.problems, self.places, strict=True)
        return replace(self, problems=[problem.relinearised(parameters[place]) for problem, place in each])

    def linearised(self, parameters: np.ndarray) -> Linearised:
        """All residuals and their Jacobian."""
        return self.with_parts(parameters)[0]

    def with_parts(self, parameters: np.ndarray) -> tuple[Linearised, list[list[np.ndarray]]]:
        """The linearised residuals, and by camera the slices of each static frame's residuals."""
        measured: list[tuple[np.ndarray, np.ndarray]] = []
        known: list[tuple[np.ndarray, np.ndarray]] = []
        found, parts, at = np.zeros(self.size, bool), [], 0
        for problem, place, reads in zip(self.problems, self.places, self.reads, strict=True):
            evaluated = problem.evaluate(parameters[place])
            off, slopes = problem.residuals(parameters[place], evaluated)
            rows = np.zeros((len(off), self.size))
            rows[:, place] = slopes
            first, count = len(off) - problem.certain, len(reads)
            points = [len(evaluated.points[index]) for index in np.flatnonzero(problem.kept).tolist()]
            some = np.ones(first, bool)
            some[sum(points) :] = np.concatenate([reads, np.repeat(reads, (first - sum(points) - count) // count)])
            measured.append((off[:first][some], rows[:first][some]))
            moments = at + sum(points) + np.cumsum(reads) - 1
            bounds = at + np.cumsum([0, *points])
            parts.append(
                [
                    np.append(np.arange(*ends), moment if read else np.zeros(0, int))
                    for ends, moment, read in zip(pairwise(bounds), moments, reads, strict=True)
                ]
            )
            at += int(some.sum())
            for estimate in problem.prior.poses:
                width = estimate.common.shape[1]
                both = slice(self.common.start, self.common.start + width)
                shared = np.linalg.inv(np.linalg.cholesky(estimate.covariance)) @ estimate.common
                off[first : first + 6] += shared @ parameters[both]
                rows[first : first + 6, both] += shared
                known.append((off[first : first + 6], rows[first : first + 6]))
                first += 6
            tips = slice(first, first + len(problem.tips))
            # none where one of the cameras did not see the end
            by_length = self.tip_std_m * evaluated.by_length[:, None][:, : self.tip.stop - self.tip.start]
            off[tips] += by_length @ parameters[self.tip]
            rows[tips, self.tip] += by_length
            known.append((off[tips], rows[tips]))
            own = np.flatnonzero(~found[place[POSE.stop :]]) + tips.stop
            known.append((off[own], rows[own]))
            found[place] = True
        last = np.arange(self.tip.start, self.common.stop)
        known.append((parameters[last], np.eye(self.size)[last]))
        certain = sum(len(off) for off, _ in known)
        residuals = np.concatenate([off for off, _ in measured + known])
        return Linearised(parameters, residuals, np.vstack([rows for _, rows in measured + known]), certain), parts


def _together(cameras: Mapping[str, BundleAdjustment]) -> dict[str, BundleAdjustment]:
    (first_name, first_one), *rest = cameras.items()
    for name, one in rest:
        _refuse_other_antenna(first_name, first_one, name, one)
    alone = list(cameras.values())
    problem = _Cameras.of(alone)
    parameters = np.zeros(problem.size)
    for place, one in reversed(list(zip(problem.places, alone, strict=True))):
        parameters[place] = one.solution.parameters
    try:
        for _ in range(AntennaSettings.passes):
            first = problem.linearised(np.minimum(parameters, problem.upper))
            solution = _minimised(problem, first, AntennaSettings.standstill)
            moved, parameters = np.abs(solution.parameters - parameters), solution.parameters
            problem = problem.relinearised(parameters)
            std = np.linalg.norm(solution.covariance_root(), axis=1)
            if (moved < AntennaSettings.last_change * std).all():
                break
    except LensLost as error:
        raise SolveError(f"all cameras: {error}") from None
    if not solution.converged:
        raise SolveError("bundle adjustment of all cameras did not converge")
    final, frames = problem.with_parts(parameters)
    scatter = _scatter_of(*_disagreements(final, [rows for each in frames for rows in each]))
    wider = replace(problem, problems=[_widened(each) for each in problem.problems])
    root = _scattered(wider.linearised(parameters), scatter).covariance_root()
    # as each camera's own: the lens may be off by all its standard deviation
    lenses = [(place[one.lens], one.prior) for place, one in zip(problem.places, problem.problems, strict=True)]
    root = np.hstack([root, *(root @ root[lens].T * np.sqrt(known.lens_shares**-2 - 1.0) for lens, known in lenses)])
    own_m, found = problem.tip_std_m * root[problem.tip], {}
    for (name, one), each, place in zip(cameras.items(), problem.problems, problem.places, strict=True):
        tip = None
        if len(own_m):
            offset_m = problem.tip_std_m * float(parameters[problem.tip][0])
            common = np.concatenate([rows @ own_m[0] for rows in _own_units(each, root[place])])
            tip = Tip(offset_m, float(np.linalg.norm(own_m)), common)
        solved = _in_units(each, parameters[place], root[place])
        found[name] = replace(one, **solved, tip=tip, scatter=scatter)
    return found


def _refuse_other_antenna(name: str, one: BundleAdjustment, other_name: str, other: BundleAdjustment) -> None:
    """Raises InputError where two cameras' adjustments solved significantly different antennas."""
    antenna = slice(POSE.stop, POSE.stop + len(PARAMETERS))
    # both rest on the same loads: their difference is smaller than the sum of their covariances says
    both = one.covariance[antenna, antenna] + other.covariance[antenna, antenna]
    apart, std = other.parameters[antenna] - one.parameters[antenna], np.sqrt(np.diag(both))
    p = disagreement_p(np.array([chi_square(apart, both)]), np.array([len(apart)]))[0]
    if p < AntennaSettings.contradicts or one.problem.length_m != other.problem.length_m:
        worst = int(np.argmax(np.abs(apart / std)))
        what = f"camera {other_name} finds another antenna than {name}, most of all {PARAMETERS[worst]}"
        remedy = "check plane, loads and noload of both cameras, and that both saw the same antenna"
        raise InputError(f"{what}, {np.abs(apart / std).max():.1f} std off", remedy=remedy)
