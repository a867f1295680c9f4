"""`vbaa estimate SESSION --rig rig.json -o contacts.csv`."""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path
from typing import Any

MODELS = ("auto", "elastica", "rod")


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `vbaa estimate`."""
    parser.add_argument("session", type=Path, help="the session folder with recording/ in it")
    parser.add_argument("--rig", type=Path, required=True, help="rig.json of `vbaa calibrate`")
    parser.add_argument("-o", "--output", type=Path, required=True, help="contacts.csv to write")
    parser.add_argument(
        "--model",
        default="auto",
        choices=MODELS,
        help="mechanical model (default: the lowest that suffices)",
    )
    parser.add_argument(
        "--background",
        type=Path,
        metavar="IMAGE",
        help="the same view without the antenna, taken off every picture: where camera and surroundings stand still",
    )
    parser.add_argument(
        "--overlay",
        type=Path,
        metavar="DIR",
        help="folder to write with a picture of every frame that shows what was seen, and index.html to leaf through",
    )


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Estimate every frame of a recording and write contacts.csv."""
    from contextlib import ExitStack

    import numpy as np

    from vbaa_calib.console import progress, say
    from vbaa_calib.errors import InputError
    from vbaa_calib.files import refuse_overwrite
    from vbaa_calib.rig import Rig
    from vbaa_calib.session import check_pictures, load_session, read_recording

    from .estimate import ContactEstimator
    from .overlay_folder import overlaid, refuse_folder
    from .recording import estimate_recording, read_ground
    from .table import ContactRow, write_contacts

    refuse_overwrite(args.output, args.force)
    if args.output.suffix != ".csv":
        raise InputError("is not a .csv", where=args.output, remedy="the suffix chooses the format")
    if args.overlay is not None:
        refuse_folder(args.overlay, args.force)
    session = load_session(args.session)
    rig = Rig.load(args.rig)
    frames = read_recording(session)
    pictures = [frame.image for frame in frames if frame.image is not None]
    check_pictures(pictures, rig.camera.image_size, "the rig was calibrated at")
    estimator = ContactEstimator(rig, args.model)
    ground = None if args.background is None else read_ground(rig, args.background)
    found = progress(estimate_recording(estimator, session, frames, ground), "contacts", len(frames))
    with ExitStack() as stack:
        if args.overlay is not None:
            found = stack.enter_context(overlaid(found, estimator, args.overlay, args.force))
        rows = [ContactRow.of(item.frame.frame, item.frame.time_s, item.contact) for item in found]
    write_contacts(args.output, rows, args.force)
    counts = Counter(row.status for row in rows)
    say(f"{len(rows)} frames: " + ", ".join(f"{count} {status}" for status, count in counts.most_common()))
    located = [row.distance_std_m for row in rows if np.isfinite(row.distance_std_m)]
    if located:
        say(f"contact distance known to {1e3 * float(np.median(located)):.2f} mm (median standard deviation)")
    say(f"wrote {args.output}")
    if args.overlay is not None:
        say(f"wrote {args.overlay}: open {args.overlay / 'index.html'} to see what was seen in each frame")
    return {
        "contacts": str(args.output),
        "overlay": None if args.overlay is None else str(args.overlay),
        "frames": len(rows),
        "status": dict(counts),
        "models": dict(Counter(row.model for row in rows)),
        "distance_std_median_m": float(np.median(located)) if located else None,
    }
