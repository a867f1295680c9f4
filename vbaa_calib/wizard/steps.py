"""The wizard's steps in order: the progress of each, and the check of a picture for it."""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from targets.sheet import board_id, size_words
from vbaa_calib.calibrate.antenna.problem import GAIN, OFFSET
from vbaa_calib.calibrate.check.assessment import assess
from vbaa_calib.calibrate.given_lens import GivenLens
from vbaa_calib.calibrate.guide.next_observation import load_progress
from vbaa_calib.calibrate.guide.next_view import ViewProgress, lens_progress, plane_progress
from vbaa_calib.calibrate.guide.settings import GuideSettings
from vbaa_calib.calibrate.guide.suggestion import Suggestion, pose_match
from vbaa_calib.calibrate.pipeline import Calibration, calibrate
from vbaa_calib.calibrate.report import rig_document
from vbaa_calib.core.errors import Diagnosis, InputError, VbaaError
from vbaa_calib.core.files import write_json, write_text
from vbaa_calib.core.images import read_picture
from vbaa_calib.detect.board.corners import BoardView, detect_corners
from vbaa_calib.detect.quality.hints import picture_hints, wrong_board
from vbaa_calib.detect.quality.settings import QualitySettings
from vbaa_calib.diagnose.boards import resolution_changed, same_pose
from vbaa_calib.rig import Rig
from vbaa_calib.session import load_session
from vbaa_calib.sources import Picture

from .against_answers import antenna_diagnoses, camera_place, entries_that_show_it, jig_refusal
from .questions import PICTURES, free_pose_deg
from .session_state import SessionState, still_of


@dataclass(frozen=True)
class _Number:
    """A number and its goal with units; `met` is None without a goal."""

    label: str
    value: str
    goal: str | None = None
    met: bool | None = None


@dataclass(frozen=True, eq=False)
class Progress:
    """Progress of a step. enough : whether more pictures would not help. usable : whether the step may be closed."""

    seen: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    next: str = ""
    enough: bool = False
    usable: bool = False
    numbers: tuple[_Number, ...] = ()
    target: Suggestion | None = None  # where to show the board next
    diagnoses: tuple[Diagnosis, ...] = ()

    @property
    def lines(self) -> list[str]:
        """The progress as text: grave problems, then doubts, the next thing to do last."""
        lines = [f"seen      {line}" for line in self.seen]
        for number in self.numbers:
            goal = f" (goal {number.goal}{', reached' if number.met else ''})" if number.goal else ""
            lines.append(f"          {number.label}: {number.value}{goal}")
        lines += [f"missing   {line}" for line in self.missing]
        for diagnosis in sorted(self.diagnoses, key=lambda one: not one.grave):
            lines.append(f"{'WRONG' if diagnosis.grave else diagnosis.label:9s} {diagnosis.words}")
            lines.append(f"          → {diagnosis.remedy}")
        return [*lines, f"next      {self.next}"] if self.next else lines


@dataclass(frozen=True, eq=False)
class PictureCheck:
    """Result of checking a picture for a step.

    refusal : why it is refused, or "". words : what it shows, for the log. hints : what could be better.
    corners_px : (N, 2) corners of the board with their ids (N,), or points on the antenna.
    closeness : to the suggested pose, 0 to 1, None without one. closer : what to change.
    """

    refusal: str = ""
    corners_px: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    hints: tuple[Diagnosis, ...] = ()
    words: str = ""
    closeness: float | None = None
    closer: str = ""
    ids: np.ndarray = field(default_factory=lambda: np.zeros(0, int))


Readings = Mapping[str, float]
"""What was read with a picture, SI."""


@dataclass(frozen=True)
class Step:
    """A step of the wizard. check : checks a picture, None for a step without pictures; its readings are None for a
    preview."""

    name: str
    title: str
    what: str
    why: str
    progress: Callable[[SessionState], Progress]
    check: Callable[[SessionState, Picture, Readings | None], PictureCheck] | None = None


def _counted(number: int, word: str) -> str:
    """A number with its noun in the singular or plural: "1 picture", "2 pictures"."""
    return f"{number} {word}{'' if number == 1 else 's'}"


