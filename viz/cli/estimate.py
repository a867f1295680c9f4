"""`vbaa estimate SESSION --rig rig.json -o contacts.csv`: a recording to contacts, and a report to read."""

from __future__ import annotations

import argparse
import math
from array import array
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from estimator.contact.recording import Ground
    from estimator.table.contacts import ContactRow
    from vbaa_calib.rig import Rig
    from vbaa_calib.session import Frame, Session

MODELS = ("auto", "paper", "linear", "elastica", "rod")
"""auto and `vbaa_calib.antenna.rungs.RUNGS`, which is not imported for the sake of a quick --help."""
DRIFTS = ("none", "lab", "rough")  # `vbaa_calib.session.DRIFTS`, not imported either
FRICTION_RAD = 0.2
"""The estimator's own, `estimate.FRICTION_RAD`, not imported either."""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `vbaa estimate`."""
    parser.add_argument("session", type=Path, help="the session folder with recording/ in it")
    parser.add_argument("--rig", type=Path, required=True, help="rig.json of `vbaa calibrate`")
    parser.add_argument("-o", "--output", type=Path, required=True, help="contacts.csv to write, or contacts.parquet")
    parser.add_argument(
        "--model",
        default="auto",
        choices=MODELS,
        help="mechanical model (default: the lowest that suffices)",
    )
    parser.add_argument(
        "--friction",
        type=float,
        default=FRICTION_RAD,
        metavar="RAD",
        help="how far friction may turn the force from the antenna's normal, as a standard deviation "
        f"(default: {FRICTION_RAD}); 0: no friction",
    )
    parser.add_argument(
        "--drift",
        choices=DRIFTS,
        help="what may have changed since the calibration (default: as session.yaml says, else as rig.json does)",
    )
    parser.add_argument("--no-moment", action="store_true", help="vision alone: leave the moment readings aside")
    parser.add_argument(
        "--jobs", type=int, metavar="N", help="threads over the frames (default: the processor's cores)"
    )
    parser.add_argument(
        "--background",
        type=Path,
        metavar="IMAGE|auto",
        help="the same view without the antenna, taken off every picture that it lies behind; auto: learnt from the "
        "recording and the pictures of the free antenna, where the background is at rest in them",
    )
    parser.add_argument(
        "--overlay",
        type=Path,
        metavar="DIR",
        help="folder to write with a picture of every frame that shows what was seen, and index.html to leaf through",
    )
    parser.add_argument("--report", type=Path, metavar="PAGE", help="the report's name (default: beside the output)")
    parser.add_argument("--no-report", action="store_true", help="leave the report out")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Estimate every frame of a recording, write contacts.csv, then report.html. Refuses before any work."""
    from estimator.table.files import check_format
    from vbaa_calib.core.console import say
    from vbaa_calib.core.errors import InputError
    from vbaa_calib.core.files import refuse_overwrite
    from vbaa_calib.session import refuse_measured
    from viz.files.outputs import PAGES, refuse_output, report_beside

    if args.no_report and args.report is not None:
        raise InputError("--report and --no-report", where="vbaa estimate", remedy="give one of them")
    refuse_overwrite(args.output, args.force, (args.rig, args.background))
    refuse_measured(args.output, args.session)
    check_format(args.output)
    if args.overlay is not None:
        from estimator.contact.overlay import refuse_folder

        refuse_folder(args.overlay, args.force)
    if args.no_report:
        return {**_estimate(args)[0], "report": None}
    output = report_beside(args.output) if args.report is None else args.report
    refuse_output(output, PAGES, args.force)
    result, ground = _estimate(args)
    from viz.report.make import Sources, make_report

    sources = Sources(args.output, args.rig, args.session, ground=ground, drift=result["drift"])
    title = f"Contacts of the antenna: {args.session.resolve().name}"
    make_report(output, sources, title=title, argv=args.argv, force=args.force)
    say(f"wrote {output}: open it in a browser")
    return {**result, "report": str(output)}


