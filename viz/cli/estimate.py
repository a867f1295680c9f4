"""`vbaa estimate SESSION --rig rig.json -o contacts.csv`: a recording to contacts, and a report to read."""

from __future__ import annotations

import argparse
import math
import re
from array import array
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from vbaa_calib.cli.options import add_accept_rig, usable_rig
from vbaa_calib.core.console import progress, say
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import refuse_overwrite
from viz.files.outputs import PAGES, refuse_output, report_path

from . import streams

if TYPE_CHECKING:
    from estimator.contact.contacts import Contacts
    from estimator.contact.estimate import ContactEstimator
    from estimator.contact.inputs import Batch
    from estimator.contact.recording import FrameContact, Ground
    from estimator.contact.source import Source
    from estimator.table.contacts import ContactRow, ContactTable
    from vbaa_calib.core.errors import Verdict
    from vbaa_calib.rig import Rig
    from vbaa_calib.session import Drift, Frame

MODELS = ("auto", "paper", "linear", "elastica", "rod")
"""auto and `vbaa_calib.antenna.rungs.RUNGS`, which is not imported for the sake of a quick --help."""
DRIFTS = ("none", "lab", "rough")  # `vbaa_calib.session.DRIFTS`, not imported either
FRICTION_RAD = 0.2
"""The estimator's own, `estimate.FRICTION_RAD`, not imported either."""


def add_estimator_options(parser: argparse.ArgumentParser, *, learns_background: bool = True) -> None:
    """Add the options of the estimator itself, which `estimate`, `live` and `batch` share."""
    parser.add_argument(
        "--model", default="auto", choices=MODELS, help="mechanical model (default: the lowest that suffices)"
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
    parser.add_argument(
        "--track-zero", action="store_true", help="follow the moment sensor's zero by the free frames as they pass"
    )
    add_accept_rig(parser)
    parser.add_argument("--no-moment", action="store_true", help="vision alone: leave the moment readings aside")
    learnt = "; auto: learnt from the recording and the free antenna's pictures, where the background does not move"
    parser.add_argument(
        "--background",
        type=Path,
        metavar="IMAGE|auto" if learns_background else "IMAGE",
        help="the same view without the antenna, subtracted from every picture" + learnt * learns_background,
    )


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "session",
        type=Path,
        nargs="?",
        help="the session folder with recording/ in it; a ROS bag, an .mcap, a video, or a table of pictures",
    )
    parser.add_argument(
        "--centrelines",
        type=Path,
        metavar="FILE",
        help="in place of a session: the antenna's pixels, frame,u_px,v_px[,sigma_px], from one's own tracker, or as "
        "DeepLabCut, WhiskerToolbox, whisk or NWB have them; --readings: frame,time_s,pan_rad,tilt_rad[,moment_Nm]",
    )
    parser.add_argument("--line", metavar="NAME", help="which of several lines or individuals there is the antenna")
    parser.add_argument("--rate", type=float, metavar="HZ", help="frames a second, where --readings do not say when")
    parser.add_argument("--rig", type=Path, required=True, help="rig.json of `vbaa calibrate`")
    parser.add_argument("-o", "--output", type=Path, required=True, help="contacts.csv to write, or contacts.parquet")
    add_estimator_options(parser)
    parser.add_argument(
        "--two",
        action="store_true",
        help="search frames that no single contact explains for two, half a second each: both are rows, by the column "
        "contact",
    )
    parser.add_argument(
        "--jobs", type=int, metavar="N", help="threads over the frames (default: the processor's cores)"
    )
    parser.add_argument(
        "--overlay",
        type=Path,
        metavar="DIR",
        help="folder to write with a picture of every frame that shows what was seen, and index.html to leaf through",
    )
    parser.add_argument("--report", type=Path, metavar="PAGE", help="the report's name (default: beside the output)")
    parser.add_argument("--no-report", action="store_true", help="leave the report out")
    streams.configure(parser)
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> dict[str, Any]:
    """Estimate every frame of a recording, write contacts.csv, then report.html. Refuses before any work.

    The exit code is 1 where the verdict on the recording is wrong.
    """
    from estimator.table.files import check_format
    from vbaa_calib.session import refuse_measured

    if args.no_report and args.report is not None:
        raise InputError("--report contradicts --no-report", where="vbaa estimate", remedy="give one of them")
    if (args.session is None) == (args.centrelines is None):
        remedy = "give a session, a bag or a video, or --centrelines"
        raise InputError("exactly one recording is needed", where="vbaa estimate", remedy=remedy)
    if args.line is not None and args.centrelines is None:
        raise InputError("--line is for --centrelines", where="vbaa estimate", remedy="leave it out")
    if args.rate is not None and (args.centrelines is None or args.readings is not None or not 0.0 < args.rate < 1e9):
        raise InputError("--rate is for --centrelines without --readings", where="vbaa estimate", remedy="leave it out")
    if args.clock_offset != "0" and (args.session is None or _is_session(args.session)):
        remedy = "leave it out: here every reading stands beside its picture"
        raise InputError("--clock-offset is for a bag, a video or a table of pictures", remedy=remedy)
    inputs = (args.rig, args.background, args.readings, args.centrelines, args.session)
    refuse_overwrite(args.output, args.force, [each for each in inputs if each is None or not each.is_dir()])
    if args.session is not None:
        refuse_measured(args.output, args.session)
    check_format(args.output)
    if args.overlay is not None:
        from estimator.contact.overlay import refuse_folder

        refuse_folder(args.overlay, args.force)
    if args.no_report:
        return {**_estimate(args)[0], "report": None}
    output = report_path(args.output) if args.report is None else args.report
    refuse_output(output, PAGES, args.force)
    result, ground, verdict = _estimate(args)
    from viz.report.make import Sources, make_report

    if len(names := result["antennas"] or ()) > 1:
        plain = [re.sub(r"[^\w.-]", "_", name) for name in names]
        pages = [output.with_name(f"{output.stem}-{name}{output.suffix}") for name in plain]
        for name, page in zip(names, pages, strict=True):
            title = f"Contacts of {name}: {args.centrelines.resolve().name}"
            make_report(page, Sources(args.output, antenna=name), title=title, argv=args.argv, force=args.force)
        say(f"wrote {', '.join(map(str, pages))}")
        return {**result, "report": list(map(str, pages))}
    session = args.session if args.session is not None and _is_session(args.session) else None
    about = {name: result[name] for name in ("drift", "readings")}
    sources = Sources(args.output, args.rig, session, ground=ground, verdict=verdict, **about)
    title = f"Contacts of the antenna: {(args.session or args.centrelines).resolve().name}"
    make_report(output, sources, title=title, argv=args.argv, force=args.force)
    say(f"wrote {output}: open it in a browser")
    return {**result, "report": str(output)}


