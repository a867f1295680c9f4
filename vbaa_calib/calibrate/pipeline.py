"""A session to a rig: lens, plane C by every method at hand, then bundle adjustment of everything.

Each stage is a function of what came before, and can be called by itself: `solve_intrinsics`, `find_plane`,
`stills_prior`, `observe_stills`, `solve_antenna`, `make_rig`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment
from vbaa_calib.calibrate.antenna.inputs import Prior
from vbaa_calib.calibrate.antenna.residual_checks import Checks, check
from vbaa_calib.calibrate.antenna.session_rig import make_rig, observe_stills, prior, solve_antenna
from vbaa_calib.calibrate.faults.stills import still_diagnoses, with_cause
from vbaa_calib.calibrate.faults.views import judge_views
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
    stills : no-load frames and loads, in the order of bundle adjustment.
    still_diagnoses : what the stills show to be wrong; what the lens' pictures do is in the lens' verdict.
    """

    session: Session
    rig: Rig
    lens: LensSolution
    plane: PlaneC
    joint: BundleAdjustment
    checks: Checks
    stills: Sequence[Still]
    still_diagnoses: Sequence[Diagnosis]


def stills_prior(session: Session, lens: LensSolution, plane: PlaneC) -> Prior:
    """What lens and plane C say before the stills are solved."""
    line_px = session.possible_drift.line_px
    return prior(session.antenna, lens.camera, plane.estimates, plane.by_antenna_alone, session.load_readings, line_px)


def calibrate(session: Session, lens_model: str = "auto") -> Calibration:
    """A session to a rig. Everything that can be wrong with the inputs is checked before the long work.

    Raises
    ------
    InputError : whatever is wrong with the session, and estimates of plane C that contradict each other.
    SolveError : a solver that did not arrive, with the likely cause; an InputError where a typed row is that.
    """
    stills = [*read_noload(session), *read_loads(session)]
    photos = [path for name in ("intrinsics", *picture_folders(session)) for path in list_images(session.root / name)]
    height, width = read_gray(photos[0]).shape
    pictures = [*photos, *(still.image for still in stills if still.image is not None)]
    check_pictures(pictures, (width, height), f"{photos[0].name} is")
    # plane C first: one picture shows whether the board is the one described
    views = read_views(session)
    lens_views = detect_folder(session.root / "intrinsics", session.board)
    lens = judge_views(lens_views, solve_intrinsics(lens_views, session.board, lens_model), session.board)
    plane = find_plane(session, lens.camera, lens.board_flex, views)
    before = stills_prior(session, lens, plane)
    observations = observe_stills(session, plane.kinematics, before)
    try:
        joint = solve_antenna(session, observations, before)
    except SolveError as error:
        raise with_cause(session, plane.kinematics, observations, before, error) from error
    held = still_diagnoses(session, plane.kinematics, joint)
    rig = make_rig(session, plane.kinematics, joint, observations)
    return Calibration(session, rig, lens, plane, joint, check(joint), stills, tuple(held))
