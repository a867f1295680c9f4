"""How well EI is known by the loads so far, and which weight to hang where next.

The readings of places and weights are parameters of the bundle adjustment, and of the forecast.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment
from vbaa_calib.calibrate.antenna.inputs import Observation, reading_keys
from vbaa_calib.calibrate.antenna.problem import ANTENNA, GAIN
from vbaa_calib.geometry import Kinematics
from vbaa_calib.session import STANDARD_GRAVITY_M_S2, Load, LoadReadings, Session, Still, gravity_antenna

from .settings import GuideSettings

_LOG_STIFFNESS = ANTENNA.start + 6  # place among `RIG_PARAMETERS`


@dataclass(frozen=True, eq=False)
class _Pull:
    """A direction (2,), unit (y, z), in which a weight can pull at a place of the joints, straight down or not."""

    pan_rad: float
    tilt_rad: float
    direction: np.ndarray
    gravity_m_s2: np.ndarray
    over_pulley: bool


@dataclass(frozen=True, eq=False)
class _LoadCandidate:
    """A load that could be hung."""

    load: Load
    mass_kg: float
    pull: _Pull
    jacobian: np.ndarray  # (N, 17 + P) whitened rows that it would add
    by_readings: np.ndarray  # (N, 2) by its distance, per m, and by the logarithm of its force


def _pulls(session: Session, kinematics: Kinematics, observations: Sequence[Observation]) -> list[_Pull]:
    """Possible pulls: straight down at the joints so far, where that is across the antenna; over a pulley to all four
    sides where the session did so before, or is weightless."""
    joints = {(0.0, 0.0), *((one.still.pan_rad, one.still.tilt_rad) for one in observations)}
    home = [Still(None, pan, tilt, 0.0) for pan, tilt in sorted(joints, key=lambda at: (abs(at[0]) + abs(at[1]), at))]
    gravity = gravity_antenna(kinematics, session.gravity_world_m_s2, home)
    found: list[_Pull] = []
    for still, pull in zip(home, gravity, strict=True):
        size, across = float(np.linalg.norm(pull)), float(np.hypot(pull[1], pull[2]))
        if size > 0 and abs(pull[0]) <= GuideSettings.sideways * size:
            down = pull[1:] / across
            if all(down @ known.direction < GuideSettings.straight for known in found):
                found.append(_Pull(still.pan_rad, still.tilt_rad, down, pull, False))
    pulled = [(one.load_N, one.gravity_m_s2) for one in observations]
    sideways = any(
        load @ pull[1:] < GuideSettings.straight * np.linalg.norm(load) * np.linalg.norm(pull) for load, pull in pulled
    )
    if sideways or not any(one.gravity_m_s2.any() for one in observations):
        for direction in np.array([[0.0, 1.0], [0.0, -1.0], [1.0, 0.0], [-1.0, 0.0]]):
            if all(direction @ known.direction < GuideSettings.straight for known in found):
                found.append(_Pull(home[0].pan_rad, home[0].tilt_rad, direction, gravity[0], True))
    return found


def _load_candidates(
    joint: BundleAdjustment, session: Session, kinematics: Kinematics, masses_kg: Sequence[float]
) -> list[_LoadCandidate]:
    """Every weight at every place and pull that the elastica and the picture support."""
    length = session.antenna.length_m
    grid = np.arange(GuideSettings.ruler_m, length - GuideSettings.load_to_tip_m + 1e-9, GuideSettings.ruler_m)
    grid = (
        grid[grid >= GuideSettings.nearest_load * length]
        if (grid >= GuideSettings.nearest_load * length).any()
        else np.array([length - GuideSettings.load_to_tip_m])
    )
    places = np.unique(
        grid[np.linspace(0, len(grid) - 1, min(GuideSettings.load_places, len(grid))).round().astype(int)]
    )
    stiffness = float(np.exp(joint.parameters[ANTENNA][6]))

    def turning(at_m: float) -> float:
        return float(session.antenna.taper.turning(np.array(at_m / length)))

    wanted = []
    for pull in _pulls(session, kinematics, joint.problem.observations):
        weight = float(np.linalg.norm(pull.gravity_m_s2)) or STANDARD_GRAVITY_M_S2
        for mass in sorted(set(masses_kg)):
            force = mass * weight * pull.direction
            wanted += [
                (mass, pull, Load(None, pull.pan_rad, pull.tilt_rad, 0.0, float(at), float(force[0]), float(force[1])))
                for at in places
                if mass * weight * at**2 * turning(at) / (2.0 * stiffness) <= GuideSettings.steepest_rad
            ]
    if not wanted:
        return []
    observations = [Observation(load, np.zeros((0, 2)), np.zeros(0), pull.gravity_m_s2) for _, pull, load in wanted]
    placed = _predicted(joint, observations)
    if not placed:
        return []
    at = joint.solution.parameters[: joint.problem.lens.stop]
    problem = joint.problem.over([*placed.values()]).relinearised(at)
    found = zip(placed, problem.by_still(at), problem.whitened_by_load(at), strict=True)
    return [_LoadCandidate(wanted[index][2], *wanted[index][:2], rows, by_load) for index, (_, rows), by_load in found]


def _predicted(joint: BundleAdjustment, wanted: Sequence[Observation]) -> dict[int, Observation]:
    """The static frames in which the antenna stays in the picture, by their index, with the points that would be seen
    of them."""
    problem, parameters = joint.problem, joint.solution.parameters
    free = Observation(Still(None, 0.0, 0.0, 0.0), np.zeros((0, 2)), np.zeros(0), wanted[0].gravity_m_s2)
    curves = replace(problem, observations=[free, *wanted]).curves(parameters[None, ANTENNA])
    camera, view = problem.camera(parameters), joint.T_antenna_camera.inverse()
    pixels, valid = camera.project(curves.points_m @ view.rotation.T + view.translation_m)
    seen = valid & ((pixels >= 0) & (pixels <= np.subtract(camera.image_size, 1))).all(axis=-1)
    share = np.gradient(curves.arclength_m, axis=1) / problem.length_m
    visible = (share * seen).sum(axis=1)
    usual = [one for one, kept in zip(problem.observations, problem.kept, strict=True) if kept]
    points = float(np.median([len(one.points_px) for one in usual])) / max(float(visible[0]), 1e-3)
    sigma = float(np.median(np.concatenate([one.sigma_px for one in usual])))
    placed = {}
    for index in np.flatnonzero((visible[1:] >= GuideSettings.least_visible * visible[0]) & (visible[0] > 0)).tolist():
        # a node stands for all the points of its piece of the antenna
        which = seen[index + 1]
        each = sigma / np.sqrt(np.maximum(points * share[index + 1, which], 1e-3))
        placed[index] = replace(wanted[index], points_px=pixels[index + 1, which], sigma_px=each)
    return placed


@dataclass(frozen=True)
class _StiffnessStd:
    """Relative standard deviations of EI: by the pictures' noise, by the places, by the weights, by everything."""

    noise: float
    distance: float
    mass: float
    total: float


