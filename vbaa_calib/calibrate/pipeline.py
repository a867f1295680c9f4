"""A session to a rig: lens, plane C by every method at hand, then bundle adjustment of everything.

Each stage is a function of what came before, and can be called by itself: `solve_lens`, `find_plane`,
`prior_of_session`, `observe_stills`, `solve_antenna`, `make_rig`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np

from targets.board import Board
from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment
from vbaa_calib.calibrate.antenna.inputs import Observation, Prior
from vbaa_calib.calibrate.antenna.residual_checks import check
from vbaa_calib.calibrate.antenna.session_rig import make_rig, observe_stills, prior, read_by, solve_antenna
from vbaa_calib.calibrate.lens.intrinsics import LensSolution
from vbaa_calib.calibrate.lens_from_views import solve_lens
from vbaa_calib.camera import Camera
from vbaa_calib.core.arrays import validate_arguments
from vbaa_calib.core.errors import Diagnosis, InputError, SolveError, VbaaError, Verdict
from vbaa_calib.core.images import SUFFIXES, list_images, picture_size
from vbaa_calib.detect.board.corners import BoardView, detect_folder
from vbaa_calib.diagnose.jig import plane_contradicted
from vbaa_calib.diagnose.session import failure_causes, static_frame_diagnoses, with_cause
from vbaa_calib.rig import Rig
from vbaa_calib.session import Session, Still, check_pictures, read_loads, read_noload

from .doubts import doubts
from .given_lens import GivenLens, focus_changed, given_solution
from .plane_c import PlaneC, because, find_plane, is_slip, jig_causes, picture_folders, read_views


@dataclass(frozen=True, eq=False)
class Calibration:
    """A calibrated rig, with the evidence for it.

    Attributes
    ----------
    stills : static frames, without a load and with one, in the order of bundle adjustment.
    given : the initial lens, where it was not solved from intrinsics/.
    others : calibrations of further cameras, by name, each by itself; `rig` is of all cameras in one solve.
    static_frame_diagnoses : mistakes that the static frames reveal; those of the lens' pictures are in its verdict.
    """

    session: Session
    rig: Rig
    lens: LensSolution
    plane: PlaneC
    joint: BundleAdjustment
    checks: Mapping[str, Any]
    stills: Sequence[Still]
    static_frame_diagnoses: Sequence[Diagnosis]
    given: GivenLens | None = None
    others: Mapping[str, Calibration] = field(default_factory=dict)

    @staticmethod
    def together(each: Mapping[str, Calibration]) -> Calibration:
        """The calibration of several cameras: the first one's, with the rig of all of them from one solve. each :
        separate calibrations by camera name, with the same antenna, joints and sensors.

        Raises
        ------
        InputError : they are of different antennas.
        SolveError : the solve does not converge.
        """
        (first, made), *rest = each.items()
        findings = list(made.rig.verdict.findings)
        for name, one in rest:
            findings += [replace(finding, words=f"{name}: {finding.words}") for finding in one.rig.verdict.findings]
        joint = BundleAdjustment.together({name: one.joint for name, one in each.items()})
        rigs = {
            name: replace(make_rig(made.session, made.plane.kinematics, one, one.noted), image=each[name].rig.image)
            for name, one in joint.items()
        }
        main = replace(rigs.pop(first), camera_name=first, others=rigs, verdict=Verdict.of(findings))
        return replace(made, rig=main, others=dict(rest))


def prior_of_session(session: Session, lens: LensSolution, plane: PlaneC) -> Prior:
    """The priors of bundle adjustment, from the results for lens and plane C."""
    readings, drift = session.load_readings, session.possible_drift
    before = prior(session.antenna, lens.camera, plane.estimates, plane.by_antenna_alone, readings, drift)
    return read_by(session.wrench_sensor, before)


_Solved = TypeVar("_Solved")


def next_lenses(lens: LensSolution, views: Sequence[BoardView], board: Board) -> Iterator[LensSolution]:
    """Solutions with the other compared lens models in order of expected error, each solved on demand. Models that
    fold, or with an expected error above 3 px, are left out."""
    errors_px = {one.model: one.expected_error_px or np.inf for one in lens.comparison if one.monotonic}
    for model in sorted(errors_px, key=errors_px.__getitem__):
        if model == lens.model or errors_px[model] > 3.0:
            continue
        try:
            again = solve_lens(views, board, model)
        except VbaaError:
            continue
        words = (
            f"camera, antenna and sensor have no common solution with the {lens.model} lens: {model} was taken, of "
            f"{errors_px[model]:.2g} px expected error"
        )
        remedy = "add views of the board over the whole picture, or choose another --lens-model"
        passed_over = Diagnosis("lens_passed_over", words, remedy)
        reasons = (f"The lens model {model} is the next by expected error.", *again.reasons[1:])
        yield replace(again, comparison=lens.comparison, reasons=reasons).with_diagnoses([passed_over])


def first_solved(
    lens: LensSolution,
    others: Callable[[], Iterable[LensSolution]],
    solve: Callable[[LensSolution], _Solved],
    causes: Callable[[], Sequence[Diagnosis]],
) -> _Solved:
    """Result of `solve` for a lens, or for the first of the other lenses with which it converges, unless a diagnosis
    explains the failure.

    causes : as `failure_causes` finds them; asked once, after the first failure.

    Raises SolveError, the first lens' one, with the likely cause or the lens models that were tried in vain; InputError
    where a typed row is the cause.
    """
    try:
        return solve(lens)
    except SolveError as error:
        failure = error
    found, tried = causes(), [lens.model]
    # rows that nothing explains may be the lens' fault, too
    if all(one.name == "load_row_unexplained" for one in found):
        for other in others():
            tried.append(other.model)
            with suppress(VbaaError):
                return solve(other)
    named = f"{failure} (lens models tried: {', '.join(tried)})" if len(tried) > 1 else str(failure)
    raise with_cause(SolveError(named), found) from failure


def _lens_folder(session: Session, given: GivenLens | None) -> list[str]:
    """The folder of the lens's pictures, in a list; empty where the lens is known and there are no pictures to test
    it."""
    folder = session.folder("intrinsics")
    if given is not None and not (
        folder.is_dir() and any(path.suffix.lower() in SUFFIXES for path in folder.iterdir())
    ):
        return []
    if not folder.exists():
        remedy = "take pictures of the board, or start from a lens that is known: --camera FILE"
        raise InputError("no such folder", where=folder, remedy=remedy)
    return ["intrinsics"]


def _every_camera(session: Session, lens_model: str, given: GivenLens | None) -> Calibration:
    """Calibrates each camera separately, to find errors in its pictures, then all in one solve. Raises as
    `calibrate`."""
    if given is not None:
        names = ", ".join(session.cameras)
        raise InputError("--camera is one lens", remedy=f"take pictures of the board with each: {names}")
    each: dict[str, Calibration] = {}
    for name in session.cameras:
        alone = replace(session.of_camera(name), cameras={name: session.cameras[name]})
        each[name] = calibrate(alone, lens_model)
    return replace(Calibration.together(each), session=session)


def _mistakes(
    session: Session, camera: Camera, plane: PlaneC, observations: Sequence[Observation], joint: BundleAdjustment
) -> list[Diagnosis]:
    """What is wrong with a session that has a common solution, the likeliest first."""
    contradicted = plane_contradicted(joint)
    if contradicted:
        # what the free antenna alone says of plane C, before what loads and readings seem to say with a wrong one
        free = [one for one in observations if not one.loaded]
        found = jig_causes(session, camera, plane, free)
        if is_slip(found, session, camera, plane, free):
            return found
    mistakes = static_frame_diagnoses(session, plane.kinematics, joint)
    # the antenna's length is one of the table's hypotheses, and what nothing explained may be the camera's
    rest = [one for one in mistakes if one.name not in ("antenna_length", "stills_contradict", "load_row_unexplained")]
    # where the pictures fit no antenna, diagnoses of loads and clamp may be due to a wrong plane C
    unexplained = any(one.name == "stills_contradict" for one in mistakes)
    if not contradicted or (any(one.grave for one in rest) and not unexplained):
        return mistakes
    found = jig_causes(session, camera, plane, observations)
    return [*found, *([] if unexplained else rest)] if found else mistakes


@validate_arguments
def calibrate(session: Session, lens_model: str = "auto", given: GivenLens | None = None) -> Calibration:
    """Calibrates a rig from a session. All inputs are checked before the long computation.

    given : the initial lens; pictures in intrinsics/ are optional then, and test it.

    Raises
    ------
    InputError : whatever is wrong with the session, and estimates of plane C that contradict each other.
    SolveError : a solver that did not converge, with the likely cause; InputError where the cause is a typed row.
    """
    if len(session.cameras) > 1:
        return _every_camera(session, lens_model, given)
    stills = [*read_noload(session), *read_loads(session)]
    folders = [*_lens_folder(session, given), *picture_folders(session)]
    photos = [path for name in folders for path in list_images(session.folder(name))]
    pictures = [*photos, *(still.image for still in stills if still.image is not None)]
    size, wanted_by = (
        (picture_size(photos[0]), f"{photos[0].name} is")
        if given is None
        else (given.camera.image_size, given.size_words)
    )
    part = "give --binning or --roi if they are a part of the lens's pictures, or take the lens of this resolution"
    check_pictures(pictures, size, wanted_by, *([] if given is None else [part]))
    # plane C first: one picture shows whether the board is the one described
    views = read_views(session)
    lens_views = detect_folder(session.folder("intrinsics"), session.board) if folders[0] == "intrinsics" else []
    placed = [(folder, view) for way, folder in (("jig", "plane"), ("sweep", "sweep")) for view in views.get(way, ())]
    if given is None:
        lens = solve_lens(lens_views, session.board, lens_model)
        words, remedy = "the lens of intrinsics/ is not that of", "take all pictures at one focus and zoom"
        refocused = focus_changed(lens.camera, placed, lens.board_shape, Diagnosis("refocused", words, remedy))
        lens = lens.with_diagnoses(one for one in refocused if one.grave)
    else:
        lens = given_solution(given, lens_views, session.board, placed)
    begun: list[tuple[PlaneC, Sequence[Observation], Prior]] = []

    def solve(lens: LensSolution) -> tuple[LensSolution, PlaneC, Sequence[Observation], BundleAdjustment]:
        plane = find_plane(session, lens.camera, lens.board_shape, **views)
        before = prior_of_session(session, lens, plane)
        try:
            observations = observe_stills(session, plane.kinematics, before)
        except InputError as error:
            raise because(error, jig_causes(session, lens.camera, plane), session) from None
        begun.append((plane, observations, before))
        return lens, plane, observations, solve_antenna(session, observations, before)

    def causes() -> Sequence[Diagnosis]:
        if not begun:
            return ()
        plane, observations, before = begun[0]
        # a pose that is wrong spoils all else
        free = [one for one in observations if not one.loaded]
        if found := jig_causes(session, lens.camera, plane) or jig_causes(session, lens.camera, plane, free):
            raise because(SolveError("camera, antenna and sensor have no common solution"), found, session)
        return failure_causes(session, plane.kinematics, observations, before)

    def others() -> Iterable[LensSolution]:
        free = given is None and lens_model == "auto"
        return next_lenses(lens, lens_views, session.board) if free else ()

    used, plane, observations, joint = first_solved(lens, others, solve, causes)
    mistakes = _mistakes(session, used.camera, plane, observations, joint)
    rig = make_rig(session, plane.kinematics, joint, observations)
    made = Calibration(session, rig, used, plane, joint, check(joint), stills, tuple(mistakes), given)
    return replace(made, rig=replace(rig, verdict=Verdict.of(doubts(made))))
