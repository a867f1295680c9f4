"""The session that follows from answers and pictures: session.yaml, its tables, and the calibration so far."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, TypeVar

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from targets.board import BoardWithIds
from targets.print_scale import SCALE, PrintScale, print_scale, rescaled
from vbaa_calib.antenna.materials import MATERIALS
from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment
from vbaa_calib.calibrate.antenna.inputs import Observation
from vbaa_calib.calibrate.antenna.session_rig import ExpectedAntenna, nominal_parameters, solve_antenna
from vbaa_calib.calibrate.doubts import prior_doubts
from vbaa_calib.calibrate.given_lens import GivenLens, given_solution, read_lens
from vbaa_calib.calibrate.guide.view_uncertainty import WorkPlane
from vbaa_calib.calibrate.lens.intrinsics import LensSolution
from vbaa_calib.calibrate.lens_from_views import solve_lens
from vbaa_calib.calibrate.pipeline import first_solved, next_lenses, prior_of_session
from vbaa_calib.calibrate.plane_c import PlaneC, find_plane
from vbaa_calib.calibrate.pose.fusion import fused
from vbaa_calib.convert.values import Wanted
from vbaa_calib.core.csv_rows import csv_text
from vbaa_calib.core.errors import Diagnosis, InputError, VbaaError
from vbaa_calib.core.files import UniqueKeyDumper, read_yaml, write_text
from vbaa_calib.core.images import read_gray, read_picture
from vbaa_calib.detect.board.board_file import load_board
from vbaa_calib.detect.board.corners import BoardView, detect_corners
from vbaa_calib.diagnose.session import failure_causes, static_frame_diagnoses
from vbaa_calib.geometry import Pose
from vbaa_calib.session import (
    SCHEMA,
    SILENT,
    STANDARD_GRAVITY_M_S2,
    Load,
    NominalAntenna,
    Session,
    Still,
    gravity_antenna,
    has_sweep,
    load_session,
    session_from,
)

from .questions import BY_KEY, DIRECTIONS, READINGS, complete, in_si
from .store import AcceptedPicture, Store

_Result = TypeVar("_Result")
BOARD = "board.yaml"
_STATIC_STEPS = ("noload", "loads")
_UNITS = {
    "antenna": {
        "length_m": ("antenna_length_mm", 1e-3),
        "diameter_m": ("antenna_diameter_mm", 1e-3),
        "youngs_modulus_Pa": ("youngs_modulus_GPa", 1e9),
        "density_kg_m3": ("density_kg_m3", 1.0),
    },
    "moment_sensor": {"std_Nm": ("moment_std_mNm", 1e-3)},
    "load_readings": {"distance_std_m": ("distance_std_mm", 1e-3), "force_std_relative": ("mass_std_percent", 1e-2)},
}
"""Section and key of session.yaml → the answer, and the size of its unit in SI."""


def scale_of(answers: Mapping[str, Any]) -> PrintScale | None:
    """The print's scale; None until both readings are known. Raises InputError for impossible readings."""
    measured = ("measure_x_mm", "board_along_x_mm", "measure_y_mm", "board_along_y_mm")
    if any(name not in answers for name in measured):
        return None
    where = "board_along_x_mm, board_along_y_mm"
    x, along_x, y, along_y = (float(answers[name]) for name in measured)
    try:
        return print_scale(x, along_x, y, along_y, float(answers.get("board_reading_std_mm", SCALE.reading_std_mm)))
    except ValueError as error:
        # targets.print_scale knows its own parameters, not what they are called here
        what = str(error).replace("reading_std", "board_reading_std")
        what = what.replace("reading_x", "board_along_x").replace("reading_y", "board_along_y")
        raise InputError(what, where=where, remedy="measure it again") from None


