"""What workers do: each function is one task of dask, and gives the same when it is done again."""

from __future__ import annotations

import hashlib
import json
import pickle
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import vbaa_calib
from estimator.contact.drift import LearntRig, summary
from estimator.contact.estimate import ContactEstimator
from estimator.contact.inputs import left_out, left_out_words
from estimator.contact.pieces import Lines, Seen, cuts, learn, look, made, seam, solve
from estimator.contact.recording import Ground
from estimator.contact.source import (
    Source,
    StreamOptions,
    inputs_digest,
    is_stream,
    open_source,
    part_index,
    recording_files,
)
from estimator.contact.surroundings import AUTO, surroundings
from estimator.table.files import write_contacts
from estimator.table.overview import Overview
from vbaa_calib.core.errors import clipped, sentence_of
from vbaa_calib.core.files import sha256
from vbaa_calib.rig import Rig
from vbaa_calib.session import Index, drift_of

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
    """A recording that was opened, or a piece of it: the one at `index` of `count`. about : how its summary begins."""

    recording: Recording
    settings: Settings
    results: Results
    source: Source
    rig: Rig
    ground: Ground | None
    about: Row
    index: int = 0
    count: int = 1

    def estimator(self) -> ContactEstimator:
        return ContactEstimator(
            self.rig, self.settings.model, friction=self.settings.friction, jobs=self.settings.threads
        )

    def file(self, index: int) -> Path:
        """Of a piece's rows; between those of pieces lie those of their seams."""
        path = self.results.piece(self.recording.name, str(self.about["digest"]), index)
        path.parent.mkdir(parents=True, exist_ok=True)
        return path


_FRAME_BYTES = 4096
"""About what is kept of a frame's picture while its recording is worked on."""


@dataclass(frozen=True, eq=False)
class _Looked:
    """A piece without its pictures, what they show, and the processor's seconds for it."""

    piece: Opened
    seen: Seen
    cpu_s: float

    def __sizeof__(self) -> int:
        # dask does the rest of the work where such large things lie; by itself Python counts only the references
        return (0 if isinstance(self.seen.measured, Lines) else _FRAME_BYTES) * len(self.seen.frames)


@dataclass(frozen=True, eq=False)
class _Piece:
    """A piece whose rows are in their file, but for those at its edges; of the last one also how the rig has changed by
    then. cpu_s : the processor's seconds. made : a pickled `Made`, whose thousand arrays dask would send one by one.
    outside : sums of `left_out`. overview : `Overview.numbers` of its readings."""

    made: bytes
    cpu_s: float
    outside: Counter[str]
    overview: Mapping[str, Any]
    learnt: LearntRig | None = None


