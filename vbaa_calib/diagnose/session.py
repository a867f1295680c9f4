"""The table of hypotheses about mistakes in a session, with the pictures as the witness."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations

import numpy as np

from targets.board import AprilGrid
from vbaa_calib.antenna.materials import MATERIALS
from vbaa_calib.antenna.shape import PARAMETERS
from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment
from vbaa_calib.calibrate.antenna.inputs import Observation, Prior
from vbaa_calib.calibrate.antenna.problem import Problem
from vbaa_calib.calibrate.antenna.settings import AntennaSettings
from vbaa_calib.calibrate.pose.fusion import PoseEstimate
from vbaa_calib.core.errors import Diagnosis, InputError, SolveError
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.rig.reprojection import SeenPoints
from vbaa_calib.session import STANDARD_GRAVITY_M_S2 as G
from vbaa_calib.session import Load, Session, Still, gravity_antenna

from .decision import DecisionSettings, Explanation, causes, diagnose, explained
from .sensor import TABLE as SENSOR
from .sensor import MomentReadings, channel_diagnoses
from .settings import SETTINGS
from .typed_loads import FORCE_UNITS, LENGTH_UNITS, rows_name, typed_load_diagnoses, weighed
from .witness import Alteration, RigFit, Witness, name_of


@dataclass(frozen=True, eq=False)
class _Mistake:
    """One possible mistake: its correction, its message and its prior.

    alter : the problem corrected for the mistake, at some values of it. says : the diagnosis, from a fit.
    prior_std : standard deviations of its values, about 0. log_prior : prior log odds.
    gross : whether it is so large that it is tried only where the pictures widely contradict the reports; single : a
        contradiction in one row is enough.
    moments : whether the moment sensor's readings count, too.
    within : whether a fit's values are plausible. slopes, further : see `Witness.forecast`.
    """

    alter: Alteration
    says: Callable[[RigFit], Diagnosis]
    prior_std: tuple[float, ...] = ()
    log_prior: float = 0.0
    gross: bool = False
    single: bool = False
    moments: bool = False
    within: Callable[[RigFit], bool] = lambda fit: True
    slopes: Callable[[np.ndarray], np.ndarray] | None = None
    further: Sequence[np.ndarray] = ()


def _percent(value: float, std: float) -> str:
    return f"{100 * abs(value):.2g} ± {100 * std:.1g} %"


def _restilled(problem: Problem, change: Callable[[int, Still], Still]) -> Problem:
    """The problem with changed readings of the static frames."""
    frames = [change(index, one.still) for index, one in enumerate(problem.observations)]
    pairs = zip(problem.observations, frames, strict=True)
    return replace(
        problem, observations=[one if frame is one.still else replace(one, still=frame) for one, frame in pairs]
    )


def _posed(problem: Problem, change: Callable[[PoseEstimate], Pose]) -> Problem:
    """The problem with other estimates of the camera's pose."""
    poses = [replace(one, T_antenna_camera=change(one)) for one in problem.prior.poses]
    return replace(problem, prior=replace(problem.prior, poses=poses))


def _reloaded(problem: Problem, which: Sequence[int], change: Callable[[Load], Load]) -> Problem:
    """The problem with changed readings of some loads."""

    def of(index: int, frame: Still) -> Still:
        return change(frame) if isinstance(frame, Load) and index in which else frame

    return _restilled(problem, of)


def _moved_load(load: Load, by_m: float, length_m: float) -> Load:
    return replace(load, distance_m=float(np.clip(load.distance_m + by_m, 1e-3 * length_m, length_m)))


def _turned_load(load: Load, matrix: np.ndarray) -> Load:
    y, z = matrix @ [load.force_y_N, load.force_z_N]
    return replace(load, force_y_N=float(y), force_z_N=float(z))


def _rescaled(load: Load, factor: float) -> Load:
    return replace(load, distance_m=factor * load.distance_m)


