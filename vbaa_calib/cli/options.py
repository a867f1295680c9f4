"""Options that several verbs share, and what they select: joint angles, one of several antennas, the rig, a lens
file."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from vbaa_calib.core.console import say
from vbaa_calib.core.errors import InputError

if TYPE_CHECKING:
    from vbaa_calib.convert.values import Wanted
    from vbaa_calib.rig import Rig

_ANGLES = ("pan", "tilt")


def add_joints(parser: argparse._ActionsContainer, of: str = "joint angle") -> None:
    """Add --pan and --tilt (None by default) and --degrees."""
    for name in _ANGLES:
        parser.add_argument(f"--{name}", type=float, metavar="RAD", help=f"{of}, rad (default: 0)")
    parser.add_argument("--degrees", action="store_true", help="--pan, --tilt and a bag's joints are in degrees")


def add_antenna(parser: argparse._ActionsContainer) -> None:
    """Add --antenna, which selects one of several antennas."""
    parser.add_argument("--antenna", metavar="NAME", help="which antenna's contacts, where the table has several")


def joints_rad(args: argparse.Namespace) -> dict[str, float]:
    """The command line's joint angles by name, rad. Raises InputError for more than a turn."""
    angles = {name: getattr(args, name) for name in _ANGLES if getattr(args, name) is not None}
    for name, value in angles.items():
        if not abs(value) <= (360.0 if args.degrees else 2.0 * math.pi):
            remedy = "give degrees, up to a turn" if args.degrees else "give radians, up to a turn, or add --degrees"
            raise InputError(f"--{name} is {value:g}", remedy=remedy)
    return {name: math.radians(value) if args.degrees else value for name, value in angles.items()}


def pan_tilt_rad(args: argparse.Namespace) -> tuple[float, float]:
    """Pan and tilt, rad, 0 by default. Raises InputError as `joints_rad` does."""
    angles = joints_rad(args)
    return angles.get("pan", 0.0), angles.get("tilt", 0.0)


def add_accept_rig(parser: argparse.ArgumentParser) -> None:
    """Add --accept-rig, for a rig with a wrong calibration."""
    parser.add_argument(
        "--accept-rig", action="store_true", help="use the rig although the verdict on its calibration is wrong"
    )


def usable_rig(path: Path, accept_wrong: bool = True) -> Rig:
    """The rig in a rig.json. A wrong calibration is reported if it is accepted; otherwise raises InputError."""
    from vbaa_calib.rig import Rig

    rig = Rig.load(path)
    if rig.verdict.severity != "wrong":
        return rig
    worst = rig.verdict.findings[0] if rig.verdict.findings else None
    words = f"the verdict on its calibration is wrong{f': {worst.words}' if worst else ''}"
    if not accept_wrong:
        remedy = worst.remedy if worst else "calibrate again"
        raise InputError(words, where=path, remedy=f"{remedy}; or use it as it is with --accept-rig")
    say(f"warning, {path}: {words}; it is used all the same")
    return rig


def add_lens_file(parser: argparse.ArgumentParser) -> None:
    """Add the options that select camera, size, binning and part of a lens file."""
    group = parser.add_argument_group("of a lens file")
    group.add_argument(
        "--camera-name", metavar="NAME", help="which camera, where it holds several (cam1; CAMERA_ID; a bag's topic)"
    )
    group.add_argument("--size", metavar="WxH", help="the picture's size in pixels, for files that do not state it")
    group.add_argument(
        "--binning", metavar="N|NxM", help="pixels of its pictures that are one of yours (default: as it says, or 1)"
    )
    group.add_argument(
        "--roi", type=int, nargs=4, metavar=("X", "Y", "W", "H"), help="the part of its pictures that yours are"
    )
    group.add_argument(
        "--rectified", action="store_true", help="your pictures were rectified with its projection matrix"
    )
    group.add_argument(
        "--fisheye",
        action=argparse.BooleanOptionalAction,
        help="whether four coefficients are a fisheye's k1 to k4, or k1 k2 p1 p2",
    )


def wanted_of(args: argparse.Namespace, *files: Path | None) -> Wanted:
    """Camera, size, binning and part that the options select. files : those that may be a lens file.

    Raises InputError for what is no size, binning or part, and where there is no file.
    """
    from vbaa_calib.convert.values import Wanted

    wanted = Wanted.of(vars(args))
    if wanted != Wanted() and not any(files):
        name = "--camera-name" if args.camera_name else "--size, --binning, --roi, --rectified, --fisheye"
        raise InputError("is about a lens file, of which there is none", where=name, remedy="give --camera FILE, too")
    return wanted
