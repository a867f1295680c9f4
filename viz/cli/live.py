"""`vbaa live RIG SOURCE`: estimates contacts from pictures and readings as they come."""

from __future__ import annotations

import argparse
import gc
import math
import os
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from vbaa_calib.cli.options import usable_rig
from vbaa_calib.core.console import say
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_bytes, refuse_input

from . import streams
from .estimate import add_estimator_options

if TYPE_CHECKING:
    from estimator.contact.estimate import ContactEstimator
    from estimator.contact.recording import Ground
    from estimator.live import LiveContact, LiveEstimator
    from estimator.live.outputs import ContactBag, Datagrams, GrowingTable
    from vbaa_calib.streams import MessageSource, Timing
    from viz.files.rerun_log import RerunLog

    _Sink: TypeAlias = "ContactBag | Datagrams | GrowingTable | RerunLog"


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("rig", type=Path, help="rig.json of `vbaa calibrate`")
    parser.add_argument(
        "source",
        help="camera:0, /dev/video0, rtsp://host/path, a folder that fills up, a ROS bag, an .mcap, a video, a table "
        "of pictures, or - for JSON lines on standard input",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FILE",
        help="contacts.csv, which grows as contacts come; contacts.parquet is written at the end, and "
        "contacts.parquet.csv grows until then",
    )
    parser.add_argument("--lines", action="store_true", help="contacts as JSON lines on standard output")
    parser.add_argument("--udp-out", metavar="[HOST:]PORT", help="where contacts are sent as JSON lines, by UDP")
    parser.add_argument("--bag", type=Path, metavar="FILE", help="contacts as ROS messages, in an .mcap file or a bag")
    parser.add_argument(
        "--rerun",
        nargs="?",
        const="spawn",
        metavar="TARGET",
        help="show it in Rerun: alone, in a viewer that is opened; a URL, in one that runs; or a file.rrd to write",
    )
    parser.add_argument("--udp", metavar="[HOST:]PORT", help="where readings come in as JSON lines, by UDP")
    parser.add_argument(
        "--udp-key", type=Path, metavar="FILE", help="a secret that signs them: all others are left out (HMAC-SHA256)"
    )
    add_estimator_options(parser, learns_background=False)
    streams.add_watch(parser)
    parser.add_argument("--no-final", action="store_true", help="only what is known at once, in half the solver's time")
    parser.add_argument(
        "--idle", type=float, default=10.0, metavar="S", help="a folder or standard input silent for so long has ended"
    )
    streams.configure(parser)
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> dict[str, Any]:
    """Estimate a stream until it ends or is interrupted. Returns the summary; the exit code is 1 where the verdict
    on the recording is wrong. Raises InputError before any work."""
    from estimator.contact.estimate import ContactEstimator
    from estimator.contact.surroundings import AUTO, surroundings
    from estimator.diagnose import RigWatch
    from estimator.live import LiveEstimator
    from vbaa_calib.session import drift_of
    from vbaa_calib.streams import Synchronizer

    if not 0.0 < args.idle <= 1e9:
        raise InputError(f"--idle is {args.idle}", where="vbaa live", remedy="give seconds, more than 0")
    if args.background == AUTO:
        remedy = "give a picture without the antenna"
        raise InputError("--background auto needs pictures that are yet to come", where="vbaa live", remedy=remedy)
    if args.lines and args.json:
        raise InputError("--lines and --json both write to stdout", where="vbaa live", remedy="give one of them")
    rig = usable_rig(args.rig, args.accept_rig)
    rig = replace(rig, drift=drift_of(args.drift, rig.drift, track_zero=args.track_zero))
    estimator = ContactEstimator(rig, args.model, friction=args.friction, jobs=1)
    timing = streams.timing_of(args, rig)
    ground, words = surroundings(rig, args.background, list)
    if words:
        say(f"background: {words}")
    with ExitStack() as stack:
        source, timing = _opened(args, estimator, timing, ground)
        # before any output is begun
        source = source if source.live else source.begun()
        sinks = _sinks(args, stack)
        synchronizer = Synchronizer(timing, source.channels, rig.image_sizes, source.notes, source.live)
        watch = None if args.watch is None else RigWatch(rig, waits=not source.live)
        live = LiveEstimator(estimator, synchronizer, ground, final=not args.no_final, watch=watch)
        live.warm()
        # what is there by now stays: looking through it for garbage takes as long as five pictures
        gc.collect()
        gc.freeze()
        say(f"estimating from {source.name}; Ctrl-C ends it")
        monitor = _Monitor(source, live, rig.drift.of_rig, stops=args.watch == "stop")
        _follow(source, live, sinks, monitor, args.lines)
    return monitor.summary(args)