@dataclass(frozen=True, eq=False)
class _StiffnessForecast:
    """Uncertainty of EI now, and after further loads.

    A weight that hangs twice is off by the same both times, and so is a place that is used twice: their errors do not
    average out.
    """

    readings: Sequence[tuple[str, str]]  # the G different places and weights, as `reading_keys` names them
    scale: np.ndarray  # (17 + P,) of the joint solve's parameters
    # (17 + P + G, 17 + P + G) of the scaled parameters, then of the readings' errors in deviations
    information: np.ndarray
    added: np.ndarray  # (C, 17 + P + G, 17 + P + G) what each candidate adds to it

    @staticmethod
    def of(joint: BundleAdjustment, candidates: Sequence[_LoadCandidate], readings: LoadReadings) -> _StiffnessForecast:
        """The forecast from a bundle adjustment and the loads that could be hung next."""
        solution = joint.problem.linearised(joint.solution.parameters)
        known = {"distance": readings.distance_std_m, "mass": readings.force_std_relative}
        # as noted: corrected numbers cannot be shared with another load
        loads = [one.still for one in joint.noted if isinstance(one.still, Load)] + [one.load for one in candidates]
        names = [key for key in dict.fromkeys(key for one in loads for key in reading_keys(one)) if known[key[0]] > 0]
        jacobian = solution.jacobian * solution.weights[:, None]
        light = slice(joint.problem.light.start, None)
        # what all lines share, and a wrench sensor's parameters, are marginalised
        basis = np.linalg.qr(jacobian[:, light])[0]
        jacobian = (jacobian - basis @ (basis.T @ jacobian))[:, : light.start]
        size = joint.problem.lens.stop
        scale = np.linalg.norm(jacobian[:, :size], axis=0)
        jacobian[:, :size] /= scale

        def gram(one: _LoadCandidate) -> np.ndarray:
            both = np.hstack([one.jacobian / scale, np.zeros((len(one.jacobian), len(names)))])
            for key, slopes in zip(reading_keys(one.load), one.by_readings.T, strict=True):
                if key in names:
                    both[:, size + names.index(key)] = slopes * known[key[0]]
            return both.T @ both

        information, own = np.eye(size + len(names)), jacobian.shape[1]
        # the solve's own rows have the free antenna and the priors in them as well
        information[:own, :own] = jacobian.T @ jacobian
        added = np.array([gram(one) for one in candidates]).reshape(-1, *information.shape)
        return _StiffnessForecast(names, scale, information, added)

    def now(self) -> _StiffnessStd:
        """Standard deviations of EI with the present loads."""
        return self._std(self.information[None])[0]

    def after_each(self) -> list[_StiffnessStd]:
        """Standard deviations of EI with each candidate besides."""
        return self._std(self.information + self.added)

    def after(self, index: int) -> _StiffnessForecast:
        """The forecast with this candidate hung."""
        return replace(self, information=self.information + self.added[index])

    def _std(self, information: np.ndarray) -> list[_StiffnessStd]:
        of_mass = np.array([kind == "mass" for kind, _ in self.readings], bool)
        solved = []
        for which in (np.zeros_like(of_mass), of_mass, np.ones_like(of_mass)):
            free = np.flatnonzero(np.concatenate([np.ones(len(self.scale), bool), which]))
            inverse = np.linalg.inv(information[:, free[:, None], free])
            solved.append(np.sqrt(inverse[:, _LOG_STIFFNESS, _LOG_STIFFNESS]) / self.scale[_LOG_STIFFNESS])
        noise, mass, total = solved
        place = np.sqrt(np.maximum(total**2 - mass**2, 0.0))
        mass = np.sqrt(np.maximum(mass**2 - noise**2, 0.0))
        return [_StiffnessStd(*row) for row in np.column_stack([noise, place, mass, total]).tolist()]