def _other_size(state: SessionState, size: tuple[int, int]) -> Diagnosis | None:
    """The reason why a picture of `size` (width, height) px does not belong to this session; None if it does."""
    known, wanted = state.given_lens, state.image_size
    if known is None or size == wanted:
        return None if wanted is None else resolution_changed(size, wanted)
    words = f"the picture is {size[0]}x{size[1]} px, {known.size_words} {wanted[0]}x{wanted[1]} px" if wanted else ""
    return Diagnosis(
        "picture_not_of_given_lens", words, "set the camera to that mode, or name its own lens", severity="wrong"
    )


def _check_board(state: SessionState, picture: Picture, live: bool) -> tuple[BoardView, PictureCheck]:
    """Check of a picture of the board, and the board's view. live : without the slow search for other boards."""
    image = picture.image
    view = detect_corners(image, state.board, picture.name)
    changed = _other_size(state, view.image_size)
    if changed is not None:
        return view, PictureCheck(str(changed), view.corners_px, (changed,), ids=view.ids)
    hints = list(picture_hints(image, view, state.board))
    if not live and len(view.ids) < QualitySettings.least_corners:
        other = wrong_board(image, view, state.board)
        hints = hints if other is None else [other, *hints]
    refusal = next((str(hint) for hint in hints if hint.grave), "")
    if not refusal and len(view.ids) < QualitySettings.least_corners:
        refusal = f"{len(view.ids)} corners of the board are seen; show more of it"
    return view, PictureCheck(refusal, view.corners_px, tuple(hints), f"{len(view.ids)} corners", ids=view.ids)


def _check_plane(state: SessionState, picture: Picture, readings: Readings | None) -> PictureCheck:
    view, check = _check_board(state, picture, readings is None)
    if check.refusal or state.store.folder("plane") != "plane":
        return check
    return replace(check, refusal=jig_refusal(state, view, fast=readings is None))


def _board_in_the_way(state: SessionState, image: np.ndarray) -> str:
    """The reason why a picture (H, W) uint8 cannot be of the antenna: the jig's board is in it; "" otherwise."""
    if (
        state.store.folder("plane") != "plane"
        or len(detect_corners(image, state.board, "").ids) < QualitySettings.least_corners
    ):
        return ""
    return "the board is still in the picture; take it and its jig away"


def _check_antenna(step: str, state: SessionState, picture: Picture, readings: Readings | None) -> PictureCheck:
    """Check of a picture of the antenna; without readings, whether to ask for them."""
    height, width = picture.image.shape
    changed = _other_size(state, (width, height))
    if changed is not None:
        return PictureCheck(str(changed), hints=(changed,))
    if not readings:
        return PictureCheck(_board_in_the_way(state, picture.image))
    path = Path(picture.name)
    frame, image = still_of(step, path, readings), read_picture(path, picture.data)
    try:
        seen = state.observe(frame, step, image)
    except InputError as error:
        if not state.taken(step) and (other := entries_that_show_it(state, frame, step, image)):
            return PictureCheck(
                f"the antenna is not where the jig's answers put it, but where {other} puts it: type that"
            )
        jig = "" if state.taken(step) else "; or the answers about the jig are wrong, so that it is sought elsewhere"
        return PictureCheck(f"{error.what}; shoot it again with the antenna lit and wholly in view{jig}")
    return PictureCheck("", seen.points_px, words=f"antenna seen at {len(seen.points_px)} points")


_ENOUGH = "enough, more will not help"


def _board_progress(state: SessionState) -> Progress:
    scale = state.scale
    seen = f"board {board_id(state.nominal_board)}: {size_words(state.board)}"
    if scale is None:
        return Progress((seen,), ("two readings of the print",))
    number = _Number("scale of the print", f"{100 * scale.scale:.2f} ± {100 * scale.std:.2f} %")
    return Progress((seen, scale.words), next=scale.remedy, enough=True, usable=True, numbers=(number,))


@dataclass(frozen=True)
class _StepSettings:
    """When a step has enough pictures."""

    least_views: int = 3  # of the board, to solve for a lens
    trusted_views: int = 6  # of the board, to trust it
    least_free: int = 2  # of the free antenna
    enough_free: int = 5
    least_loads: int = 2
    stiffness_std: float = 0.01  # relative standard deviation of EI that suffices


