"""Known loads that could be hung next, and the rows that each would add to the bundle adjustment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment
from vbaa_calib.calibrate.antenna.inputs import Observation
from vbaa_calib.calibrate.antenna.problem import ANTENNA
from vbaa_calib.geometry import Kinematics
from vbaa_calib.session import Load, Session, Still, gravity_antenna

_STANDARD_GRAVITY_M_S2 = 9.80665
_STEEPEST_RAD = np.deg2rad(35.0)
"""Slope at the load up to which the model of the antenna is exact enough."""
_NEAREST, _FARTHEST_M = 0.35, 5e-3
"""Loads hang beyond this part of the length, and at least this far from the tip: a hook needs a place."""
_RULER_M, _PLACES = 5e-3, 9
"""Distances that are easily found on a ruler, and how many of them are tried."""
_SIDEWAYS = 0.02
"""Part of a hanging weight that may pull along the antenna: only the force across it is known."""
_STRAIGHT = np.cos(np.deg2rad(10.0))
"""Loads that pull further off gravity than this hang over a pulley."""
_LEAST_VISIBLE = 0.97
"""Part of the visible free antenna that must also be visible of the loaded one."""


@dataclass(frozen=True, eq=False)
class Pull:
    """A direction in which a weight can pull, at a place of the joints.

    direction : (2,) unit (y, z), antenna frame. over_pulley : it does not hang straight down.
    """

    pan_rad: float
    tilt_rad: float
    direction: np.ndarray
    gravity_m_s2: np.ndarray
    over_pulley: bool


@dataclass(frozen=True, eq=False)
class LoadCandidate:
    """A load that could be hung.

    jacobian : (N, 17 + P) whitened rows that it would add.
    by_readings : (N, 2) derivatives of its residuals by its distance, per m, and by the logarithm of its force.
    """

    load: Load
    mass_kg: float
    pull: Pull
    jacobian: np.ndarray
    by_readings: np.ndarray


def pulls(session: Session, kinematics: Kinematics, observations: Sequence[Observation]) -> list[Pull]:
    """Straight down at the joints so far, where that is across the antenna; over a pulley to all four sides where the
    session did so before, or is weightless."""
    joints = {(0.0, 0.0), *((one.still.pan_rad, one.still.tilt_rad) for one in observations)}
    home = [Still(None, pan, tilt, 0.0) for pan, tilt in sorted(joints, key=lambda at: (abs(at[0]) + abs(at[1]), at))]
    gravity = gravity_antenna(kinematics, session.gravity_world_m_s2, home)
    found: list[Pull] = []
    for still, pull in zip(home, gravity, strict=True):
        size, across = float(np.linalg.norm(pull)), float(np.hypot(pull[1], pull[2]))
        if size > 0 and abs(pull[0]) <= _SIDEWAYS * size:
            down = pull[1:] / across
            if all(down @ known.direction < _STRAIGHT for known in found):
                found.append(Pull(still.pan_rad, still.tilt_rad, down, pull, False))
    pulled = [(one.load_N, one.gravity_m_s2) for one in observations]
    aside = any(load @ pull[1:] < _STRAIGHT * np.linalg.norm(load) * np.linalg.norm(pull) for load, pull in pulled)
    if aside or not any(one.gravity_m_s2.any() for one in observations):
        for direction in np.array([[0.0, 1.0], [0.0, -1.0], [1.0, 0.0], [-1.0, 0.0]]):
            if all(direction @ known.direction < _STRAIGHT for known in found):
                found.append(Pull(home[0].pan_rad, home[0].tilt_rad, direction, gravity[0], True))
    return found


def load_candidates(
    joint: BundleAdjustment, session: Session, kinematics: Kinematics, masses_kg: Sequence[float]
) -> list[LoadCandidate]:
    """Every weight at every place and pull that the elastica and the picture support."""
    length = session.antenna.length_m
    grid = np.arange(_RULER_M, length - _FARTHEST_M + 1e-9, _RULER_M)
    grid = grid[grid >= _NEAREST * length]
    if not len(grid):
        grid = np.array([length - _FARTHEST_M])
    places = np.unique(grid[np.linspace(0, len(grid) - 1, min(_PLACES, len(grid))).round().astype(int)])
    stiffness = float(np.exp(joint.parameters[ANTENNA][6]))
    wanted = []
    for pull in pulls(session, kinematics, joint.problem.observations):
        weight = float(np.linalg.norm(pull.gravity_m_s2)) or _STANDARD_GRAVITY_M_S2
        for mass in sorted(set(masses_kg)):
            force = mass * weight * pull.direction
            wanted += [
                (mass, pull, Load(None, pull.pan_rad, pull.tilt_rad, 0.0, float(at), float(force[0]), float(force[1])))
                for at in places
                if mass * weight * at**2 / (2.0 * stiffness) <= _STEEPEST_RAD
            ]
    if not wanted:
        return []
    observations = [Observation(load, np.zeros((0, 2)), np.zeros(0), pull.gravity_m_s2) for _, pull, load in wanted]
    placed, inside = _predicted(joint, observations)
    chosen = [item for item, seen in zip(wanted, inside, strict=True) if seen]
    if not chosen:
        return []
    at = joint.solution.parameters[: joint.problem.lens.stop]
    problem = joint.problem.over(placed).relinearised(at)
    found = zip(chosen, problem.by_still(at), problem.whitened_by_load(at), strict=True)
    return [LoadCandidate(load, mass, pull, rows, by_load) for (mass, pull, load), (_, rows), by_load in found]


def _predicted(joint: BundleAdjustment, wanted: Sequence[Observation]) -> tuple[list[Observation], list[bool]]:
    """The stills that stay in the picture, with the points that would be seen of them; and which these are."""
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
    inside = [bool(own >= _LEAST_VISIBLE * visible[0] > 0) for own in visible[1:]]
    placed = []
    for index in (np.flatnonzero(inside) + 1).tolist():
        # a node stands for all the points of its piece of the antenna
        which = seen[index]
        each = sigma / np.sqrt(np.maximum(points * share[index, which], 1e-3))
        placed.append(replace(wanted[index - 1], points_px=pixels[index, which], sigma_px=each))
    return placed, inside
