"""What workers do: each function is one task of dask, and gives the same when it is done again."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import vbaa_calib
from estimator.contact.contacts import MovingContacts
from estimator.contact.drift import LearntRig, summary
from estimator.contact.estimate import ContactEstimator
from estimator.contact.pieces import Judged, Seen, cuts, judge, learn, look, rows, solve
from estimator.contact.recording import Ground
from estimator.contact.source import (
    Source,
    StreamOptions,
    inputs_digest,
    is_stream,
    open_source,
    recording_files,
)
from estimator.contact.surroundings import AUTO, surroundings
from estimator.table.files import write_contacts
from vbaa_calib.core.errors import clipped, sentence_of
from vbaa_calib.core.files import sha256
from vbaa_calib.rig import Rig
from vbaa_calib.session import drift_of

from .recordings import Recording
from .results import Results, Row


@dataclass(frozen=True)
class Settings:
    """What is to be done with every recording: the options of `vbaa estimate`, and of the batch.

    piece : frames of a recording that are one task, at most. threads : of each task's kernels.
    again : do also what is done and unchanged.
    """

    model: str = "auto"
    friction: float = 0.2
    drift: str | None = None
    track_zero: bool = False
    no_moment: bool = False
    background: Path | None = None
    streams: StreamOptions = field(default_factory=StreamOptions)
    reconstruct: bool = False
    piece: int = 16384
    threads: int = 1
    again: bool = False

    def said(self, path: Path) -> dict[str, Any]:
        """What of it the contacts of a recording depend on."""
        names = ("model", "friction", "drift", "track_zero", "no_moment")
        pixels = None if self.background is None else str(self.background)
        if self.background is not None and self.background != AUTO:
            pixels = sha256(self.background)
        said = {name: getattr(self, name) for name in names} | {"background": pixels}
        return said | {"streams": asdict(self.streams)} if is_stream(path) else said


@dataclass(frozen=True, eq=False)
class Opened:
    """A recording that was opened, or one piece of it.

    source, piece : the frames that are here, with those before the piece where its pictures may need them; which of
        them are the piece.
    count : frames of the recording. about : how its summary begins.
    """

    recording: Recording
    settings: Settings
    results: Results
    source: Source
    piece: slice
    rig: Rig
    ground: Ground | None
    about: Row
    count: int

    def estimator(self) -> ContactEstimator:
        return ContactEstimator(
            self.rig, self.settings.model, friction=self.settings.friction, jobs=self.settings.threads
        )

    @property
    def pieces(self) -> list[slice]:
        """Where the recording is cut."""
        return cuts(self.count, self.settings.piece) if self.source.divisible else [slice(0, self.count)]


_FRAME_BYTES = 4096
"""About what is kept of a frame while its recording is worked on."""


@dataclass(frozen=True, eq=False)
class Fitted:
    """A piece whose frames were looked at and, once `found` is there, fitted; and the processor's seconds for it."""

    seen: Seen
    learnt: LearntRig | None = None
    found: Sequence[MovingContacts] = ()
    cpu_s: float = 0.0

    def __sizeof__(self) -> int:
        # dask does the rest of the work where such large things lie; by itself Python counts only the references
        return _FRAME_BYTES * len(self.seen.frames)


@dataclass(frozen=True)
class Piece:
    """The file of a piece's rows, and what it took: the processor's seconds."""

    path: Path
    cpu_s: float


@dataclass(frozen=True)
class Outcome:
    """What became of a recording: `state` is done, unchanged, failed, long, whole: not in pieces after all, or
    opened: to be done in so many pieces, whose rig changes are learnt one after the other where it `learns`."""

    name: str
    state: str
    row: Row
    pieces: int = 1
    learns: bool = False


def do(recording: Recording, settings: Settings, results: Results) -> Outcome:
    """A whole recording, unless it is done already or long. What is wrong with it is told in its row."""
    try:
        _one_thread_each(settings.threads)
        about = _about(recording, settings)
        before = None if settings.again else results.done(recording.name)
        if before is not None and before["digest"] == about["digest"]:
            return _with_object(Outcome(recording.name, "unchanged", before), recording, settings, results)
        if _rows(recording) > settings.piece:
            return Outcome(recording.name, "long", about)
        opened = _opened(recording, settings, results, about)
        if opened.source.divisible and opened.count > settings.piece:
            return Outcome(recording.name, "long", about)
        return do_opened(opened)
    except Exception as error:
        return failed(recording, error)