_LIMITS = _StepSettings()


def _check_lens(state: SessionState, picture: Picture, readings: Readings | None) -> PictureCheck:
    view, check = _check_board(state, picture, readings is None)
    if check.refusal:
        return check
    views = state.views("lens")
    if readings is None and same_pose(view, views[-1:], state.board) is not None:
        check = replace(check, refusal=f"taken as {views[-1].name}: now another pose")
    elif (again := same_pose(view, views, state.board)) is not None:
        check = replace(check, refusal=str(again), hints=(*check.hints, again))
    # how near it is to the pose suggested: where one was, for folders that nobody watches need none
    now: ViewProgress | None = state.known("guidance", _guidance_inputs(state))
    if now is None or now.suggestion is None:
        return check
    camera = None if now.solution is None else now.solution.camera
    close, closer = pose_match(now.suggestion, view, state.board, camera)
    return replace(check, closeness=close, closer=closer)


def _guidance(state: SessionState) -> ViewProgress:
    """Uncertainty of points on plane C from the pictures so far, and the board pose that would reduce it most."""
    _, size = inputs = _guidance_inputs(state)

    def made() -> ViewProgress:
        try:
            solution = state.lens()
        except VbaaError:
            solution = None
        return lens_progress(state.views("lens"), state.board, state.work_plane(), GuideSettings.goal_m, size, solution)

    return state.cached("guidance", inputs, made)


def _guidance_inputs(state: SessionState) -> tuple[Hashable, tuple[int, int]]:
    """What the guidance depends on, and the size of the pictures to come."""
    return state.inputs("lens", "plane"), state.live_size or (1280, 720)


def _lens_progress(state: SessionState) -> Progress:
    views = state.views("lens")
    if state.given_lens is not None:
        known = state.lens()
        return Progress((known.words,), next=_ENOUGH, enough=True, usable=True, diagnoses=known.verdict.findings)
    seen = [f"{_counted(len(views), 'picture')}, {sum(len(view.ids) for view in views)} corners"]
    try:
        now = _guidance(state)
    except VbaaError as error:
        return Progress(tuple(seen), (str(error),), "show the board in another pose")
    target, missing = None, now.words
    if now.suggestion is not None and not now.enough:
        target = now.suggestion
    if now.solution is not None:
        seen.append(f"lens {now.solution.model}, rms {now.solution.rms_px:.2f} px")
        seen += [f"{one.name} is left out: {one.reason}" for one in now.solution.dropped]
    verdict = now.solution.verdict.findings if now.solution is not None else ()
    if len(views) < _LIMITS.least_views:
        missing = f"{_counted(_LIMITS.least_views - len(views), 'more picture')}, then there is a first lens"
    # a lens of few pictures agrees with them by its freedom
    means = now.solution is not None and np.isfinite(now.std_m) and len(views) >= _LIMITS.trusted_views
    reached, goal = bool(now.std_m <= GuideSettings.goal_m), f"{1e3 * GuideSettings.goal_m:.2f} mm"
    std = _Number("error that the lens adds where the antenna moves", f"{1e3 * now.std_m:.3f} mm", goal, reached)
    return Progress(
        seen=tuple(seen),
        missing=() if now.enough else (missing,),
        next=_ENOUGH if now.enough else (target.words if target else ""),
        enough=now.enough,
        usable=now.solution is not None,
        numbers=(std,) if means else (),
        target=target,
        # until there is enough, the next pose is the remedy of most; two kinds of advice would contradict each other
        diagnoses=tuple(one for one in verdict if one.grave or now.enough or not target),
    )


