"""What follows from answers and pictures: worked out when it is asked for, and again only when its inputs change."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from pathlib import Path
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
from vbaa_calib.session import Load, Session, Still, gravity_antenna

from .journal import AcceptedPicture
from .session_file import scale_of, session_of, write_session, write_table
from .store import Store

_Result = TypeVar("_Result")
BOARD = "board.yaml"
_STILLS = ("noload", "loads")
_ALL = ("lens", "plane", *_STILLS)


class SessionState:
    """A store, and what follows from it. Methods raise what the calibration beneath raises: InputError, SolveError.

    live_size : (width, height) px of the live pictures, where there were some.
    """

    def __init__(self, store: Store) -> None:
        self.store = store
        self.live_size: tuple[int, int] | None = None
        self._cache: dict[Hashable, tuple[Hashable, Any]] = {}

    def cached(self, name: Hashable, inputs: Hashable, make: Callable[[], _Result]) -> _Result:
        """What was made of the same inputs before, a failure too; or made now."""
        if name not in self._cache or self._cache[name][0] != inputs:
            try:
                self._cache[name] = inputs, make()
            except VbaaError as error:
                self._cache[name] = inputs, error
        found = self._cache[name][1]
        if isinstance(found, VbaaError):
            raise found
        return found

    def inputs(self, *steps: str) -> Hashable:
        """What changes when an answer or a picture of these steps does."""
        journal = self.store.journal
        answers = tuple(sorted((key, repr(value)) for key, value in journal.answers.items()))
        return answers, tuple((step, tuple(one.sha256 for one in journal.of(step).taken)) for step in steps)

    @property
    def nominal_board(self) -> BoardSpec:
        """The board as it was meant."""
        path = self.store.root / BOARD
        stamp = path.stat().st_mtime_ns if path.exists() else 0
        return self.cached("nominal board", stamp, lambda: load_board(path))

    @property
    def scale(self) -> PrintScale | None:
        """The print's scale by the two readings; None before they were given."""
        return scale_of(self.store.journal.answers)

    @property
    def board(self) -> BoardSpec:
        """The board as it was printed."""
        scale = scale_of(self.store.journal.answers, require_square=True)
        return self.nominal_board if scale is None else rescaled(self.nominal_board, scale)

    @property
    def _scale_std(self) -> float:
        """Of the print's scale, relative; 0 where the board came with the session, as it says."""
        given = "board_given" in self.store.journal.answers
        return 0.0 if self.scale is None or given else self.scale.std / self.scale.scale

    @property
    def session(self) -> Session:
        """session.yaml, as far as it is answered."""
        return session_of(self.store, self.board, self._scale_std)

    def write_files(self) -> None:
        """Bring session.yaml and the tables up to date."""
        write_session(self.store, self.board, self._scale_std)

    def taken(self, step: str) -> tuple[AcceptedPicture, ...]:
        """The pictures of a step."""
        return self.store.journal.of(step).taken

    def _view(self, taken: AcceptedPicture) -> BoardView:
        path, spec = self.store.path(taken), self.board
        inputs = taken.sha256, repr(spec.to_dict())
        return self.cached(("view", taken.file), inputs, lambda: detect_corners(read_gray(path), spec, path.name))

    def views(self, step: str) -> list[BoardView]:
        """The board in all pictures of a step."""
        return [self._view(taken) for taken in self.taken(step)]

    def lens_corners(self) -> np.ndarray:
        """(N, 2) px of all corners of the lens' pictures."""
        return np.concatenate([np.zeros((0, 2)), *(view.corners_px for view in self.views("lens"))])

    @property
    def image_size(self) -> tuple[int, int] | None:
        """(width, height) of the first picture that was taken."""
        first = [*self.taken("lens")[:1], *self.taken("plane")[:1]]
        return self._view(first[0]).image_size if first else None

    def lens(self) -> LensSolution:
        """The lens by its pictures."""
        return self.cached("lens", self.inputs("lens"), lambda: solve_intrinsics(self.views("lens"), self.board))

    def plane(self) -> PlaneC:
        """The camera's pose on the antenna's base by the way that was chosen."""
        return self.cached("plane", self.inputs("lens", "plane"), self._solve_plane)

    def _solve_plane(self) -> PlaneC:
        way, lens, taken = self.store.folder("plane"), self.lens(), self.taken("plane")
        if not taken:
            raise InputError("no picture yet", where=self.store.root / way, remedy="take one")
        if way == "over":
            views = PlaneViews(None, None, {one.file: read_gray(self.store.path(one)) for one in taken})
        elif way == "sweep":
            write_table(self.store.root / "sweep" / "sweep.csv", "sweep", taken)
            views = PlaneViews(None, self.views("plane"), None)
        else:
            views = PlaneViews(self.views("plane"), None, None)
        return find_plane(self.session, lens.camera, lens.board_flex, views)

    def work_plane(self) -> WorkPlane:
        """Where the antenna will move, seen from the camera: by plane C where it was seen, else as the user says."""
        length_m, answers = self.session.antenna.length_m, self.store.journal.answers
        if self.taken("plane"):
            try:
                pose = self.plane().estimates[0].T_antenna_camera
                return WorkPlane(pose.inverse(), length_m, 0.25 * length_m)
            except VbaaError:
                pass
        distance_m = 1e-3 * float(answers.get("camera_distance_mm", 400.0))
        return WorkPlane.about(distance_m, float(np.radians(answers.get("camera_inclination_deg", 0.0))), length_m)

    def stills(self) -> list[Still]:
        """All pictures of the antenna, in the order of the bundle adjustment."""
        return [still_of(step, self.store.path(one), one.readings) for step in _STILLS for one in self.taken(step)]

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
        return self._observation("noload", first[0]).paint if first and step != "noload" else None

    def _observation(self, step: str, taken: AcceptedPicture) -> Observation:
        inputs = taken.sha256, tuple(taken.readings.items()), self.inputs("lens", "plane")
        path = self.store.path(taken)
        still = still_of(step, path, taken.readings)
        return self.cached(("antenna", taken.file), inputs, lambda: self.observe(still, step, read_picture(path)))

    def joint(self) -> BundleAdjustment:
        """The bundle adjustment of lens, plane C, antenna and sensor, by the stills so far."""
        return self.cached("joint", self.inputs(*_ALL), self._solve_joint)

    def _solve_joint(self) -> BundleAdjustment:
        session = self.session
        before = stills_prior(session, self.lens(), self.plane())
        seen = [self._observation(step, one) for step in _STILLS for one in self.taken(step)]
        if not seen:
            raise InputError("no picture of the antenna yet", where=self.store.root, remedy="take one")
        return adjust_bundle(seen, before, session.antenna.length_m, session.moment_std_Nm)

    def still_diagnoses(self) -> list[Diagnosis]:
        """What is wrong, or looks wrong, with the pictures of the antenna and what was typed with them."""
        joint = self.joint()
        remedy = "check the answers about the jig (place, axes, turn, how well it is known) and the clamp"

        def made() -> list[Diagnosis]:
            against_plane = [
                Diagnosis("antenna_contradicts_plane", words, remedy, grave=True) for words in prior_doubts(joint)
            ]
            return [*against_plane, *still_diagnoses(self.session, self.plane().kinematics, joint)]

        return self.cached("diagnoses", self.inputs(*_ALL), made)


def still_of(step: str, path: Path | None, readings: Mapping[str, float]) -> Still:
    """A still with its readings, a load where the step is that."""
    names = ["pan_rad", "tilt_rad", "moment_Nm"] + (["distance_m", "force_y_N", "force_z_N"] if step == "loads" else [])
    entries = {name: readings[name] for name in names}
    return (Load if step == "loads" else Still)(path, **entries, time_s=readings.get("time_s"))