def _opened(
    args: argparse.Namespace, estimator: ContactEstimator, timing: Timing, ground: Ground | None
) -> tuple[MessageSource, Timing]:
    """The named source with its readings, and the timing with the clocks' offset, estimated if asked. Raises
    InputError."""
    from vbaa_calib.core.files import is_recorded
    from vbaa_calib.streams.devices import udp_socket, with_datagrams
    from vbaa_calib.streams.recorded import open_running

    path, key, rig = Path(args.source), _key(args), estimator.rig
    if is_recorded(path) and args.source != "-":
        if args.udp is not None:
            remedy = "give recorded readings with a recorded source: --readings"
            raise InputError("--udp is for live sources", where="vbaa live", remedy=remedy)
        stream = streams.stream_of(args, path, rig, timing).clocked(estimator, ground)
        for words in stream.clocks:
            say(words)
        return stream.opened(), stream.timing
    if streams.ESTIMATE in (args.clock_offset, *(each.rpartition("=")[2] for each in args.camera_offset)):
        remedy = "estimate it from a recording of the same rig (vbaa estimate says it), then state it"
        raise InputError("an offset to be estimated needs a recording", where="vbaa live", remedy=remedy)
    if args.readings is not None:
        remedy = "give live readings with a live source: --udp, or standard input"
        raise InputError("--readings is for recorded sources", where="vbaa live", remedy=remedy)
    listening = None if args.udp is None else udp_socket(args.udp)
    try:
        cameras = list(rig.cameras) if rig.others else []
        running = open_running(args.source, args.idle, cameras, streams.views_of(args, rig))
        source = with_datagrams(running, listening, key)
    except BaseException:
        if listening is not None:
            listening.close()
        raise
    return source.without_moments() if args.no_moment else source, timing


def _key(args: argparse.Namespace) -> bytes | None:
    """The secret of --udp-key. Raises InputError for a short one, and for one that other users can read."""

    path: Path | None = args.udp_key
    if path is None:
        return None
    if args.udp is None:
        raise InputError("--udp-key without --udp", where="vbaa live", remedy="give both, or leave it out")
    key = read_bytes(path, "key", 1 << 20).strip()
    if len(key) < 16:
        remedy = f"write one like this: (umask 077; openssl rand -hex 32 > {path})"
        raise InputError(f"has a key of {len(key)} bytes; 16 are needed", where=path, remedy=remedy)
    if os.name == "posix" and path.stat().st_mode & 0o077:
        raise InputError("other users may read this key", where=path, remedy=f"chmod 600 {path}, and take a new one")
    return key