def _plane_progress(state: SessionState) -> Progress:
    way, count = state.store.folder("plane"), len(state.taken("plane"))
    # Way to plane C → fewest pictures, enough pictures (0: judged from the pictures), and what to shoot.
    ways = {
        "plane": (1, 0, "the board in the jig, the jig fixed to the antenna's base"),
        "sweep": (5, 10, "the board fixed in the world; turn pan and tilt to another place, let them rest, read them"),
        "over": (1, 3, "the board flat under the free antenna, at rest"),
    }
    least, most, shoot = ways[way]
    seen = _counted(count, "picture")
    if count < least:
        return Progress((seen,), (f"{least - count} more at least",), shoot)
    try:
        plane = state.plane()
    except VbaaError as error:
        return Progress((seen,), (str(error),), shoot)
    estimate, lens = plane.estimates[0], state.lens()
    covariance = estimate.covariance
    if lens.camera.covariance is not None:
        covariance = covariance + estimate.lens_sensitivity @ lens.camera.covariance @ estimate.lens_sensitivity.T
    std = np.sqrt(np.diag(covariance))
    numbers = [
        _Number("camera's position, with the jig's own uncertainty", f"± {1e3 * std[3:].max():.2f} mm"),
        _Number("camera's angles, the same", f"± {1e3 * std[:3].max():.2f} mrad"),
    ]
    if way == "plane":
        now = plane_progress(state.views("plane"), lens.board_shape, lens.camera, state.work_plane())
        enough, missing = now.enough, now.words
        if now.std_m >= 0:
            numbers.insert(0, _Number("plane C by lens and jig's pictures", f"± {1e3 * now.std_m:.3f} mm"))
    else:
        enough, missing = count >= most, f"{most - count} more would average out noise and show a board that moves"
    x, y, z = 1e3 * estimate.T_antenna_camera.translation_m
    distance, doubts = camera_place(state, estimate.T_antenna_camera)
    return Progress(
        seen=(seen, f"camera at ({x:.1f}, {y:.1f}, {z:.1f}) mm in the antenna frame", distance),
        missing=() if enough else (missing,),
        next=_ENOUGH if enough else shoot,
        enough=enough,
        usable=True,
        numbers=tuple(numbers),
        diagnoses=tuple(doubts),
    )


def _free_progress(state: SessionState) -> Progress:
    taken = state.taken("noload")
    missing, diagnoses, solved = list[str](), list[Diagnosis](), False
    if len(taken) < _LIMITS.enough_free:
        missing.append(_counted(_LIMITS.enough_free - len(taken), "more picture"))
    if taken and np.ptp([np.degrees(one.readings["tilt_rad"]) for one in taken]) < 20.0:
        gain = " and the moment sensor's gain" * state.session.with_sensor
        missing.append(f"another tilt: how the antenna sags under its weight shows gravity{gain}")
    try:
        diagnoses = antenna_diagnoses(state, together=False)
        if len(taken) >= _LIMITS.least_free:
            diagnoses, solved = antenna_diagnoses(state), True
    except VbaaError as error:
        missing.append(str(error))
    pan, tilt = free_pose_deg(len(taken))
    return Progress(
        seen=(f"{_counted(len(taken), 'picture')} of the free antenna",),
        missing=tuple(missing),
        next=f"free antenna at pan {pan:g}°, tilt {tilt:g}°, at rest" if missing else _ENOUGH,
        enough=not missing,
        usable=solved,
        diagnoses=tuple(diagnoses),
    )


def _loads_progress(state: SessionState) -> Progress:
    taken = state.taken("loads")
    seen = (_counted(len(taken), "load"),)
    masses = [1e-3 * float(mass) for mass in state.store.journal.answers["weights_g"]]
    try:
        now = load_progress(state.joint(), state.session, masses, state.plane().kinematics, _LIMITS.stiffness_std)
    except VbaaError as error:
        then = "correct what is said above; `back` leads to it" if taken else "hang a weight on the antenna"
        return Progress(seen, (str(error),), then)
    enough = now.enough and len(taken) >= _LIMITS.least_loads
    value, goal = f"{100 * now.now['total']:.2f} %", f"{100 * _LIMITS.stiffness_std:.0f} %"
    std = _Number("stiffness EI, one standard deviation", value, goal, now.reached)
    return Progress(
        seen=seen,
        missing=(*(() if enough or now.reached else (now.words,)), *now.missing),
        next=_ENOUGH if enough else now.suggestion[2] if now.suggestion else "",
        enough=enough,
        usable=len(taken) >= _LIMITS.least_loads,
        numbers=(std,) if taken else (),
        diagnoses=tuple(antenna_diagnoses(state)) if taken else (),
    )


