"""The options of verbs that take a lens from a file, and what they mean."""

from __future__ import annotations

import argparse
import re
from typing import TYPE_CHECKING

from vbaa_calib.core.errors import InputError

if TYPE_CHECKING:
    from vbaa_calib.convert.values import Wanted


def add_lens_file(parser: argparse.ArgumentParser) -> None:
    """The options on what of a lens file is wanted."""
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


def wanted_of(args: argparse.Namespace) -> Wanted:
    """What of a lens file is wanted. Raises InputError for what is no size, binning or part."""
    from vbaa_calib.convert.values import Wanted

    size, binning = _pair(args.size, "--size", "1280x960"), _pair(args.binning, "--binning", "2, or 2x1")
    if args.roi is not None and min(*args.roi[:2], args.roi[2] - 1, args.roi[3] - 1) < 0:
        raise InputError("--roi is {} {} {} {}".format(*args.roi), remedy="give left, top, width and height in pixels")
    roi = None if args.roi is None else tuple(args.roi)
    return Wanted(args.camera_name, size, binning, roi, args.rectified, args.fisheye)


def _pair(text: str | None, flag: str, like: str) -> tuple[int, int] | None:
    if text is None:
        return None
    found = re.fullmatch(r"([1-9]\d{0,5})(?:[xX,]([1-9]\d{0,5}))?", text.strip())
    if found is None or (flag == "--size" and found[2] is None):
        raise InputError(f"{flag} is {text!r}", remedy=f"give it like {like}")
    return int(found[1]), int(found[2] or found[1])
