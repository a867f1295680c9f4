"""Diagnosis of the jig: the mistake in session.yaml, or the change since its picture, that explains the antenna's
position.

Witnesses are the free antenna in its pictures, with its visible end, and the other ways to plane C. All hypotheses are
weighed on the same lines, each by the evidence (Laplace) of a solve of camera pose, antenna and lens.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from targets.board import corner_points
from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment, noise_scale
from vbaa_calib.calibrate.antenna.inputs import Observation
from vbaa_calib.calibrate.antenna.problem import POSE, Problem
from vbaa_calib.calibrate.antenna.session_rig import ExpectedAntenna, nominal_parameters, prior
from vbaa_calib.calibrate.pose.board_pose import BoardPose, jig_estimate
from vbaa_calib.calibrate.pose.fusion import PoseEstimate, differences
from vbaa_calib.camera import Camera
from vbaa_calib.core.arrays import spread_evenly
from vbaa_calib.core.errors import Diagnosis, InputError, Severity, SolveError
from vbaa_calib.core.images import read_picture
from vbaa_calib.core.least_squares import Linearised, Rules, minimise
from vbaa_calib.detect.whisker.corridor import free_curve
from vbaa_calib.geometry import Pose
from vbaa_calib.session import Session, Still, gravity_antenna

from .decision import Explanation, causes, decide

SLIPS = (
    *(f"jig_{what}" for what in ("unit", "sign", "axes_exchanged", "turned", "rotation_order", "inverse")),
    *("pictures_mirrored", "pictures_turned"),
)
"""Names of mistakes in session.yaml, and of pictures, that are not off by an amount."""


@dataclass(frozen=True)
class _JigSettings:
    """Thresholds and priors of mistakes in the jig's entry, and of changes since its picture."""

    log_prior: float = -6.0  # log probability of each slip in session.yaml
    log_prior_change: float = -3.0  # the same of a camera that moved, a refocus, a length: these are commoner
    free_frames: int = 2  # pictures in which the free antenna is looked for by every hypothesis
    some_free: int = 3  # lines of the free antenna that are weighed, where they are known
    some_loaded: int = 6  # lines under a load that are weighed with them
    reaches: tuple[float | None, ...] = (1.3, 3.0)  # standard deviations within which it must lie to be found so
    least_inside: float = 0.6  # part of the free antenna that a hypothesis must put into the picture
    lost: float = 1e3  # log evidence against a hypothesis that puts the antenna somewhere else altogether
    far: float = 0.3  # part of the antenna's length in the picture: where it lies farther off, nothing is solved
    correlated: float = 3.0  # square root of how many neighbouring points share one error
    offset_m: float = 5e-3  # prior standard deviation of a jig that is off, per axis
    camera_rad: float = 5e-3  # the same of a camera that was knocked, per axis
    camera_m: float = 1e-3  # the same of its place
    focal: float = 0.02  # the same of a focal length, relative
    loads_rad: float = 0.01  # the same of a camera that turned between the pictures without and with loads, per axis
    rounds: int = 4  # in which its turn is estimated
    length: float = 0.02  # the same of the antenna's length, relative
    scattered: float = 2.0  # scatter of the lines, over their own, up to which they fit
    most_cost: float = 50.0  # of the priors, that a hypothesis may leave: other things may be wrong besides
    least_cost: float = 8.0  # of the priors, half their χ², from which another explanation is looked for


@dataclass(frozen=True, eq=False)
class _JigMistake:
    """A hypothesis: the jig's pose under it, the mirroring of the antenna's pictures, and what is uncertain."""

    name: str
    words: str
    remedy: str
    T_antenna_board: Pose
    log_prior: float
    flips: tuple[bool, bool] = (False, False)  # the antenna's pictures, left to right and upside down
    turn_rad: float = 0.0  # further standard deviations: of the camera's turn since the jig's picture
    move_m: float = 0.0  # of its place
    offset_m: float = 0.0  # of the board's place in the jig
    focal: float = 0.0  # of the focal length since the boards' pictures, relative
    length_m: float = 0.0  # of the antenna's length
    loads_rad: float = 0.0  # of the camera's turn between the free antenna's pictures and those of the loads
    other: int | None = None  # which of the other ways is off by `offset_m` in place of the jig


