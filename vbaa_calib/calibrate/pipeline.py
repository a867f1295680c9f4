"""A session to a rig, start to end: lens, plane C by every way at hand, then everything in one solve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from vbaa_calib.calibrate.antenna.bundle_adjustment import JointSolution
from vbaa_calib.calibrate.antenna.residual_checks import Checks, check
from vbaa_calib.calibrate.antenna.session_rig import make_rig, prior, solve_antenna
from vbaa_calib.calibrate.faults.stills import still_diagnoses, with_cause
from vbaa_calib.calibrate.faults.views import view_set_diagnoses
from vbaa_calib.calibrate.lens.intrinsics import LensSolution, solve_intrinsics
from vbaa_calib.core.errors import Diagnosis, SolveError
from vbaa_calib.core.images import list_images, read_gray
from vbaa_calib.detect.board.corners import detect_folder
from vbaa_calib.rig import Rig
from vbaa_calib.session import Session, Still, check_pictures, read_loads, read_noload

from .plane_c import PlaneC, find_plane, picture_folders, read_views


@dataclass(frozen=True, eq=False)
class Calibration:
    """A rig and how it was found.

    Attributes
    ----------
    stills : no-load frames and loads, in the order of the joint solve.
    lens_diagnoses : what the lens' pictures, taken together, show to be wrong. still_diagnoses : what the stills do.
    """

    session: Session
    rig: Rig
    lens: LensSolution
    plane: PlaneC
    joint: JointSolution
    checks: Checks
    stills: Sequence[Still]
    lens_diagnoses: Sequence[Diagnosis]
    still_diagnoses: Sequence[Diagnosis]


def calibrate(session: Session, lens_model: str = "auto") -> Calibration:
    """A session to a rig. Everything that can be wrong with the inputs is checked before the long work.

    Raises
    ------
    InputError : whatever is wrong with the session, and ways to plane C that contradict each other.
    SolveError : a solver that did not arrive, with the likely cause; an InputError where a typed row is that.
    """
    stills = [*read_noload(session), *read_loads(session)]
    _require_one_size(session, stills)
    # plane C first: one picture tells whether the board is the one described
    views = read_views(session)
    pictures = detect_folder(session.root / "intrinsics", session.board)
    lens = solve_intrinsics(pictures, session.board, lens_model)
    doubted = view_set_diagnoses(pictures, lens, session.board)
    plane = find_plane(session, lens.camera, lens.board_flex, views)
    before = prior(session.antenna, lens.camera, plane.estimates, plane.by_antenna_alone, session.load_readings)
    try:
        joint, observations = solve_antenna(session, plane.kinematics, before)
    except SolveError as error:
        raise with_cause(session, plane.kinematics, before, error) from error
    held = still_diagnoses(session, plane.kinematics, joint)
    rig = make_rig(session, plane.kinematics, joint, observations)
    return Calibration(session, rig, lens, plane, joint, check(joint), stills, tuple(doubted), tuple(held))


def _require_one_size(session: Session, stills: Sequence[Still]) -> None:
    photos = [path for name in ("intrinsics", *picture_folders(session)) for path in list_images(session.root / name)]
    height, width = read_gray(photos[0]).shape
    pictures = [*photos, *(still.image for still in stills if still.image is not None)]
    check_pictures(pictures, (width, height), f"{photos[0].name} is")
