"""The pictures that a rig is checked against: a session's, or one each of the board and the free antenna."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from targets.board import BoardSpec
from vbaa_calib.calibrate.lens.board_flex import Bend
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import sha256
from vbaa_calib.core.images import list_images
from vbaa_calib.core.models import checked
from vbaa_calib.rig import Rig
from vbaa_calib.session import NominalAntenna, Session, Still, read_loads, read_noload, read_pose

from .rig import at, number_at

PARTS = ("intrinsics", "plane", "noload", "loads")
_NO_JIG = "session.yaml does not say where the jig is"
_NAME_SESSION = "name the session that the rig was calibrated from"


@dataclass(frozen=True, eq=False)
class NewPictures:
    """One new picture of each, with the joints at rest.

    board : the board in its jig. free : the free antenna. Either may be None, not both.
    pan_rad, tilt_rad : the joints' readings with `free`.
    moment_Nm : the moment sensor's reading with it; None where nobody noted it.
    """

    board: Path | None
    free: Path | None
    pan_rad: float = 0.0
    tilt_rad: float = 0.0
    moment_Nm: float | None = None

    def __post_init__(self) -> None:
        if self.board is None and self.free is None:
            raise InputError("no picture is given", remedy="give --board, --free or both")
        for name in ("pan_rad", "tilt_rad"):
            value = getattr(self, name)
            if not math.isfinite(value) or abs(value) > 2 * math.pi:
                raise InputError(f"{name} is {value:g}", remedy="give radians, up to a turn")
        if self.moment_Nm is not None and not math.isfinite(self.moment_Nm):
            raise InputError(f"moment_Nm is {self.moment_Nm:g}", remedy="give the sensor's reading in N·m, or leave it")


@dataclass(frozen=True, eq=False)
class CheckInputs:
    """Pictures to check a rig against, and what must be known to read them.

    session : board, jig, antenna and gravity; nothing more is read from its folder.
    parts : those of `PARTS` that there are pictures of.
    boards : part → its pictures. stills : of the free and the loaded antenna; `moment_Nm` NaN where not read.
    no_jig : why the jig's place is not known, where it is not.
    """

    session: Session
    parts: tuple[str, ...]
    boards: Mapping[str, tuple[Path, ...]]
    stills: tuple[Still, ...]
    no_jig: str = _NO_JIG

    @property
    def pictures(self) -> list[Path]:
        """All of them."""
        boards = [path for paths in self.boards.values() for path in paths]
        return boards + [still.image for still in self.stills if still.image is not None]


def from_session(session: Session) -> CheckInputs:
    """Everything in a session's folder. Raises InputError for a folder without any of `PARTS`."""
    parts = tuple(part for part in PARTS if (session.root / part).exists())
    if not parts:
        what = f"has none of {', '.join(PARTS)}"
        raise InputError(what, where=session.root, remedy="one picture in plane/ and one in noload/ will do")
    noload = read_noload(session) if "noload" in parts else []
    stills = [*noload, *(read_loads(session) if "loads" in parts else [])]
    boards = {part: tuple(list_images(session.root / part)) for part in PARTS[:2] if part in parts}
    return CheckInputs(session, parts, boards, tuple(stills))


def from_pictures(session: Session, new: NewPictures, no_jig: str = _NO_JIG) -> CheckInputs:
    """The new pictures alone; the session describes board, jig and antenna."""
    moment_Nm = math.nan if new.moment_Nm is None else new.moment_Nm
    boards = {} if new.board is None else {"plane": (new.board,)}
    stills = () if new.free is None else (Still(new.free, new.pan_rad, new.tilt_rad, moment_Nm),)
    return CheckInputs(session, (*boards, *(("noload",) if stills else ())), boards, stills, no_jig)


def recorded_session(document: Mapping[str, Any], rig: Rig, path: Path) -> Session:
    """Board and jig as rig.json records them (`quality.lens.board`, `quality.jig`), the rest from the rig.

    The antenna's material is not known here. Raises InputError where the board is not recorded or not one.
    """
    board, jig = at(document, "quality", "lens", "board"), at(document, "quality", "jig")
    remedy = f"{_NAME_SESSION}: `vbaa check rig.json SESSION --board …`"
    if board is None:
        raise InputError("quality.lens.board is not recorded", where=path, remedy=remedy)
    spec = checked(BoardSpec, board, path, remedy, "quality.lens.board")
    return Session(
        root=path,
        board=spec,
        antenna=NominalAntenna(rig.antenna.length_m, rig.antenna.diameter_m, math.nan, math.nan),
        T_antenna_board=jig and read_pose(at(jig, "T_antenna_board"), path, "quality.jig.T_antenna_board"),
        kinematics=rig.kinematics,
        gravity_world_m_s2=rig.gravity_world_m_s2,
        moment_std_Nm=rig.moment_sensor.std_Nm,
    )


def refuse_calibration_pictures(document: Mapping[str, Any], new: NewPictures, path: Path) -> None:
    """Raises InputError for a picture that the rig was calibrated from: it fits whatever has happened since."""
    recorded = at(document, "inputs_sha256")
    used = list(recorded.values()) if isinstance(recorded, Mapping) else []
    for picture in (new.board, new.free):
        if picture is not None and used and picture.is_file() and sha256(picture) in used:
            what = f"is one of the pictures that {path} was calibrated from"
            raise InputError(what, where=picture, remedy="take a new one: an old one cannot show what has changed")


def recorded_bend(quality: Mapping[str, Any]) -> Bend | None:
    """The board's shape as the calibration found it; None where it was solved with a flat one."""
    if at(quality, "lens", "board_flex", "used") is not True:
        return None
    sagittas = np.array([number_at(value) or 0.0 for value in at(quality, "lens", "board_flex", "sagittas_m") or ()])
    return Bend(sagittas, np.zeros((2, 2))) if sagittas.shape == (2,) else None