def _estimate(args: argparse.Namespace) -> tuple[dict[str, Any], Ground | None, Verdict]:
    """Write contacts.csv; returns the frames by status, the corrections that were applied, and the verdict on the
    recording."""
    import numpy as np

    from estimator.contact.drift import drift_in_words, summary
    from estimator.diagnose import RecordingVerdict, RecordingWatch
    from estimator.diagnose.consequences import changed_row, with_unused
    from estimator.table.contacts import ContactRow
    from estimator.table.files import rewrite_contacts, write_contacts
    from estimator.table.overview import Overview, overview_in_words
    from vbaa_calib.native import core

    rig = usable_rig(args.rig, args.accept_rig)
    unpacking = TemporaryDirectory(prefix="vbaa-overlay-")  # gone with this call
    args.unpacked = Path(unpacking.name)
    estimator, frames = _recording(args, rig)
    source = frames.source
    if frames.words:
        say(f"background: {frames.words}")
    watch, verdict = None if frames.antennas else RecordingWatch(estimator.rig), RecordingVerdict()
    overview = Overview(estimator.rig.columns)
    models, std_m, frame_of, pairs = Counter[str](), array("d"), array("q"), 0
    if args.two and (rig.antenna.taper or frames.antennas):
        what = "--two needs a uniform antenna with a clamp that does not move"
        raise InputError(what, where=args.rig, remedy="leave it out: one contact at a time")

    def tables(parts: Iterable[tuple[slice, Batch, Contacts]], listed: Sequence[Frame]) -> Iterator[ContactTable]:
        """The rows of every frame, many at a time."""
        nonlocal verdict
        counted = (None if at else part for part in parts for at in range(len(part[2])))
        whole = (part for part in progress(counted, "contacts", frames.count) if part is not None)
        assert watch is not None
        for table in watch.followed(whole, listed, overview):
            frame_of.extend(range(len(frame_of), overview.frames))
            models.update(table.model.tolist())
            std_m.extend(table.distance_std_m.tolist())
            yield table
        verdict = with_unused(watch.verdict(), overview.unused, overview.frames)

    def rows() -> Iterator[ContactRow]:
        """The rows of every frame, each drawn into the overlay folder where one is asked for."""
        nonlocal verdict, pairs
        found = progress(frames.items, "contacts", frames.count)
        remarks = list[str]()
        with ExitStack() as stack:
            if args.overlay is not None:
                from estimator.contact.overlay import overlaid

                found = stack.enter_context(overlaid(found, estimator, args.overlay, args.force, remarks))
            for item in found:
                both = [item.contact]
                if args.two and item.contact.status == "failed":
                    both = estimator.measure_two(item.measured)
                    both = both if len(both) > 1 else [item.contact]
                    pairs += len(both) > 1
                if watch is not None:
                    watch.push(item.measured, item.contact)
                for image in (item.frame.image, *item.frame.others.values()):
                    if image is not None and image.parent == args.unpacked:
                        image.unlink()
                row = ContactRow.of(item.frame, both[0])
                if item.clamp is not None:
                    place, angle = item.clamp[:3], float(item.clamp[3])
                    row = replace(row, antenna=item.antenna, clamp_world_m=place, clamp_angle_rad=angle)
                overview.add_readings(item.frame, item.measured, item.contact)
                overview.add_result(row.frame, row.status, row.reason)
                models[row.model] += 1
                for contact, one in enumerate([row, *(ContactRow.of(item.frame, each) for each in both[1:])]):
                    std_m.append(one.distance_std_m)
                    frame_of.append(overview.frames - 1)
                    yield replace(one, contact=contact) if contact else one
            if watch is not None:
                verdict = with_unused(watch.verdict(), overview.unused, overview.frames)
            remarks += verdict.verdict.lines

    together = None if args.overlay is not None or args.two else source.together(estimator)
    found = rows() if together is None else tables(together, source.frames)
    write_contacts(args.output, found, args.force)
    if verdict.concerns_any:
        rewrite_contacts(args.output, lambda row, *which: changed_row(verdict, frame_of[row], *which))
        overview.amend(partial(changed_row, verdict))
    for words in verdict.verdict.lines:
        say(words)
    notes, counts = ((), {}) if source.stream is None else (source.stream.notes, source.stream.counts)
    for note in (*notes, *overview.outside_in_words(rig.camera.image_size)):
        say(note)
    numbers = overview.numbers()
    for words in overview_in_words(numbers):
        say(words)
    if args.two:
        say(f"two contacts in {pairs} frames: a row each, contact 0 and 1")
    known = [std for row, std in enumerate(std_m) if math.isfinite(std) and not verdict.concerns(frame_of[row])]
    located = core.search.median(np.array(known)) if known else None
    if located is not None:
        say(f"contact distance known to {1e3 * located:.2f} mm (median standard deviation)")
    drift = summary(estimator.drift)
    for words in drift_in_words(drift, watched=estimator.rig.drift.of_rig):
        say(words)
    say(f"wrote {args.output}")
    if args.overlay is not None:
        say(f"wrote {args.overlay}: open {args.overlay / 'index.html'} to see what was seen in each frame")
    result = {
        "contacts": str(args.output),
        "overlay": None if args.overlay is None else str(args.overlay),
        "frames": overview.frames,
        "verdict": verdict.verdict.to_dict(),
        **numbers,
        "models": dict(models),
        "pairs": pairs,
        "distance_std_median_m": located,
        "drift": drift,
        "background": frames.words or None,
        "stream": dict(counts) or None,
        "antennas": list(frames.antennas) or None,
        "outside_points": overview.outside["points"],
        "outside_frames": overview.outside["frames"],
        "exit_code": int(verdict.verdict.severity == "wrong"),
    }
    return result, frames.ground, verdict.verdict


