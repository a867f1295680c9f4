"""What follows from what the wizard has: worked out when it is asked for, and again only when its causes change."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Any, TypeVar

import numpy as np

from targets.board import BoardSpec
from targets.print_scale import PrintScale, rescaled
from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment, adjust_bundle
from vbaa_calib.calibrate.antenna.inputs import Observation
from vbaa_calib.calibrate.antenna.session_rig import ExpectedAntenna, nominal_parameters
from vbaa_calib.calibrate.faults.stills import still_diagnoses
from vbaa_calib.calibrate.guide.view_uncertainty import WorkPlane
from vbaa_calib.calibrate.lens.intrinsics import LensSolution, solve_intrinsics
from vbaa_calib.calibrate.pipeline import stills_prior
from vbaa_calib.calibrate.plane_c import PlaneC, PlaneViews, find_plane
from vbaa_calib.calibrate.pose.fusion import fused
from vbaa_calib.calibrate.report import prior_doubts
from vbaa_calib.core.errors import Diagnosis, InputError, VbaaError
from vbaa_calib.core.images import read_gray, read_picture
from vbaa_calib.detect.board.board_file import load_board
from vbaa_calib.detect.board.corners import BoardView, detect_corners
from vbaa_calib.detect.whisker.paint import Paint
from vbaa_calib.geometry import Kinematics
from vbaa_calib.session import Load, Session, Still, gravity_antenna

from .journal import Taken
from .session_file import scale_of, session_of, square_scale_of, write_session, write_table
from .store import Store

Result = TypeVar("Result")
BOARD = "board.yaml"


class Known:
    """A store, and what follows from it. Methods raise what the work beneath raises: InputError, SolveError.

    live_size : (width, height) px of the pictures that come in, where some did.
    """

    def __init__(self, store: Store) -> None:
        self.store = store
        self._kept: dict[Hashable, tuple[Hashable, Any]] = {}
        self.live_size: tuple[int, int] | None = None

    def once(self, name: Hashable, cause: Hashable, make: Callable[[], Result]) -> Result:
        """What was made of the same cause before, a failure too; or made now."""
        if name not in self._kept or self._kept[name][0] != cause:
            try:
                self._kept[name] = cause, make()
            except VbaaError as error:
                self._kept[name] = cause, error
        found = self._kept[name][1]
        if isinstance(found, VbaaError):
            raise found
        return found

    @property
    def nominal_board(self) -> BoardSpec:
        """The board as it was meant."""
        path = self.store.root / BOARD
        stamp = path.stat().st_mtime_ns if path.exists() else 0
        return self.once("nominal board", stamp, lambda: load_board(path))

    @property
    def scale(self) -> PrintScale | None:
        """The print's scale by the two readings; None before they were given."""
        return scale_of(self.store.journal.answers)

    @property
    def board(self) -> BoardSpec:
        """The board as it was printed."""
        scale = square_scale_of(self.store.journal.answers)
        return self.nominal_board if scale is None else rescaled(self.nominal_board, scale)

    @property
    def scale_std(self) -> float:
        """Of the print's scale, relative; 0 where the board came with the session, as it says."""
        given = "board_given" in self.store.journal.answers
        return 0.0 if self.scale is None or given else self.scale.std / self.scale.scale

    @property
    def session(self) -> Session:
        """session.yaml, as far as it is answered."""
        return session_of(self.store, self.board, self.scale_std)

    def taken(self, step: str) -> tuple[Taken, ...]:
        """The pictures of a step."""
        return self.store.journal.of(step).taken

    def view(self, taken: Taken) -> BoardView:
        """The board in a picture."""
        path, spec = self.store.path(taken), self.board
        cause = taken.sha256, spec.to_dict().__repr__()
        return self.once(("view", taken.file), cause, lambda: detect_corners(read_gray(path), spec, path.name))

    def views(self, step: str) -> list[BoardView]:
        """The board in all pictures of a step."""
        return [self.view(taken) for taken in self.taken(step)]

    def cause(self, *steps: str) -> Hashable:
        """What changes when an answer or a picture of these steps does."""
        journal = self.store.journal
        answers = tuple(sorted((key, repr(value)) for key, value in journal.answers.items()))
        return answers, tuple((step, tuple(one.sha256 for one in journal.of(step).taken)) for step in steps)

    def still_diagnoses(self) -> list[Diagnosis]:
        """What is wrong, or looks wrong, with the pictures of the antenna and what was typed with them."""
        cause = self.cause("lens", "plane", "noload", "loads")
        joint = self.joint()
        return self.once("diagnoses", cause, lambda: [*_against_plane(joint), *self._still_diagnoses(joint)])

    def _still_diagnoses(self, joint: BundleAdjustment) -> list[Diagnosis]:
        return still_diagnoses(self.session, self.kinematics, joint)

    def lens_corners(self) -> np.ndarray:
        """(N, 2) px of all corners of the lens' pictures."""
        return np.concatenate([np.zeros((0, 2)), *(view.corners_px for view in self.views("lens"))])

    def lens(self) -> LensSolution:
        """The lens by its pictures."""
        return self.once("lens", self.cause("lens"), lambda: solve_intrinsics(self.views("lens"), self.board))

    @property
    def image_size(self) -> tuple[int, int] | None:
        """(width, height) of the first picture that was taken."""
        for step in ("lens", "plane"):
            for taken in self.taken(step)[:1]:
                return self.view(taken).image_size
        return None

    def work_plane(self) -> WorkPlane:
        """Where the antenna will move, seen from the camera: by the jig where it was seen, else as the user says."""
        session = self.session
        about = self.store.journal.answers
        try:
            T_camera_antenna = self.plane().estimates[0].T_antenna_camera.inverse() if self.taken("plane") else None
        except VbaaError:
            T_camera_antenna = None
        if T_camera_antenna is not None:
            return WorkPlane(T_camera_antenna, session.antenna.length_m, 0.25 * session.antenna.length_m)
        return WorkPlane.about(
            1e-3 * float(about.get("camera_distance_mm", 400.0)),
            float(np.radians(about.get("camera_inclination_deg", 0.0))),
            session.antenna.length_m,
        )

    def plane(self) -> PlaneC:
        """The camera's pose on the antenna's base by the way that was chosen."""
        return self.once("plane", self.cause("lens", "plane"), self._plane)

    def _plane(self) -> PlaneC:
        way, lens = self.store.folder("plane"), self.lens()
        if not self.taken("plane"):
            raise InputError("no picture yet", where=self.store.root / way, remedy="take one")
        views = None if way == "over" else self.views("plane")
        over = {one.file: read_gray(self.store.path(one)) for one in self.taken("plane")} if way == "over" else None
        if way == "sweep":
            write_table(self.store.root / "sweep" / "sweep.csv", "sweep", self.taken("plane"))
        seen = PlaneViews(views if way == "plane" else None, views if way == "sweep" else None, over)
        return find_plane(self.session, lens.camera, lens.board_flex, seen)

    @property
    def kinematics(self) -> Kinematics:
        """The session's, with what a sweep found of the joints."""
        return self.plane().kinematics

    def still(self, step: str, taken: Taken) -> Still:
        """A picture of the antenna with its readings."""
        return still_of(step, self.store.path(taken), taken.readings)

    def observation(self, step: str, taken: Taken) -> Observation:
        """What is seen of the antenna in a picture."""
        cause = taken.sha256, tuple(taken.readings.items()), self.cause("lens", "plane")
        path = self.store.path(taken)
        return self.once(
            ("seen", taken.file), cause, lambda: self.observe(self.still(step, taken), step, read_picture(path))
        )

    def observe(self, still: Still, step: str, image: np.ndarray) -> Observation:
        """The antenna in a still that need not be taken yet; its picture as `read_picture` gives it."""
        session, plane, camera = self.session, self.plane(), self.lens().camera
        nominal = nominal_parameters(session.antenna)
        pull = gravity_antenna(plane.kinematics, session.gravity_world_m_s2, [still])[0]
        expected = ExpectedAntenna(session.antenna, camera, fused(plane.estimates), nominal, self._paint(step))
        return expected.observe(still, image, pull)

    def _paint(self, step: str) -> Paint | None:
        """What tells the antenna from its background, by the first free picture."""
        first = self.taken("noload")[:1]
        if step == "noload" or not first:
            return None
        return self.observation("noload", first[0]).paint

    def joint(self) -> BundleAdjustment:
        """Everything in one solve, by the stills so far."""
        return self.once("joint", self.cause("lens", "plane", "noload", "loads"), self._joint)

    def _joint(self) -> BundleAdjustment:
        session, plane = self.session, self.plane()
        before = stills_prior(session, self.lens(), plane)
        seen = [self.observation(step, one) for step in ("noload", "loads") for one in self.taken(step)]
        if not seen:
            raise InputError("no picture of the antenna yet", where=self.store.root, remedy="take one")
        return adjust_bundle(seen, before, session.antenna.length_m, session.moment_std_Nm)

    def write_files(self) -> None:
        """Bring session.yaml and the tables up to what the store has."""
        write_session(self.store, self.board, self.scale_std)

    def stills(self) -> list[Still]:
        """All pictures of the antenna, in the order of the joint solve."""
        return [self.still(step, one) for step in ("noload", "loads") for one in self.taken(step)]


def _against_plane(joint: BundleAdjustment) -> list[Diagnosis]:
    """Where the antenna contradicts what plane C and its clamp were before it was seen."""
    remedy = "check what was said of the jig (place, axes, turn, how well it is known) and the clamp"
    return [Diagnosis("antenna_contradicts_plane", words, remedy, grave=True) for words in prior_doubts(joint)]


def still_of(step: str, path: Any, readings: Any) -> Still:
    """A still with its readings, a load where the step is that."""
    common = {name: readings[name] for name in ("pan_rad", "tilt_rad", "moment_Nm")}
    if step == "loads":
        load = {name: readings[name] for name in ("distance_m", "force_y_N", "force_z_N")}
        return Load(path, **common, **load, time_s=readings.get("time_s"))
    return Still(path, **common, time_s=readings.get("time_s"))