def do_opened(opened: Opened) -> Outcome:
    """A recording in one piece. Raises what is wrong with it."""
    fitted = fit(opened)
    piece = file_of(opened, 0, fitted, (None, judge_piece(opened, fitted, None), None))
    return finish(opened, [piece], fitted.learnt)


def open_long(recording: Recording, settings: Settings, results: Results) -> Opened:
    """A long recording, for its pieces. Raises what is wrong with it."""
    opened = _opened(recording, settings, results, _about(recording, settings))
    source = opened.source.skimmed()
    count = len(source.frames)
    return replace(opened, source=source, piece=slice(0, count), count=count)


def parts_of(opened: Opened) -> Outcome:
    """In how many pieces it is to be done."""
    return Outcome(opened.recording.name, "opened", opened.about, len(opened.pieces), opened.rig.drift.of_rig)


def head_of(opened: Opened) -> Opened:
    """All but frames and pictures: what is needed at the end."""
    return replace(opened, source=replace(opened.source, frames=(), places=(), lines=None), ground=None)


def piece_of(opened: Opened, index: int) -> Opened:
    """What one piece needs, and no more."""
    piece, source = opened.pieces[index], opened.source
    if source.lines is None:
        source = replace(source, frames=source.frames[: piece.stop], places=source.places[: piece.stop])
        return replace(opened, source=source, piece=piece)
    frames = source.frames[piece]
    lines = source.lines.picked([frame.frame for frame in frames])
    return replace(opened, source=replace(source, frames=frames, lines=lines), piece=slice(0, len(frames)))


def fit(opened: Opened) -> Fitted:
    """A piece of a recording whose rig is as it was calibrated, or all of any recording."""
    seen = look_at(opened)
    return solve_for(opened, seen, learn_from(opened, seen, None))


def look_at(opened: Opened) -> Fitted:
    """What a piece shows."""
    begun = time.process_time()
    seen = look(opened.estimator(), opened.source, opened.piece, opened.ground)
    return Fitted(seen, cpu_s=time.process_time() - begun)


def learn_from(opened: Opened, seen: Fitted, before: Sequence[LearntRig] | None) -> list[LearntRig]:
    """How the rig has changed at each batch of a piece."""
    return learn(opened.estimator(), seen.seen, None if before is None else before[-1])


def solve_for(opened: Opened, seen: Fitted, learnt: Sequence[LearntRig]) -> Fitted:
    """A piece's contacts, not yet tested for motion."""
    begun = time.process_time()
    found = solve(opened.estimator(), seen.seen, learnt)
    return replace(seen, learnt=learnt[-1], found=found, cpu_s=seen.cpu_s + time.process_time() - begun)


def judge_piece(opened: Opened, fitted: Fitted, before: Judged | None) -> Judged:
    """The motion in a piece, from that in the one before it."""
    return judge(opened.rig, opened.source.shutter, fitted.seen, fitted.found, before)


def file_of(opened: Opened, index: int, fitted: Fitted, judged: Sequence[Judged | None]) -> Piece:
    """The file of a piece's rows; `judged` (3,) : the motion in the piece before it, its own, and in the next."""
    begun = time.process_time()
    path = opened.results.piece(opened.recording.name, str(opened.about["digest"]), index)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_contacts(path, rows(opened.rig, opened.source.shutter, fitted.seen, fitted.found, judged), force=True)
    return Piece(path, fitted.cpu_s + time.process_time() - begun)


def learnt_of(fitted: Fitted) -> LearntRig | None:
    """How the rig has changed by the end of a piece."""
    return fitted.learnt


