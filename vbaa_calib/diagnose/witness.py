"""The pictures of a session as a witness: the fit of a rig under altered reports."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.polynomial import legendre

from vbaa_calib.antenna.shape import Curves
from vbaa_calib.calibrate.antenna.bundle_adjustment import noise_scale
from vbaa_calib.calibrate.antenna.inputs import Observation, Prior
from vbaa_calib.calibrate.antenna.problem import ANTENNA, GAIN, OFFSET, LensLost, Problem
from vbaa_calib.calibrate.antenna.settings import AntennaSettings
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import SolveError
from vbaa_calib.core.least_squares import SQUARES, Linearised, Rules, minimise
from vbaa_calib.core.robust import huber_weights, mad_std
from vbaa_calib.geometry import Kinematics
from vbaa_calib.rig.reprojection import ImageCurves, SeenPoints, feet, image_curves, see
from vbaa_calib.session import READINGS, Load, Session

from .sensor import MomentReadings
from .settings import SETTINGS

Alteration = Callable[[Problem, np.ndarray], Problem]
"""Of a problem and values (K,), the problem as it were if a mistake of these values were put right."""


_RULES = Rules(iterations=80, standstill=0.02, takes_last=True, may_rise=1e-3)


@dataclass(frozen=True, eq=False)
class RigFit:
    """The rig that explains the pictures best under altered reports.

    Attributes
    ----------
    problem : with the altered reports. parameters : (17 + P + K,) of the rig.
    values, covariance : of the alteration's K parameters.
    scale : scatter of most pictures about the fit, over their own noise.
    log_likelihood : of pictures and priors, with the alteration's prior and the penalty on its free parameters.
    solution : the problem linearised at the minimum.
    """

    problem: Problem
    parameters: np.ndarray
    values: np.ndarray
    covariance: np.ndarray
    scale: float
    log_likelihood: float
    solution: Linearised

    @property
    def contradicted(self) -> int:
        """Number of pictures with gross residuals under this fit."""
        own = self.solution.residuals[: self.solution.measured]
        return int((_squares(own) > SETTINGS.points * SETTINGS.gross**2).sum())

    @property
    def std(self) -> np.ndarray:
        """(K,) standard deviations of the values."""
        return np.sqrt(np.diag(self.covariance))


def _condensed(problem: Problem, parameters: np.ndarray) -> Problem:
    """The problem with a few independent points for each picture, with as much information on a smooth curve as all of
    them.

    A polynomial is fitted to the distances of a picture's points from the antenna with these parameters, with or
    without its reported load, whichever is nearer; its values at Gauss nodes are the points.
    """
    count = SETTINGS.points
    nodes, weights = legendre.leggauss(count)
    view = problem.pose(parameters).inverse()
    some = (problem, problem.unloaded)
    images = [image_curves(one.curves(parameters[None, ANTENNA]), view) for one in some]
    distances = [
        min((_Distances.of(seen, image, index, count - 1) for image in images), key=lambda one: one.scatter)
        for index, seen in enumerate(problem.seen_at_lens)
    ]
    left = [one.left for one in distances if one.smooth is not None]
    freedom = [len(one) / (len(one) - count) for one in left]
    scatter = noise_scale(left) * float(np.sqrt(np.median(freedom))) if left else 1.0
    kinds = max(len({one.loaded for one in problem.observations}), 1)
    alike = sum(one.shared for one in problem.observations) / kinds
    scatter *= max(float(np.sqrt(alike)), 1.0)
    common = SETTINGS.common**2
    seen = [one.at(nodes, scatter * np.sqrt(2.0 / (len(one.t) * weights) + common)) for one in distances]
    found = replace(problem, seen_at_lens=seen, noise_scale=1.0, known_axes=None, known_light=None, places=nodes)
    axes = found.line_axes() if problem.prior.drift.line_px else None
    return replace(found, known_axes=axes, known_light=found.light_modes())


@dataclass(frozen=True, eq=False)
class _Distances:
    """Distances of a picture's N points from a curve, in standard deviations, at places t from −1 to 1."""

    seen: SeenPoints
    normals: np.ndarray  # (N, 2) one standard deviation long
    t: np.ndarray
    smooth: np.ndarray | None  # of a robust polynomial through them; None of a picture with too few points
    left: np.ndarray  # (N,) residuals of the points from the polynomial
    scatter: float  # standard deviation of these

    @staticmethod
    def of(seen: SeenPoints, images: ImageCurves, index: int, degree: int) -> _Distances:
        image = images.picked(slice(index, index + 1))
        at, along = image.at(0, feet(seen, image))
        normal = np.column_stack([-along[:, 1], along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
        std = np.sqrt(np.einsum("ni,nij,nj->n", normal, seen.covariance, normal))
        off = ((seen.points - at) * normal).sum(axis=1) / std
        t = np.linspace(-1.0, 1.0, len(off))
        if len(t) < 2 * (degree + 1) or not np.isfinite(off).all():
            return _Distances(seen, normal, t, None, off, np.inf)
        # where points are known less well, as where a thread crosses, the same distance is fewer deviations
        basis, weights = legendre.legvander(t, degree) * (np.median(std) / std)[:, None], np.ones(len(t))
        for _ in range(4):
            root = np.sqrt(weights)
            found = np.linalg.lstsq(basis * root[:, None], off * root, rcond=None)[0]
            left = off - basis @ found
            weights = huber_weights(left / max(mad_std(left), 1e-9))
        return _Distances(seen, normal * std[:, None], t, found, left, mad_std(left))

    def at(self, nodes: np.ndarray, std: np.ndarray) -> SeenPoints:
        """The points nearest to the nodes, moved onto the polynomial, with other standard deviations."""
        if self.smooth is None:
            some = self.seen.picked(np.linspace(0.0, len(self.t) - 1.0, len(nodes)).round().astype(int))
            return replace(some, covariance=some.covariance * len(nodes) / len(self.t))
        which = np.abs(self.t[:, None] - nodes).argmin(axis=0)
        some = self.seen.picked(which)
        points = some.points - self.left[which, None] * self.normals[which]
        return replace(some, points=points, covariance=some.covariance * (std**2)[:, None, None])


def _squares(residuals: np.ndarray) -> np.ndarray:
    """(F,) sums of squares of each picture, from residuals (F·points,)."""
    return np.asarray((residuals.reshape(-1, SETTINGS.points) ** 2).sum(axis=1))


def _losses(residuals: np.ndarray) -> np.ndarray:
    """(F,) losses of pictures by Student's t with a scale common to all points of one."""
    freedom, points = SETTINGS.picture_freedom, SETTINGS.points
    return 0.5 * (freedom + points) * np.log1p(_squares(residuals) / freedom)


def _weights(residuals: np.ndarray) -> np.ndarray:
    """(F·points,) weights that turn the robust loss into least squares."""
    freedom, points = SETTINGS.picture_freedom, SETTINGS.points
    return np.repeat((freedom + points) / (freedom + _squares(residuals)), points)


def _weighted(now: Linearised, weights: np.ndarray) -> Linearised:
    """Least squares with weights (F·points,) on the pictures' residuals."""
    factor = np.append(np.sqrt(weights), np.ones(now.certain))
    return replace(now, residuals=now.residuals * factor, jacobian=now.jacobian * factor[:, None], loss=SQUARES)


def _with_values(
    now: Linearised, columns: Sequence[np.ndarray], values: np.ndarray, std: np.ndarray
) -> Linearised | None:
    """The linearised fit with K further parameters at `values`, of prior N(0, std²) and Jacobian `columns`; None where
    one is not finite."""
    prior = np.hstack([np.zeros((len(std), now.jacobian.shape[1])), np.diag(1.0 / std)])
    jacobian = np.vstack([np.column_stack([now.jacobian, *columns]), prior])
    residuals = np.append(now.residuals, values / std)
    found = replace(now, residuals=residuals, jacobian=jacobian, certain=now.certain + len(std))
    return found if found.is_finite else None


def _with_tips(problem: Problem, camera: Camera) -> Problem:
    """The problem with the antenna's visible ends added, except those that the lens does not reach."""
    if problem.prior.tip_std_m is None:
        return problem.without_tips()
    ends = [(np.array(one.tip_px), np.array([one.tip_std_px])) for one in problem.observations]
    which = [
        index
        for index, (px, std) in enumerate(ends)
        if np.isfinite([*px, *std]).all() and len(see(camera, px[None], std))
    ]
    if not which:
        return problem.without_tips()
    tips = see(camera, np.array([ends[k][0] for k in which]), np.concatenate([ends[k][1] for k in which]))
    return replace(problem, tips=np.array(which), tips_at_lens=tips)


def _scatter(now: Linearised) -> float:
    """Ratio of the scatter of most pictures' points to their standard deviations."""
    return float(np.sqrt(np.median(_squares(now.residuals[: now.measured])) / SETTINGS.points))


@dataclass(frozen=True, eq=False)
class Witness:
    """A session's reports, with its pictures as evidence.

    whole : the reports, the moment sensor left out. problem : with its pictures condensed.
    moment_std_Nm : of that sensor. before : what was known before, the sensor included.
    starts : (17 + P + K,) parameters from which a rig is sought.
    """

    session: Session
    kinematics: Kinematics
    whole: Problem
    problem: Problem
    moment_std_Nm: float
    starts: tuple[np.ndarray, ...]
    before: Prior

    @staticmethod
    def of(session: Session, kinematics: Kinematics, observations: Sequence[Observation], before: Prior) -> Witness:
        """The witness of observations as reported. Raises SolveError."""
        prior_std = before.std.copy()
        nominal = AntennaSettings.nominal_std, AntennaSettings.log_mass_std
        prior_std[[6, 7]] = np.minimum(prior_std[[6, 7]], nominal)
        std_Nm = session.moment_std_Nm
        whole = Problem.of(
            observations,
            replace(before, std=prior_std, sensor=None, sensor_std=np.zeros(0)),
            session.antenna.length_m,
            SETTINGS.sensor_off * std_Nm,
        )
        whole = _with_tips(whole, before.camera)
        witness = Witness(session, kinematics, whole, whole, std_Nm, (whole.begin,), before)
        free = np.array([not isinstance(one.still, Load) for one in observations])
        try:
            if free.any() and not free.all():
                # a wrong load must not affect what the free antenna says
                alone = replace(witness, problem=replace(_condensed(whole, whole.begin), kept=free)).fit()
                witness = witness if alone is None else replace(witness, starts=(alone.parameters, whole.begin))
            others = witness.starts
            for _ in range(2):
                witness = replace(witness, problem=_condensed(whole, witness.starts[0]))
                fit = witness.reported
                if fit is None:
                    break
                witness = replace(witness, starts=(fit.parameters, *others))
        except (ValueError, np.linalg.LinAlgError):
            raise SolveError("the antenna has no shape under the reported loads") from None
        return witness

    def applied(self, alter: Alteration, fit: RigFit) -> Witness:
        """The witness with a fitted mistake corrected."""
        whole = alter(self.whole, fit.values)
        starts = (fit.parameters, *self.starts[1:])
        return replace(self, whole=whole, problem=_condensed(whole, fit.parameters), starts=starts)

    @property
    def loads(self) -> list[tuple[int, Load]]:
        """The known loads, with the indices of their observations."""
        return [(i, one.still) for i, one in enumerate(self.problem.observations) if isinstance(one.still, Load)]

    @cached_property
    def reported(self) -> RigFit | None:
        """The fit with everything as reported."""
        found = self.fit()
        if found is None or found.scale < SETTINGS.gross:
            return found
        others = [replace(self, starts=(start,)).fit() for start in self.starts]
        return max((one for one in (found, *others) if one is not None), key=lambda one: one.log_likelihood)

    @property
    def log_likelihood(self) -> float:
        """Log likelihood of the pictures with everything as reported; next to none where that has no solution."""
        return -1e6 if self.reported is None else self.reported.log_likelihood

    @property
    def excess(self) -> float:
        """Nats by which the pictures fit worse with everything as reported than where all is right."""
        return -self.log_likelihood - SETTINGS.usual_cost * len(self.problem.observations)

    @property
    def beyond_usual(self) -> float:
        """Log odds that something is wrong, whatever it is, over all being as reported; pictures that were left out
        have been named."""
        return self.excess - SETTINGS.left_out * int((~self.problem.kept).sum()) - SETTINGS.vague

    def fit(
        self,
        alter: Alteration = lambda problem, values: problem,
        prior_std: Sequence[float] = (),
        at: np.ndarray | None = None,
        least: float = -np.inf,
    ) -> RigFit | None:
        """The rig that explains the pictures best under an alteration with values N(0, prior_std²); None where it
        gives no shape. at : initial parameters and values, as from `forecast`. least : smallest log likelihood of
        interest; the minimisation is broken off where it does not lead there."""
        std = np.array(prior_std, float)
        begin = [np.append(one, 0.0 * std) for one in self.starts]
        begin += [] if at is None else [at]
        count = len(self.starts[0])
        nearest = min(begin, key=lambda one: self._misfit(alter, one[count:], one[:count]))
        now = self._evaluated(alter, std, nearest)
        if now is None:
            return None
        upper = np.concatenate([self.problem.upper, np.full(len(std), np.inf)])
        scatter = _scatter(now)
        if scatter > SETTINGS.far_off:
            # where most points are far off, which pictures are wrong does not show yet
            even = np.full(now.measured, scatter**-2)

            def roughly(at: np.ndarray) -> Linearised | None:
                found = self._evaluated(alter, std, at)
                return None if found is None else _weighted(found, even)

            end = minimise(roughly, _weighted(now, even), replace(_RULES, iterations=6), upper)[0]
            now = self._evaluated(alter, std, end.parameters) or now
        evaluate = partial(self._evaluated, alter, std)
        now, promise, more = minimise(evaluate, now, replace(_RULES, iterations=SETTINGS.tries), upper)
        if more and promise - self._cost(now) > least:
            now = minimise(evaluate, now, _RULES, upper)[0]
        occam = 0.0
        values, own = now.parameters[count:], np.zeros((len(std), len(std)))
        if len(std):
            own = now.covariance()[count:, count:]
            occam = 0.5 * float(np.linalg.slogdet(own / np.outer(std, std))[1])
        likelihood = occam - self._cost(now)
        return RigFit(alter(self.problem, values), now.parameters[:count], values, own, _scatter(now), likelihood, now)

    def _cost(self, now: Linearised) -> float:
        """Negative log likelihood."""
        missing = len(self.problem.kept) - now.measured // SETTINGS.points
        cost = now.cost + SETTINGS.left_out * missing
        return float(cost) if np.isfinite(cost) else np.inf

    def _evaluated(self, alter: Alteration, std: np.ndarray, at: np.ndarray) -> Linearised | None:
        """The altered problem at parameters and values, without the moment sensor."""
        count = len(at) - len(std)
        parameters, values = at[:count], at[count:]
        try:
            problem = alter(self.problem, values)
            residuals, jacobian = problem.residuals(parameters)
            pictures = sum(len(seen) for seen, kept in zip(problem.seen_at_lens, problem.kept, strict=True) if kept)
            rows = np.ones(len(residuals), bool)
            rows[pictures : pictures + int(problem.kept.sum())] = False
            residuals, jacobian = residuals[rows], jacobian[rows]
            columns = self._columns(alter, std, at, residuals)
        except (ValueError, LensLost, np.linalg.LinAlgError):
            return None
        linearised = Linearised(at, residuals, jacobian, problem.certain, loss=(_losses, _weights))
        return _with_values(linearised, columns, values, std)

    def _columns(self, alter: Alteration, std: np.ndarray, at: np.ndarray, misfits: np.ndarray) -> list[np.ndarray]:
        """Derivatives (R,) of the misfits by each of the values."""
        count, found = len(at) - len(std), []
        for index, own in enumerate(std):
            values = at[count:].copy()
            values[index] += 1e-3 * own
            found.append((alter(self.problem, values).misfits(at[:count]) - misfits) / (1e-3 * own))
        return found

    def forecast(
        self,
        alter: Alteration,
        prior_std: Sequence[float] = (),
        roughly: bool = False,
        slopes: Callable[[np.ndarray], np.ndarray] | None = None,
        further: Sequence[np.ndarray] = (),
    ) -> tuple[float, np.ndarray]:
        """First-order prediction of the log likelihood that `fit` would find, with the parameters and values there;
        −inf where the altered antenna has no shape.

        roughly : with the slopes as they are without the alteration. slopes : of a Jacobian (R, 17 + P + K), those
        (R, K) of the values; None: by differences. further : steps (17 + P + K,) to initial parameters and values that
        are tried where little fits.
        """
        std = np.array(prior_std, float)
        if roughly or (len(std) and self.reported is not None):
            # where little fits, the reports' own solution leads nowhere
            lost = self.reported is None or self.reported.scale > SETTINGS.gross
            some = self._begun if lost or self.reported is None else [self.reported.solution]
            every = [self._augmented(one, alter, std, slopes) for one in some]
            if lost and len(further):
                begin = [np.append(start, 0.0 * std) + step for start in self.starts for step in further]
                count = len(self.starts[0])
                nearest = min(begin, key=lambda one: self._misfit(alter, one[count:], one[:count]))
                every.append(self._evaluated(alter, std, nearest))
        else:
            nearest = min(self.starts, key=lambda one: self._misfit(alter, 0.0 * std, one))
            every = [self._evaluated(alter, std, np.append(nearest, 0.0 * std))]
        found = [self._stepped(one, std) for one in every if one is not None]
        return max(found, key=lambda one: one[0], default=(-np.inf, np.zeros(0)))

    def _stepped(self, now: Linearised, std: np.ndarray) -> tuple[float, np.ndarray]:
        """Log likelihood and parameters at the minimum, to first order."""
        after, count = now, now.measured
        for _ in range(SETTINGS.rounds):
            weighted = _weighted(now, _weights(after.residuals[:count]))
            step = weighted.step(0.0)[0]
            after = replace(now, parameters=now.parameters + step, residuals=now.residuals + now.jacobian @ step)
        if not len(std):
            return -self._cost(after), after.parameters
        own = after.covariance()[-len(std) :, -len(std) :]
        occam = 0.5 * float(np.linalg.slogdet(own / np.outer(std, std))[1])
        return occam - self._cost(after), after.parameters

    @cached_property
    def _begun(self) -> list[Linearised]:
        """The problem as reported, linearised at each of the initial values."""
        every = (self._evaluated(lambda problem, values: problem, np.zeros(0), start) for start in self.starts)
        return [one for one in every if one is not None]

    def _misfit(self, alter: Alteration, values: np.ndarray, parameters: np.ndarray) -> float:
        """Loss of the pictures and priors under an alteration, at some parameters."""
        try:
            problem = alter(self.problem, values)
            off = problem.misfits(parameters)
        except ValueError:
            return np.inf
        rest = len(off) - problem.certain
        cost = float(_losses(off[:rest]).sum() + 0.5 * off[rest:] @ off[rest:])
        return cost if np.isfinite(cost) else np.inf

    def _augmented(
        self, now: Linearised, alter: Alteration, std: np.ndarray, slopes: Callable[[np.ndarray], np.ndarray] | None
    ) -> Linearised | None:
        """The linearised problem as reported, with the values of an alteration (zero there) as further parameters;
        without values, with the alteration's misfits."""
        none, at = 0.0 * std, np.append(now.parameters, 0.0 * std)
        try:
            if not len(std):
                off = alter(self.problem, none).misfits(now.parameters)
                return replace(now, residuals=off) if len(off) == len(now.residuals) else None
            known = None if slopes is None else list(slopes(now.jacobian).T)
            columns = self._columns(alter, std, at, now.residuals) if known is None else known
        except ValueError:
            return None
        return _with_values(replace(now, parameters=at), columns, none, std)

    def channels(self, fit: RigFit) -> dict[str, MomentReadings]:
        """The readings of each channel of a wrench sensor, and a fit's prediction of them for the sensor in its
        stated place."""
        sensor, before = self.session.wrench_sensor, self.before
        if sensor is None or before.sensor is None:
            return {}
        prior = replace(fit.problem.prior, sensor=before.sensor, sensor_std=before.sensor_std)
        every = np.ones(len(fit.problem.kept), bool)
        problem = replace(fit.problem, prior=prior, kept=every, moment_std_Nm=self.moment_std_Nm)
        at = np.append(fit.parameters, np.zeros(len(before.sensor_std)))
        evaluated = problem.evaluate(at)
        count, root = len(before.sensor.components), fit.solution.covariance_root()[: len(fit.parameters)]
        off, slopes = problem.other_readings(at, evaluated.wrenches)
        off, slopes = off.reshape(-1, count), slopes.reshape(len(off) // max(count, 1), count, -1)
        found, turned = {}, slice(problem.sensor.start, problem.sensor.start + 3)
        for name in sensor.signs:
            column = READINGS[name]
            read = np.array([getattr(one.still, column) for one in problem.observations])
            if name == "my":
                gain = float(prior.mean[GAIN - 6])
                true = gain * evaluated.moments[:, 0]
                rows = problem.moment_slopes(at, evaluated.moments, evaluated.wrenches) * gain / at[GAIN]
                rows[:, [GAIN, OFFSET]] = 0.0
            else:
                channel = before.sensor.components.index(name)
                true = read + before.sensor.std[channel] * off[:, channel]
                rows = slopes[:, channel] * before.sensor.std[channel]
            known = [rows[:, : len(root)] @ root, rows[:, turned], SETTINGS.moment_relative * np.diag(true)]
            whole = self._readings(problem.observations, read, true, np.hstack(known), sensor.std(name))
            force = name.startswith("f")
            found[column] = replace(whole, offset_std_Nm=SETTINGS.offset_std_N) if force else whole
        return found

    def moments(self, fit: RigFit) -> MomentReadings:
        """The moment sensor's readings, and a fit's prediction of them."""
        if READINGS["my"] in (channels := self.channels(fit)):
            return channels[READINGS["my"]]
        problem, observations = replace(fit.problem, moment_std_Nm=self.moment_std_Nm), fit.problem.observations
        evaluated = problem.evaluate(fit.parameters)
        slopes = problem.moment_slopes(fit.parameters, evaluated.moments, evaluated.wrenches) / fit.parameters[GAIN]
        slopes[:, [GAIN, OFFSET]] = 0.0
        root = slopes @ fit.solution.covariance_root()[: len(fit.parameters)]
        # what no model of antenna and sensor is better than
        root = np.hstack([root, SETTINGS.moment_relative * np.diag(evaluated.moments[:, 0])])
        read, true = np.array([one.still.moment_Nm for one in observations]), evaluated.moments[:, 0]
        about_z = _about_z(problem.curves(fit.parameters[None, ANTENNA]), observations, fit.parameters)
        return replace(self._readings(observations, read, true, root, self.moment_std_Nm), about_z=about_z)

    @staticmethod
    def _readings(
        observations: Sequence[Observation], read: np.ndarray, true: np.ndarray, root: np.ndarray, std: float
    ) -> MomentReadings:
        times = [one.still.time_s for one in observations]
        timed = not any(time is None for time in times)
        return MomentReadings(
            read,
            true,
            np.zeros_like(true),
            root,
            std,
            np.array(times, float) if timed else np.arange(len(times), dtype=float),
            "s" if timed else "row",
            tuple(name_of(observations, index) for index in range(len(observations))),
        )


def _about_z(curves: Curves, observations: Sequence[Observation], parameters: np.ndarray) -> np.ndarray:
    """(F,) moments x·f_y − y·f_x of force and weight about the antenna frame's z."""
    points, step = curves.points_m, np.diff(curves.arclength_m)
    middle = np.einsum("fn,fni->fi", step, 0.5 * (points[:, 1:] + points[:, :-1]))
    weight = np.exp(parameters[13]) * np.array([one.gravity_m_s2 for one in observations])
    load = np.array([one.load_N for one in observations])
    hook = curves.contact_m
    return hook[:, 0] * load[:, 0] + middle[:, 0] * weight[:, 1] - middle[:, 1] * weight[:, 0]


def name_of(observations: Sequence[Observation], index: int) -> str:
    """Name of an observation: its table, row and picture."""
    frame = observations[index].still
    loaded = isinstance(frame, Load)
    row = 1 + sum(isinstance(one.still, Load) == loaded for one in observations[:index])
    table = "loads.csv" if loaded else "noload.csv"
    return f"{table} row {row}" + (f" ({frame.image.name})" if frame.image else "")