@dataclass(frozen=True, eq=False)
class _Recording:
    """A recording with its frames, estimated on demand, their number if known, and the background with words on it;
    where clamps move, the antennas' names."""

    source: Source
    items: Iterable[FrameContact]
    count: int | None
    ground: Ground | None = None
    words: str = ""
    antennas: Sequence[str] = ()


def _is_session(path: Path) -> bool:
    from vbaa_calib.core.files import is_recorded

    return not is_recorded(path)


def _estimator(args: argparse.Namespace, rig: Rig, drift: Drift | None) -> ContactEstimator:
    from estimator.contact.estimate import ContactEstimator
    from vbaa_calib.session import drift_of

    rig = replace(rig, drift=drift_of(args.drift, drift, rig.drift, track_zero=args.track_zero))
    return ContactEstimator(rig, args.model, friction=args.friction, jobs=args.jobs)


def _recording(args: argparse.Namespace, rig: Rig) -> tuple[ContactEstimator, _Recording]:
    """The recording, with the estimator of its drift. Raises InputError."""
    from estimator.contact.source import estimate_source

    if args.centrelines is not None and rig.clamp is not None:
        return _of_moving_clamps(args, rig)
    source = _source(args, rig)
    estimator = _estimator(args, rig, source.drift)
    if source.stream is None and not args.no_moment:
        _say_silent(source.frames, rig)
    ground, words = None, ""
    if args.background is not None:
        from estimator.contact.surroundings import surroundings  # loads OpenCV

        with TemporaryDirectory(prefix="vbaa-stills-") as folder:
            ground, words = surroundings(estimator.rig, args.background, lambda: source.stills(rig, Path(folder)))
    source = source.clocked(estimator, ground)
    for line in () if source.stream is None else source.stream.clocks:
        say(line)
    items = estimate_source(estimator, source, ground, args.unpacked if args.overlay else None)
    count = len(source.frames) if source.stream is None else None
    return estimator, _Recording(source, items, count, ground, words)


