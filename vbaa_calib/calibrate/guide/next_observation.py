"""What a session should observe next: each candidate's rows of the joint least-squares problem, and the reduction of
EI's uncertainty by each load.

The errors of the loads' distances and weights are parameters of the bundle adjustment, and of the forecast.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from targets.board import BoardWithIds, corner_points
from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment
from vbaa_calib.calibrate.antenna.inputs import Observation, ReadingGroups
from vbaa_calib.calibrate.antenna.problem import ANTENNA, GAIN, LOG_STIFFNESS, POSE, Problem
from vbaa_calib.calibrate.lens.models import pose_slopes, projected
from vbaa_calib.calibrate.pipeline import Calibration
from vbaa_calib.calibrate.pose.board_pose import jig_estimate
from vbaa_calib.calibrate.pose.fusion import PoseEstimate
from vbaa_calib.calibrate.pose.sweep import solve_sweep
from vbaa_calib.core.errors import VbaaError
from vbaa_calib.core.least_squares import without_own
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.session import STANDARD_GRAVITY_M_S2, Load, Session, Still, gravity_antenna

from .settings import GuideSettings
from .suggestion import visible_corners


def _unseen(frame: Still, gravity_m_s2: np.ndarray) -> Observation:
    """A static frame without a picture."""
    return Observation(frame, np.zeros((0, 2)), np.zeros(0), gravity_m_s2)


def _directions(loads: Sequence[Observation]) -> np.ndarray:
    """(N, 2) unit vectors (y, z) of the loads' forces."""
    pulled = np.array([one.load_N for one in loads]).reshape(-1, 2)
    return pulled / np.linalg.norm(pulled, axis=1, keepdims=True)


def _over_pulley(load: Observation) -> bool:
    """Whether a load pulls in another direction than gravity."""
    pull, gravity = load.load_N, load.gravity_m_s2
    down = pull @ gravity[1:] >= GuideSettings.straight * np.linalg.norm(pull) * np.linalg.norm(gravity)
    return not (down and gravity.any())


def _mass_kg(load: Observation) -> float:
    """Mass of the weight that exerts a load."""
    return float(np.linalg.norm(load.load_N) / (np.linalg.norm(load.gravity_m_s2) or STANDARD_GRAVITY_M_S2))


def _pulls(session: Session, kinematics: Kinematics, observations: Sequence[Observation]) -> list[Observation]:
    """Possible directions of force, as loads of 1 N: straight down at the joint angles used so far, where that is
    across the antenna; over a pulley in the four lateral directions, where the session has such loads or no gravity."""
    joints = {(0.0, 0.0), *((one.still.pan_rad, one.still.tilt_rad) for one in observations)}
    home = [Still(None, pan, tilt, 0.0) for pan, tilt in sorted(joints, key=lambda at: (abs(at[0]) + abs(at[1]), at))]
    gravity = gravity_antenna(kinematics, session.gravity_world_m_s2, home)
    found: list[Observation] = []

    def add(frame: Still, direction: np.ndarray, pull: np.ndarray) -> None:
        if (_directions(found) @ direction < GuideSettings.straight).all():
            y, z = direction.tolist()
            found.append(_unseen(Load(None, frame.pan_rad, frame.tilt_rad, 0.0, 0.0, y, z), pull))

    for still, pull in zip(home, gravity, strict=True):
        size, across = float(np.linalg.norm(pull)), float(np.hypot(pull[1], pull[2]))
        if size > 0 and abs(pull[0]) <= GuideSettings.sideways * size:
            add(still, pull[1:] / across, pull)
    if any(_over_pulley(one) for one in observations if one.loaded) or not any(
        one.gravity_m_s2.any() for one in observations
    ):
        for direction in np.array([[0.0, 1.0], [0.0, -1.0], [1.0, 0.0], [-1.0, 0.0]]):
            add(home[0], direction, gravity[0])
    return found