def _sensor_progress(state: SessionState) -> Progress:
    if not state.session.columns:
        return Progress(("there is none: vision alone",), (), "", enough=True, usable=True)
    joint = state.joint()
    diagnoses = [one for one in state.static_frame_diagnoses() if "sensor" in one.name or "moment" in one.name]
    remedy = diagnoses[0].remedy if diagnoses else ""
    if (several := joint.sensor) is not None:
        turn_std = 1e3 * np.sqrt(np.diag(several.own_covariance)[:3]).max()
        numbers = tuple(
            _Number(name, f"gain {gain:.3f}, zero {zero:.3g}")
            for name, gain, zero in zip(several.components, several.gain, several.offset, strict=True)
        )
        seen = f"its axes are known to {turn_std:.2g} mrad"
        return Progress((seen,), (), remedy, enough=True, usable=True, numbers=numbers, diagnoses=tuple(diagnoses))
    gain, offset = joint.sensor_gain_offset
    std = np.sqrt(np.diag(joint.covariance))[[GAIN, OFFSET]]
    scatter = float(np.sqrt(np.mean(joint.moment_residuals_Nm**2)))
    numbers = (
        _Number("gain", f"{gain:.4f} ± {std[0]:.4f}"),
        _Number("zero", f"{1e3 * offset:.3f} ± {1e3 * std[1]:.3f} mN·m"),
    )
    seen = f"{len(joint.moment_residuals_Nm)} readings, {1e3 * scatter:.3g} mN·m off the model (rms)"
    return Progress((seen,), (), remedy, enough=True, usable=True, numbers=numbers, diagnoses=tuple(diagnoses))


RIG, REPORT = "rig.json", "check.html"
Report = Callable[[dict[str, Any]], str]
"""From check.json's content to its page: what draws stands above the wizard."""
Advise = Callable[[Calibration], Mapping[str, Any]]
"""From a calibration to what to observe next: what forecasts contacts stands above the wizard, too."""


def conclude(
    root: Path, report: Report, known_lens: GivenLens | None = None, advise: Advise | None = None
) -> dict[str, Any]:
    """Calibrate the session and write rig.json and check.html into it. Returns check.json's content.

    rig.json does not depend on how the wizard was called. Raises InputError and SolveError as `calibrate` does.
    """
    calibration = calibrate(load_session(root), given=known_lens)
    guide = {} if advise is None else advise(calibration)
    write_json(root / RIG, rig_document(calibration, ["vbaa", "wizard"], guide), readable_as=Rig.from_dict)
    document = assess(root / RIG, root).to_dict()
    write_text(root / REPORT, report(document))
    return document


def _verdict_progress(state: SessionState) -> Progress:
    counts = [f"{len(state.taken(step))} {words}" for step, words in PICTURES.items()]
    return Progress(seen=(f"pictures: {', '.join(counts)}",), next="everything is solved together; this takes a minute")


_PROGRESS = {
    "board": _board_progress,
    "lens": _lens_progress,
    "plane": _plane_progress,
    "noload": _free_progress,
    "loads": _loads_progress,
    "sensor": _sensor_progress,
    "verdict": _verdict_progress,
}


def _open_while_wrong(progress: Callable[[SessionState], Progress], state: SessionState) -> Progress:
    """A step's progress, kept open while a diagnosis is wrong that more pictures do not mend; its remedy is then the
    next thing to do."""
    now = progress(state)
    wrong = next((one for one in now.diagnoses if one.grave), None)
    if wrong is None or now.target is not None:
        return now
    rows = re.findall(r"row (\d+)", wrong.words) if wrong.name.startswith("load_") else []
    row = f"; type `loads_{rows[0]} = …` with the whole line to correct it" if rows else ""
    return replace(now, enough=False, next=f"{wrong.remedy}{row}; or type enough, and it stays as it is")


_CHECK: dict[str, Callable[[SessionState, Picture, Readings | None], PictureCheck]] = {
    "lens": _check_lens,
    "plane": _check_plane,
    "noload": partial(_check_antenna, "noload"),
    "loads": partial(_check_antenna, "loads"),
}
_WORDS = yaml.safe_load(Path(__file__).with_name("steps.yaml").read_text(encoding="utf-8"))
STEP_BY_NAME = {
    name: Step(name, **_WORDS[name], progress=partial(_open_while_wrong, progress), check=_CHECK.get(name))
    for name, progress in _PROGRESS.items()
}
