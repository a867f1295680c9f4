"""Residuals and Jacobian of camera pose, antenna, moment sensor and lens for all static frames of the free and the
loaded antenna."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from vbaa_calib.antenna.shape import PARAMETERS, Curves, bend
from vbaa_calib.calibrate.pose.fusion import PoseEstimate
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import SolveError
from vbaa_calib.core.least_squares import Linearised
from vbaa_calib.detect.whisker.profile import LINE_MODES
from vbaa_calib.geometry import Pose
from vbaa_calib.rig import RIG_PARAMETERS, RIG_STEPS, WrenchSensor
from vbaa_calib.rig.reprojection import (
    SeenPoints,
    image_curves,
    see,
    see_each,
    whitened_along,
    whitened_residuals,
    whitened_with_lens,
    with_slopes_on_curves,
)
from vbaa_calib.session import READINGS, Load

from .inputs import Observation, Prior, ReadingGroups
from .settings import AntennaSettings


def _unevenly_bent(curves: Curves, parameters: np.ndarray, profile: np.ndarray) -> Curves:
    """Shapes of B antennas (parameters (B, 9)) with a compliance that varies along them, to first order. profile :
    (2,) coefficients of the first two Legendre polynomials by which the relative compliance differs from 1; the
    bending moments stay."""
    step = np.diff(curves.arclength_m)[..., None]
    middle = (curves.arclength_m[:, 1:] + curves.arclength_m[:, :-1]) / curves.arclength_m[:, -1:] - 1.0
    softer = np.polynomial.legendre.legval(middle, [0.0, *profile])[..., None]
    bow = np.column_stack([np.zeros(len(parameters)), parameters[:, 4:6]])[:, None]
    turn = softer * (np.cross(curves.tangents[:, :-1], curves.tangents[:, 1:]) - bow * step)
    start = np.zeros((len(parameters), 1, 3))
    turned = np.cross(np.concatenate([start, np.cumsum(turn, axis=1)], axis=1), curves.tangents)
    moved = np.cumsum(0.5 * (turned[:, 1:] + turned[:, :-1]) * step, axis=1)
    points = curves.points_m + np.concatenate([start, moved], axis=1)
    return replace(curves, points_m=points, tangents=curves.tangents + turned)


POSE = slice(0, 6)  # places among `RIG_PARAMETERS`: steps of the camera's pose,
ANTENNA = slice(6, 6 + len(PARAMETERS))  # the antenna's parameters,
LOG_STIFFNESS = ANTENNA.start + 6  # among them that of EI,
GAIN = ANTENNA.stop  # the moment sensor's gain
OFFSET = GAIN + 1  # and offset
_BENT = 1 + len(PARAMETERS)  # the antenna, and one a step further along each of its parameters
RIG = len(RIG_PARAMETERS)  # how many these are


class LensLost(SolveError):
    """A step of the lens within its covariance led to a lens that folds: the covariance is too large."""


class Evaluation(NamedTuple):
    """Predictions of a problem at its parameters, with derivatives."""

    # per observation (N, 16 + P + K + L) whitened distances, slopes by pose, antenna, lens, readings, light
    points: list[np.ndarray]
    moments: np.ndarray  # (F, 10 + K) with slopes by antenna, readings and taper
    wrenches: np.ndarray  # (F, 10 + K, 6) force and moment with the same slopes; (F, 10 + K, 0) without a wrench sensor
    tips: np.ndarray  # (T, 16 + P + K + L) as `points`, along the antenna
    by_length: np.ndarray  # (T,) slopes of the tips by the visible length, per m


@dataclass(frozen=True, eq=False)
class Problem:
    """The residuals as functions of the parameters (17 + P + K + L + W,): `RIG_PARAMETERS`; P steps along
    `lens_axes`; K errors of the loads' readings, one of which may be the antenna's taper; L errors common to the
    lines of all pictures; W of a wrench sensor. All but the first 17 are in standard deviations."""

    observations: Sequence[Observation]  # F, with the loads as the parameters had them at the last `relinearised`
    prior: Prior
    seen_at_lens: Sequence[SeenPoints]  # every observation's points, through the lens that is `lens_at` steps away
    lens_at: np.ndarray  # (P,)
    length_m: float
    moment_std_Nm: float  # infinite: no moment sensor
    noise_scale: float  # factor on the stated deviations of the points
    kept: np.ndarray  # (F,) which observations take part
    groups: ReadingGroups  # what the readings have in common
    readings_at: np.ndarray  # (K,) parameters that are in `observations` already
    tips: np.ndarray = field(default_factory=lambda: np.zeros(0, int))  # (T,) of which observations the end is used
    tips_at_lens: SeenPoints | None = None
    changes: np.ndarray | None = None  # (F, 9) by which the antenna differs in each observation
    # (3,) logarithm of the compliance to z over that to y, and how it changes along the antenna: see `_unevenly_bent`
    uneven: np.ndarray = field(default_factory=lambda: np.zeros(3))
    places: np.ndarray | None = None  # (N,) of every picture's points along its line, −1 to 1; None: evenly
    thinner: float = 0.0  # error of the taper, in deviations, with which shapes are bent
    misread: np.ndarray | None = None  # (K,) errors of the readings in `observations`, with which shapes are bent
    # as `line_axes` and `light_modes` give them, where they are known
    known_axes: list[tuple[np.ndarray, np.ndarray]] | None = None
    known_light: list[np.ndarray] | None = None

    @staticmethod
    def of(observations: Sequence[Observation], prior: Prior, length_m: float, moment_std_Nm: float) -> Problem:
        """The problem with all observations, the points' stated standard deviations, and the prior's lens."""
        count = len(observations)
        groups = ReadingGroups.of([one.still for one in observations], prior.readings)
        kept, at = np.ones(count, bool), np.zeros(groups.count)
        blank = Problem(observations, prior, (), np.zeros(0), length_m, moment_std_Nm, 1.0, kept, groups, at)
        return blank.relinearised(blank.begin)

    @property
    def unloaded(self) -> Problem:
        """The problem with loads of 0 N; the node `CONTACT` stays at the load's place."""
        bare = [
            replace(one, still=replace(one.still, force_y_N=0.0, force_z_N=0.0)) if isinstance(one.still, Load) else one
            for one in self.observations
        ]
        return replace(self, observations=bare)

    def without_tips(self) -> Problem:
        """The same problem without the antenna's ends."""
        return replace(self, tips=np.zeros(0, int), tips_at_lens=None)

    @property
    def upper(self) -> np.ndarray:
        """(17 + P + K + L,) upper bounds of the parameters, so that no load lies beyond the tip."""
        ends = np.full(self.size, np.inf)
        ends[self.readings] = self.groups.ends(
            [one.still for one in self.observations], self.readings_at, (1.0 - 1e-5) * self.length_m
        )
        return ends

    @property
    def begin(self) -> np.ndarray:
        """(17 + P + K + L,) initial parameters: the prior's mean."""
        return np.concatenate([np.zeros(6), self.prior.mean, np.zeros(self.size - RIG)])

    @property
    def lens(self) -> slice:
        """Slice of the lens's parameters; the readings' follow."""
        return slice(RIG, RIG + len(self.prior.lens_axes))

    @property
    def readings(self) -> slice:
        """Slice of the errors of the loads' readings."""
        return slice(self.lens.stop, self.lens.stop + self.groups.count)

    @property
    def light(self) -> slice:
        """Slice of the errors common to all lines."""
        shared = self.prior.drift.light_px > 0.0 or self.prior.drift.lock_px > 0.0
        return slice(self.taper.stop, self.taper.stop + LINE_MODES * shared)

    @property
    def taper(self) -> slice:
        """Slice of the antenna's taper error; empty where it has no standard deviation."""
        return slice(self.readings.stop, self.readings.stop + (self.prior.log_tip_std > 0.0))

    def log_tip(self, parameters: np.ndarray) -> float:
        """Logarithm of the ratio of the tip's diameter to the stated one."""
        return self.prior.log_tip_std * float(parameters[self.taper].sum())

    @property
    def sensor(self) -> slice:
        """Slice of the wrench sensor's parameters, the last ones."""
        return slice(self.light.stop, self.light.stop + len(self.prior.sensor_std))

    @property
    def size(self) -> int:
        """Number of parameters."""
        return self.sensor.stop

    def wrench_sensor(self, parameters: np.ndarray) -> WrenchSensor | None:
        """The wrench sensor with the errors in these parameters."""
        known = self.prior.sensor
        return None if known is None else known.moved(self.prior.sensor_std * parameters[self.sensor])

    def relinearised(self, parameters: np.ndarray) -> Problem:
        """The problem linearised at these parameters: points back-projected through their lens, loads as corrected by
        them.

        Raises LensLost where that lens folds before points that the prior's lens sees.
        """
        camera = self.camera(parameters)
        here, frames = self._loaded(parameters), [one.still for one in self.observations]
        if here.misread is not None:
            pairs = zip(self.observations, self.groups.corrected(frames, here.misread), strict=True)
            here = replace(here, observations=[replace(one, still=frame) for one, frame in pairs], misread=None)
        here = replace(here, readings_at=parameters[self.readings])
        images = image_curves(here.curves(parameters[None, ANTENNA]), self.pose(parameters).inverse())
        seen = see_each(camera, [(one.points_px, one.std_px(self.noise_scale)) for one in self.observations])
        seen = with_slopes_on_curves(seen, camera, images)
        if self.seen_at_lens and sum(map(len, seen)) < sum(map(len, self.seen_at_lens)):
            raise LensLost("the lens that the pictures require folds inside the picture")
        return replace(here, seen_at_lens=seen, lens_at=parameters[self.lens], tips_at_lens=here._tips_seen(camera))

    def _tips_seen(self, camera: Camera) -> SeenPoints | None:
        """Image points of the antenna's visible ends, through a lens. Raises LensLost where the lens folds before
        them."""
        some = [self.observations[index] for index in self.tips]
        if not some:
            return None
        px, std_px = np.array([one.tip_px for one in some]), np.array([one.tip_std_px for one in some])
        tips = see(camera, px, std_px)
        if len(tips) < len(some):
            raise LensLost("the lens folds before the antenna's end")
        return tips

    def camera(self, parameters: np.ndarray) -> Camera:
        """The lens of these parameters, with the prior's covariance."""
        camera, step = self.prior.camera, self.prior.lens_axes @ parameters[self.lens]
        return camera.moved(step) if len(step) else camera

    @property
    def certain(self) -> int:
        """Number of prior residuals, which come last and are not weighted by the robust loss."""
        return len(self.tips) + 6 * len(self.prior.poses) + len(self.prior.mean) + self.size - RIG

    def pose(self, parameters: np.ndarray) -> Pose:
        """Camera pose in the antenna frame."""
        return self.prior.start.retract(parameters[POSE])

    def seen(self, parameters: np.ndarray) -> list[SeenPoints]:
        """Back-projected points of every observation at the lens of these parameters, to first order."""
        step = self.prior.lens_axes @ (parameters[self.lens] - self.lens_at)
        return [points.with_lens_moved(step) for points in self.seen_at_lens]

    @cached_property
    def _loads(self) -> tuple[np.ndarray, np.ndarray]:
        """Places (F,) in m and forces (F, 2) of the observations' loads, along y and z in N; zero without a load."""
        frames = [one.still for one in self.observations]
        contact = np.array([one.distance_m if isinstance(one, Load) else 0.5 * self.length_m for one in frames])
        force = np.array([one.load_N for one in self.observations]).reshape(-1, 2)
        if self.misread is None:
            return contact, force
        further, heavier = self.groups.corrections(self.misread)
        return contact + further, force * heavier[:, None]

    def curves(self, antennas: np.ndarray) -> Curves:
        """Shapes of A antennas (A, 9) under the load of each of F observations: F·A curves, observation by
        observation."""
        count, each = len(self.observations), len(antennas)
        loads = (np.repeat(one, each, axis=0) for one in self._loads)
        return self._bent(np.repeat(np.arange(count), each), np.tile(antennas, (count, 1)), *loads)

    def _bent(self, which: np.ndarray, parameters: np.ndarray, contact_m: np.ndarray, force_N: np.ndarray) -> Curves:
        """Shapes of B antennas (B, 9) in the gravity of observations (B,) under loads at places (B,) with forces
        (B, 2)."""
        if self.changes is not None:
            parameters = parameters + self.changes[which]
        factor = np.exp(self.uneven[0] * np.array([-0.5, 0.5]))
        curves = bend(
            parameters,
            self.length_m,
            self._gravity[which] * [1.0, *factor],
            contact_m,
            force_N * factor,
            dead=True,
            sweeps=4,  # more change nothing
            taper=self.prior.taper.thinned(self.prior.log_tip_std * self.thinner),
            diameter_m=self.prior.diameter_m,
        )
        if not self.uneven.any():
            return curves
        return _unevenly_bent(replace(curves, moment_Nm=curves.moment_Nm / factor[1]), parameters, self.uneven[1:])

    @cached_property
    def _gravity(self) -> np.ndarray:
        """(F, 3) antenna frame."""
        return np.array([one.gravity_m_s2 for one in self.observations]).reshape(-1, 3)

    def evaluate(self, parameters: np.ndarray) -> Evaluation:
        """Predictions at these parameters, with derivatives."""
        here, pose = self._loaded(parameters), self.pose(parameters)
        curves, wrenches = here._stepped(parameters)
        views = [each.inverse() for each in [pose, *map(pose.retract, np.diag(RIG_STEPS[:6]))]]
        count, each = len(self.observations), 1 + len(self._steps)
        order = np.array([0] * len(views) + list(range(1, each)))
        every = (each * np.arange(count)[:, None] + order).ravel()
        projected = image_curves(curves.picked(every), [*views, *[views[0]] * (each - 1)])
        seen, ends, light = self.seen(parameters), self._ends(parameters), parameters[self.light]
        blocks, tips, by_length = [], [np.zeros((0, 1 + len(RIG_STEPS) + self.light.start - RIG))], []
        for index, points in enumerate(seen):
            images = projected.picked(slice(index * len(order), (index + 1) * len(order)))
            blocks.append(self._with_slopes(index, *whitened_with_lens(points, images)))
            if index in ends:
                along, by_lens, stretch = whitened_along(ends[index], images)
                tips.append(self._with_slopes(index, along, by_lens))
                by_length.append(stretch)
        if len(light):
            pairs = zip(blocks, self._light_modes, strict=True)
            blocks = [np.hstack([block[:, :1] + (by @ light)[:, None], block[:, 1:], by]) for block, by in pairs]
        if (sensor := self.wrench_sensor(parameters)) is None:
            moments = self._by_curve(curves.moment_Nm.reshape(count, each, 1))[..., 0]
            wrenches = np.zeros((*moments.shape, 0))
        else:
            wrenches = self._by_curve(wrenches)
            moments = -wrenches @ sensor.axes[0]
        ends_seen = np.pad(np.vstack(tips), ((0, 0), (0, len(light))))
        return Evaluation(blocks, moments, wrenches, ends_seen, np.array(by_length))

    @property
    def _steps(self) -> np.ndarray:
        """(D,) difference steps of an observation's curve: along the antenna's parameters; where readings are
        uncertain of the load's place, towards the clamp, and the logarithm of its force; where it is, of the taper."""
        load = [-AntennaSettings.load_step_m, AntennaSettings.log_force_step] * bool(self.groups.count)
        return np.array([*RIG_STEPS[6:], *load, *[AntennaSettings.taper_step] * (self.prior.log_tip_std > 0.0)])

    def _stepped(self, parameters: np.ndarray) -> tuple[Curves, np.ndarray]:
        """Curves of F observations at the parameters and after each of D steps, F·(1 + D) of them, observation by
        observation; and the wrenches (F, 1 + D, 6) at their clamps."""
        count, each = len(self.observations), 1 + len(self._steps)
        antennas = np.repeat(parameters[None, ANTENNA], each, axis=0)
        antennas[1:_BENT] += np.diag(RIG_STEPS[6:])
        contact, force = (np.repeat(one[:, None], each, axis=1) for one in self._loads)
        if self.groups.count:
            hung = np.array([isinstance(one.still, Load) for one in self.observations], float)
            contact[:, _BENT] -= AntennaSettings.load_step_m * hung
            force[:, _BENT + 1] *= np.exp(AntennaSettings.log_force_step)
        which, all_of_them = np.repeat(np.arange(count), each), np.tile(antennas, (count, 1))
        curves = self._bent(which, all_of_them, contact.ravel(), force.reshape(-1, 2))
        if self.prior.log_tip_std > 0.0:
            order = np.arange(len(which))
            order[each - 1 :: each] = len(which) + np.arange(count)
            thinner = replace(self, thinner=self.thinner + AntennaSettings.taper_step).curves(antennas[:1])
            curves = Curves.joined([curves, thinner]).picked(order)
        if self.prior.sensor is None:
            return curves, np.zeros((count, each, 0))
        wrenches = _wrenches_of(curves, self._gravity[which], force.reshape(-1, 2), antennas)
        return curves, wrenches.reshape(count, each, 6)

    def _slopes(self, index: int, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of an observation's values (..., 1 + D), at the parameters and after each step: (..., 15) by pose
        and antenna, or (..., 9) by the antenna; (..., K + 1 or K) by the readings' errors and the taper's."""
        steps = np.append(RIG_STEPS[:6], self._steps)[1 - values.shape[-1] :]
        slopes = (values[..., 1:] - values[..., :1]) / steps
        first = len(steps) - len(self._steps) + _BENT - 1
        further = slopes[..., first:]
        if self.groups.count:
            load = self.groups.columns(index, further[..., 0], further[..., 1])
            further = np.concatenate([load, further[..., 2:]], axis=-1)
        return slopes[..., :first], further

    def _with_slopes(self, index: int, residuals: np.ndarray, by_lens: np.ndarray) -> np.ndarray:
        """(N, 16 + P + K) residuals of an observation and their Jacobian by pose, antenna, lens, readings and taper,
        from the residuals (N, 7 + D) at all steps, the pose's first."""
        by_rig, further = self._slopes(index, residuals)
        return np.hstack([residuals[:, :1], by_rig, by_lens @ self.prior.lens_axes, further])

    def _by_curve(self, values: np.ndarray) -> np.ndarray:
        """(F, 10 + K, C) values of the observations' curves and their derivatives by antenna, readings and taper, from
        the values (F, 1 + D, C) at all steps."""
        found = [np.hstack([one[:, :1], *self._slopes(i, one)]).T for i, one in enumerate(np.swapaxes(values, 1, 2))]
        return np.array(found).reshape(len(values), -1, values.shape[-1])

    def _ends(self, parameters: np.ndarray) -> dict[int, SeenPoints]:
        """The antenna's end, by observation, seen through the lens of these parameters."""
        if self.tips_at_lens is None:
            return {}
        moved = self.tips_at_lens.with_lens_moved(self.prior.lens_axes @ (parameters[self.lens] - self.lens_at))
        return {int(index): moved.picked(np.array([row])) for row, index in enumerate(self.tips)}

    def _loaded(self, parameters: np.ndarray) -> Problem:
        """The problem with shapes computed under the loads and the taper as these parameters correct them."""
        errors, thinner = parameters[self.readings] - self.readings_at, float(parameters[self.taper].sum())
        misread = errors if errors.any() else None
        return self if misread is None and thinner == self.thinner else replace(self, misread=misread, thinner=thinner)

    def _modes(self, index: int) -> np.ndarray:
        """(N, 3) derivatives of an observation's whitened distances by offset, slope and curvature of its line, per
        px."""
        seen, matrix = self.seen_at_lens[index], self.prior.camera.matrix
        std = np.sqrt(0.5 * matrix[0, 0] * matrix[1, 1] * np.trace(seen.covariance, axis1=1, axis2=2))
        places = self.places
        if places is None or len(places) != len(seen):
            places = np.linspace(-1.0, 1.0, len(seen))
        legendre = [np.ones(len(places)), places, 0.5 * (3.0 * places**2 - 1.0)]
        return np.column_stack(legendre[:LINE_MODES]) / std[:, None]

    def line_modes(self, index: int) -> np.ndarray:
        """(N, 3) derivatives of an observation's residuals by its own line's offset, slope and curvature errors, each
        in its standard deviation."""
        std_px = np.hypot(self.prior.drift.line_px, self.observations[index].locking * self.prior.drift.lock_px)
        return self._modes(index) * std_px / self.noise_scale

    def light_modes(self) -> list[np.ndarray]:
        """Per observation the derivatives (N, 3) of its whitened distances by the errors common to all lines, each in
        its standard deviation."""
        drift, every = self.prior.drift, enumerate(self.observations)
        return [self._modes(i) * np.hypot(drift.light_px, one.locking * drift.lock_px) for i, one in every]

    @cached_property
    def _light_modes(self) -> list[np.ndarray]:
        return self.light_modes() if self.known_light is None else self.known_light

    def without_line(self, index: int, rows: np.ndarray) -> np.ndarray:
        """Rows (N, ...) of an observation's points, with their line's common errors marginalised (whitened)."""
        if self.prior.drift.line_px == 0.0:
            return rows
        axes, shrunk = self._line_axes[index]
        return rows - shrunk @ (axes.T @ rows)

    def in_own_std(self, index: int, whitened: np.ndarray) -> np.ndarray:
        """Residuals (N,) of an observation's points, without their line's common errors, in `Observation.sigma_px`."""
        observation, residuals = self.observations[index], self.without_line(index, whitened)
        wider = observation.std_px(self.noise_scale) / observation.sigma_px
        return residuals * wider if len(wider) == len(residuals) else residuals

    @cached_property
    def _line_axes(self) -> list[tuple[np.ndarray, np.ndarray]]:
        return self.line_axes() if self.known_axes is None else self.known_axes

    def line_axes(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Per observation the orthonormal axes (N, 3) of `line_modes`, and the fraction that whitening removes along
        each."""
        modes = [np.linalg.svd(self.line_modes(i), full_matrices=False) for i in range(len(self.seen_at_lens))]
        return [(axes, axes * (1.0 - 1.0 / np.hypot(1.0, std))) for axes, std, _ in modes]

    def by_still(self, parameters: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Per observation the residuals (N + 1,) of points and moment, and their Jacobian (N + 1, 17 + P + K + L)."""
        distances, moments, wrenches, *_ = self.evaluate(parameters)
        read = -self.moment_residuals_Nm(parameters, moments) / self.moment_std_Nm
        rows = self.moment_slopes(parameters, moments, wrenches) / self.moment_std_Nm
        points = [(block[:, 0] / self.noise_scale, self.by_all(block) / self.noise_scale) for block in distances]
        together = zip(points, read, rows, strict=True)
        return [(np.append(off, own), np.vstack([slopes, row])) for (off, slopes), own, row in together]

    def residuals(self, parameters: np.ndarray, evaluated: Evaluation | None = None) -> tuple[np.ndarray, np.ndarray]:
        """All residuals (R,) and their Jacobian (R, 17 + P + K + L + W): whitened points, moments, a wrench sensor's
        other readings, poses, tips, antenna to sensor, priors. evaluated : the result of `evaluate` there, if known."""
        evaluated = self.evaluate(parameters) if evaluated is None else evaluated
        moments = evaluated.moments
        points = np.vstack([self.without_line(i, evaluated.points[i]) for i in np.flatnonzero(self.kept).tolist()])
        misfit = -self.moment_residuals_Nm(parameters, moments)
        rows = self.moment_slopes(parameters, moments, evaluated.wrenches)
        parts = [
            (points[:, 0] / self.noise_scale, self.by_all(points) / self.noise_scale),
            (self._in_std(misfit[self.kept]), rows[self.kept] / self.moment_std_Nm),
            self.other_readings(parameters, evaluated.wrenches[self.kept]),
        ]
        parts += [self._pose_prior(estimate, parameters) for estimate in self.prior.poses]
        parts.append(self._tip_rows(evaluated))
        size = len(parameters)
        std = np.concatenate([self.prior.std, np.ones(size - RIG)])
        away = parameters[6:] - np.concatenate([self.prior.mean, np.zeros(size - RIG)])
        parts.append((away / std, np.hstack([np.zeros((size - 6, 6)), np.diag(1 / std)])))
        return np.concatenate([part for part, _ in parts]), np.vstack([rows for _, rows in parts])

    def misfits(self, parameters: np.ndarray) -> np.ndarray:
        """`residuals` without the sensors' readings and without the Jacobian."""
        here = self._loaded(parameters)
        images = image_curves(here.curves(parameters[None, ANTENNA]), self.pose(parameters).inverse())
        seen, ends = self.seen(parameters), self._ends(parameters)
        own = [images.picked(slice(index, index + 1)) for index in range(len(seen))]
        light, parts = parameters[self.light], []
        for index in np.flatnonzero(self.kept).tolist():
            off = whitened_residuals(seen[index], own[index])[:, 0]
            off = off + self._light_modes[index] @ light if len(light) else off
            parts.append(self.without_line(index, off) / self.noise_scale)
        parts += [self._away(estimate, parameters)[1] for estimate in self.prior.poses]
        along = [whitened_along(end, own[index]) for index, end in ends.items()]
        parts.append(self._common_whitening(np.array([each[2] for each in along])) @ [each[0][0, 0] for each in along])
        size = len(parameters)
        std = np.concatenate([self.prior.std, np.ones(size - RIG)])
        parts.append((parameters[6:] - np.concatenate([self.prior.mean, np.zeros(size - RIG)])) / std)
        return np.concatenate(parts)

    def linearised(self, parameters: np.ndarray) -> Linearised:
        """All residuals and their Jacobian, in the form that `minimise` takes."""
        return Linearised(parameters, *self.residuals(parameters), self.certain)

    def _tip_rows(self, evaluated: Evaluation) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (T,) of the antenna's ends and their Jacobian, with their common distance from the length
        marginalised."""
        if not len(self.tips):
            return np.zeros(0), np.zeros((0, self.size))
        whiten = self._common_whitening(evaluated.by_length)
        return whiten @ evaluated.tips[:, 0], whiten @ self.by_all(evaluated.tips)

    def _common_whitening(self, by_length: np.ndarray) -> np.ndarray:
        """(T, T) matrix that whitens the ends' distances, which share the error of the antenna's length."""
        common = (self.prior.tip_std_m or 0.0) * by_length
        return np.asarray(np.linalg.inv(np.linalg.cholesky(np.eye(len(common)) + np.outer(common, common))))

    def by_all(self, rows: np.ndarray) -> np.ndarray:
        """Rows of an `Evaluation` as derivatives by all parameters; gain, offset and sensor errors, which do not move
        points, get zeros."""
        none = np.zeros((len(rows), 2)), np.zeros((len(rows), len(self.prior.sensor_std)))
        return np.hstack([rows[:, 1 : 1 + GAIN], none[0], rows[:, 1 + GAIN :], none[1]])

    def moment_slopes(self, parameters: np.ndarray, moments: np.ndarray, wrenches: np.ndarray) -> np.ndarray:
        """(F, 17 + P + K + L + W) of the predicted readings by the parameters, from an `Evaluation`."""
        rows = np.zeros((len(moments), len(parameters)))
        rows[:, ANTENNA] = parameters[GAIN] * moments[:, 1:_BENT]
        rows[:, self.readings.start : self.taper.stop] = parameters[GAIN] * moments[:, _BENT:]
        rows[:, GAIN], rows[:, OFFSET] = moments[:, 0], 1.0
        if (sensor := self.wrench_sensor(parameters)) is not None:
            turns = slice(self.sensor.start, self.sensor.start + 3)
            by_turn = -wrenches[:, 0] @ sensor.turns[:, 0].T
            rows[:, turns] = parameters[GAIN] * by_turn * self.prior.sensor_std[:3]
        return rows

    def other_readings(self, parameters: np.ndarray, wrenches: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (F·C,) and Jacobian of the kept observations' wrench components other than the moment about y."""
        sensor = self.wrench_sensor(parameters)
        if sensor is None:
            return np.zeros(0), np.zeros((0, len(parameters)))
        names, first, count = list(READINGS), self.sensor.start, len(sensor.components)
        which = [names.index(name) for name in sensor.components]
        used = [one for one, kept in zip(self.observations, self.kept, strict=True) if kept]
        read = np.array([[one.still.readings[index] for index in which] for one in used]).reshape(len(used), count)
        values = np.moveaxis(wrenches @ sensor.axes[which].T, 2, 1)
        rows = np.zeros((len(used), count, len(parameters)))
        rows[:, :, ANTENNA] = values[:, :, 1:_BENT]
        rows[:, :, self.readings.start : self.taper.stop] = values[:, :, _BENT:]
        rows[:, :, first : first + 3] = np.einsum("fw,kcw->fck", wrenches[:, 0], sensor.turns[:, which])
        rows *= sensor.gain[:, None]
        own = np.arange(count)
        rows[:, own, first + 3 + own], rows[:, own, first + 3 + count + own] = values[:, :, 0], 1.0
        rows[:, :, self.sensor] *= self.prior.sensor_std
        off = (sensor.gain * values[:, :, 0] + sensor.offset - read) / sensor.std
        return off.ravel(), (rows / sensor.std[:, None]).reshape(-1, len(parameters))

    def moment_residuals_Nm(self, parameters: np.ndarray, moments: np.ndarray) -> np.ndarray:
        """(F,) measured moments less the predicted ones; NaN without a sensor."""
        readings = np.array([obs.still.moment_Nm for obs in self.observations])
        return readings - parameters[GAIN] * moments[:, 0] - parameters[OFFSET]

    def _in_std(self, misfit_Nm: np.ndarray) -> np.ndarray:
        """Moment residuals in standard deviations of the sensor's noise; 0 without a sensor."""
        return misfit_Nm / self.moment_std_Nm if np.isfinite(self.moment_std_Nm) else np.zeros_like(misfit_Nm)

    def _pose_prior(self, estimate: PoseEstimate, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        whiten, away = self._away(estimate, parameters)
        rows = np.zeros((6, len(parameters)))
        rows[:, POSE] = whiten
        if len(self.prior.lens_axes):
            rows[:, self.lens] = -whiten @ (estimate.lens_sensitivity @ self.prior.lens_axes)
        return away, rows

    def _away(self, estimate: PoseEstimate, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(6, 6) whitening matrix of a pose estimate, and (6,) the parameters' pose relative to it, whitened."""
        whiten = np.linalg.inv(np.linalg.cholesky(estimate.covariance))
        away = self.pose(parameters).tangent_from(estimate.T_antenna_camera)
        if len(self.prior.lens_axes):
            away = away - estimate.lens_sensitivity @ self.prior.lens_axes @ parameters[self.lens]
        return whiten, whiten @ away


def _wrenches_of(curves: Curves, gravity_m_s2: np.ndarray, load_N: np.ndarray, antennas: np.ndarray) -> np.ndarray:
    """(B, 6) force and moment about the antenna's origin of loads (B, 2) along y and z, and of the weight in gravity
    (B, 3), of antennas (A, 9) in turn."""
    load = np.column_stack([np.zeros(len(load_N)), load_N])
    mass = np.exp(np.resize(antennas[:, 7], len(load)))[:, None]
    points, step = curves.points_m, np.diff(curves.arclength_m)
    middle = np.einsum("bn,bni->bi", step, 0.5 * (points[:, 1:] + points[:, :-1]))
    force = load + mass * gravity_m_s2 * curves.arclength_m[:, -1:]
    moment = np.cross(curves.contact_m, load) + mass * np.cross(middle, gravity_m_s2)
    moment[:, 1] = -curves.moment_Nm
    return np.hstack([force, moment])


assert RIG == OFFSET + 1
