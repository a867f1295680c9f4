"""`vbaa look`: the antenna's detection in one picture, in words and as a debug picture."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from vbaa_calib.cli.options import add_joints, pan_tilt_rad, usable_rig
from vbaa_calib.core.console import say
from vbaa_calib.core.files import replacing
from viz.files.outputs import refuse_output


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("image", type=Path, help="a picture of the antenna, at the size that the rig was calibrated at")
    parser.add_argument("--rig", type=Path, required=True, help="rig.json, as vbaa calibrate writes it")
    add_joints(parser)
    parser.add_argument(
        "--background",
        type=Path,
        metavar="IMAGE|auto",
        help="the same view without the antenna: taken off; auto: learnt from the pictures beside this one",
    )
    parser.add_argument("-o", "--output", type=Path, metavar="LOOK", help="debug picture to write, .png or .jpg")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> dict[str, Any]:
    """Detect the antenna. Returns the result and its numbers; the exit code is 0 whatever the result.

    Raises InputError for a broken picture or rig, a wrong size or angle, or a file in the way.
    """
    pan, tilt = pan_tilt_rad(args)
    if args.output is not None:
        refuse_output(args.output, (".png", ".jpg", ".jpeg"), args.force, (args.image, args.background))

    import cv2
    import numpy as np

    from estimator.contact.overlay import corridor_of
    from estimator.contact.recording import prepared, subtracted
    from estimator.contact.surroundings import AUTO, neighbours, surroundings
    from vbaa_calib.core.images import read_gray, read_picture
    from vbaa_calib.detect.drawing.overlay import centreline_picture, described
    from vbaa_calib.detect.whisker.acceptance import Cause, stretches, why_lost
    from vbaa_calib.detect.whisker.centreline import NOTHING, Visibility
    from vbaa_calib.detect.whisker.paint import without_other_things
    from vbaa_calib.session import Frame, check_pictures

    rig = usable_rig(args.rig)
    pictures = [path for path in (args.image, args.background) if path not in (None, AUTO)]
    check_pictures(pictures, rig.camera.image_size, "the rig was calibrated at")
    frame = Frame(image=args.image, pan_rad=pan, tilt_rad=tilt, moment_Nm=0.0, frame=0, time_s=0.0)
    plane, own = rig.image.paint.plane, read_picture(args.image)
    plain = plane(own)
    ground, ground_words = surroundings(rig, args.background, lambda: neighbours(rig, frame))
    looking = prepared(rig, frame)
    less = None if ground is None or looking is None else subtracted(looking, plain, ground(frame, rig.camera_name))
    if ground is not None and less is None:
        ground_words = "left aside, since it does not lie behind the antenna in this picture"
    line = NOTHING if less is None else less[1]
    if looking is not None:
        if less is None:
            line = rig.image.paint.find(looking, own, plain)
        line = without_other_things(own, line, rig.image.looks, looking.corridor.width_px, rig.image.paint)
    # an antenna that is dark instead of bright, the other way round, or here this and there that
    words_of = {True: "brighter", False: "darker", None: "here brighter, there darker"}
    bright = rig.image.paint.bright
    others = [] if line.found or bright is None else [not bright, None]
    paints = {words_of[other]: replace(rig.image.paint, bright=other, both_edges=False) for other in others}
    opposite = None
    if looking is not None:
        opposite = next((words for words, paint in paints.items() if paint.find(looking, own, plain).found), None)
    other_way, taken = opposite is not None, words_of[rig.image.paint.bright]
    hint = f"; taken for {opposite} it is found: is this the rig's picture?" if other_way else ""
    words = f"looked for as {taken} than its surroundings, as the rig says{hint}"
    where = corridor_of(rig, frame)
    parts = [] if where is None else stretches(plain, line, where, rig.image.paint.polarity)
    lost, change = why_lost(parts)
    say(f"verdict  {line.verdict}" + (f": {line.reason}" if line.reason else ""))
    say(f"antenna  {described(line)}")
    if lost:
        say(f"not seen {lost}")
        say(f"remedy   {change}")
    if ground_words:
        say(f"behind   {ground_words}")
    say(f"paint    {words}")
    if args.output is not None:
        pose = f"{args.image.name}, pan {pan:.3f}, tilt {tilt:.3f} rad"
        drawn = centreline_picture(
            read_gray(args.image), line, where, (pose, lost, change and f"remedy: {change}", words), parts
        )
        with replacing(args.output, args.force) as temporary:
            temporary.write_bytes(cv2.imencode(args.output.suffix.lower(), drawn)[1].tobytes())
        say(f"wrote {args.output}")
    measured = len(line.points_px) > 0
    return {
        "verdict": line.verdict,
        "reason": line.reason,
        "seen": line.seen,
        "hidden": float(np.mean(np.asarray(line.visibility) == Visibility.HIDDEN)) if len(line.visibility) else 0.0,
        "not_seen": [
            {"start": part.start, "end": part.end, "cause": part.cause.name.lower(), "words": part.cause.words}
            for part in parts
            if part.cause is not Cause.SEEN
        ],
        "points": len(line.points_px),
        "sigma_median_px": float(np.median(line.sigma_px)) if measured else None,
        "end": line.end,
        "end_std_px": None if np.isnan(line.end_std_px) else line.end_std_px,
        "end_px": line.end_px.tolist() if np.isfinite(line.end_px).all() else None,
        "amplitude": line.amplitude if measured else None,
        "noise": line.noise if measured else None,
        "breadth": line.breadth if measured else None,
        "bright": rig.image.bright,
        "found_the_other_way": other_way,
        "background": ground_words or None,
        "image": str(args.image),
        "picture": None if args.output is None else str(args.output),
    }