def _jig(value: Mapping[str, Any]) -> dict[str, Any]:
    x, y = (np.array(DIRECTIONS[value[key]], float) for key in ("jig_board_x", "jig_board_y"))
    turn = Rotation.from_rotvec(value["jig_turn_deg"], degrees=True)
    rotation = turn * Rotation.from_matrix(np.column_stack([x, y, np.cross(x, y)]))
    return {
        "T_antenna_board": {
            "translation_m": [1e-3 * part for part in value["jig_translation_mm"]],
            "rotation_xyzw": [float(part) for part in rotation.as_quat()],
        },
        "translation_std_m": 1e-3 * value["jig_std_mm"],
        "rotation_std_rad": float(np.radians(value["jig_std_deg"])),
    }


def _write_table(path: Path, taken: Sequence[AcceptedPicture]) -> None:
    """Write a picture folder's table with numbers in full precision, unless the file is already the same."""
    timed = ["time_s"] if all("time_s" in one.readings for one in taken) else []
    read = [name for name in READINGS[path.stem] if name not in SILENT or all(name in one.readings for one in taken)]
    columns = ["image", *read, *timed]
    rows = [
        {"image": Path(one.file).name} | {name: repr(float(one.readings[name])) for name in columns[1:]}
        for one in taken
    ]
    text = csv_text(rows, columns)
    if not path.exists() or path.read_text(encoding="utf-8", errors="replace") != text:
        write_text(path, text)


