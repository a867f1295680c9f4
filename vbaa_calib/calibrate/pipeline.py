"""A session to a rig: lens, plane C by every method at hand, then bundle adjustment of everything.

Each stage is a function of what came before, and can be called by itself: `solve_lens`, `find_plane`,
`stills_prior`, `observe_stills`, `solve_antenna`, `make_rig`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment
from vbaa_calib.calibrate.antenna.inputs import Prior
from vbaa_calib.calibrate.antenna.residual_checks import Checks, check
from vbaa_calib.calibrate.antenna.session_rig import make_rig, observe_stills, prior, solve_antenna
from vbaa_calib.calibrate.faults.stills import still_diagnoses, with_cause
from vbaa_calib.calibrate.lens.intrinsics import LensSolution
from vbaa_calib.calibrate.lens_from_views import solve_lens
from vbaa_calib.core.arrays import gate
from vbaa_calib.core.errors import Diagnosis, InputError, SolveError
from vbaa_calib.core.images import SUFFIXES, list_images, picture_size
from vbaa_calib.detect.board.corners import detect_folder
from vbaa_calib.rig import Rig, RigVerdict
from vbaa_calib.session import Session, Still, check_pictures, read_loads, read_noload

from .doubts import doubts
from .given_lens import GivenLens, given_solution
from .plane_c import PlaneC, find_plane, picture_folders, read_views


@dataclass(frozen=True, eq=False)
class Calibration:
    """A rig and how it was found.

    Attributes
    ----------
    stills : no-load frames and loads, in the order of bundle adjustment.
    given : the lens that the calibration started from, where it was not solved from intrinsics/.
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
    given: GivenLens | None = None


def stills_prior(session: Session, lens: LensSolution, plane: PlaneC) -> Prior:
    """What lens and plane C say before the stills are solved."""
    line_px = session.possible_drift.line_px
    return prior(session.antenna, lens.camera, plane.estimates, plane.by_antenna_alone, session.load_readings, line_px)


def _lens_folder(session: Session, given: GivenLens | None) -> list[str]:
    """The folder of the lens' pictures; none where a lens is given and there are no pictures to test it."""
    folder = session.root / "intrinsics"
    if given is not None and not (
        folder.is_dir() and any(path.suffix.lower() in SUFFIXES for path in folder.iterdir())
    ):
        return []
    if not folder.exists():
        remedy = "take pictures of the board, or start from a lens that is known: --camera FILE"
        raise InputError("no such folder", where=folder, remedy=remedy)
    return [folder.name]


@gate
def calibrate(session: Session, lens_model: str = "auto", given: GivenLens | None = None) -> Calibration:
    """A session to a rig. Everything that can be wrong with the inputs is checked before the long work.

    given : the lens to start from; pictures in intrinsics/ test it then, and are not needed.

    Raises
    ------
    InputError : whatever is wrong with the session, and estimates of plane C that contradict each other.
    SolveError : a solver that did not arrive, with the likely cause; an InputError where a typed row is that.
    """
    stills = [*read_noload(session), *read_loads(session)]
    folders = [*_lens_folder(session, given), *picture_folders(session)]
    photos = [path for name in folders for path in list_images(session.root / name)]
    pictures = [*photos, *(still.image for still in stills if still.image is not None)]
    size, whose = (
        (picture_size(photos[0]), f"{photos[0].name} is") if given is None else (given.camera.image_size, given.whose)
    )
    check_pictures(pictures, size, whose)
    # plane C first: one picture shows whether the board is the one described
    views = read_views(session)
    lens_views = detect_folder(session.root / "intrinsics", session.board) if folders[0] == "intrinsics" else []
    if given is None:
        lens = solve_lens(lens_views, session.board, lens_model)
    else:
        placed = [("plane", view) for view in views.jig or ()] + [("sweep", view) for view in views.sweep or ()]
        lens = given_solution(given, lens_views, session.board, placed)
    plane = find_plane(session, lens.camera, lens.board_shape, views)
    before = stills_prior(session, lens, plane)
    observations = observe_stills(session, plane.kinematics, before)
    try:
        joint = solve_antenna(session, observations, before)
    except SolveError as error:
        raise with_cause(session, plane.kinematics, observations, before, error) from error
    held = still_diagnoses(session, plane.kinematics, joint)
    rig = make_rig(session, plane.kinematics, joint, observations)
    made = Calibration(session, rig, lens, plane, joint, check(joint), stills, tuple(held), given)
    return replace(made, rig=replace(rig, verdict=RigVerdict.of(doubts(made))))