def _estimate(args: argparse.Namespace) -> tuple[dict[str, Any], Ground | None]:
    """contacts.csv; what became of the frames, and what was taken off them."""
    from contextlib import ExitStack
    from dataclasses import replace

    import numpy as np

    from estimator.contact.drift import summary
    from estimator.contact.estimate import ContactEstimator
    from estimator.contact.recording import estimate_recording
    from estimator.contact.shutter import checked
    from estimator.contact.source import free_stills
    from estimator.contact.surroundings import surroundings
    from estimator.table.contacts import ContactRow
    from estimator.table.files import write_contacts
    from vbaa_calib.core.console import progress, say
    from vbaa_calib.rig import Rig
    from vbaa_calib.session import DRIFTS as drifts
    from vbaa_calib.session import check_pictures, load_session

    session, rig = load_session(args.session), Rig.load(args.rig)
    drift = session.drift if args.drift is None else drifts[args.drift]
    rig = rig if drift is None else replace(rig, drift=drift)
    estimator = ContactEstimator(rig, args.model, friction=args.friction, jobs=args.jobs)
    frames = _frames(session, rig, args.no_moment)
    pictures = [frame.image for frame in frames if frame.image is not None]
    check_pictures(pictures, rig.camera.image_size, "the rig was calibrated at")
    ground, words = surroundings(rig, args.background, lambda: [*frames, *free_stills(session, rig)])
    if words:
        say(f"background: {words}")
    statuses, models, std_m = Counter[str](), Counter[str](), array("d")  # all that is kept of the rows

    def rows() -> Iterator[ContactRow]:
        """Of every frame, each drawn into the overlay folder on its way where one is asked for."""
        contacts = estimate_recording(estimator, session, frames, ground)
        found = progress(checked(contacts, session.shutter, rig.camera.image_size[1]), "contacts", len(frames))
        with ExitStack() as stack:
            if args.overlay is not None:
                from estimator.contact.overlay import overlaid

                found = stack.enter_context(overlaid(found, estimator, args.overlay, args.force))
            for item in found:
                row = ContactRow.of(item.frame, item.contact)
                statuses[row.status] += 1
                models[row.model] += 1
                if math.isfinite(row.distance_std_m):
                    std_m.append(row.distance_std_m)
                yield row

    write_contacts(args.output, rows(), args.force)
    say(f"{len(frames)} frames: " + ", ".join(f"{count} {status}" for status, count in statuses.most_common()))
    located = float(np.median(std_m)) if std_m else None
    if located is not None:
        say(f"contact distance known to {1e3 * located:.2f} mm (median standard deviation)")
    changed = summary(estimator.drift)
    if changed["free_frames"]:
        say(
            f"the free antenna, seen in {changed['free_frames']} frames, has moved {changed['picture_px']:.2g} px "
            f"since the calibration, and the sensor's zero by {changed['moment_zero_std']:.2g} std"
        )
    elif rig.drift.of_rig:
        say("no frame shows the free antenna: begin with some, and the rig's drift costs less")
    if changed["beyond"]:
        say(f"warning: {', '.join(changed['beyond'])} changed more than drift does: run vbaa check, or calibrate again")
    say(f"wrote {args.output}")
    if args.overlay is not None:
        say(f"wrote {args.overlay}: open {args.overlay / 'index.html'} to see what was seen in each frame")
    result = {
        "contacts": str(args.output),
        "overlay": None if args.overlay is None else str(args.overlay),
        "frames": len(frames),
        "status": dict(statuses),
        "models": dict(models),
        "distance_std_median_m": located,
        "drift": changed,
        "background": words or None,
    }
    return result, ground


def _frames(session: Session, rig: Rig, no_moment: bool) -> list[Frame]:
    """The frames of the recording, without their moments where these are not to be used, and a word about that."""
    from dataclasses import replace

    import numpy as np

    from vbaa_calib.core.console import say
    from vbaa_calib.session import read_recording

    frames = read_recording(session)
    if no_moment:
        return [replace(frame, moment_Nm=np.nan, moment_z_Nm=np.nan) for frame in frames]
    silent = sum(np.isnan(frame.moment_Nm) for frame in frames)
    if silent:
        say(f"{silent} of {len(frames)} frames have no moment reading: vision alone there")
    if rig.second_moment_sensor is None and not all(np.isnan(frame.moment_z_Nm) for frame in frames):
        say("moment_z_Nm is left aside: rig.json has no second_moment_sensor")
    return frames