def _source(args: argparse.Namespace, rig: Rig) -> Source:
    """The recording of a session, a stream, or centrelines. Raises InputError."""
    from estimator.contact.source import Source, open_source
    from vbaa_calib.session import centrelines_of, without_moments

    if args.centrelines is not None:
        if args.background is not None:
            raise InputError("--background is for pictures only", where="vbaa estimate", remedy="leave it out")
        lines = centrelines_of(args.centrelines, args.line, tuple(rig.cameras) if rig.others else ())
        frames = streams.frames_of(args, {"": lines, **lines.others})
        return Source(None, without_moments(frames) if args.no_moment else frames, lines)
    if _is_session(args.session):
        if args.readings is not None:
            what = "--readings belongs to a bag, a video or --centrelines"
            raise InputError(what, where="vbaa estimate", remedy="a session's readings are in recording/recording.csv")
        return open_source(args.session, rig, args.no_moment)
    return Source(None, (), None, streams.stream_of(args, args.session, rig, streams.timing_of(args)))


def _of_moving_clamps(args: argparse.Namespace, rig: Rig) -> tuple[ContactEstimator, _Recording]:
    """The recording of antennas with moving clamps, by centrelines of all that both file and rig have. Raises
    InputError."""
    from estimator.contact.moving_clamp import clamp_tracks, estimate_antennas
    from estimator.contact.source import Source
    from vbaa_calib.session import antennas_of

    for name in ("background", "overlay"):
        if getattr(args, name) is not None:
            what = f"--{name} is for pictures; there are only lines"
            raise InputError(what, where="vbaa estimate", remedy="leave it out")
    lines = antennas_of(args.centrelines, args.line)
    frames = streams.frames_of(args, lines)
    if len(lines) == len(rig.antennas) == 1:
        lines = dict(zip(rig.antennas, lines.values(), strict=True))
    known = {name: each for name, each in lines.items() if not rig.antennas or name in rig.antennas}
    if not known:
        what = f"has lines of {', '.join(lines)}, the rig antennas {', '.join(rig.antennas)}"
        raise InputError(what, where=args.centrelines, remedy="give the antennas in the rig the names of the lines")
    if left := sorted(lines.keys() - known.keys()):
        say(f"left out, as the rig does not have them: {', '.join(left)}")
    tracks = clamp_tracks(rig, frames, known)
    for name, track in tracks.items():
        say(f"{name}: {track.words}")
    items = estimate_antennas(tracks, frames, known, model=args.model, friction=args.friction)
    estimator = _estimator(args, replace(rig, clamp=None, antennas={}), None)
    return estimator, _Recording(Source(None, frames), items, len(frames) * len(known), antennas=list(known))


def _say_silent(frames: Sequence[Frame], rig: Rig) -> None:
    """Print a warning about readings that are missing or not used."""
    import numpy as np

    from vbaa_calib.session import READINGS
    from vbaa_calib.session.tables import numbers_of

    silent = int(np.isnan(numbers_of(frames, "moment_Nm")).sum())
    if not rig.columns:
        say("vision alone: the rig has no moment sensor" + ", moment_Nm is left aside" * (silent < len(frames)))
    elif silent and rig.columns == ("moment_Nm",):
        say(f"{silent} of {len(frames)} frames have no moment reading: vision alone there")
    others = [name for name in list(READINGS.values())[1:] if name not in rig.columns]
    unused = [name for name in others if not np.isnan(numbers_of(frames, name)).all()]
    if unused:
        say(f"{', '.join(unused)} {'is' if len(unused) == 1 else 'are'} not used: rig.json has no such sensor")