def _sinks(args: argparse.Namespace, stack: ExitStack) -> list[_Sink]:
    """The outputs of contacts; all are closed, complete, with the stack. Raises InputError for an existing file."""
    from estimator.live.outputs import ContactBag, Datagrams, GrowingTable
    from vbaa_calib.streams.bag_of_session import refuse_bag

    inputs = (args.rig, args.readings, args.background, args.udp_key, Path(args.source))
    if args.bag is not None:
        refuse_input(args.bag, inputs)
        refuse_bag(args.bag, args.force)
    if args.rerun is not None:
        from viz.files.rerun_log import RerunLog, refuse_log

        refuse_log(args.rerun, args.force)
    sinks: list[_Sink] = []
    if args.output is not None:
        sinks.append(GrowingTable(args.output, args.force, inputs, final=not args.no_final))
    if args.bag is not None:
        sinks.append(ContactBag(args.bag))
    if args.udp_out is not None:
        sinks.append(Datagrams(args.udp_out))
    if args.rerun is not None:
        sinks.append(RerunLog(args.rerun, args.force))
    for sink in sinks:
        stack.callback(sink.close)
    return sinks


def _follow(source: MessageSource, live: LiveEstimator, sinks: list[_Sink], monitor: _Monitor, lines: bool) -> None:
    """Send every contact to every output, as JSON lines to standard output, too, until the source ends or Ctrl-C."""
    from estimator.live.outputs import GrowingTable, json_line
    from vbaa_calib.streams import now_s

    def spread(contacts: Iterator[LiveContact]) -> None:
        for contact in contacts:
            for sink in sinks:
                sink.write(contact)
            if lines:
                print(json_line(contact), flush=True)
            monitor.write(contact)

    with _interruptible() as interrupted:
        with closing(source.messages()) as messages:
            for message in messages:
                spread(live.push(message))
                # what waits already may be what a picture waits for
                if source.live and message is None:
                    spread(live.tick(now_s()))
                monitor.news()
                if interrupted or monitor.stopped:
                    break
        # the source is closed by now: what is left takes a moment
        if interrupted or monitor.stopped:
            source.notes.append("interrupted" if interrupted else "stopped by the watch")
        spread(live.finish())
    for sink in sinks:
        if isinstance(sink, GrowingTable):
            sink.verdict = live.verdict.now


@contextmanager
def _interruptible() -> Iterator[list[int]]:
    """Context in which Ctrl-C is only noted, so that nothing is cut off midway; a second one ends it at once."""
    noted: list[int] = []

    def note(number: int, frame: Any) -> None:
        if noted:
            raise KeyboardInterrupt
        noted.append(number)

    if threading.current_thread() is not threading.main_thread():
        yield noted
        return
    before = signal.signal(signal.SIGINT, note)
    try:
        yield noted
    finally:
        signal.signal(signal.SIGINT, before)