def _loads(
    joint: BundleAdjustment, session: Session, kinematics: Kinematics, masses_kg: Sequence[float]
) -> list[Observation]:
    """Every weight at every distance and direction that keeps the antenna within the elastica model's range, the
    heaviest last."""
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
    turning = session.antenna.taper.turning(places / length)
    found = []
    for pull in _pulls(session, kinematics, joint.problem.observations):
        weight = float(np.linalg.norm(pull.gravity_m_s2)) or STANDARD_GRAVITY_M_S2
        assert isinstance(pull.still, Load)
        for mass in sorted(set(masses_kg)):
            y, z = (mass * weight * pull.load_N).tolist()
            fits = mass * weight * places**2 * turning / (2.0 * stiffness) <= GuideSettings.steepest_rad
            hung = [replace(pull.still, distance_m=at, force_y_N=y, force_z_N=z) for at in places[fits].tolist()]
            found += [_unseen(load, pull.gravity_m_s2) for load in hung]
    return found


def _predicted(joint: BundleAdjustment, wanted: Sequence[Observation]) -> dict[int, Observation]:
    """The candidate static frames in which the antenna stays in the picture, by their index, with their predicted
    points."""
    problem, parameters = joint.problem, joint.solution.parameters
    free = _unseen(Still(None, 0.0, 0.0, 0.0), wanted[0].gravity_m_s2)
    curves = replace(problem, observations=[free, *wanted]).curves(parameters[None, ANTENNA])
    camera, view = problem.camera(parameters), joint.T_antenna_camera.inverse()
    pixels, valid = camera.project(curves.points_m @ view.rotation.T + view.translation_m)
    seen = valid & ((pixels >= 0) & (pixels <= np.subtract(camera.image_size, 1))).all(axis=-1)
    share = np.gradient(curves.arclength_m, axis=1) / problem.length_m
    visible = (share * seen).sum(axis=1)
    usual = [one for one, kept in zip(problem.observations, problem.kept, strict=True) if kept]
    count = float(np.median([len(one.points_px) for one in usual]))
    sigma = float(np.median(np.concatenate([one.sigma_px for one in usual])))
    placed = {}
    for index in np.flatnonzero((visible[1:] >= GuideSettings.least_visible * visible[0]) & (visible[0] > 0)).tolist():
        line = pixels[index + 1, seen[index + 1]]
        along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
        # evenly along the picture's line, as they are found: what lines share depends on it
        even = np.linspace(0.0, along[-1], max(int(min(count, GuideSettings.points)), 2))
        points = np.column_stack([np.interp(even, along, each) for each in line.T])
        std = np.full(len(points), sigma * np.sqrt(len(points) / count))
        placed[index] = replace(wanted[index], points_px=points, sigma_px=std)
    return placed


def _stiffness_std(joint: BundleAdjustment, rows: Sequence[np.ndarray] = ()) -> float:
    """Relative standard deviation of EI after further observations, as `BundleAdjustment.forecast` takes their rows."""
    every = np.vstack(rows) if len(rows) else np.zeros((0, joint.problem.size))
    return float(np.sqrt(joint.forecast(every)[LOG_STIFFNESS, LOG_STIFFNESS]))


def _stiffness_parts(joint: BundleAdjustment) -> dict[str, float]:
    """Relative standard deviations of EI: due to "noise", "distance" and "mass" (of the loads), and in "total"."""
    problem, certain = joint.problem, 1e6 * np.eye(joint.problem.size)
    places, weights = (
        certain[problem.readings.start + np.unique(each[each >= 0])]
        for each in (problem.groups.distance, problem.groups.force)
    )
    total, without_places = _stiffness_std(joint), _stiffness_std(joint, [places])
    noise = _stiffness_std(joint, [places, weights])
    place, mass = (np.sqrt(max(a**2 - b**2, 0.0)) for a, b in ((total, without_places), (without_places, noise)))
    return {"noise": noise, "distance": float(place), "mass": float(mass), "total": total}


