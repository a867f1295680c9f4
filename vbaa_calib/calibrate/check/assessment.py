"""`assess`: everything that `vbaa check` reports about a rig, alone or against new pictures."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from targets.board import corner_points
from vbaa_calib.calibrate.antenna.session_rig import ExpectedAntenna, observe
from vbaa_calib.calibrate.lens.board_shape import SHAPE_NAMES, BoardShape
from vbaa_calib.core.arrays import check_angle
from vbaa_calib.core.console import progress
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_json, sha256
from vbaa_calib.core.images import list_images
from vbaa_calib.detect.board.board_file import with_ids
from vbaa_calib.detect.board.corners import detect_files
from vbaa_calib.rig import Rig
from vbaa_calib.session import (
    NominalAntenna,
    Session,
    Still,
    check_pictures,
    load_session,
    read_loads,
    read_noload,
    read_pose,
)

from .antenna import CheckedStill, check_antenna, check_stills
from .boards import check_lens, check_pose
from .finding import FAILS, HOLDS, LOOK, NOT_GIVEN, Checked, Finding, worst
from .rig import at, number_at, rig_findings, rig_maps, rig_numbers

_PARTS = ("intrinsics", "plane", "noload", "loads")  # folders of a session that a rig is checked against
_NO_JIG = "session.yaml does not say where the jig is"  # why the camera's pose is left open


@dataclass(frozen=True, eq=False)
class NewPictures:
    """One new picture of each, with the joints at rest."""

    board: Path | None  # the board in its jig; None if free is given
    free: Path | None  # the free antenna; None if board is given
    pan_rad: float = 0.0  # the joints' readings with `free`
    tilt_rad: float = 0.0
    moment_Nm: float | None = None  # the sensor's reading with `free`; None where nobody noted it

    def __post_init__(self) -> None:
        if self.board is None and self.free is None:
            raise InputError("no picture is given", remedy="give --board, --free or both")
        for name in ("pan_rad", "tilt_rad"):
            check_angle(getattr(self, name), name)
        if self.moment_Nm is not None and not math.isfinite(self.moment_Nm):
            raise InputError(f"moment_Nm is {self.moment_Nm:g}", remedy="give the sensor's reading in N·m, or leave it")


@dataclass(frozen=True, eq=False)
class Assessment:
    """The result of `assess`."""

    rig: Rig
    path: Path
    findings: tuple[Finding, ...]  # on the rig by itself; those on new pictures are in `session`
    quality: Mapping[str, Any]  # of rig.json, as it is there
    session: Checked | None
    nominal_Nm2: float | None = None  # E·πd⁴/64, from rig.json or the session
    own_pictures: bool = False  # the session's pictures are those of the calibration

    @property
    def answers(self) -> list[Finding]:
        """All findings, those on new pictures first."""
        return [*(self.session.findings if self.session else ()), *self.findings]

    @property
    def verdict(self) -> str:
        """The worst level of all answered questions."""
        return worst(self.answers)

    @property
    def headline(self) -> str:
        """The verdict in a sentence."""
        if self.own_pictures and self.verdict == HOLDS:
            return "This rig fits its calibration's pictures."
        return {
            HOLDS: "This rig holds.",
            LOOK: "Look at this rig before you rely on it.",
            FAILS: "This rig does not hold.",
            NOT_GIVEN: "There is nothing to judge this rig by.",
        }[self.verdict]

    @property
    def words(self) -> str:
        """The verdict, and the questions that were not answered with "holds"."""
        sentences = [self.headline]
        for level, start in ((FAILS, "Does not hold"), (LOOK, "Look at")):
            found = [
                f"{one.question} {one.words[:1].upper()}{one.words[1:]}." for one in self.answers if one.level == level
            ]
            sentences += [f"{start}: {' '.join(found)}"] if found else []
        if self.session is None:
            sentences.append("Judged by rig.json alone; new pictures show whether the rig is still valid.")
        if self.own_pictures:
            sentences.append("These are the calibration's own pictures; new ones show whether the rig is still valid.")
        return " ".join(sentences)

    def to_dict(self) -> dict[str, Any]:
        """The document check.json, from which alone the report is made."""
        session = self.session or Checked((), {})
        return {
            "schema": "vbaa.check/1",
            "rig": str(self.path),
            "verdict": self.verdict,
            "headline": self.headline,
            "words": self.words,
            "findings": [finding.to_dict() for finding in self.findings],
            "numbers": rig_numbers(self.rig, self.nominal_Nm2),
            "maps": rig_maps(self.rig),
            "quality": dict(self.quality),
            "session_findings": [finding.to_dict() for finding in session.findings],
            "session": dict(session.document) if self.session else None,
            "own_pictures": self.own_pictures,
        }


def assess(path: Path, session_root: Path | None = None, new: NewPictures | None = None) -> Assessment:
    """Judge a rig.json by itself, and against a session or new pictures. With new pictures the
    session, or without one rig.json's record, describes jig and board; its own pictures are not read.

    Raises InputError for a broken rig or session, pictures of another size than the lens', a session without any of
    `_PARTS`, and a new picture that the rig was calibrated from.
    """
    path = Path(path)
    data = read_json(path)
    rig, quality = Rig.from_dict(data, path), data.get("quality", {})
    session = None if session_root is None else load_session(Path(session_root))
    nominal = number_at(quality, "antenna", "nominal_stiffness_Nm2")
    if nominal is None and session is not None:
        nominal = session.antenna.stiffness_Nm2
    own = rig_findings(rig, quality, nominal)
    recorded = at(data, "inputs_sha256")
    used = set(recorded.values()) if isinstance(recorded, Mapping) else set()
    if session is not None:
        for name in ("length_m", "diameter_m"):
            own_m, other_m = getattr(rig.antenna, name), getattr(session.antenna, name)
            if abs(own_m - other_m) > 1e-3 * own_m:
                what, where = f"antenna.{name} is {other_m:g}, the rig's {own_m:g}", session.root / "session.yaml"
                raise InputError(what, where=where, remedy="check a rig with its own antenna")
    inputs = None if session is None or new is not None else _from_session(session)
    if new is not None:
        _refuse_calibration_pictures(used, new, path)
        no_jig = _NO_JIG if session else "rig.json does not record the jig: name its session"
        inputs = _from_pictures(session or _recorded_session(data, rig, path), new, no_jig)
    checked = None if inputs is None else _check_pictures(rig, quality, inputs)
    pictures = [] if inputs is None else inputs.pictures
    its_own = bool(pictures) and all(sha256(picture) in used for picture in pictures)
    return Assessment(rig, path, tuple(own), quality, checked, nominal, its_own)


@dataclass(frozen=True, eq=False)
class _Inputs:
    """Pictures to check a rig against, and what must be known to read them."""

    session: Session  # board, jig, antenna and gravity; nothing more is read from its folder
    parts: tuple[str, ...]
    boards: Mapping[str, Sequence[Path]]  # part → its pictures
    stills: Sequence[Still]  # of the free and the loaded antenna; `moment_Nm` NaN where not read
    no_jig: str = _NO_JIG  # why the jig's place is not known, where it is not

    @property
    def pictures(self) -> list[Path]:
        boards = [path for paths in self.boards.values() for path in paths]
        return boards + [still.image for still in self.stills if still.image is not None]


def _from_session(session: Session) -> _Inputs:
    parts = tuple(part for part in _PARTS if (session.root / part).exists())
    if not parts:
        what = f"has none of {', '.join(_PARTS)}"
        raise InputError(what, where=session.root, remedy="one picture in plane/ and one in noload/ will do")
    noload = read_noload(session) if "noload" in parts else []
    loads = read_loads(session) if "loads" in parts else []
    boards = {part: list_images(session.folder(part)) for part in _PARTS[:2] if part in parts}
    return _Inputs(session, parts, boards, [*noload, *loads])


def _from_pictures(session: Session, new: NewPictures, no_jig: str) -> _Inputs:
    moment_Nm = math.nan if new.moment_Nm is None else new.moment_Nm
    boards = {} if new.board is None else {"plane": [new.board]}
    stills = [] if new.free is None else [Still(new.free, new.pan_rad, new.tilt_rad, moment_Nm)]
    return _Inputs(session, (*boards, *(["noload"] if stills else [])), boards, stills, no_jig)


def _recorded_session(document: Mapping[str, Any], rig: Rig, path: Path) -> Session:
    """Board and jig as rig.json records them, the rest from the rig. The antenna's material is not known here."""
    board, jig = at(document, "quality", "lens", "board"), at(document, "quality", "jig")
    remedy = "name the session that the rig was calibrated from: `vbaa check rig.json SESSION --jig …`"
    if board is None:
        raise InputError("quality.lens.board is not recorded", where=path, remedy=remedy)
    return Session(
        root=path,
        board=with_ids(board, path, "quality.lens.board", remedy),
        antenna=NominalAntenna(
            rig.antenna.length_m,
            rig.antenna.diameter_m,
            math.nan,
            math.nan,
            profile=rig.antenna.profile,
            stiffness_profile=rig.antenna.stiffness_profile,
        ),
        T_antenna_board=jig and read_pose(at(jig, "T_antenna_board"), path, "quality.jig.T_antenna_board"),
        kinematics=rig.kinematics,
        gravity_world_m_s2=rig.gravity_world_m_s2,
        moment_std_Nm=rig.moment_sensor.std_Nm,
    )