@dataclass(eq=False)
class _Monitor:
    """What a person sees while it runs, and the summary at the end."""

    source: MessageSource
    live: LiveEstimator
    watched: bool
    stops: bool = False
    # the frames that quantiles of the latency are of
    latency_s: deque[float] = field(default_factory=lambda: deque(maxlen=100_000))
    amended: int = 0
    next_s: float = 0.0
    begin_s: float = field(default_factory=time.monotonic)
    warned: set[str] = field(default_factory=set)
    at_once: dict[int, str] = field(default_factory=dict)
    reported: int = 0

    def __post_init__(self) -> None:
        from estimator.table.overview import Overview

        self.overview = Overview(self.live.estimator.rig.columns)

    @property
    def stopped(self) -> bool:
        """Whether an alarm ends the run."""
        return self.stops and self.live.watch is not None and bool(self.live.watch.alarms)

    def write(self, contact: LiveContact) -> None:
        frame, own = contact.row.frame, contact.item.contact
        if contact.final:
            self.amended += self.at_once.pop(frame, own.status) != own.status
            return
        self.overview.add_readings(contact.item.frame, contact.item.measured, own)
        self.overview.add_result(frame, own.status, own.reason)
        self.latency_s.append(contact.latency_s)
        if self.live.final:
            self.at_once[frame] = own.status
        for one in contact.alarms:
            say(f"alarm, frame {frame}: {one}")
        self._warn(frame)
        now_s = time.monotonic()
        if now_s >= self.next_s and sys.stderr is not None and sys.stderr.isatty():
            # a line every second
            self.next_s = now_s + 1.0
            self._show(contact, now_s)

    def news(self) -> None:
        """Print the source's notes as they come, and once that the pictures' size has changed."""

        for note in self.source.notes[self.reported :]:
            say(note)
        self.reported = len(self.source.notes)
        other = "pictures of another size"
        if other not in self.warned and self.live.synchronizer.counts[other]:
            self.warned.add(other)
            say(f"warning: {other} than the rig's come, and are left out")

    def _warn(self, frame: int) -> None:
        """Print each diagnosis of the recording once."""

        verdict = self.live.verdict.now.verdict
        for one, words in zip(verdict.findings, verdict.lines, strict=True):
            if one.name not in self.warned:
                self.warned.add(one.name)
                say(f"warning, frame {frame}: {words}")

    def _show(self, contact: LiveContact, now_s: float) -> None:
        row = contact.row
        where = ""
        if math.isfinite(row.distance_m):
            force = 1e3 * math.hypot(row.force_y_N, row.force_z_N)
            where = f" at {1e3 * row.distance_m:.1f} ± {1e3 * row.distance_std_m:.1f} mm"
            where += f", {force:.1f} mN" if math.isfinite(force) else ""
        rate = self.overview.frames / max(now_s - self.begin_s, 1e-3)
        dropped = self.source.dropped()
        late = f"{1e3 * contact.latency_s:.0f} ms"
        print(
            f"\r\x1b[K{row.time_s:.2f} s: {row.status}{where}; {rate:.1f} frames/s, {late} late, {dropped} dropped",
            end="",
            file=sys.stderr,
            flush=True,
        )

    def summary(self, args: argparse.Namespace) -> dict[str, Any]:
        """Print the summary, and return it as numbers."""
        import numpy as np

        from estimator.contact.drift import drift_in_words
        from estimator.diagnose.consequences import changed_row, with_unused
        from estimator.table.overview import overview_in_words

        if self.next_s:
            print(file=sys.stderr)
        synchronizer = self.live.synchronizer
        self.news()
        for note in synchronizer.left_out():
            say(note)
        frames, dropped = self.overview.frames, self.source.dropped()
        verdict = with_unused(self.live.verdict.now, self.overview.unused, frames)
        if verdict.concerns_any:
            self.overview.amend(partial(changed_row, verdict))
        numbers = self.overview.numbers()
        median, late = np.quantile(self.latency_s or [0.0], [0.5, 0.99]).tolist()
        if not frames:
            say("no frames")
        else:
            for words in [*verdict.verdict.lines, *overview_in_words(numbers)]:
                say(words)
            say(
                f"latency {1e3 * median:.1f} ms (median), {1e3 * late:.1f} ms (99 %); pictures dropped: {dropped}; "
                f"contacts amended by later frames: {self.amended}"
            )
        watch = self.live.watch
        alarms = [] if watch is None else [{"frame": frame, **one.to_dict()} for frame, one in watch.alarms]
        drift = self.live.changed()
        for words in drift_in_words(drift, watched=self.watched):
            say(words)
        if not self.watched:
            say("the rig's drift is not watched: --drift none")
        for output in (args.output, args.bag):
            if output is not None:
                say(f"wrote {output}")
        return {
            "source": self.source.name,
            "contacts": None if args.output is None else str(args.output),
            "frames": frames,
            "verdict": verdict.verdict.to_dict(),
            **numbers,
            "amended": self.amended,
            "dropped": dropped,
            "reconnected": self.source.reopened(),
            "latency_p50_s": median if frames else None,
            "latency_p99_s": late if frames else None,
            "stream": dict(synchronizer.counts),
            "drift": drift,
            "alarms": alarms,
            "notes": list(self.source.notes),
            "exit_code": int(verdict.verdict.severity == "wrong" or bool(alarms)),
        }