@dataclass(frozen=True, eq=False)
class _LoadProgress:
    """Uncertainty of EI from the loads so far, and the suggested next load."""

    now: Mapping[str, float]  # EI's deviations, see `_stiffness_parts`
    # what to hang next: joints, distance and force to note, EI's deviation after it, and what a person does; None
    # where no weight helps
    suggestion: tuple[Load, float, str] | None
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
    """The uncertainty of EI from the static frames so far, with or without loads, and the available load that reduces
    it most. A weight that is used twice has the same error both times, and so has a place: they do not average out.
    kinematics : with the joints' zeros from a sweep; goal_relative : of EI, distances and weights included."""
    wanted = _loads(joint, session, kinematics, masses_kg)
    candidates = [*_predicted(joint, wanted).values()] if wanted else []
    rows = _antenna_rows(joint, candidates) if candidates else []
    now, after = _stiffness_parts(joint), [_stiffness_std(joint, [one]) for one in rows]
    kept = zip(joint.noted, joint.kept, strict=True)
    hung = [one.still for one, inside in kept if inside and isinstance(one.still, Load)]
    gain_std = float(np.sqrt(joint.covariance[GAIN, GAIN]) / max(abs(joint.parameters[GAIN]), 1e-9))
    gain_std = gain_std if session.with_sensor else 0.0
    # a load that shows the gain comes first where the gain is not known, if any can
    showing_gain = [
        index for index, way in enumerate(_directions(candidates)) if abs(way[1]) > GuideSettings.out_of_plane
    ]
    gain_open = gain_std > GuideSettings.gain_std and bool(showing_gain)
    best = min(showing_gain if gain_open else range(len(candidates)), key=lambda index: after[index], default=None)
    # after the best few further loads; NaN without any
    reachable, ahead, stds = min(after, default=np.nan), list[np.ndarray](), after
    for _ in range(GuideSettings.ahead - 1 if candidates else 0):
        ahead.append(rows[int(np.argmin(stds))])
        stds = [_stiffness_std(joint, [*ahead, one]) for one in rows]
        reachable = min(reachable, *stds)
    reached, helps = now["total"] <= goal_relative, reachable < (1 - GuideSettings.least_load_gain) * now["total"]
    enough = len(hung) >= GuideSettings.fewest_loads and not gain_open and (reached or not helps)
    suggestion = None
    if best is not None and (not enough or helps):
        words = f"hang {_load_words(candidates[best])}: EI to ± {_percent(after[best])}"
        load = candidates[best].still
        assert isinstance(load, Load)
        suggestion = load, after[best], words + ", and the sensor's gain" * gain_open
    words = (
        f"EI is known to ± {_percent(now['total'])} (pictures {_percent(now['noise'])}, places "
        f"{_percent(now['distance'])}, weights {_percent(now['mass'])}); the goal is {_percent(goal_relative)}"
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


def _load_words(one: Observation) -> str:
    """Weight, distance and direction of a load in words."""
    load, direction = one.still, _directions([one])[0]
    assert isinstance(load, Load)
    axis = int(np.argmax(np.abs(direction)))
    pulling = f"over a pulley, pulling to {'+' if direction[axis] > 0.0 else '−'}{'yz'[axis]}"
    return (
        f"{1e3 * _mass_kg(one):.4g} g at {1e3 * load.distance_m:.0f} mm from the clamp, "
        f"{pulling if _over_pulley(one) else 'straight down'} (pan {np.rad2deg(load.pan_rad):.0f}°, tilt "
        f"{np.rad2deg(load.tilt_rad):.0f}°)"
    )


def _missing(hung: Sequence[Load], gain_std: float, possible: Sequence[Observation]) -> tuple[str, ...]:
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
        if (np.abs(_directions(possible)[:, axis]) > GuideSettings.along).any():
            how = "hang one that way"
        found.append(f"no load along {name}: whether the antenna bends alike in y and z is not tested; {how}")
    if hung and gain_std > GuideSettings.gain_std:
        found.append(f"the moment sensor's gain is known to ± {_percent(gain_std)} only: it needs a load along z")
    return tuple(found)


def _limit(now: Mapping[str, float]) -> str:
    """The largest contribution to EI's uncertainty, and how to reduce it, in words."""
    if now["noise"] > np.hypot(now["distance"], now["mass"]):
        return "the pictures: a heavier weight bends the antenna more"
    if now["distance"] > now["mass"]:
        return "the places: measure them from the clamp with a calliper"
    return "the weights: weigh them on a better balance"


def _percent(part: float) -> str:
    return f"{100 * part:.2g} %" if not part < 1e-5 else "0 %"


Further = tuple[Mapping[str, Any], np.ndarray]
"""What would be observed, with `words` for a person, and its rows as `BundleAdjustment.forecast` takes them."""


def further_observations(made: Calibration) -> list[Further]:
    """Candidate observations: loads, pictures of the free antenna and of boards, a sweep, a more exact jig, as far as
    the session allows."""
    found = [*_of_antenna(made), *_of_boards(made), *_of_jig(made), *_of_sweep(made)]
    width = max((rows.shape[1] for _, rows in found), default=0)
    return [(described, np.pad(rows, ((0, 0), (0, width - rows.shape[1])))) for described, rows in found]


def _of_antenna(made: Calibration) -> Iterator[Further]:
    """Candidate loads, the heaviest at each distance, and the free antenna at several tilts."""
    session, joint, kinematics = made.session, made.joint, made.plane.kinematics
    heaviest = dict[Any, tuple[Observation, dict[str, Any]]]()
    for one in _loads(joint, session, kinematics, _masses_kg(session, joint)):
        load = one.still
        assert isinstance(load, Load)
        described: dict[str, Any] = {name: getattr(load, name) for name in ("pan_rad", "tilt_rad", "distance_m")}
        place = (*described.values(), *_directions([one])[0].round(6))
        described |= {"force_y_N": load.force_y_N, "force_z_N": load.force_z_N}
        described |= {"kind": "load", "words": f"a load of {_load_words(one)}"}
        heaviest[place] = one, described
    count = GuideSettings.free_pictures
    frames = [Still(None, 0.0, float(tilt), 0.0) for tilt in GuideSettings.free_tilts_rad]
    for frame, pull in zip(frames, gravity_antenna(kinematics, session.gravity_world_m_s2, frames), strict=True):
        words = f"{count} pictures of the free antenna at a tilt of {np.degrees(frame.tilt_rad):.0f}°"
        described = {"kind": "free", "words": words, "pictures": count, "pan_rad": 0.0, "tilt_rad": frame.tilt_rad}
        heaviest[frame.tilt_rad] = _unseen(frame, pull), described
    wanted = [*heaviest.values()]
    placed = _predicted(joint, [one for one, _ in wanted])
    rows = _antenna_rows(joint, [*placed.values()]) if placed else []
    for index, each in zip(placed, rows, strict=True):
        described = wanted[index][1]
        yield described, np.tile(each, (described.get("pictures", 1), 1))


def _masses_kg(session: Session, joint: BundleAdjustment) -> list[float]:
    """The weights used so far, and further ones that bend the antenna up to the model's limit, rounded to two
    digits."""
    stiffness, length = float(np.exp(joint.parameters[ANTENNA][6])), session.antenna.length_m
    places = np.array(GuideSettings.weighty_places)
    steep = GuideSettings.steepest_rad * np.array(GuideSettings.weighty_slopes)[:, None]
    forces = 2.0 * stiffness * steep / (places * length) ** 2 / session.antenna.taper.turning(places)
    masses = [float(f"{mass:.2g}") for mass in (forces / STANDARD_GRAVITY_M_S2).ravel()]
    hung = [one.load_N for one in joint.noted if one.loaded]
    return sorted({*masses, *(float(f"{np.hypot(*force) / STANDARD_GRAVITY_M_S2:.3g}") for force in hung)})


def _antenna_rows(joint: BundleAdjustment, observations: Sequence[Observation]) -> list[np.ndarray]:
    """Jacobian of each static frame's points and moment, with the errors of its own line marginalised, as
    `BundleAdjustment.forecast` takes it, reduced by QR to as many rows as columns. The further errors are those of
    distances and weights that no load so far had."""
    problem, at = joint.problem, joint.solution.parameters
    known, count = [one.still for one in joint.noted], problem.groups.count
    every = ReadingGroups.of([*known, *(one.still for one in observations)], problem.prior.readings)
    new = every.count - count
    groups = ReadingGroups(every.std, every.distance[len(known) :], every.force[len(known) :])
    own = slice(problem.readings.stop, problem.readings.stop + new)
    wide = np.insert(at, [problem.readings.stop] * new, 0.0)
    there = replace(
        problem.without_tips(),
        observations=observations,
        seen_at_lens=(),
        kept=np.ones(len(observations), bool),
        groups=groups,
        readings_at=wide[problem.readings.start : own.stop],
        changes=None,
        known_axes=None,
        known_light=None,
    ).relinearised(wide)
    found = []
    for index, (_, rows) in enumerate(there.by_still(wide)):
        points = there.without_line(index, rows[:-1]) / np.sqrt(joint.alike)
        whole = np.vstack([points, rows[-1:]]) / joint.scatter
        found.append(np.linalg.qr(np.hstack([np.delete(whole, own, axis=1), whole[:, own]]))[1])
    return found


def _of_boards(made: Calibration) -> Iterator[Further]:
    """Candidate pictures of the board: near the camera and tilted in all directions, and in the picture's corners."""
    camera, lens, spec = made.joint.camera, made.lens, made.session.board
    before = made.joint.problem.prior.camera.covariance
    if made.given is not None or before is None or not lens.views:
        return
    points, seen = lens.board_points, [one.T_camera_board for one in lens.views]
    pairs = zip(seen, visible_corners(camera, seen, spec), strict=True)
    # what the pictures so far tell in proportion to the lens' covariance: it holds more than the corners' noise
    rows = np.vstack([_lens_rows(made, pose, points[ids]) for pose, ids in pairs])
    scale = float(np.einsum("ni,ij,nj->", rows, before, rows)) / np.linalg.matrix_rank(before)
    for words, poses in _board_sets(made, spec):
        ids = visible_corners(camera, poses, spec)
        if min(map(len, ids)) < GuideSettings.least_corners:
            continue
        rows = np.vstack([_lens_rows(made, pose, points[each]) for pose, each in zip(poses, ids, strict=True)])
        yield (
            {"kind": "board", "words": words, "T_camera_board": [one.to_dict() for one in poses]},
            _through_lens(made.joint.problem, rows / np.sqrt(max(scale, 1e-30))),
        )


def _lens_rows(made: Calibration, T_camera_board: Pose, points: np.ndarray) -> np.ndarray:
    """(2N, 4 + k) derivatives of a picture's corners by the lens, whitened, with the board's pose eliminated."""
    _, by_point, by_lens = projected(made.joint.camera, T_camera_board @ points)
    by_pose = pose_slopes(by_point, points @ T_camera_board.rotation.T)
    return without_own(by_lens, by_pose, np.array([0, len(points)]))[0]


def _board_sets(made: Calibration, spec: BoardWithIds) -> Iterator[tuple[str, list[Pose]]]:
    """Sets of five board poses in the camera frame, with their names."""
    camera, (width, height) = made.joint.camera, made.joint.camera.image_size
    tilt = GuideSettings.tilt_rad
    middle = (0.5, 0.5)
    tilted = [(middle, tilt, away) for away in 0.25 * np.pi + 0.5 * np.pi * np.arange(4)] + [(middle, 0.0, 0.0)]
    cornered = [((x, y), tilt, np.arctan2(0.5 - y, 0.5 - x)) for x in (0.25, 0.75) for y in (0.25, 0.75)]
    cornered.append((middle, tilt, 0.0))
    degrees = f"{np.degrees(tilt):.0f}°"
    sets = (
        (0.75, tilted, f"5 pictures of the board that fills the picture, facing the camera and tilted by {degrees}"),
        (0.5, cornered, f"5 pictures of the board, in the corners and the middle of the picture, tilted by {degrees}"),
    )
    for fills, places, words in sets:
        away_m = float(np.max(spec.size_m * np.diag(camera.matrix)[:2] / (fills * np.array([width, height]))))
        at = np.array([np.array(place) * (width - 1, height - 1) for place, *_ in places])
        rays, seen = camera.unproject(at)
        if not seen.all():
            continue
        middle_m = np.append(spec.outline_m.mean(axis=0), 0.0)
        turns = [Pose.from_rotvec(a * np.array([np.sin(w), -np.cos(w), 0.0]), np.zeros(3)) for _, a, w in places]
        poses = [
            Pose(turn.rotation, away_m * ray / ray[2] - turn.rotation @ middle_m)
            for turn, ray in zip(turns, rays, strict=True)
        ]
        yield words, poses


def _through_lens(problem: Problem, rows: np.ndarray) -> np.ndarray:
    """Rows (N, size) by all parameters, from rows (N, 4 + k) by the lens's."""
    whole = np.zeros((len(rows), problem.size))
    whole[:, problem.lens] = rows @ problem.prior.lens_axes
    return whole


def _pose_rows(problem: Problem, estimate: PoseEstimate, information: np.ndarray) -> np.ndarray:
    """Rows (6, size) that add the information (6, 6) on the camera's pose by one method."""
    values, axes = np.linalg.eigh(information)
    root = (axes * np.sqrt(np.maximum(values, 0.0))).T
    rows = _through_lens(problem, -root @ estimate.lens_sensitivity)
    rows[:, POSE] = root
    return rows


def _of_jig(made: Calibration) -> Iterator[Further]:
    """Candidate: the jig measured with half its standard deviations."""
    session, jig, problem = made.session, made.plane.jig, made.joint.problem
    stds = session.jig_translation_std_m, session.jig_rotation_std_rad
    if jig is None or session.T_antenna_board is None or not all(stds):
        return
    now = next(one for one in made.plane.estimates if one.way == "jig")
    whole, seen = (jig_estimate(jig, session.T_antenna_board, *each).covariance for each in (stds, (0.0, 0.0)))
    after = now.covariance - 0.75 * (whole - seen)
    words = f"the jig measured to {0.5e3 * stds[0]:.2g} mm and {0.5e3 * stds[1]:.2g} mrad"
    more = np.linalg.inv(after) - np.linalg.inv(now.covariance)
    described = {"kind": "jig", "words": words, "translation_std_m": 0.5 * stds[0], "rotation_std_rad": 0.5 * stds[1]}
    yield described, _pose_rows(problem, now, more)


def _of_sweep(made: Calibration) -> Iterator[Further]:
    """Candidate: a sweep of the joints, where there was none, simulated by solving its predicted corners."""
    session, joint, spec, kinematics = made.session, made.joint, made.session.board, made.plane.kinematics
    if made.plane.sweep is not None or session.cameras:
        return
    points, camera = corner_points(spec), joint.camera
    noise_px = max(made.lens.rms_inliers_px, GuideSettings.least_sigma_px) / np.sqrt(2.0)
    (_, poses), *_ = [*_board_sets(made, spec), ("", [])]
    for turn in GuideSettings.sweep_turns_rad if poses else ():
        joints = turn * np.array([[pan, tilt] for pan in (-1, 0, 1) for tilt in (-1, 0, 1)])
        carried = [kinematics.T_world_antenna(*each) @ joint.T_antenna_camera for each in joints.tolist()]
        fixed = carried[len(joints) // 2] @ poses[0]
        seen = [each.inverse() @ fixed for each in carried]
        ids = visible_corners(camera, seen, spec)
        if min(map(len, ids)) < 0.9 * spec.corner_count:
            continue
        rng = np.random.default_rng(0)
        views, readings = [], []
        for index, (pose, own) in enumerate(zip(seen, ids, strict=True)):
            pixels = camera.project(pose @ points[own])[0]
            noisy = pixels + noise_px * rng.normal(size=pixels.shape)
            views.append(BoardView(f"sweep_{index}", own, noisy, camera.image_size, np.arange(spec.corner_count)))
            pan_rad, tilt_rad = joints[index].tolist()
            readings.append(Still(Path(views[-1].name), pan_rad, tilt_rad, np.nan))
        with suppress(VbaaError):
            swept = solve_sweep(views, readings, made.lens.board_shape, camera, kinematics, session.tilt_zero_std_rad)
            if swept.loose:
                return
            words = f"a sweep of the joints by ± {turn:g} rad with the board before the camera"
            described = {"kind": "sweep", "words": words, "turn_rad": turn, "T_camera_board": poses[0].to_dict()}
            yield described, _pose_rows(joint.problem, swept.estimate, np.linalg.inv(swept.estimate.covariance))
        return