@dataclass(frozen=True, eq=False)
class _LoadProgress:
    """How well EI is known."""

    now: _StiffnessStd  # EI's deviations
    # what to hang next: joints, distance and force to note, EI's deviations after it, and what a person does; None
    # where no weight helps
    suggestion: tuple[Load, _StiffnessStd, str] | None
    enough: bool  # the goal is met, or no further load of these weights helps
    reached: bool  # the goal is met
    missing: tuple[str, ...]  # what the loads do not show, in words
    words: str


def load_progress(
    joint: BundleAdjustment,
    session: Session,
    masses_kg: Sequence[float],
    kinematics: Kinematics,
    goal_relative: float = 0.01,
) -> _LoadProgress:
    """The uncertainty of EI by the static frames so far, with or without loads, and the load of the weights at hand
    that lowers it most. A weight that is used twice counts with the same error. kinematics : with the joints' zeros by
    a sweep; goal_relative : of EI, places and weights included.
    """
    candidates = _load_candidates(joint, session, kinematics, masses_kg)
    forecast = _StiffnessForecast.of(joint, candidates, joint.problem.prior.readings)
    now, after = forecast.now(), [std.total for std in forecast.after_each()]
    kept = zip(joint.noted, joint.kept, strict=True)
    hung = [one.still for one, inside in kept if inside and isinstance(one.still, Load)]
    gain_std = float(np.sqrt(joint.covariance[GAIN, GAIN]) / max(abs(joint.parameters[GAIN]), 1e-9))
    gain_std = gain_std if session.with_sensor else 0.0
    # a load that shows the gain comes first where the gain is not known, if any can
    showing_gain = [
        index for index, one in enumerate(candidates) if abs(one.pull.direction[1]) > GuideSettings.out_of_plane
    ]
    gain_open = gain_std > GuideSettings.gain_std and bool(showing_gain)
    best = min(showing_gain if gain_open else range(len(candidates)), key=lambda index: after[index], default=None)
    # after the best few further loads; NaN without any
    reachable, ahead = np.inf if candidates else np.nan, forecast
    for _ in range(GuideSettings.ahead if candidates else 0):
        ahead = ahead.after(int(np.argmin([std.total for std in ahead.after_each()])))
        reachable = min(reachable, ahead.now().total)
    reached, helps = now.total <= goal_relative, reachable < (1 - GuideSettings.least_load_gain) * now.total
    enough = len(hung) >= GuideSettings.fewest_loads and not gain_open and (reached or not helps)
    suggestion = None
    if best is not None and (not enough or helps):
        suggestion = _suggestion(candidates[best], forecast.after(best).now(), gain_open)
    words = (
        f"EI is known to ± {_percent(now.total)} (pictures {_percent(now.noise)}, places {_percent(now.distance)}, "
        f"weights {_percent(now.mass)}); the goal is {_percent(goal_relative)}"
    )
    if enough and reached:
        words += ": enough, more is not needed"
    elif enough:
        words += f": more of these loads will not help. What limits it is {_limit(now)}"
    elif not masses_kg:
        words += ": name the weights at hand"
    elif suggestion is None:
        words += ": none of these weights fits: each bends the antenna too far, or out of the picture"
    elif not reached and not reachable <= goal_relative:
        words += f": the best few loads of these weights lead to {_percent(reachable)}. What limits it is {_limit(now)}"
    missing = _missing(hung, gain_std, _pulls(session, kinematics, joint.problem.observations))
    return _LoadProgress(now, suggestion, enough, reached, missing, words)