def _refuse_calibration_pictures(used: Collection[str], new: NewPictures, path: Path) -> None:
    """Refuses pictures that the rig was calibrated from, which fit whatever has happened since. used : SHA-256 of
    those."""
    for picture in (new.board, new.free):
        if picture is not None and picture.is_file() and sha256(picture) in used:
            what = f"is one of the pictures that {path} was calibrated from"
            raise InputError(what, where=picture, remedy="take a new one: an old one cannot show what has changed")


def _check_pictures(rig: Rig, quality: Mapping[str, Any], inputs: _Inputs) -> Checked:
    """Checks the lens, then the camera's pose, then antenna and sensor, each with the results before it."""
    session, parts = inputs.session, inputs.parts
    check_pictures(progress(inputs.pictures, "reading the pictures"), rig.camera.image_size, "the rig's lens is")
    # the board's shape as the calibration found it
    recorded_shape = [number_at(quality, "lens", "board_shape", "parameters", name) or 0.0 for name in SHAPE_NAMES]
    shape = replace(BoardShape.flat(corner_points(session.board)), parameters=np.array(recorded_shape))
    boards = [(part, view) for part, paths in inputs.boards.items() for view in detect_files(paths, session.board)]
    recorded = number_at(quality, "lens", "rms_inliers_px") or number_at(quality, "lens_rms_px")
    lens = check_lens(rig.camera, boards, shape, recorded, number_at(quality, "plane_rms_px"))
    lens_holds = not any(finding.is_bad for finding in lens.findings)
    in_jig = [view for part, view in boards if part == "plane"]
    pose, current = check_pose(rig, in_jig, session, inputs.no_jig, shape, lens_holds)
    stills: list[CheckedStill] = []
    if inputs.stills:
        where = rig.camera, current.T_antenna_camera, rig.antenna.parameters
        expected = ExpectedAntenna(session.antenna, *where, rig.image.paint)
        seen, _ = observe(session, rig.kinematics, inputs.stills, expected, "antenna")
        stills = check_stills(current, seen, session.load_readings)
    antenna = check_antenna(current, stills, camera_known=pose.document["camera_pose"] is not None)
    given = {"given": list(parts), "not_given": [part for part in _PARTS if part not in parts]}
    return Checked(
        (*lens.findings, *pose.findings, *antenna.findings),
        {**given, **lens.document, **pose.document, **antenna.document},
    )
