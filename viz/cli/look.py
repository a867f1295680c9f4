"""`vbaa look`: what is seen of the antenna in one picture, in words and as a debug picture."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

    from vbaa_calib.detect.whisker.centreline import Centreline
    from vbaa_calib.rig import Rig
    from vbaa_calib.session import Frame

SUFFIXES = (".png", ".jpg", ".jpeg")


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `vbaa look`."""
    parser.add_argument("image", type=Path, help="a picture of the antenna, at the size that the rig was calibrated at")
    parser.add_argument("--rig", type=Path, required=True, help="rig.json, as vbaa calibrate writes it")
    parser.add_argument("--pan", type=float, default=0.0, metavar="RAD", help="joint angle (default: 0)")
    parser.add_argument("--tilt", type=float, default=0.0, metavar="RAD", help="joint angle (default: 0)")
    parser.add_argument("--background", type=Path, metavar="IMAGE", help="the same view without the antenna: taken off")
    parser.add_argument("-o", "--output", type=Path, metavar="LOOK", help="debug picture to write, .png or .jpg")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Look for the antenna. Returns the verdict and its numbers; the exit code is 0 whatever the verdict.

    Raises InputError for a broken picture or rig, a wrong size or angle, or a file in the way.
    """
    _check(args)

    from estimator.contact.recording import detect, paint
    from vbaa_calib.core.console import say
    from vbaa_calib.core.images import read_gray, read_picture
    from vbaa_calib.detect.drawing.overlay import described
    from vbaa_calib.rig import Rig
    from vbaa_calib.session import Frame, check_pictures

    rig = Rig.load(args.rig)
    given = [args.image] + ([] if args.background is None else [args.background])
    check_pictures(given, rig.camera.image_size, "the rig was calibrated at")
    frame = Frame(image=args.image, pan_rad=args.pan, tilt_rad=args.tilt, moment_Nm=0.0, frame=0, time_s=0.0)
    plane = paint(rig).plane
    picture = plane(read_picture(args.image))
    image = picture if args.background is None else _taken_off(picture, plane(read_picture(args.background)))
    line = detect(rig, frame, image)
    other_way = not line.found and detect(_other_way(rig), frame, image).found
    taken, other = ("brighter", "darker") if rig.image.bright else ("darker", "brighter")
    taken += "" if rig.image.weights is None else " in its colour"
    hint = f"; taken for {other} it is found: is this the rig's picture?" if other_way else ""
    words = f"looked for as {taken} than its surroundings, as the rig says{hint}"
    say(f"verdict  {line.verdict}" + (f": {line.reason}" if line.reason else ""))
    say(f"antenna  {described(line)}")
    say(f"paint    {words}")
    if args.output is not None:
        _write(_drawn(rig, frame, read_gray(args.image), line, words), args.output, args.force)
        say(f"wrote {args.output}")
    return _numbers(line, rig.image.bright, other_way) | {
        "image": str(args.image),
        "picture": None if args.output is None else str(args.output),
    }


def _check(args: argparse.Namespace) -> None:
    import math
    import os

    from vbaa_calib.core.errors import InputError
    from vbaa_calib.core.files import refuse_overwrite

    for name in ("pan", "tilt"):
        value = getattr(args, name)
        if not abs(value) <= 2 * math.pi:
            raise InputError(f"--{name} is {value:g}", where="vbaa look", remedy="give radians, less than a turn")
    if args.output is None:
        return
    if args.output.suffix.lower() not in SUFFIXES:
        raise InputError("is not a .png or .jpg", where=args.output, remedy="the suffix chooses the format")
    if os.path.realpath(args.output) in [os.path.realpath(path) for path in (args.image, args.background) if path]:
        raise InputError("is a picture that is looked at", where=args.output, remedy="take another name")
    refuse_overwrite(args.output, args.force)


def _taken_off(picture: np.ndarray, empty: np.ndarray) -> np.ndarray:
    """(H, W) float32: what is in the picture and not in the empty scene."""
    import numpy as np

    from vbaa_calib.detect.whisker.background import Background

    return Background(empty.astype(np.float32)).subtracted_from(picture)


def _other_way(rig: Rig) -> Rig:
    """The rig with an antenna that is dark instead of bright, or the other way round."""
    from dataclasses import replace

    return replace(rig, image=replace(rig.image, bright=not rig.image.bright))


def _drawn(rig: Rig, frame: Frame, picture: np.ndarray, line: Centreline, paint: str) -> np.ndarray:
    """(H, W, 3) uint8, blue, green, red: the picture with what was seen, over a legend."""
    from estimator.contact.overlay import corridor_of
    from vbaa_calib.detect.drawing.overlay import centreline_picture

    assert frame.image is not None
    joints = f"pan {frame.pan_rad:.3f}, tilt {frame.tilt_rad:.3f} rad"
    return centreline_picture(picture, line, corridor_of(rig, frame), f"{frame.image.name}, {joints}", paint)


def _write(image: np.ndarray, path: Path, force: bool) -> None:
    import cv2

    from vbaa_calib.core.files import replacing

    with replacing(path, force) as temporary:
        temporary.write_bytes(cv2.imencode(path.suffix.lower(), image)[1].tobytes())


def _numbers(line: Centreline, bright: bool, other_way: bool) -> dict[str, Any]:
    """For --json: null where a number does not exist."""
    import numpy as np

    from vbaa_calib.detect.whisker.centreline import Visibility

    measured = len(line.points_px) > 0
    return {
        "verdict": line.verdict,
        "reason": line.reason,
        "seen": line.seen,
        "hidden": float(np.mean(np.asarray(line.visibility) == Visibility.HIDDEN)) if len(line.visibility) else 0.0,
        "points": len(line.points_px),
        "sigma_median_px": float(np.median(line.sigma_px)) if measured else None,
        "end": line.end,
        "end_px": line.end_px.tolist() if np.isfinite(line.end_px).all() else None,
        "amplitude": line.amplitude if measured else None,
        "noise": line.noise if measured else None,
        "breadth": line.breadth if measured else None,
        "bright": bright,
        "found_the_other_way": other_way,
    }