def _suggestion(one: _LoadCandidate, after: _StiffnessStd, gain_open: bool) -> tuple[Load, _StiffnessStd, str]:
    load, direction = one.load, one.pull.direction
    axis = int(np.argmax(np.abs(direction)))
    pulling = f"over a pulley, pulling to {'+' if direction[axis] > 0.0 else '−'}{'yz'[axis]}"
    words = (
        f"hang {1e3 * one.mass_kg:.4g} g at {1e3 * load.distance_m:.0f} mm from the clamp, "
        f"{pulling if one.pull.over_pulley else 'straight down'} (pan {np.rad2deg(load.pan_rad):.0f}°, tilt "
        f"{np.rad2deg(load.tilt_rad):.0f}°): EI to ± {_percent(after.total)}"
        + (", and the sensor's gain" if gain_open else "")
    )
    return load, after, words


def _missing(hung: Sequence[Load], gain_std: float, possible: Sequence[_Pull]) -> tuple[str, ...]:
    """Sentences on what the loads so far do not determine."""
    found = []
    if len(hung) < GuideSettings.fewest_loads:
        more = GuideSettings.fewest_loads - len(hung)
        found.append(f"{more} more load{'s' * (more > 1)}: a wrong one is found only by comparison with two others")
    forces = np.array([[load.force_y_N, load.force_z_N] for load in hung]).reshape(-1, 2)
    size = np.linalg.norm(forces, axis=1)
    for axis, name in enumerate("yz"):
        if not hung or (np.abs(forces[:, axis]) > GuideSettings.along * size).any():
            continue
        how = f"that needs a thread over a pulley along {name}, or an antenna rolled by a quarter turn"
        if any(abs(pull.direction[axis]) > GuideSettings.along for pull in possible):
            how = "hang one that way"
        found.append(f"no load along {name}: whether the antenna bends alike in y and z is not tested; {how}")
    if hung and gain_std > GuideSettings.gain_std:
        found.append(f"the moment sensor's gain is known to ± {_percent(gain_std)} only: it needs a load along z")
    return tuple(found)


def _limit(now: _StiffnessStd) -> str:
    """The largest part of EI's uncertainty, and what would lower it."""
    if now.noise > np.hypot(now.distance, now.mass):
        return "the pictures: a heavier weight bends the antenna more"
    if now.distance > now.mass:
        return "the places: measure them from the clamp with a calliper"
    return "the weights: weigh them on a better balance"


def _percent(part: float) -> str:
    return f"{100 * part:.2g} %" if not part < 1e-5 else "0 %"