def _plane_turn(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


# ---- lengths


def _lengths(witness: Witness) -> Iterator[_Mistake]:
    """Hypotheses of lengths: antenna.length_m, and the board's squares, which scale the camera's distance."""
    if len(witness.problem.tips):
        nominal = witness.problem.length_m

        def length(fit: RigFit) -> Diagnosis:
            found, std = 1e3 * fit.problem.length_m, 1e3 * nominal * fit.std[0]
            return Diagnosis(
                "antenna_length",
                f"antenna.length_m is {1e3 * nominal:.4g} mm, the pictures show {found:.4g} ± {std:.2g} mm from clamp "
                "to tip",
                "measure it again from the clamp to the tip, or set antenna.tip: null where the visible end is not the "
                "tip",
            )

        def longer(problem: Problem, v: np.ndarray) -> Problem:
            return replace(problem, length_m=nominal * (1.0 + v[0]))

        yield _Mistake(longer, length, (SETTINGS.length,), SETTINGS.measured)
    jig = witness.session.T_antenna_board
    origin = np.zeros(3) if jig is None else jig.translation_m

    def scaled(problem: Problem, v: np.ndarray) -> Problem:
        def nearer(one: PoseEstimate) -> Pose:
            pose = one.T_antenna_camera
            return Pose(pose.rotation, origin + (pose.translation_m - origin) / (1.0 + v[0]))

        return _posed(problem, nearer)

    def board(fit: RigFit) -> Diagnosis:
        side = "smaller" if fit.values[0] > 0 else "larger"
        what = "tag" if isinstance(witness.session.board, AprilGrid) else "square"
        return Diagnosis(
            "board_scale",
            f"the board's {what}s are {_percent(fit.values[0], fit.std[0])} {side} than board.{what}_m",
            f"measure the printed board over many {what}s and correct {what}_m",
            "wrong" if abs(fit.values[0]) > 0.015 else "doubt",
        )

    if any(one.way != "over board" for one in witness.problem.prior.poses):
        yield _Mistake(scaled, board, (SETTINGS.board,), SETTINGS.mistake)


# ---- loads


def _cells(before: Load, after: Load) -> str:
    """The cells of a row that differ between two versions of it."""
    names = ("distance_m", "force_y_N", "force_z_N")
    pairs = [(name, getattr(before, name), getattr(after, name)) for name in names]
    size = weighed(before) + weighed(after)
    return ", ".join(
        f"{name} {a:.4g} → {b:.4g}"
        for name, a, b in pairs
        if abs(a - b) > 1e-6 * (size if name.startswith("force") else before.distance_m)
    )


def _question(what: str, how: str, before: Load, after: Load) -> str:
    if what == "distance":
        return f"{1e3 * after.distance_m:.4g} mm from the clamp that was typed as distance_m {before.distance_m:.4g}"
    if "exchanged" in how or "sign" in how:
        y, z = after.force_y_N + 0.0, after.force_z_N + 0.0
        return f"({y:.4g}, {z:.4g}) N in (y, z) that was typed as ({before.force_y_N:.4g}, {before.force_z_N:.4g})"
    typed, meant = weighed(before), weighed(after)
    return f"{1e3 * meant / G:.4g} g, which is {meant:.4g} N, that was typed as {typed:.4g} newtons"


def _slips(witness: Witness, which: Sequence[int], log_prior: float) -> Iterator[_Mistake]:
    """Hypotheses of units, signs and axes of some rows."""
    loads = dict(witness.loads)
    count, length_m = len(loads), witness.problem.length_m
    rows = [(list(loads).index(index), loads[index]) for index in which]

    def cause(what: str, how: str, change: Callable[[Load], Load], less: float) -> _Mistake:
        def says(fit: RigFit) -> Diagnosis:
            first = rows[0][1]
            words = (
                f"{rows_name(rows, count)}: the picture contradicts the row, and would fit if the {what} was given "
                f"{how}. Is it {_question(what, how, first, change(first))}?"
            )
            cells = "; ".join(f"row {index + 1}: {_cells(load, change(load))}" for index, load in rows[:3])
            return Diagnosis(f"load_{what}_mistyped", words, f"if so, correct {cells}", "wrong")

        return _Mistake(
            lambda problem, v: _reloaded(problem, which, change), says, (), log_prior - less, True, len(which) == 1
        )

    for how, factor in FORCE_UNITS:
        yield cause("force", how, partial(_turned_load, matrix=factor * np.eye(2)), 1.0)
    known: list[np.ndarray] = [np.eye(2)]
    forces = np.array([[load.force_y_N, load.force_z_N] for _, load in rows]).T
    # Wrong directions of a force, and the matrix that puts each right.
    slips = (
        ("with its sign turned round", -np.eye(2)),
        ("with the sign of y turned round", np.diag([-1.0, 1.0])),
        ("with the sign of z turned round", np.diag([1.0, -1.0])),
        ("with y and z exchanged", np.array([[0.0, 1.0], [1.0, 0.0]])),
        ("with y and z exchanged, and the sign turned round", np.array([[0.0, -1.0], [-1.0, 0.0]])),
        ("with y and z exchanged, and the sign of one of them turned round", np.array([[0.0, 1.0], [-1.0, 0.0]])),
        ("with y and z exchanged, and the sign of one of them turned round", np.array([[0.0, -1.0], [1.0, 0.0]])),
    )
    for how, turn in slips:
        if all(np.abs((turn - other) @ forces).max() > 1e-6 * np.abs(forces).max() for other in known):
            known.append(turn)
            yield cause("force", how, partial(_turned_load, matrix=turn), 1.5)
    places = np.array([load.distance_m for _, load in rows])
    for how, factor in LENGTH_UNITS:
        if (factor * places <= length_m).all():
            yield cause("distance", how, partial(_rescaled, factor=factor), 1.5)
    if (places < length_m * (1 - 1e-6)).all() and (np.abs(length_m - 2 * places) > 0.02 * length_m).any():
        yield cause("distance", "from the tip", lambda load: replace(load, distance_m=length_m - load.distance_m), 1.5)


def _one_load(witness: Witness, index: int, less: float) -> Iterator[_Mistake]:
    """Hypotheses of wrong distance, force and direction of one load. less : logarithm of the number of pictures, which
    lowers the prior log odds of each."""
    name, load = name_of(witness.problem.observations, index), dict(witness.loads)[index]
    length_m = witness.problem.length_m

    def moved(problem: Problem, v: np.ndarray) -> Problem:
        return _reloaded(problem, [index], lambda one: _moved_load(one, v[0], length_m))

    def place(fit: RigFit) -> Diagnosis:
        return Diagnosis(
            "load_distance_mistyped",
            f"{name}: the picture shows the load at {1e3 * (load.distance_m + fit.values[0]):.4g} ± "
            f"{1e3 * fit.std[0]:.2g} mm, not at {1e3 * load.distance_m:.4g} mm",
            f"correct distance_m of this row: it is off by {1e3 * fit.values[0]:+.2g} mm",
            "wrong" if abs(fit.values[0]) > 0.02 * load.distance_m else "doubt",
        )

    yield _Mistake(moved, place, (SETTINGS.distance * length_m,), SETTINGS.measured - less)

    def heavier(problem: Problem, v: np.ndarray) -> Problem:
        return _reloaded(problem, [index], lambda one: _turned_load(one, np.exp(v[0]) * np.eye(2)))

    def force(fit: RigFit) -> Diagnosis:
        meant = weighed(load) * float(np.exp(fit.values[0]))
        rests = ", or something carries part of it" if fit.values[0] < 0 else ""
        return Diagnosis(
            "load_force_mistyped",
            f"{name}: the picture shows a load of {meant:.4g} N ± {100 * fit.std[0]:.2g} %, not of "
            f"{weighed(load):.4g} N{rests}",
            "weigh it again, correct the row, and see that it hangs free",
            "wrong" if abs(fit.values[0]) > 0.03 else "doubt",
        )

    yield _Mistake(heavier, force, (SETTINGS.force,), SETTINGS.mistake - less)

    def turned(problem: Problem, v: np.ndarray) -> Problem:
        return _reloaded(problem, [index], lambda one: _turned_load(one, _plane_turn(v[0])))

    def direction(fit: RigFit) -> Diagnosis:
        return Diagnosis(
            "load_force_mistyped",
            f"{name}: the picture shows a load turned by {np.rad2deg(fit.values[0]):+.2g} ± "
            f"{np.rad2deg(fit.std[0]):.1g}° from y to z",
            "check the pulley, and force_y_N and force_z_N of the row",
            "wrong" if abs(fit.values[0]) > 0.03 else "doubt",
        )

    yield _Mistake(turned, direction, (SETTINGS.turn_rad,), SETTINGS.mistake - less - 1.0)


def _exchanges(witness: Witness, suspects: Sequence[int]) -> Iterator[_Mistake]:
    """Hypotheses of exchanged weights, distances or pictures of two loads."""
    loads, observations = dict(witness.loads), witness.problem.observations
    pairs = [pair for pair in combinations(loads, 2) if set(pair) & set(suspects)]
    less = float(np.log(max(len(pairs), 1)))
    for i, j in pairs:
        a, b = loads[i], loads[j]

        def cause(what: str, change: Mapping[int, Observation], i: int = i, j: int = j) -> _Mistake:
            names = [name_of(observations, index) for index in (i, j)]

            def says(fit: RigFit) -> Diagnosis:
                words = f"the {what} of {names[0]} and {names[1]} are exchanged"
                new = [change[k].still for k in (i, j)]
                cells = "; ".join(
                    f"{name}: {_cells(loads[k], load)}"
                    for name, k, load in zip(names, (i, j), new, strict=True)
                    if isinstance(load, Load)
                )
                return Diagnosis("load_rows_exchanged", words, f"correct {cells}", "wrong")

            def alter(problem: Problem, v: np.ndarray) -> Problem:
                each = enumerate(problem.observations)
                seen = [
                    replace(one, still=change[k].still, gravity_m_s2=change[k].gravity_m_s2) if k in change else one
                    for k, one in each
                ]
                return replace(problem, observations=seen)

            return _Mistake(alter, says, (), SETTINGS.mistake - less, True, True)

        def with_load(index: int, load: Load) -> Observation:
            return replace(observations[index], still=load)

        if abs(a.distance_m - b.distance_m) > 1e-6:
            places = replace(a, distance_m=b.distance_m), replace(b, distance_m=a.distance_m)
            yield cause("distances", {i: with_load(i, places[0]), j: with_load(j, places[1])})
        ratio = weighed(b) / weighed(a) if weighed(a) > 0 else 1.0
        if abs(np.log(max(ratio, 1e-9))) > 1e-3:
            heavier = _turned_load(a, ratio * np.eye(2)), _turned_load(b, np.eye(2) / ratio)
            yield cause("weights", {i: with_load(i, heavier[0]), j: with_load(j, heavier[1])})
        yield cause(
            "pictures",
            {
                i: replace(observations[j], still=replace(b, image=a.image)),
                j: replace(observations[i], still=replace(a, image=b.image)),
            },
        )


def _all_loads(witness: Witness) -> Iterator[_Mistake]:
    """Hypotheses of errors common to all loads."""
    which, length_m = [index for index, _ in witness.loads], witness.problem.length_m
    if not which:
        return

    def shifted(fit: RigFit) -> Diagnosis:
        way = "further from" if fit.values[0] > 0 else "nearer to"
        return Diagnosis(
            "load_distances_shifted",
            f"all loads hang {1e3 * abs(fit.values[0]):.2g} ± {1e3 * fit.std[0]:.1g} mm {way} the clamp than "
            "distance_m",
            "check from where the distances were measured: from the clamp's edge, where the antenna begins to bend",
            "wrong" if abs(fit.values[0]) > 0.01 * length_m else "doubt",
        )

    yield _Mistake(
        lambda problem, v: _reloaded(problem, which, lambda one: _moved_load(one, v[0], length_m)),
        shifted, (SETTINGS.shift_m,), SETTINGS.mistake,
    )  # fmt: skip

    def turned(fit: RigFit) -> Diagnosis:
        return Diagnosis(
            "loads_turned",
            f"all loads pull in directions turned by {np.rad2deg(fit.values[0]):+.2g} ± {np.rad2deg(fit.std[0]):.1g}° "
            "from y to z against force_y_N and force_z_N",
            "check which way y and z point at the antenna, and the pulleys",
            "wrong" if abs(fit.values[0]) > 0.03 else "doubt",
        )

    yield _Mistake(
        lambda problem, v: _reloaded(problem, which, lambda one: _turned_load(one, _plane_turn(v[0]))),
        turned, (SETTINGS.turn_rad,), SETTINGS.mistake,
    )  # fmt: skip
    lightest_N = min(weighed(load) for _, load in witness.loads)
    if lightest_N > 0.0:

        def more(fit: RigFit) -> Diagnosis:
            grams = f"{1e3 * abs(fit.values[0]) / G:.3g} ± {1e3 * fit.std[0] / G:.1g} g"
            return Diagnosis(
                "loads_shifted",
                f"all loads are {'heavier' if fit.values[0] > 0 else 'lighter'} by {grams} than reported: a hanger "
                "that was not weighed, or a balance that was not zeroed",
                "weigh everything that hangs on the antenna, and correct force_y_N and force_z_N of all rows",
                "wrong" if abs(fit.values[0]) > 0.03 * lightest_N else "doubt",
            )

        def heavier(load: Load, by_N: float) -> Load:
            return _turned_load(load, max(1.0 + by_N / weighed(load), 0.01) * np.eye(2))

        yield _Mistake(
            lambda problem, v: _reloaded(problem, which, lambda one: heavier(one, v[0])),
            more, (0.3 * lightest_N,), SETTINGS.mistake,
        )  # fmt: skip
    yield from _slips(witness, which, SETTINGS.mistake)


def _materials(witness: Witness) -> Iterator[_Mistake]:
    """Hypotheses of another modulus, density or diameter."""
    nominal = witness.session.antenna

    def other(problem: Problem, v: np.ndarray) -> Problem:
        mean = problem.prior.mean.copy()
        mean[6:8] += v
        return replace(problem, prior=replace(problem.prior, mean=mean))

    def says(fit: RigFit) -> Diagnosis:
        ratio, heavier = np.exp(fit.parameters[12:14] - witness.problem.prior.mean[6:8])
        std = np.sqrt(np.diag(fit.solution.covariance())[12:14])
        modulus, density = ratio * nominal.youngs_modulus_Pa, heavier * nominal.density_kg_m3
        thick = nominal.diameter_m * ratio**0.25
        words = (
            f"EI is {100 * (ratio - 1):+.0f} % off E·πd⁴/64 = {nominal.stiffness_Nm2:.4g} N·m²: with the reported "
            f"diameter its modulus is {1e-9 * modulus:.3g} GPa"
        )
        if std[1] < 0.15:
            words += f" and its density {density:.3g} kg/m³"
        words += f", or with the reported material its diameter is {1e3 * thick:.3g} mm"
        return Diagnosis(
            "stiffness_not_nominal", words, "check the material and diameter_m; EI itself is measured", "doubt"
        )

    def possible(fit: RigFit) -> bool:
        ratio = float(np.exp(fit.parameters[12] - witness.problem.prior.mean[6]))
        return SETTINGS.moduli_Pa[0] <= ratio * nominal.youngs_modulus_Pa <= SETTINGS.moduli_Pa[1]

    # EI and the mass per length of each usual material, as parameters of the rig and as values
    count, further = len(witness.starts[0]), []
    for material in MATERIALS.values():
        step = np.zeros(count + 2)
        ratios = material.youngs_modulus_Pa / nominal.youngs_modulus_Pa, material.density_kg_m3 / nominal.density_kg_m3
        step[[12, 13]] = step[count:] = np.log(ratios)
        further.append(step)
    yield _Mistake(other, says, AntennaSettings.any_material, 0.0, within=possible, further=further)


# ---- gravity and joints


def _with_gravity(pulls: np.ndarray, problem: Problem, v: np.ndarray) -> Problem:
    every = zip(problem.observations, pulls, strict=True)
    return replace(problem, observations=[replace(one, gravity_m_s2=pull) for one, pull in every])


def _always(diagnosis: Diagnosis, fit: RigFit) -> Diagnosis:
    return diagnosis


def _news(witness: Witness) -> Callable[[np.ndarray], bool]:
    """A test whether gravity (F, 3) in the frames differs from the reported one and from that of all its earlier
    calls."""
    known = [np.array([one.gravity_m_s2 for one in witness.problem.observations])]

    def new(pulls: np.ndarray) -> bool:
        differs = all(np.abs(pulls - other).max() > 0.05 for other in known)
        known.append(pulls)
        return differs

    return new


def _gravity(witness: Witness) -> Iterator[_Mistake]:
    """Hypotheses of gravity's direction."""
    kinematics, world = witness.kinematics, witness.session.gravity_world_m_s2
    frames = [one.still for one in witness.problem.observations]
    new = _news(witness)
    worlds = {
        f"gravity pointed to {'+−'[sign < 0]}{name} of the world": G * (sign * np.eye(3)[axis])
        for axis, name in enumerate("xyz")
        for sign in (1, -1)
    }
    if world.any():
        worlds["there were no gravity"] = np.zeros(3)
    # what is no further away is a tilt
    near, log_prior = np.cos(4.0 * SETTINGS.turn_rad) * G * np.linalg.norm(world), SETTINGS.mistake - 1.5
    worlds = {words: gravity for words, gravity in worlds.items() if not gravity @ world > near}
    for words, gravity in worlds.items():
        pulls = gravity_antenna(kinematics, gravity, frames)
        numbers = ", ".join(f"{value + 0.0:g}" for value in gravity)
        likely = Diagnosis(
            "gravity_direction",
            f"the antenna's pictures look as if {words}, not as reported",
            f"gravity_world: [{numbers}] in session.yaml would fit; check where the world's axes point",
            "wrong",
        )
        if new(pulls):
            yield _Mistake(partial(_with_gravity, pulls), partial(_always, likely), (), log_prior, moments=True)
    if not world.any():
        return

    def tilted(problem: Problem, v: np.ndarray) -> Problem:
        turn = Pose.from_rotvec(np.array([v[0], v[1], 0.0]), np.zeros(3)).rotation

        carried = kinematics.world_antenna(*np.array([(one.pan_rad, one.tilt_rad) for one in frames]).T)[0]
        before = np.array([one.gravity_m_s2 for one in problem.observations])
        world_pulls = np.einsum("fij,fj->fi", turn @ carried, before)
        return _with_gravity(np.einsum("fji,fj->fi", carried, world_pulls), problem, v)

    def tilt(fit: RigFit) -> Diagnosis:
        x, y = np.rad2deg(fit.values)
        size, std = float(np.hypot(x, y)), float(np.rad2deg(fit.std.max()))
        pull = Pose.from_rotvec(np.array([*fit.values, 0.0]), np.zeros(3)) @ world
        numbers = ", ".join(f"{value:.3f}" for value in pull)
        return Diagnosis(
            "gravity_tilted",
            f"gravity is tilted by {size:.2g} ± {std:.1g}° against gravity_world ({x:+.2g}° about x, "
            f"{y:+.2g}° about y)",
            f"level the base, or write gravity_world: [{numbers}]; about the tilt's axis it may be the encoder's zero",
            "wrong" if size > 2.0 else "doubt",
        )

    yield _Mistake(tilted, tilt, (0.5 * SETTINGS.turn_rad,) * 2, SETTINGS.mistake, moments=True)


def _joints(witness: Witness) -> Iterator[_Mistake]:
    """Hypotheses of signs, units and order of the joints' readings."""
    return (cause for _, cause in _joint_faults(witness))


def _joint_faults(witness: Witness) -> Iterator[tuple[str, _Mistake]]:
    """Hypotheses of mistakes in the joints' readings, each with the fault in words."""
    kinematics, world = witness.kinematics, witness.session.gravity_world_m_s2
    frames = [one.still for one in witness.problem.observations]
    new = _news(witness)
    # How the joints would have moved, what to correct, and the matrix that puts (pan, tilt) right.
    faults = (
        ("the tilt turned the other way", "the sign of tilt_rad", np.diag([1.0, -1.0])),
        ("the pan turned the other way", "the sign of pan_rad", np.diag([-1.0, 1.0])),
        ("pan and tilt were exchanged", "the columns pan_rad and tilt_rad", np.array([[0.0, 1.0], [1.0, 0.0]])),
        ("the angles were in degrees", "the unit: angles are in rad", np.pi / 180 * np.eye(2)),
        ("the angles had been turned into rad twice", "the angles: they are in rad once", 180 / np.pi * np.eye(2)),
        ("the tilt stayed at 0", "tilt_rad, or connect its encoder", np.diag([1.0, 0.0])),
    )
    for words, what, turn in faults:
        angles = [turn @ (one.pan_rad, one.tilt_rad) for one in frames]
        moved = [replace(one, pan_rad=float(a[0]), tilt_rad=float(a[1])) for one, a in zip(frames, angles, strict=True)]
        pulls = gravity_antenna(kinematics, world, moved)
        likely = Diagnosis(
            "joint_readings_wrong",
            f"the antenna's pictures look as if {words}, not as reported",
            f"correct {what}, in all tables",
            "wrong",
        )
        if new(pulls):
            alter = partial(_with_gravity, pulls)
            yield words, _Mistake(alter, partial(_always, likely), (), SETTINGS.mistake - 1.5, moments=True)


# ---- antenna and clamp


def _changed(which: list[int], kept: np.ndarray, axes: np.ndarray) -> Alteration:
    """An alteration by which the antenna's parameters `which` (K) differ in the observations where `kept` (F,), by
    the values (Q,) along axes (K, Q)."""

    def alter(problem: Problem, v: np.ndarray) -> Problem:
        changes = np.zeros((len(kept), len(PARAMETERS))) if problem.changes is None else problem.changes.copy()
        changes[np.ix_(kept, np.array(which))] += axes @ v
        return replace(problem, changes=changes)

    return alter


def _pair(fit: RigFit, factor: float, unit: str) -> str:
    (y, z), (y_std, z_std) = factor * fit.values, factor * fit.std
    return f"{y:.2g} ± {y_std:.1g}{unit} y and {z:.2g} ± {z_std:.1g}{unit} z"


def _size(fit: RigFit, which: slice, factor: float, unit: str) -> str:
    size, std = (factor * float(np.linalg.norm(each[which])) for each in (fit.values, fit.std))
    return f"{size:.2g} ± {std:.1g}{unit}"


_turn = partial(_size, which=slice(0, 3), factor=180.0 / np.pi, unit="°")


def _since(witness: Witness) -> Iterator[_Mistake]:
    """Hypotheses of a clamp that slipped, an antenna that was bent, or a camera that turned, between two pictures."""
    observations = witness.problem.observations
    times = [one.still.time_s for one in observations]
    order = list(range(len(times)))
    if all(time is not None for time in times):
        order = np.argsort(np.array(times, float), kind="stable").tolist()
    less = float(np.log(max(len(order) - 1, 1)))
    tight = "tighten the clamp, then take no-load frames and loads anew"
    fasten = "fasten the camera, then take all pictures anew"
    straight = "a load has bent it for good: straighten or replace it, then take all pictures anew with lighter loads"

    # a camera that turns about its centre looks like a clamp that turns about it the other way
    x, y, z = witness.problem.prior.start.translation_m
    by_turn = np.array([[-z, 0.0, x], [y, -x, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
    moved, mrad, bent = (
        partial(_pair, factor=by, unit=u) for by, u in ((1e3, " mm along"), (1e3, " mrad about"), (1.0, " per m about"))
    )
    # name, the antenna's parameters, how the values change them, their standard deviation, log odds, words, their size
    kinds = (
        ("clamp_slipped", [0, 1], np.eye(2), SETTINGS.slip_m, 0.0, "the clamp has moved by {}", moved, tight),
        ("clamp_slipped", [2, 3], np.eye(2), SETTINGS.slip_rad, 0.0, "the clamp has turned by {}", mrad, tight),
        (
            *("antenna_bent_between", [4, 5], np.eye(2), SETTINGS.bow / witness.problem.length_m, 0.0),
            *("the antenna is bent by {} more than before,", bent, straight),
        ),
        # what it has in common with a clamp that slipped is the clamp's
        ("camera_turned", [0, 1, 2, 3], by_turn, SETTINGS.turn_rad, -1.0, "the camera has turned by {}", _turn, fasten),
    )
    ends = np.cumsum([0, *map(len, witness.problem.seen_at_lens)])
    tips = witness.problem.tips
    for split in range(1, len(order)):
        later = np.zeros(len(order), bool)
        later[order[split:]] = True

        def slopes(jacobian: np.ndarray, which: list[int], axes: np.ndarray, later: np.ndarray = later) -> np.ndarray:
            rows = np.zeros(len(jacobian), bool)
            for index in np.flatnonzero(later).tolist():
                rows[ends[index] : ends[index + 1]] = True
            first = ends[-1] + 6 * len(witness.problem.prior.poses)
            rows[first : first + len(tips)] = later[tips]
            return np.where(rows[:, None], jacobian[:, [6 + each for each in which]], 0.0) @ axes

        since = f"from {name_of(observations, order[split])} on"
        for name, which, axes, std, log_odds, words, size, remedy in kinds:

            def says(
                fit: RigFit,
                name: str = name,
                words: str = f"{words} {since}",
                size: Callable[[RigFit], str] = size,
                remedy: str = remedy,
            ) -> Diagnosis:
                return Diagnosis(name, words.format(size(fit)), remedy, "wrong")

            alter, by = _changed(which, later, axes), partial(slopes, which=which, axes=axes)
            prior_std = (std,) * axes.shape[1]
            yield _Mistake(alter, says, prior_std, SETTINGS.mistake - less + log_odds, slopes=by)


def _camera(witness: Witness) -> Iterator[_Mistake]:
    """Hypotheses of a camera that was moved or refocused, or of pictures that were cropped, between those that plane C
    was found from and the antenna's."""
    again = "take both again, one after the other, with nothing touched in between"
    if any(one.way == "over board" for one in witness.problem.prior.poses):
        return

    def moved(problem: Problem, v: np.ndarray) -> Problem:
        return _posed(problem, lambda one: one.T_antenna_camera.retract(v))

    def motion(fit: RigFit) -> Diagnosis:
        words = (
            f"the camera turned by {_turn(fit)} and moved by {_size(fit, slice(3, 6), 1e3, ' mm')} between the "
            "pictures for plane C and the antenna's"
        )
        return Diagnosis("camera_moved", words, again, "wrong")

    yield _Mistake(moved, motion, (SETTINGS.camera_rad,) * 3 + (SETTINGS.camera_m,) * 3, SETTINGS.mistake)

    camera = witness.problem.prior.camera
    middle = (0.5 * (np.array(camera.image_size) - 1.0) - camera.matrix[:2, 2]) / np.diag(camera.matrix)[:2]

    def enlarged(problem: Problem, v: np.ndarray, about: np.ndarray) -> Problem:
        def scaled(seen: SeenPoints) -> SeenPoints:
            by = 1.0 / (1.0 + v[0])
            return replace(seen, points=about + by * (seen.points - about), covariance=by**2 * seen.covariance)

        tips = None if problem.tips_at_lens is None else scaled(problem.tips_at_lens)
        return replace(problem, seen_at_lens=[scaled(one) for one in problem.seen_at_lens], tips_at_lens=tips)

    def focus(fit: RigFit) -> Diagnosis:
        words = (
            f"the focal length changed by {100 * fit.values[0]:+.2g} ± {100 * fit.std[0]:.1g} % between the pictures "
            "for plane C and the antenna's"
        )
        return Diagnosis("refocused", words, f"switch autofocus and zoom off; {again}", "wrong")

    yield _Mistake(partial(enlarged, about=np.zeros(2)), focus, (SETTINGS.focal,), SETTINGS.mistake)

    def cropped(problem: Problem, v: np.ndarray) -> Problem:
        by_focal = np.zeros(len(camera.parameters))
        by_focal[:2] = camera.parameters[:2] * v[0]
        moved = _posed(problem, lambda one: one.T_antenna_camera.retract(one.lens_sensitivity @ by_focal))
        return enlarged(moved, v, middle)

    # which pictures differ from the others, and what puts them right
    parts: tuple[tuple[str, Alteration], ...]
    parts = (("the antenna's pictures", partial(enlarged, about=middle)), ("the lens's pictures", cropped))
    for index, (which, alter) in enumerate(parts):

        def crop(fit: RigFit, which: str = which, sign: float = 1.0 - 2.0 * index) -> Diagnosis:
            words = (
                f"{which} are enlarged by {100 * sign * fit.values[0]:+.2g} ± {100 * fit.std[0]:.1g} % about their "
                "middle against the others: cropped, or of another mode of the camera"
            )
            return Diagnosis("picture_cropped", words, "take all pictures in the same mode, uncropped", "wrong")

        yield _Mistake(alter, crop, (SETTINGS.crop,), SETTINGS.mistake)


def _antenna(witness: Witness) -> Iterator[_Mistake]:
    """Hypotheses of bow, a compliant clamp, and a whisker that is not uniform along or around itself."""
    length, loaded = witness.problem.length_m, bool(witness.loads)

    def shifted(which: Sequence[int]) -> Alteration:
        def alter(problem: Problem, v: np.ndarray) -> Problem:
            mean = problem.prior.mean.copy()
            mean[list(which)] += v
            return replace(problem, prior=replace(problem.prior, mean=mean))

        return alter

    def bowed(fit: RigFit) -> Diagnosis:
        y, z = fit.parameters[10:12]
        return Diagnosis(
            "antenna_bent",
            f"the free antenna is bowed by {y:.2g} per m about y and {z:.2g} per m about z: "
            f"{0.5e3 * float(np.hypot(y, z)) * length**2:.0f} mm at the tip of {1e3 * length:.0f} mm",
            "straighten or replace the whisker, or set it with its bow in plane C, and check gravity_world",
        )

    yield _Mistake(shifted([4, 5]), bowed, (0.5 / length,) * 2, SETTINGS.mistake)
    if not loaded:
        return

    def soft(fit: RigFit) -> Diagnosis:
        return Diagnosis(
            "clamp_soft",
            f"the clamp turns with the load as {1e3 * fit.parameters[14]:.2f} ± "
            f"{1e3 * float(np.sqrt(fit.solution.covariance()[14, 14])):.2f} mm more of the antenna would",
            "clamp it over a longer piece, between metal, and check where the distances are measured from",
        )

    gives = (SETTINGS.give_m,)
    yield _Mistake(shifted([8]), soft, gives, SETTINGS.rare, within=lambda fit: bool(fit.parameters[14] > 0))

    def uneven(fit: RigFit) -> Diagnosis:
        side = "y" if fit.values[0] > 0 else "z"
        return Diagnosis(
            "stiffness_uneven",
            f"the antenna is {_percent(fit.values[0], fit.std[0])} stiffer against bending to {side} than to the other "
            "side",
            "is the whisker round? EI is the mean of both",
            "wrong" if abs(fit.values[0]) > 0.03 else "doubt",
        )

    yield _Mistake(partial(_with_uneven, [0]), uneven, (SETTINGS.uneven,), SETTINGS.rare)

    def changes(softer: float) -> Diagnosis:
        """The diagnosis of a compliance that varies along the antenna; softer : towards its tip."""
        side, ratio = "softer" if softer > 1.0 else "stiffer", max(softer, 1.0 / softer)
        words = f"the antenna is about {ratio:.1f} times {side} half way to its tip than"
        if witness.problem.prior.taper:
            words += " its profile says"
            remedy = "measure its diameters again and correct antenna.profile, or give antenna.stiffness_profile"
        else:
            words += " at its clamp: tapered, or of two materials"
            remedy = (
                "measure its diameters from clamp to tip and give them as antenna.profile (of two materials: "
                "antenna.stiffness_profile), or use a whisker of one diameter and material"
            )
        return Diagnosis("stiffness_varies", words, remedy, "wrong" if ratio > 1.3 else "doubt")

    def varies(fit: RigFit) -> Diagnosis:
        # beyond the loads hardly anything bends it
        clamp, half = np.clip([1.0 - fit.values[0] + fit.values[1], 1.0 - 0.5 * fit.values[1]], 0.05, None)
        return changes(half / clamp)

    def thinned(problem: Problem, v: np.ndarray) -> Problem:
        log_tip = float(np.clip(v[0], -SETTINGS.thinnest, SETTINGS.thinnest))
        return replace(problem, prior=replace(problem.prior, taper=problem.prior.taper.thinned(log_tip)))

    yield _Mistake(
        thinned,
        lambda fit: changes((0.5 + 0.5 * float(np.exp(fit.values[0]))) ** -4),
        (SETTINGS.cone,),
        SETTINGS.rare,
        within=lambda fit: bool(abs(fit.values[0]) < SETTINGS.thinnest),
    )

    yield _Mistake(partial(_with_uneven, [1, 2]), varies, (SETTINGS.profile, 0.5 * SETTINGS.profile), SETTINGS.rare)


def _with_uneven(which: Sequence[int], problem: Problem, v: np.ndarray) -> Problem:
    """The problem with some of its three numbers of unevenness changed."""
    uneven = problem.uneven.copy()
    uneven[which] += v
    return replace(problem, uneven=uneven)


# ---- single pictures


def _touched(witness: Witness, index: int, less: float) -> Iterator[_Mistake]:
    """Hypothesis of a no-load frame in which something pushes the antenna."""
    length, observations = witness.problem.length_m, witness.problem.observations
    stiffness = float(np.exp(witness.problem.prior.mean[6]))
    frame, pushes = observations[index].still, []
    for part in (0.35, 0.6, 0.95):
        std = 3.0 * stiffness * SETTINGS.touch * length / (part * length) ** 3 * part**2

        def touched(problem: Problem, v: np.ndarray, part: float = part) -> Problem:
            load = Load(
                frame.image, frame.pan_rad, frame.tilt_rad, frame.moment_Nm, part * length, float(v[0]), float(v[1]),
                time_s=frame.time_s,
            )  # fmt: skip
            return _restilled(problem, lambda i, one: load if i == index else one)

        def says(fit: RigFit) -> Diagnosis:
            force = float(np.hypot(*fit.values))
            return Diagnosis(
                "noload_touched",
                f"{name_of(observations, index)}: something pushes the antenna aside, by about {1e3 * force:.2g} mN",
                "take the picture again with nothing near the antenna, or take its row out",
                "wrong",
            )

        pushes.append(_Mistake(touched, says, (std, std), SETTINGS.mistake - less - 1.1))
    # where along the antenna hardly shows
    yield max(pushes, key=lambda one: witness.forecast(one.alter, one.prior_std)[0])


def _left_out(witness: Witness, index: int) -> _Mistake:
    """Hypothesis of a picture that contradicts all others for an unknown reason."""
    observations = witness.problem.observations

    def alter(problem: Problem, v: np.ndarray) -> Problem:
        kept = problem.kept.copy()
        kept[index] = False
        return replace(problem, kept=kept)

    likely = Diagnosis(
        "load_row_unexplained" if isinstance(observations[index].still, Load) else "noload_row_unexplained",
        f"{name_of(observations, index)}: the picture contradicts all others, and no usual mistake explains it",
        "check the row, that the picture belongs to it, and that its line is the antenna",
        "wrong",
    )
    return _Mistake(alter, lambda fit: likely, (), SETTINGS.rare)


_TABLE: tuple[Callable[[Witness], Iterator[_Mistake]], ...] = (
    _lengths,
    _all_loads,
    _materials,
    _gravity,
    _joints,
    _since,
    _camera,
    _antenna,
)
"""Mistakes that concern a session; those of single rows follow where rows contradict the others."""


def _single(witness: Witness, reported: float) -> Iterator[_Mistake]:
    """Hypotheses of mistakes in single rows and pictures, among those without which the fit improves."""
    observations = witness.problem.observations
    suspects, gross = [], witness.reported is None or witness.reported.scale > SETTINGS.gross
    for index in range(len(observations)):
        out = _left_out(witness, index)
        gain = witness.forecast(out.alter)[0] - reported + SETTINGS.left_out
        if gain > 0.7 * SETTINGS.misfit or gross:
            suspects.append(index)
            yield out
    less = float(np.log(len(observations)))
    rough: list[_Mistake] = list(_exchanges(witness, suspects))
    for index in suspects:
        if isinstance(observations[index].still, Load):
            yield from _one_load(witness, index, less)
            rough += _slips(witness, [index], SETTINGS.mistake - less)
        else:
            yield from _touched(witness, index, less)
    rough.sort(key=lambda cause: witness.forecast(cause.alter, roughly=True)[0] + cause.log_prior, reverse=True)
    yield from rough[: SETTINGS.tried]


def _explanations(witness: Witness) -> Iterator[Explanation[Witness]]:
    """Explanations that fit the pictures better than the reports do, with their log odds."""
    reported = witness.reported
    base, excess = witness.log_likelihood, witness.excess
    ranked = []
    mistakes = [mistake for row in _TABLE for mistake in row(witness)]
    if excess > SETTINGS.misfit:
        mistakes += _single(witness, base)
    widely = reported is None or reported.contradicted > 1 or reported.solution.prior_cost > SETTINGS.misfit
    for cause in mistakes:
        if cause.gross and not (excess > SETTINGS.misfit and (widely or cause.single)):
            continue
        found, at = witness.forecast(cause.alter, cause.prior_std, slopes=cause.slopes, further=cause.further)
        forecast = found - base + cause.log_prior
        if forecast > DecisionSettings.least_log_odds - (SETTINGS.by_moments if cause.moments else SETTINGS.hopeless):
            ranked.append((forecast, cause, at))
    ranked.sort(key=lambda one: one[0], reverse=True)
    moments = None if reported is None else _moments_of(witness, reported)
    best = base
    for _, cause, at in ranked[: SETTINGS.tried]:
        fit = witness.fit(cause.alter, cause.prior_std, at, best - SETTINGS.behind)
        if fit is None or not cause.within(fit):
            continue
        best = max(best, fit.log_likelihood)
        odds = fit.log_likelihood - base + cause.log_prior
        if moments is not None:
            odds += _moments_of(witness, fit) - moments
        yield Explanation(cause.says(fit), float(odds), partial(witness.applied, cause.alter, fit))


def _moments_of(witness: Witness, fit: RigFit) -> float:
    """Log likelihood of the moment sensor's readings with any sign, unit, zero and noise."""
    readings = witness.moments(fit)
    if len(readings.read) < 4 or not np.isfinite(readings.read).all():
        return 0.0
    spread = 10.0 * max(float(np.ptp(readings.read)), readings.std_Nm)
    any_gain = spread / max(float(np.ptp(readings.true)), 1e-12)
    return readings.log_likelihood(0.0, any_gain, offset_std_Nm=spread)[0]


def _joints_untested(witness: Witness, reported: RigFit) -> list[Diagnosis]:
    """A note where pictures and moments do not refute other signs or another order or unit of the joints' readings."""
    moments, possible = _moments_of(witness, reported), []
    for words, cause in _joint_faults(witness):
        gained = witness.forecast(cause.alter)[0] - reported.log_likelihood
        if gained < -DecisionSettings.least_log_odds - SETTINGS.by_moments:
            continue
        fit = witness.fit(cause.alter, least=reported.log_likelihood - SETTINGS.behind)
        if fit is None:
            continue
        gained = fit.log_likelihood + _moments_of(witness, fit) - reported.log_likelihood - moments
        if gained > -DecisionSettings.least_log_odds:
            possible.append(words)
    if not possible:
        return []
    return [
        Diagnosis(
            "joints_untested",
            f"gravity bends this antenna too little to show whether {' or '.join(possible)}: the joints' readings are "
            "taken as reported",
            "turn each joint by hand and see that its angle in rad grows the right way, or add no-load frames at "
            "larger tilts",
            "note",
        )
    ]


def _sensor_diagnoses(readings: MomentReadings) -> list[Diagnosis]:
    """Diagnoses of the moment sensor, the likeliest first."""
    seen = np.isfinite(readings.read).all() and np.ptp(readings.true) >= SETTINGS.seen_std * readings.std_Nm
    if len(readings.read) < SETTINGS.fewest or not seen:
        return []
    return diagnose(readings, SENSOR)


def static_frame_diagnoses(session: Session, kinematics: Kinematics, joint: BundleAdjustment) -> list[Diagnosis]:
    """Diagnoses of a session's numbers, rows, camera, antenna, clamp and moment sensor, the likeliest first. joint :
    the solution from all its pictures, from `solve_antenna`."""
    try:
        return _session_diagnoses(session, kinematics, joint.noted, joint.problem.prior)
    except SolveError:
        return []


def _session_diagnoses(
    session: Session, kinematics: Kinematics, observations: Sequence[Observation], before: Prior
) -> list[Diagnosis]:
    """`static_frame_diagnoses` for observations that may have no common solution. Raises SolveError."""
    witness = Witness.of(session, kinematics, observations, before)
    rounds, right = explained(witness, [_explanations])
    found = causes(rounds, right.beyond_usual)
    fit = right.reported
    if fit is None or fit.scale > SETTINGS.fits:
        return [_contradiction(np.inf if fit is None else fit.scale), *found]
    channels = right.channels(fit)
    sensor = channel_diagnoses(channels) if channels else _sensor_diagnoses(right.moments(fit))
    return [*found, *sensor, *_joints_untested(right, fit)]


def with_cause(error: SolveError, causes: Sequence[Diagnosis]) -> SolveError | InputError:
    """An error of `solve_antenna` with the likeliest of its `failure_causes`, or a note that none is found."""
    if causes and causes[0].name.startswith("load_"):
        return InputError(f"{error}. {causes[0].words}", remedy=causes[0].remedy)
    if causes:
        return SolveError(f"{error}. Likely: {causes[0]}")
    return SolveError(
        f"{error}. No load, reading or joint angle explains it: look at the antenna's pictures with vbaa look, "
        "add views of the board over the whole picture, or choose another --lens-model"
    )


def failure_causes(
    session: Session, kinematics: Kinematics, observations: Sequence[Observation], before: Prior
) -> list[Diagnosis]:
    """Likely causes of a calibration that raised an error. Raises nothing itself."""
    try:
        found = _session_diagnoses(session, kinematics, observations, before)
    except SolveError:
        found = []
    if found and found[0].name != "stills_contradict":
        return found
    loads = [one.still for one in observations if isinstance(one.still, Load)]
    return [one for one in found if one.grave] or typed_load_diagnoses(loads, session.antenna) or found


def _contradiction(scale: float) -> Diagnosis:
    return Diagnosis(
        "stills_contradict",
        f"the pictures do not fit one antenna: they lie {scale:.0f} times further off it than their own scatter; no "
        "single cause explains it",
        "check unit, sign and place of every load, the joints' angles (rad), gravity_world, and that nothing moved",
        severity="wrong",
    )