def finish(opened: Opened, pieces: Sequence[Piece], learnt: LearntRig | None) -> Outcome:
    """The recording's contacts, object and summary."""
    recording, results = opened.recording, opened.results
    assert learnt is not None
    changed = summary(learnt)
    row = {
        **opened.about,
        "free_frames": changed["free_frames"],
        "drift_picture_px": changed["picture_px"],
        "drift_moment_zero_std": changed["moment_zero_std"],
        "drift_beyond": changed["beyond"],
        "warnings": _warnings(opened, changed),
        "pieces": len(pieces),
        "cpu_s": sum(piece.cpu_s for piece in pieces),
    }
    results.object(recording.name).unlink(missing_ok=True)  # it is no longer these contacts'
    row = dict(results.join(recording.name, [piece.path for piece in pieces], row))
    results.forget(recording.name, str(row["digest"]))
    return _with_object(Outcome(recording.name, "done", row), recording, opened.settings, results)


def _with_object(outcome: Outcome, recording: Recording, settings: Settings, results: Results) -> Outcome:
    """With the object's file, where it is asked for and not there."""
    path = results.object(recording.name)
    if not settings.reconstruct or path.exists():
        return outcome
    from estimator.contact.common_errors import shared_errors
    from estimator.object.surface import reconstruct, touches_of
    from estimator.table.files import read_contacts
    from viz.files.object_file import write_object

    table, rig = read_contacts(results.contacts(recording.name)), Rig.load(recording.rig)
    if not table.located.any():
        return outcome
    path.parent.mkdir(parents=True, exist_ok=True)
    write_object(
        reconstruct(touches_of(table, shared_errors(rig, table)), rig.antenna.diameter_m / 2), path, force=True
    )
    return outcome


def failed(recording: Recording, error: BaseException) -> Outcome:
    """A recording of which nothing came, and why."""
    unknown = f"something went wrong that should not ({type(error).__name__}: {clipped(str(error))})"
    sentence = sentence_of(error) or unknown
    row = {"recording": recording.name, "state": "failed", "sentence": sentence}
    row |= {"path": str(recording.path), "rig": str(recording.rig), "version": vbaa_calib.__version__}
    return Outcome(recording.name, "failed", row)


def _about(recording: Recording, settings: Settings) -> Row:
    """How a summary begins: what the recording is, and the digests of all that its contacts depend on."""
    rig_sha256, inputs_sha256 = sha256(recording.rig), inputs_digest(recording.path)
    about = {"rig_sha256": rig_sha256, "inputs_sha256": inputs_sha256, "version": vbaa_calib.__version__}
    whole = json.dumps([about, settings.said(recording.path)], sort_keys=True).encode()
    return {
        "recording": recording.name,
        "state": "done",
        "path": str(recording.path),
        "rig": str(recording.rig),
        **about,
        "digest": hashlib.sha256(whole).hexdigest(),
    }


def _rows(recording: Recording) -> int:
    """Lines of recording.csv, quickly; 0 where there is none."""
    tables = [file for file in recording_files(recording.path) if file.name == "recording.csv"]
    return tables[0].read_bytes().count(b"\n") - 1 if tables else 0


def _opened(recording: Recording, settings: Settings, results: Results, about: Row) -> Opened:
    rig = Rig.load(recording.rig)
    source = open_source(recording.path, rig, settings.no_moment, settings.streams)
    rig = replace(rig, drift=drift_of(settings.drift, source.drift, rig.drift, track_zero=settings.track_zero))
    with TemporaryDirectory(prefix="vbaa-stills-") as folder:
        ground, _ = surroundings(rig, settings.background, lambda: source.stills(rig, Path(folder)))
    opened = Opened(recording, settings, results, source, slice(0, source.count), rig, ground, about, source.count)
    if source.stream is None:
        return opened
    return replace(opened, source=replace(source, stream=source.stream.clocked(opened.estimator(), ground)))


def _warnings(opened: Opened, changed: dict[str, Any]) -> list[str]:
    warnings = []
    if opened.rig.drift.of_rig and not changed["free_frames"]:
        warnings.append("no frame shows the free antenna")
    if changed["beyond"]:
        warnings.append(f"{', '.join(changed['beyond'])} changed more than drift does: run vbaa check")
    return [*warnings, *opened.source.notes]


def _one_thread_each(threads: int) -> None:
    """OpenCV takes all cores by itself: so many threads only, so that processes and threads use the cores once."""
    import cv2

    cv2.setNumThreads(threads)
