"""Options of the verbs that read a lens from a file."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from vbaa_calib.core.errors import InputError

if TYPE_CHECKING:
    from vbaa_calib.convert.values import Wanted


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