@dataclass(frozen=True)
class Outcome:
    """What became of a recording: `state` is done, unchanged, failed, long: to be opened for about so many `pieces`,
    whole: not in pieces after all, or opened: in so many pieces, whose rig changes are learnt one after the other where
    it `learns`."""

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
        rows = _rows(recording)
        if rows > settings.piece:
            return Outcome(recording.name, "long", about, -(-rows // settings.piece))
        opened = _opened(recording, settings, results, about)
        if opened.source.divisible and opened.source.count > settings.piece:
            return Outcome(recording.name, "long", about)
        return finish(bare(opened), [look_and_fit(opened)])
    except Exception as error:
        results.forget(recording.name)  # where the disk is full others need the room
        return failed(recording, error)


def index_of(recording: Recording, part: int, of: int) -> Index | None:
    """Where the frames are in a part of a session's centrelines."""
    return None if is_stream(recording.path) else part_index(recording.path, part, of)


def open_long(
    recording: Recording, settings: Settings, results: Results, about: Row, index: Sequence[Index | None]
) -> list[Opened]:
    """The pieces of a long recording. Raises what is wrong with it."""
    opened = _opened(recording, settings, results, about, index)
    source = opened.source.skimmed()
    if not source.divisible:
        return [opened]
    parts = cuts(len(source.frames), settings.piece)
    return [replace(opened, source=source.cut(part), index=index, count=len(parts)) for index, part in enumerate(parts)]


def parts_of(pieces: Sequence[Opened]) -> Outcome:
    """In how many pieces a recording is to be done."""
    one = pieces[0]
    return Outcome(one.recording.name, "opened", one.about, len(pieces), one.rig.drift.of_rig)


def bare(piece: Opened) -> Opened:
    """All but frames and pictures: what is needed at the end."""
    return replace(piece, source=replace(piece.source, frames=(), places=(), lines=None), ground=None)


def look_at(piece: Opened) -> _Looked:
    """What a piece shows. Raises InputError for a picture that cannot be read."""
    _one_thread_each(piece.settings.threads)
    begun = time.process_time()
    seen = look(piece.estimator(), piece.source, piece.ground)
    return _Looked(bare(piece), seen, time.process_time() - begun)


def learn_from(looked: _Looked, before: Sequence[LearntRig] | None) -> list[LearntRig]:
    """The rig for each batch of a piece, and at its end; before : of the piece before."""
    found = learn(looked.piece.estimator(), looked.seen, None if before is None else before[-1])
    brief = {id(each): replace(each, history=()) for each in found}
    return [*(brief[id(each)] for each in found), found[-1]]


def look_and_fit(piece: Opened) -> _Piece:
    """Both, of a piece whose rig does not depend on what was learnt before it."""
    looked = look_at(piece)
    return fit(looked, learn_from(looked, None))


def fit(looked: _Looked, learnt: Sequence[LearntRig]) -> _Piece:
    """The rows of a piece that was looked at, written to their file but for those at its edges."""
    begun, piece = time.process_time(), looked.piece
    _one_thread_each(piece.settings.threads)
    final = piece.index == piece.count - 1
    seen = replace(looked.seen, measured=list(looked.seen.measured))
    found = solve(piece.estimator(), seen, learnt[:-1])
    one = made(piece.rig, piece.source.shutter, seen, found, first=piece.index == 0, final=final)
    if one.rows:
        write_contacts(piece.file(2 * piece.index), one.rows, force=True)
    overview = Overview(piece.rig.second_moment_sensor is not None)
    for frame in seen.frames:
        overview.add_readings(frame)
    cpu_s = looked.cpu_s + time.process_time() - begun
    outside = Counter[str]()
    for each in seen.measured:
        outside.update(left_out(each))
    end = learnt[-1] if final else None
    return _Piece(pickle.dumps(replace(one, rows=[])), cpu_s, outside, overview.numbers(), end)


def finish(head: Opened, pieces: Sequence[_Piece]) -> Outcome:
    """The recording's contacts, object and summary."""
    recording, results, learnt = head.recording, head.results, pieces[-1].learnt
    assert learnt is not None
    ends = [pickle.loads(piece.made) for piece in pieces]
    for index, (one, other) in enumerate(pairwise(ends)):
        write_contacts(head.file(2 * index + 1), seam(head.rig, head.source.shutter, one, other), force=True)
    files = [head.file(index) for index in range(2 * len(pieces) - 1)]
    changed, overview, outside = summary(learnt), Overview(), Counter[str]()
    for piece in pieces:
        overview.join(piece.overview)
        outside.update(piece.outside)
    row = {
        **head.about,
        "free_frames": changed["free_frames"],
        "drift_picture_px": changed["picture_px"],
        "drift_moment_zero_std": changed["moment_zero_std"],
        "drift_beyond": changed["beyond"],
        "readings": overview.numbers()["readings"],
        "outside_points": outside["points"],
        "warnings": [*_warnings(head, changed), *left_out_words(outside, head.rig.camera.image_size)],
        "pieces": len(pieces),
        "cpu_s": sum(piece.cpu_s for piece in pieces),
    }
    results.object(recording.name).unlink(missing_ok=True)  # it is no longer these contacts'
    row = dict(results.join(recording.name, [file for file in files if file.exists()], row))
    results.forget(recording.name)
    return _with_object(Outcome(recording.name, "done", row), recording, head.settings, results)


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


def _opened(
    recording: Recording, settings: Settings, results: Results, about: Row, index: Sequence[Index | None] = ()
) -> Opened:
    rig = Rig.load(recording.rig)
    source = open_source(recording.path, rig, settings.no_moment, settings.streams, index)
    rig = replace(rig, drift=drift_of(settings.drift, source.drift, rig.drift, track_zero=settings.track_zero))
    with TemporaryDirectory(prefix="vbaa-stills-") as folder:
        ground, _ = surroundings(rig, settings.background, lambda: source.stills(rig, Path(folder)))
    opened = Opened(recording, settings, results, source, rig, ground, about)
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