class SessionState:
    """A store and all results that follow from it, computed on demand and again when their inputs change.

    Methods raise InputError and SolveError as the calibration does. live_size : (width, height) px of live pictures.
    """

    def __init__(self, store: Store) -> None:
        self.store = store
        self.live_size: tuple[int, int] | None = None
        self._cache: dict[Hashable, tuple[Hashable, Any]] = {}
        self._session_yaml = store.root / "session.yaml"

    @staticmethod
    def answers_of(session_yaml: Path) -> dict[str, Any]:
        """The answers that a session.yaml contains. Raises InputError where it is wrong."""
        session, data = load_session(session_yaml.parent), read_yaml(session_yaml)
        sections = {
            "antenna": session.antenna,
            "moment_sensor": SimpleNamespace(std_Nm=session.moment_std_Nm),
            "load_readings": session.load_readings,
        }
        found: dict[str, Any] = {
            name: (1 / size) * getattr(sections[section], key)
            for section, keys in _UNITS.items()
            for key, (name, size) in keys.items()
            if section != "moment_sensor" or session.with_sensor
        }
        found["moment_sensor"] = bool(session.columns)
        for axis, length_m in zip("xy", session.board.size_m, strict=True):
            found |= {f"measure_{axis}_mm": 1e3 * length_m, f"board_along_{axis}_mm": 1e3 * length_m}
        ways = {"jig": bool(data.get("jig")), "sweep": has_sweep(session), "over": bool(data.get("over"))}
        found |= {"board": str(session_yaml), "board_reading_std_mm": SCALE.reading_std_mm}
        found |= {"material": session.antenna.material} if session.antenna.material in MATERIALS else {}
        found |= {"board_given": True, "gravity_given": True, "jig_given": ways["jig"], "over_given": ways["over"]}
        way = next((way for way, there in ways.items() if there), None)
        return found if way is None else found | {"plane_way": way}

    def cached(self, name: Hashable, inputs: Hashable, make: Callable[[], _Result]) -> _Result:
        """The result for these inputs, computed once; a failure is cached, too."""
        if name not in self._cache or self._cache[name][0] != inputs:
            try:
                self._cache[name] = inputs, make()
            except VbaaError as error:
                self._cache[name] = inputs, error
        found = self._cache[name][1]
        if isinstance(found, VbaaError):
            raise found
        return found

    def known(self, name: Hashable, inputs: Hashable) -> Any:
        """The result that `cached` has computed for these inputs; None where it has none."""
        before, found = self._cache.get(name, (None, None))
        return None if before != inputs or isinstance(found, VbaaError) else found

    def inputs(self, *steps: str) -> Hashable:
        """A cache key that changes with any answer, any picture of these steps, and its readings."""
        answers = tuple(sorted((key, repr(value)) for key, value in self._answers.items()))
        return answers, tuple(
            (step, tuple((one.sha256, *one.readings.items()) for one in self.taken(step))) for step in steps
        )

    @property
    def _answers(self) -> Mapping[str, Any]:
        return self.store.journal.answers

    @property
    def nominal_board(self) -> BoardWithIds:
        """The board as designed."""
        path = self.store.root / BOARD
        stamp = path.stat().st_mtime_ns if path.exists() else 0
        return self.cached("nominal board", stamp, lambda: load_board(path))

    @property
    def scale(self) -> PrintScale | None:
        """The print's scale; None before both readings are known."""
        return scale_of(self._answers)

    @property
    def board(self) -> BoardWithIds:
        """The board as printed."""
        scale = scale_of(self._answers)
        return self.nominal_board if scale is None else rescaled(self.nominal_board, scale)

    @property
    def session(self) -> Session:
        """The session of session.yaml as far as it is answered. Raises InputError for contradictory answers."""
        return session_from(self._session_data(self._written()), self.store.root, self._session_yaml)

    def _written(self) -> dict[str, Any]:
        return read_yaml(self._session_yaml) if self._session_yaml.exists() else {}

    def _session_data(self, before: Mapping[str, Any]) -> dict[str, Any]:
        """The content of session.yaml from answers and defaults. before : its previous content; other keys are kept."""
        answers, board, scale = self._answers, self.board, self.scale
        value = {key: answers.get(key, question.as_known(answers).default) for key, question in BY_KEY.items()}
        # Taken until they are answered, since they have no default.
        passing = {"antenna_length_mm": 100.0, "antenna_diameter_mm": 1.0}
        read = {
            section: {key: size * (value[name] or passing.get(name, 0.0)) for key, (name, size) in keys.items()}
            for section, keys in _UNITS.items()
        }
        antenna = dict(before.get("antenna") or {}) | read["antenna"]
        if "material" in answers:
            antenna["material"] = answers["material"] if answers["material"] in MATERIALS else None
        if (tip_m := 1e-3 * answers.get("antenna_tip_diameter_mm", 0.0)) > 0.0:
            antenna["profile"] = [[0.0, antenna["diameter_m"]], [antenna["length_m"], tip_m]]
        elif "antenna_tip_diameter_mm" in answers:
            antenna.pop("profile", None)
        data = dict(before) | {"schema": SCHEMA, "board": board.to_dict(), "antenna": antenna}
        axes = answers.get("sensor_axes", "" if before.get("wrench_sensor") else "one") * bool(value["moment_sensor"])
        if axes or not value["moment_sensor"]:
            # without an answer what the session says of its axes stays
            std_Nm = read["moment_sensor"]["std_Nm"]
            reads = {"two-axis": ["my", "mz"], "wrench": ["fx", "fy", "fz", "mx", "my", "mz"]}
            noise = {"std_Nm": std_Nm} | ({"std_N": 1e-3 * value["force_std_mN"]} if axes == "wrench" else {})
            several = dict(before.get("wrench_sensor") or {}) | {"components": reads.get(axes), **noise}
            sensor = dict(before.get("moment_sensor") or {}) | read["moment_sensor"]
            data["moment_sensor"] = sensor if axes == "one" else None
            data["wrench_sensor"] = several if axes in reads else None
        if {"distance_std_mm", "mass_std_percent"} & set(answers) or "load_readings" not in before:
            data["load_readings"] = read["load_readings"]
        # a board that came with the session is as that says
        if "board_given" not in answers and scale is not None and scale.std:
            data["print_scale_std"] = round(scale.std / scale.scale, 9)
        elif "board_given" not in answers:
            data.pop("print_scale_std", None)
        if "gravity" in answers or "gravity_world" not in before:
            down = DIRECTIONS.get(value["gravity"])
            data["gravity_world"] = None if down is None else [STANDARD_GRAVITY_M_S2 * float(part) for part in down]
        way = value["plane_way"]
        # the calibration takes every way that session.yaml names: one that was chosen before must not stay
        for other in {"jig", "over"} - {way}:
            if not answers.get(f"{other}_given"):
                data.pop(other, None)
        if way == "jig" and value["jig_translation_mm"] is not None:
            data["jig"] = _jig(value)
            data["board"]["thickness_m"] = 1e-3 * value["board_thickness_mm"]
        if way == "over" and value["over_height_mm"] is not None:
            data["over"] = dict(before.get("over") or {}) | {"height_m": 1e-3 * value["over_height_mm"]}
        return data

    def write_files(self) -> None:
        """Write session.yaml and the tables where their content has changed."""
        before = self._written()
        data = self._session_data(before)
        without_default = ("board", "antenna_length_mm", "antenna_diameter_mm", "plane_way")
        if data != before and all(key in self._answers for key in without_default):
            style: dict[str, Any] = {"sort_keys": False, "default_flow_style": None, "width": 110}
            write_text(self._session_yaml, yaml.dump(data, Dumper=UniqueKeyDumper, allow_unicode=True, **style))
        for step in ("plane", "noload", "loads"):
            folder, taken = self.store.folder(step), self.taken(step)
            if folder in READINGS and taken:
                _write_table(self.store.root / folder / f"{folder}.csv", taken)

    def taken(self, step: str) -> tuple[AcceptedPicture, ...]:
        return self.store.journal.of(step).taken

    def readings(self, step: str, typed: Mapping[str, Any], where: str) -> dict[str, float]:
        """Readings of a picture, typed under any of their names, in the form of the session's tables. Raises
        InputError."""
        session, si = self.session, in_si(typed, where)
        frame = Still(None, si.get("pan_rad", 0.0), si.get("tilt_rad", 0.0), 0.0)
        pull = session.gravity_antenna([frame])[0]
        return complete(self.store.folder(step), typed, pull, session.antenna.length_m, where, session.columns)

    def _view(self, taken: AcceptedPicture) -> BoardView:
        path, spec = self.store.path(taken), self.board
        inputs = taken.sha256, repr(spec.to_dict())
        return self.cached(("view", taken.file), inputs, lambda: detect_corners(read_gray(path), spec, path.name))

    def views(self, step: str) -> list[BoardView]:
        return [self._view(taken) for taken in self.taken(step)]

    @property
    def given_lens(self) -> GivenLens | None:
        """The known lens, if any. Raises InputError for a file without one."""
        path, wanted = self._answers.get("camera"), Wanted.of(self._answers)
        return path and self.cached("given lens", (path, wanted), lambda: read_lens(Path(path), wanted))

    @property
    def image_size(self) -> tuple[int, int] | None:
        """(width, height) px of the known lens, or of the first accepted picture."""
        if self.given_lens is not None:
            return self.given_lens.camera.image_size
        first = [*self.taken("lens")[:1], *self.taken("plane")[:1]]
        return self._view(first[0]).image_size if first else None

    def lens(self) -> LensSolution:
        """The known lens, or the one solved from the pictures so far, with its verdict."""

        def made() -> LensSolution:
            views, board = self.views("lens"), self.board
            if self.given_lens is not None:
                return given_solution(self.given_lens, views, board)
            return solve_lens(views, board)

        return self.cached("lens", self.inputs("lens"), made)

    def plane(self) -> PlaneC:
        """The camera's pose on the antenna's base, by the chosen way."""

        return self.cached("plane", self.inputs("lens", "plane"), lambda: self._plane_by(self.lens()))

    def _plane_by(self, lens: LensSolution) -> PlaneC:
        way, taken = self.store.folder("plane"), self.taken("plane")
        if not taken:
            raise InputError("no picture yet", where=self.store.root / way, remedy="take one")
        if way == "over":
            views: dict[str, Any] = {"over": {one.file: read_gray(self.store.path(one)) for one in taken}}
        elif way == "sweep":
            _write_table(self.store.root / "sweep" / "sweep.csv", taken)
            views = {"sweep": self.views("plane")}
        else:
            views = {"jig": self.views("plane")}
        return find_plane(self.session, lens.camera, lens.board_shape, **views)

    def work_plane(self) -> WorkPlane:
        """The antenna's work area as seen from the camera: by plane C if that is known, else by the answers."""
        length_m, answers = self.session.antenna.length_m, self._answers
        if self.taken("plane"):
            try:
                pose = self.plane().estimates[0].T_antenna_camera
                return WorkPlane(pose.inverse(), length_m)
            except VbaaError:
                pass
        distance_m = 1e-3 * float(answers.get("camera_distance_mm", 400.0))
        return WorkPlane.about(distance_m, float(np.radians(answers.get("camera_inclination_deg", 0.0))), length_m)

    def observe(
        self,
        frame: Still,
        step: str,
        image: np.ndarray,
        pose: Pose | None = None,
        antenna: NominalAntenna | None = None,
    ) -> Observation:
        """The antenna detected in a static frame's picture, as `read_picture` returns it. pose : T_antenna_camera,
        if not plane C's. antenna : if not the session's."""
        session, plane, camera = self.session, self.plane(), self.lens().camera
        antenna = antenna or session.antenna
        pull = gravity_antenna(plane.kinematics, session.gravity_world_m_s2, [frame])[0]
        # the first free picture shows how the antenna differs from its background
        first = self.taken("noload")[:1]
        paint = self.observation("noload", first[0]).paint if first and step != "noload" else None
        pose = pose or fused(plane.estimates)
        expected = ExpectedAntenna(antenna, camera, pose, nominal_parameters(antenna), paint)
        return expected.observe(frame, image, pull)

    def observation(self, step: str, taken: AcceptedPicture) -> Observation:
        """The antenna detected in an accepted picture of a step."""
        inputs = taken.sha256, tuple(taken.readings.items()), self.inputs("lens", "plane")
        path = self.store.path(taken)
        frame = still_of(step, path, taken.readings)
        return self.cached(("antenna", taken.file), inputs, lambda: self.observe(frame, step, read_picture(path)))

    def joint(self) -> BundleAdjustment:
        """The bundle adjustment of lens, plane C, antenna and sensor with the static frames so far, free ones first."""

        def made() -> BundleAdjustment:
            session, first = self.session, self.lens()
            seen = [self.observation(step, one) for step in _STATIC_STEPS for one in self.taken(step)]
            if not seen:
                raise InputError("no picture of the antenna yet", where=self.store.root, remedy="take one")

            def solve(lens: LensSolution) -> BundleAdjustment:
                before = prior_of_session(session, lens, self.plane() if lens is first else self._plane_by(lens))
                return solve_antenna(session, seen, before)

            def causes() -> list[Diagnosis]:
                plane = self.plane()
                return failure_causes(session, plane.kinematics, seen, prior_of_session(session, first, plane))

            def others() -> Iterable[LensSolution]:
                return () if self.given_lens is not None else next_lenses(first, self.views("lens"), self.board)

            return first_solved(first, others, solve, causes)

        return self.cached("joint", self.inputs("lens", "plane", *_STATIC_STEPS), made)

    def static_frame_diagnoses(self) -> list[Diagnosis]:
        """Diagnoses of the antenna's pictures and their readings."""
        joint = self.joint()
        remedy = "check the answers about the jig (place, axes, turn, how well it is known) and the clamp"

        def made() -> list[Diagnosis]:
            found = static_frame_diagnoses(self.session, self.plane().kinematics, joint)
            against_plane = [
                replace(one, name="antenna_contradicts_plane", remedy=remedy, severity="wrong")
                for one in prior_doubts(joint, found)
            ]
            return [*against_plane, *found]

        return self.cached("diagnoses", self.inputs("lens", "plane", *_STATIC_STEPS), made)


def still_of(step: str, path: Path | None, readings: Mapping[str, float]) -> Still:
    """A static frame with its readings; a `Load` in the step of loads."""
    values = {**SILENT, **{name: readings[name] for name in READINGS[step] if name in readings}}
    return (Load if step == "loads" else Still)(path, **values, time_s=readings.get("time_s"))