@dataclass(frozen=True, eq=False)
class JigEvidence:
    """A session with a jig, its board in the camera frame, and the other evidence on the camera's pose.

    others : the camera's pose by other ways. free : the free antenna's pictures, searched for it where `lines` is None.
    """

    session: Session
    camera: Camera
    board: BoardPose
    others: Sequence[PoseEstimate] = ()
    free: Sequence[Still] = ()
    lines: Sequence[Observation] | None = None

    @property
    def reported(self) -> _JigMistake:
        """The hypothesis that everything is as session.yaml states."""
        assert self.session.T_antenna_board is not None
        return _JigMistake("as_reported", "", "", self.session.T_antenna_board, 0.0)

    def estimate(self, case: _JigMistake) -> PoseEstimate:
        """The camera's pose in the antenna's pictures, by the jig."""
        std = self.session.jig_translation_std_m, self.session.jig_rotation_std_rad
        found = jig_estimate(self.board, case.T_antenna_board, *std)
        moved = np.hypot(case.move_m, case.offset_m if case.other is None else 0.0)
        spread = np.diag(np.repeat([case.turn_rad, moved], 3) ** 2)
        return self._before(case, replace(found, covariance=found.covariance + spread))

    def _before(self, case: _JigMistake, found: PoseEstimate) -> PoseEstimate:
        """An estimate from pictures of the board, corrected for a later change of the focal length."""
        by_lens = found.lens_sensitivity
        if not case.focal or self.camera.covariance is None:
            return found
        covariance = found.covariance + by_lens @ self.camera.covariance @ by_lens.T
        return replace(found, covariance=covariance, lens_sensitivity=np.zeros_like(by_lens))

    def by_others(self, case: _JigMistake) -> list[PoseEstimate]:
        """The camera's pose by the ways other than the jig, under a hypothesis."""
        found = [self._before(case, one) for one in self.others]
        if case.other is not None:
            spread = np.repeat([0.0, case.offset_m], 3) ** 2
            found[case.other] = replace(found[case.other], covariance=found[case.other].covariance + np.diag(spread))
        return found

    def lens(self, case: _JigMistake) -> Camera:
        """The lens of the antenna's pictures before it is solved with them."""
        if not case.focal:
            return self.camera
        axis = np.zeros(len(self.camera.parameters))
        axis[:2] = case.focal * self.camera.parameters[:2]
        known = self.camera.covariance
        return replace(self.camera, covariance=np.outer(axis, axis) + (0.0 if known is None else known))

    def found(self, case: _JigMistake) -> list[Observation]:
        """The free antenna detected near where a hypothesis predicts it, in the unmirrored pictures; empty where it
        is missing in one.

        It is searched within a few standard deviations only: a line that lies elsewhere does not support the
        hypothesis.
        """
        pose, session = self.estimate(case).T_antenna_camera, self.session
        frames = list(self.free[: _JigSettings.free_frames])
        pulls = gravity_antenna(session.kinematics, session.gravity_world_m_s2, frames)
        if not frames or self._predicted(pose, pulls[0])[1].mean() < _JigSettings.least_inside:
            return []
        images = [_flipped(read_picture(frame.image), case.flips) for frame in frames if frame.image is not None]
        nominal = nominal_parameters(session.antenna)
        expected = ExpectedAntenna(session.antenna, self.camera, pose, nominal, reaches=_JigSettings.reaches)
        try:
            expected = replace(expected, paint=expected.learned(frames, images, list(pulls)))
            seen = [expected.observe(*each) for each in zip(frames, images, pulls, strict=True)]
        except InputError:
            return []
        return self._flipped(seen, case.flips)

    def _predicted(self, T_antenna_camera: Pose, gravity_m_s2: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pixels (N, 2) of the nominal free antenna seen from a camera pose, without those that the lens cannot see,
        and the mask (M,) of the antenna's points in the picture."""
        antenna = self.session.antenna
        points = free_curve(nominal_parameters(antenna), antenna.length_m, gravity_m_s2, antenna.taper).points_m[0]
        pixels, seen = self.camera.project(T_antenna_camera.inverse() @ points)
        return pixels[seen], seen & self.camera.in_picture(np.nan_to_num(pixels, nan=-1.0))

    def _flipped(self, lines: Iterable[Observation], flips: tuple[bool, bool]) -> list[Observation]:
        """The lines in the coordinates of mirrored pictures."""
        last = np.array(self.camera.image_size) - 1.0
        turn, shift = np.where(flips, -1.0, 1.0), np.where(flips, last, 0.0)
        return [replace(one, points_px=shift + turn * one.points_px, tip_px=shift + turn * one.tip_px) for one in lines]

    def problem(self, case: _JigMistake, lines: Sequence[Observation], scale: float) -> Problem:
        """The problem of camera pose, antenna and lens with the free antenna's lines, under a hypothesis."""
        antenna, session = self.session.antenna, self.session
        before = prior(
            antenna,
            self.lens(case),
            [self.estimate(case), *self.by_others(case)],
            readings=session.load_readings,
            drift=session.possible_drift,
        )
        if before.tip_std_m is not None:
            before = replace(before, tip_std_m=float(np.hypot(before.tip_std_m, case.length_m)))
        before = replace(before, start=before.poses[0].T_antenna_camera)
        lines = self._flipped(lines, case.flips)
        # the sensor is another question
        problem = Problem.of(lines, before, antenna.length_m, 1e6 * session.moment_std_Nm)
        ends = [index for index, one in enumerate(lines) if np.isfinite([*one.tip_px, one.tip_std_px]).all()]
        ends = ends if before.tip_std_m is not None else []
        return replace(problem, tips=np.array(ends, int), noise_scale=scale).relinearised(problem.begin)

    def solved(
        self, case: _JigMistake, lines: Sequence[Observation], scale: float
    ) -> tuple[float, Problem | None, Linearised | None]:
        """Log evidence (Laplace) of a hypothesis, up to a common constant; its problem and solution."""
        if not lines:
            return self._by_ways(case), None, None
        try:
            problem = self.problem(case, lines, scale)
            first = problem.linearised(problem.begin)
            points = np.concatenate([scale * one.sigma_px for one in problem.observations])
            off_px = float(np.median(np.abs(first.residuals[: len(points)]) * points)) if first.is_finite else np.inf
            extent_px = float(np.linalg.norm(np.ptp(lines[0].points_px, axis=0)))
            if off_px > _JigSettings.far * extent_px:
                return -_JigSettings.lost, None, None
            at, *_ = minimise(problem.linearised, first, Rules(iterations=20, takes_last=True, may_rise=1e-3))
            problem.camera(at.parameters)
        except (SolveError, InputError, ValueError, np.linalg.LinAlgError):
            return -_JigSettings.lost, None, None
        weighted = at.jacobian * at.weights[:, None]
        known = sum(float(np.linalg.slogdet(one.covariance)[1]) for one in problem.prior.poses)
        information = 2.0 * float(np.log(np.abs(np.diag(np.linalg.qr(weighted, mode="r")))).sum())
        along = 0.0
        if len(problem.tips):
            by_length = problem.evaluate(at.parameters).by_length
            along = float(np.log1p((problem.prior.tip_std_m or 0.0) ** 2 * by_length @ by_length))
        evidence = -at.cost - 0.5 * (known + information + along)
        return max(evidence, -_JigSettings.lost), problem, at

    def _by_ways(self, case: _JigMistake) -> float:
        """Log evidence without pictures of the free antenna: by the other ways to plane C alone."""
        one, total = self.estimate(case), 0.0
        lens = np.zeros((0, 0)) if self.camera.covariance is None else self.camera.covariance
        for other in self.by_others(case):
            (apart,) = differences([one, other], lens)
            total -= 0.5 * (apart.statistic + float(np.linalg.slogdet(apart.covariance)[1]))
        return max(total, -_JigSettings.lost)

    @property
    def fits(self) -> bool:
        """Whether the antenna's lines and the other ways lie so near to what was reported that no explanation could
        gain more than its prior costs."""
        solution, largest = self._as_reported[2], _JigSettings.scattered * _JigSettings.correlated
        if solution is None or self._scale(self.reported, self.seen[0]) > largest:
            return False
        return solution.prior_cost < _JigSettings.least_cost

    @cached_property
    def _as_reported(self) -> tuple[float, Problem | None, Linearised | None]:
        """What `solved` finds from the lines in `seen`, with everything as reported."""
        return self.solved(self.reported, *self.seen)

    @cached_property
    def seen(self) -> tuple[Sequence[Observation], float]:
        """The free antenna's lines and the factor on their standard deviations.

        Where they were not detected beforehand, they come from the hypothesis that best explains the lines detected
        near its own prediction.
        """
        if self.lines is not None:
            some = [
                *_some(self.lines, _JigSettings.some_free, False),
                *_some(self.lines, _JigSettings.some_loaded, True),
            ]
            scale = self._scale(self.reported, some)
            if scale > _JigSettings.scattered * _JigSettings.correlated:
                # what is reported may be why they lie so far off: by a scatter as large nothing could be told apart
                scale = min(
                    self._scale(case, some) for case in [self.reported, *_slips(self), *_mirrored_pictures(self)]
                )
            return some, scale
        best: tuple[tuple[int, float], Sequence[Observation], float] = ((0, -np.inf), [], 1.0)
        places: list[tuple[Pose, tuple[bool, bool]]] = []
        elsewhere = [
            replace(self.reported, name=one.way, T_antenna_board=one.T_antenna_camera @ self.board.T_camera_board)
            for one in self.others
        ]
        for case in [self.reported, *elsewhere, *_slips(self), *_mirrored_pictures(self)]:
            pose = self.estimate(case).T_antenna_camera
            if any(flips == case.flips and np.abs(pose.tangent_from(other)).max() < 1e-4 for other, flips in places):
                continue
            places.append((pose, case.flips))
            lines = self.found(case)
            if lines:
                scale = self._scale(case, lines)
                # an end that is seen says which way the antenna lies, and how far away
                ends = sum(bool(np.isfinite(one.tip_std_px)) for one in lines)
                best = max(best, ((ends, self.solved(case, lines, scale)[0]), lines, scale), key=lambda one: one[0])
                if case.name == self.reported.name and ends == len(lines):
                    break
        return best[1:]

    def _scale(self, case: _JigMistake, lines: Sequence[Observation]) -> float:
        """Factor on the points' standard deviations, from their scatter about the best antenna under a hypothesis."""
        if not lines:
            return 1.0
        _, problem, solution = self.solved(case, lines, 1.0)
        if problem is None or solution is None:
            return _JigSettings.correlated
        left = [block[:, 0] for block in problem.evaluate(solution.parameters).points]
        return _JigSettings.correlated * max(noise_scale(left), 1.0)

    def explanation(self, case: _JigMistake) -> Explanation[JigEvidence]:
        """The explanation of the lines and the other ways by a hypothesis."""
        lines, scale = self.seen
        if case.loads_rad:
            return self._turned_before_loads(case)
        evidence, problem, solution = self.solved(case, lines, scale)
        if solution is not None and solution.prior_cost > _JigSettings.most_cost:
            # a line that is somewhere else under every hypothesis is not the antenna
            evidence = -_JigSettings.lost
        words = case.words
        if "{}" in words:
            words = words.format(self._value(case, problem, solution) if problem or self.others else "an amount")
        severity: Severity = "doubt" if case.name == "antenna_length" else "wrong"
        if lines:
            words += f"; as it is in session.yaml, {self._off(lines)}"
        gained = evidence - self._as_reported[0] + case.log_prior
        return Explanation(Diagnosis(case.name, words, case.remedy, severity), gained)

    def _turned_before_loads(self, case: _JigMistake) -> Explanation[JigEvidence]:
        """The explanation by a rotation of the camera between the pictures without and with loads: estimated to
        first order, and again with the loads' lines rotated back."""
        lines, scale = self.seen
        turn, std_rad, evidence = np.zeros(3), np.full(3, np.nan), -_JigSettings.lost
        for _ in range(_JigSettings.rounds):
            _, problem, solution = self.solved(case, [self._seen_before(one, turn) for one in lines], scale)
            if problem is None or solution is None:
                break
            counts = [len(seen) for seen in problem.seen_at_lens]
            loaded = np.repeat([one.loaded for one in lines], counts)
            columns = np.zeros((len(solution.residuals), 3))
            columns[: len(loaded)] = np.where(loaded[:, None], solution.jacobian[: len(loaded), POSE][:, :3], 0.0)
            found = solution.score_test(columns, case.loads_rad)
            if found is None:
                break
            turn, std_rad = turn + found.values, found.std
        else:
            evidence = self.solved(case, [self._seen_before(one, turn) for one in lines], scale)[0]
            # what a turn that is known no better costs, and how far it is from none
            evidence -= float(np.log(np.maximum(case.loads_rad / std_rad, 1.0)).sum())
            evidence -= 0.5 * float((turn**2).sum()) / case.loads_rad**2
        size = f"{np.degrees(np.linalg.norm(turn)):.2f} ± {np.degrees(np.linalg.norm(std_rad)):.2f}°"
        found_so = Diagnosis(case.name, case.words.format(size), case.remedy, "wrong")
        return Explanation(found_so, evidence - self._as_reported[0] + case.log_prior)

    def _seen_before(self, line: Observation, turn_rad: np.ndarray) -> Observation:
        """A load's line in the camera's orientation before it turned; any other unchanged."""
        if not line.loaded or not turn_rad.any():
            return line
        rotation = self.estimate(self.reported).T_antenna_camera.rotation
        back = rotation.T @ Pose.from_rotvec(turn_rad, np.zeros(3)).rotation @ rotation

        def moved(pixels: np.ndarray) -> np.ndarray:
            return self.camera.project(self.camera.unproject(pixels)[0] @ back.T)[0]

        tip = moved(line.tip_px[None])[0] if np.isfinite(line.tip_px).all() else line.tip_px
        return replace(line, points_px=moved(line.points_px), tip_px=tip)

    def _value(self, case: _JigMistake, problem: Problem | None, solution: Linearised | None) -> str:
        """The estimated value of a hypothesis's free parameter, for the message."""
        jig = self.estimate(replace(case, offset_m=0.0, turn_rad=0.0, move_m=0.0))
        if problem is None or solution is None:
            others = [one.T_antenna_camera.tangent_from(jig.T_antenna_camera) for one in self.others]
            step, std = np.mean(others, axis=0), np.sqrt(np.diag(self.others[0].covariance + jig.covariance))
        else:
            step = problem.pose(solution.parameters).tangent_from(jig.T_antenna_camera)
            std = np.sqrt(np.diag(solution.covariance())[:6])
        if case.focal and problem is not None and solution is not None:
            ratio = problem.camera(solution.parameters).parameters[0] / self.camera.parameters[0]
            axes = problem.prior.lens_axes[0] / self.camera.parameters[0]
            own = solution.covariance()[problem.lens, problem.lens]
            return f"{100 * (ratio - 1):+.2f} ± {100 * float(np.sqrt(axes @ own @ axes)):.2f} %"
        if case.turn_rad:
            return f"{np.degrees(np.linalg.norm(step[:3])):.2f} ± {np.degrees(np.linalg.norm(std[:3])):.2f}°"
        if case.length_m and problem is not None and solution is not None:
            found, std_m = problem.evaluate(solution.parameters), problem.prior.tip_std_m or 0.0
            information = std_m**-2 + found.by_length @ found.by_length
            off = -found.by_length @ found.tips[:, 0] / information
            return f"{1e3 * off:+.1f} ± {1e3 * information**-0.5:.1f} mm"
        if case.other is not None:
            # the camera is where the jig has it
            step = self.others[case.other].T_antenna_camera.tangent_from(jig.T_antenna_camera)
        off_mm, off_std = 1e3 * step[3:], 1e3 * std[3:]
        each = [f"{value:+.1f} ± {own:.1f}" for value, own in zip(off_mm, off_std, strict=True)]
        return f"({', '.join(each)}) mm"

    def _off(self, lines: Sequence[Observation]) -> str:
        """Distance, in words, of the free antenna from its place if everything were as reported."""
        pixels, inside = self._predicted(self.estimate(self.reported).T_antenna_camera, lines[0].gravity_m_s2)
        if not inside.any():
            return "the antenna would be outside the picture"
        apart = np.linalg.norm(lines[0].points_px[:, None] - pixels[None], axis=2).min(axis=1)
        return f"the antenna would lie {float(np.median(apart)):.0f} px off where the pictures show it"


def _some(lines: Sequence[Observation], count: int, loaded: bool) -> list[Observation]:
    """At most `count` of the lines with or without a load, evenly spaced."""
    alike = [one for one in lines if one.loaded == loaded]
    return [alike[index] for index in spread_evenly(len(alike), count)]


def _flipped(image: np.ndarray, flips: tuple[bool, bool]) -> np.ndarray:
    across, down = flips
    return np.ascontiguousarray(image[:: -1 if down else 1, :: -1 if across else 1])


def _typed(data: JigEvidence) -> Pose:
    """session.yaml's jig.T_antenna_board, of the board's back."""
    face = Pose(np.eye(3), np.array([0.0, 0.0, -data.session.board.thickness_m]))
    return data.reported.T_antenna_board @ face.inverse()


def _slips(data: JigEvidence) -> Iterator[_JigMistake]:
    """Hypotheses of mistakes in jig.T_antenna_board: units, signs, exchanged axes, half turns, the inverse pose,
    another order."""
    typed, key = _typed(data), "jig.T_antenna_board"
    face = typed.inverse() @ data.reported.T_antenna_board
    shift, turn = typed.translation_m, typed.rotation
    remedy = f"mend {key} in session.yaml, then calibrate again"

    def case(name: str, words: str, pose: Pose, more: float = 0.0) -> _JigMistake:
        return _JigMistake(f"jig_{name}", words, remedy, pose @ face, _JigSettings.log_prior + more)

    units = {"mm": (1e-3, "m"), "cm": (1e-2, "m"), "inch": (0.0254, "m")}
    for unit, (factor, meant) in units.items():
        words = f"{key}.translation_m is in {unit}, not in {meant}: ({_numbers(factor * shift)}) m fits"
        yield case("unit", words, Pose(turn, factor * shift))
        words = f"{key}.translation_m is too small, by {meant} for {unit}: ({_numbers(shift / factor)}) m fits"
        yield case("unit", words, Pose(turn, shift / factor))
    for axis, name in enumerate("xyz"):
        if abs(shift[axis]) > 0.0:
            sign = np.where(np.arange(3) == axis, -1.0, 1.0)
            words = (
                f"the sign of {name} in {key}.translation_m is wrong: {-shift[axis]:g} m fits, not {shift[axis]:g} m"
            )
            yield case("sign", words, Pose(turn, sign * shift))
    for first, second in ((0, 1), (0, 2), (1, 2)):
        order = np.arange(3)
        order[[first, second]] = second, first
        names = "xyz"[first], "xyz"[second]
        words = f"{names[0]} and {names[1]} of {key}.translation_m are exchanged: ({_numbers(shift[order])}) m fits"
        yield case("axes_exchanged", words, Pose(turn, shift[order]))
    middle = corner_points(data.session.board).mean(axis=0) * [1.0, 1.0, 0.0]
    for name, about_axis in zip("xyz", np.eye(3), strict=True):
        rotation = Pose.from_rotvec(np.pi * about_axis, np.zeros(3)).rotation
        about = Pose(rotation, middle - rotation @ middle)
        words = f"the board in the jig is turned by 180° about its {name} axis: {{}} fits"
        yield case("turned", words.format(_quaternion(turn @ rotation)), Pose(turn @ rotation, shift))
        yield case("turned", f"{words.format('its place')} where it is turned about its middle", typed @ about)
        words = f"the jig is turned by 180° about the antenna's {name} axis"
        yield case("turned", words, Pose(rotation, np.zeros(3)) @ typed)
    for degrees in (90.0, -90.0):
        quarter = Pose.from_rotvec(np.array([0.0, 0.0, np.radians(degrees)]), np.zeros(3)).rotation
        words = f"the board in the jig is turned by {degrees:+.0f}° about its z axis: {_quaternion(turn @ quarter)}"
        yield case("turned", words, Pose(turn @ quarter, shift), -1.0)
    x, y, z, w = typed.to_dict()["rotation_xyzw"]
    for own in ((y, z, w, x), (-y, -z, -w, x)):
        words = f"{key}.rotation_xyzw is in the order w, x, y, z: ({_numbers(own)}) fits"
        yield case("rotation_order", words, Pose.from_quaternion(np.array(own), shift), -1.0)
    words = f"{key} is the inverse: the pose of the antenna on the board, not of the board on the antenna"
    yield case("inverse", words, typed.inverse())
    words = f"{key}.rotation_xyzw turns the other way round: {_quaternion(turn.T)} fits"
    yield case("turned", words, Pose(turn.T, shift), -1.0)


def _mirrored_pictures(data: JigEvidence) -> Iterator[_JigMistake]:
    """Hypotheses of antenna pictures that are mirrored, or upside down, relative to the board's."""
    for flips, words in (
        ((True, False), "mirrored left to right"),
        ((False, True), "mirrored upside down"),
        ((True, True), "turned by 180°"),
    ):
        name = "pictures_turned" if all(flips) else "pictures_mirrored"
        words = f"the pictures of the antenna are {words} against the board's"
        remedy = "take them all with the same camera settings, or turn them back"
        yield _JigMistake(name, words, remedy, data.reported.T_antenna_board, _JigSettings.log_prior, flips)


def _changes(data: JigEvidence) -> Iterator[_JigMistake]:
    """Hypotheses of motions and changes by an unknown amount."""
    pose = data.reported.T_antenna_board
    again = "take the jig's and the antenna's pictures again, one after the other, with nothing touched in between"
    if data.others:
        words = "the board in the jig lies off where jig.T_antenna_board has it, by {}"
        remedy = "measure the jig again, or say in session.yaml how well it is known (jig.translation_std_m)"
        yield _JigMistake("jig_off", words, remedy, pose, _JigSettings.log_prior_change, offset_m=_JigSettings.offset_m)
        for index, one in enumerate(data.others):
            words = f"the {one.way} puts the camera off where it is, by {{}}"
            remedy = f"measure what the {one.way} rests on again (kinematics, over.height_m)"
            case = _JigMistake(f"{one.way.replace(' ', '_')}_off", words, remedy, pose, _JigSettings.log_prior_change)
            yield replace(case, offset_m=_JigSettings.offset_m, other=index)
    words = "the camera turned by {} between the jig's picture and the antenna's"
    knocked = _JigMistake("camera_moved", words, again, pose, _JigSettings.log_prior_change)
    yield replace(knocked, turn_rad=_JigSettings.camera_rad, move_m=_JigSettings.camera_m)
    if data.lines is not None and 0 < sum(one.loaded for one in data.lines) < len(data.lines):
        words = "the camera turned by {} between the pictures without and those with loads"
        remedy = "fasten the camera, take both again, and the jig's picture with them"
        yield replace(knocked, words=words, remedy=remedy, loads_rad=_JigSettings.loads_rad)
    words = "the focal length changed by {} between the board's pictures and the antenna's"
    remedy = f"switch autofocus and zoom off; {again}"
    yield _JigMistake("refocused", words, remedy, pose, _JigSettings.log_prior_change, focal=_JigSettings.focal)
    length = _JigSettings.length * data.session.antenna.length_m
    words = "antenna.length_m is off by {}"
    yield _JigMistake("antenna_length", words, "measure it again", pose, _JigSettings.log_prior_change, length_m=length)


def _numbers(values: Iterable[float]) -> str:
    return ", ".join(f"{value:.4g}" for value in values)


def _quaternion(rotation: np.ndarray) -> str:
    return f"rotation_xyzw ({_numbers(Pose(rotation, np.zeros(3)).to_dict()['rotation_xyzw'])})"


def jig_diagnoses(data: JigEvidence) -> list[Diagnosis]:
    """Diagnoses of the jig, or of changes since its picture; empty where everything may be as reported, or another
    cause explains the pictures as well."""
    if data.fits if data.seen[0] else not data.others:
        return []
    best = decide(data.explanation(case) for row in (_slips, _mirrored_pictures, _changes) for case in row(data))
    # the antenna's length is for those who know its loads
    return [] if not best or best[0].diagnosis.name == "antenna_length" else causes([best])


def plane_contradicted(joint: BundleAdjustment) -> bool:
    """Whether the camera's pose, the clamp or the antenna's end lie so far from the reports that a slip of the jig,
    or a change since its picture, may explain it: none can gain more than this costs. Where the pictures fit no
    antenna, they lie too far off their lines to move the pose."""
    if joint.problem.noise_scale > _JigSettings.scattered * _JigSettings.correlated:
        return True
    priors = joint.solution.residuals[joint.solution.measured :]
    poses = 6 * len(joint.problem.prior.poses)
    of_antenna = poses + len(joint.problem.tips)
    cost = 0.5 * float((priors[:poses] ** 2).sum() + (priors[of_antenna : of_antenna + 6] ** 2).sum())
    gap = float(np.nan_to_num(joint.tip_gap_std, posinf=0.0, neginf=0.0))
    return cost + 0.5 * gap**2 > _JigSettings.least_cost
