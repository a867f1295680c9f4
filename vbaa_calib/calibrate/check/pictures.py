"""What a rig is held against: a session's pictures, or one new picture of the board and one of the free antenna."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from targets.board import BoardSpec
from vbaa_calib.calibrate.lens.board_flex import Bend
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import sha256
from vbaa_calib.core.images import list_images
from vbaa_calib.geometry import Pose
from vbaa_calib.rig import Rig
from vbaa_calib.session import NominalAntenna, Session, Still, read_loads, read_noload, read_pose

from .rig import finite

PARTS = ("intrinsics", "plane", "noload", "loads")
BOARD_PARTS = ("intrinsics", "plane")


@dataclass(frozen=True, eq=False)
class NewPictures:
    """One new picture of each, with the joints at rest.

    Attributes
    ----------
    board : the board in its jig. free : the free antenna. Either may be None, not both.
    pan_rad, tilt_rad : the joints' readings while `free` was taken.
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
class Taken:
    """Pictures to hold a rig against, and what must be known to read them.

    Attributes
    ----------
    session : board, jig, antenna and gravity; of its folder nothing more is read.
    parts : those of `PARTS` that there are pictures of.
    boards : part → its pictures. stills : of the free and the loaded antenna; `moment_Nm` NaN where not read.
    no_jig : why the jig's place is not known, where it is not.
    """

    session: Session
    parts: tuple[str, ...]
    boards: Mapping[str, tuple[Path, ...]]
    stills: tuple[Still, ...]
    no_jig: str

    def pictures(self) -> Iterator[Path]:
        """All of them."""
        for paths in self.boards.values():
            yield from paths
        yield from (still.image for still in self.stills if still.image is not None)


def from_session(session: Session) -> Taken:
    """Everything that a session's folder holds. Raises InputError for a folder without any of `PARTS`."""
    parts = tuple(part for part in PARTS if (session.root / part).exists())
    if not parts:
        what = f"has none of {', '.join(PARTS)}"
        raise InputError(what, where=session.root, remedy="one picture in plane/ and one in noload/ will do")
    noload = read_noload(session) if "noload" in parts else []
    stills = [*noload, *(read_loads(session) if "loads" in parts else [])]
    boards = {part: tuple(list_images(session.root / part)) for part in BOARD_PARTS if part in parts}
    return Taken(session, parts, boards, tuple(stills), "session.yaml does not say where the jig is")


def from_pictures(
    session: Session, new: NewPictures, no_jig: str = "session.yaml does not say where the jig is"
) -> Taken:
    """The new pictures alone; the session says what board, jig and antenna they show."""
    moment_Nm = math.nan if new.moment_Nm is None else new.moment_Nm
    boards = {} if new.board is None else {"plane": (new.board,)}
    stills = () if new.free is None else (Still(new.free, new.pan_rad, new.tilt_rad, moment_Nm),)
    parts = (*boards, *(("noload",) if stills else ()))
    return Taken(session, parts, boards, stills, no_jig)


def recorded_session(document: Mapping[str, Any], rig: Rig, path: Path) -> Session:
    """Board and jig as rig.json records them (`quality.lens.board`, `quality.jig`), the rest from the rig.

    The antenna's material is not known here. Raises InputError where the board is not recorded or not one.
    """
    quality = document.get("quality")
    quality = quality if isinstance(quality, Mapping) else {}
    lens = quality.get("lens")
    board = lens.get("board") if isinstance(lens, Mapping) else None
    remedy = "name the session that the rig was calibrated from: `vbaa check rig.json SESSION --board …`"
    if board is None:
        raise InputError("quality.lens.board is not recorded", where=path, remedy=remedy)
    try:
        spec = BoardSpec.from_dict(board)
    except (ValueError, TypeError) as error:
        raise InputError(f"quality.lens.board: {error}", where=path, remedy=remedy) from None
    return Session(
        root=path,
        board=spec,
        antenna=NominalAntenna(rig.antenna.length_m, rig.antenna.diameter_m, math.nan, math.nan),
        T_antenna_board=_recorded_jig(quality.get("jig"), path),
        kinematics=rig.kinematics,
        gravity_world_m_s2=rig.gravity_world_m_s2,
        moment_std_Nm=rig.moment_sensor.std_Nm,
    )


def refuse_calibrations_own(document: Mapping[str, Any], new: NewPictures, path: Path) -> None:
    """Raises InputError for a picture that the rig was calibrated from: it fits whatever has happened since."""
    recorded = document.get("inputs_sha256")
    known = (
        {digest for digest in recorded.values() if isinstance(digest, str)} if isinstance(recorded, Mapping) else set()
    )
    for picture in (new.board, new.free):
        if picture is not None and known and picture.is_file() and sha256(picture) in known:
            what = f"is one of the pictures that {path} was calibrated from"
            raise InputError(what, where=picture, remedy="take a new one: an old one cannot tell what has changed")


def recorded_bend(quality: Mapping[str, Any]) -> Bend | None:
    """The board's shape as the calibration found it; None where it was solved with a flat one."""
    flex = quality.get("lens", {}).get("board_flex") if isinstance(quality.get("lens"), Mapping) else None
    if not isinstance(flex, Mapping) or flex.get("used") is not True:
        return None
    sagittas = np.array([finite(value) or 0.0 for value in flex.get("sagittas_m") or ()])
    return Bend(sagittas, np.zeros((2, 2))) if sagittas.shape == (2,) else None


def _recorded_jig(jig: Any, path: Path) -> Pose | None:
    """Pose of the board's printed face in the antenna frame; None where rig.json has none."""
    if jig is None:
        return None
    pose = jig.get("T_antenna_board") if isinstance(jig, Mapping) else None
    pose = pose if isinstance(pose, Mapping) else {}
    for key, count in (("translation_m", 3), ("rotation_xyzw", 4)):
        values = pose.get(key)
        if not isinstance(values, list) or len(values) != count or not all(map(_is_number, values)):
            raise InputError(
                f"quality.jig.T_antenna_board.{key} is not {count} numbers",
                where=path,
                remedy="calibrate again, or name the session that the rig was calibrated from",
            )
    return read_pose(pose, path, "quality.jig.T_antenna_board")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
