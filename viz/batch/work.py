"""Tasks of a batch's workers: each recording is one dask task, with the same result when it runs again."""

from __future__ import annotations

import hashlib
import json
import time
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2

import vbaa_calib
from estimator.contact.drift import summary
from estimator.contact.estimate import ContactEstimator
from estimator.contact.source import inputs_digest, is_stream, open_source
from estimator.contact.surroundings import AUTO, surroundings
from estimator.diagnose import RecordingVerdict, RecordingWatch
from estimator.diagnose.consequences import changed_row, with_unused
from estimator.table.contacts import STATUSES
from estimator.table.overview import Overview
from vbaa_calib.core.errors import clipped, sentence_of
from vbaa_calib.core.files import sha256
from vbaa_calib.rig import Rig
from vbaa_calib.session import drift_of
from vbaa_calib.streams import Timing
from vbaa_calib.streams.bags import Topics

from .recordings import BatchRecording
from .results import Results, Row


@dataclass(frozen=True)
class BatchSettings:
    """What is to be done with every recording: the options of `vbaa estimate` and of the batch.

    threads : of each task's kernels. again : do also what is done and unchanged.
    """

    model: str = "auto"
    friction: float = 0.2
    drift: str | None = None
    track_zero: bool = False
    no_moment: bool = False
    background: Path | None = None
    topics: Topics = field(default_factory=Topics)
    timing: Timing = field(default_factory=Timing)
    reconstruct: bool = False
    threads: int = 1
    again: bool = False

    def as_dict(self, path: Path) -> dict[str, Any]:
        """The options on which a recording's contacts depend."""
        names = ("model", "friction", "drift", "track_zero", "no_moment")
        pixels = None if self.background is None else str(self.background)
        if self.background is not None and self.background != AUTO:
            pixels = sha256(self.background)
        settings = {name: getattr(self, name) for name in names} | {"background": pixels}
        streams = {"topics": asdict(self.topics), "timing": asdict(self.timing)}
        return settings | {"streams": streams} if is_stream(path) else settings


@dataclass(frozen=True)
class Outcome:
    """Outcome of a recording: `state` is done, unchanged or failed; `row` its summary."""

    name: str
    state: str
    row: Row


def do(recording: BatchRecording, settings: BatchSettings, results: Results) -> Outcome:
    """Estimate a recording, unless that is done already. Errors are reported in its row."""
    try:
        # OpenCV takes all cores by itself
        cv2.setNumThreads(settings.threads)
        about = _about(recording, settings)
        before = None if settings.again else results.done(recording.name)
        if before is not None and before["digest"] == about["digest"]:
            return _with_object(Outcome(recording.name, "unchanged", before), recording, settings, results)
        outcome = Outcome(recording.name, "done", _estimated(recording, settings, results, about))
        return _with_object(outcome, recording, settings, results)
    except Exception as error:
        return failed(recording, error)


def _estimated(recording: BatchRecording, settings: BatchSettings, results: Results, about: Row) -> Row:
    """Write the contacts, as `vbaa estimate` does; returns the summary, that begins with `about`."""
    begun, rig = time.process_time(), Rig.load(recording.rig)
    source = open_source(recording.path, rig, settings.no_moment, settings.topics, settings.timing)
    rig = replace(rig, drift=drift_of(settings.drift, source.drift, rig.drift, track_zero=settings.track_zero))
    estimator = ContactEstimator(rig, settings.model, friction=settings.friction, jobs=settings.threads)
    with TemporaryDirectory(prefix="vbaa-stills-") as folder:
        ground, _ = surroundings(rig, settings.background, lambda: source.stills(rig, Path(folder)))
    source, overview = source.clocked(estimator, ground), Overview(rig.columns)
    watch = RecordingWatch(rig)

    def summarized(verdict: RecordingVerdict) -> Row:
        if verdict.concerns_any:
            overview.amend(partial(changed_row, verdict))
        changed, numbers = summary(estimator.drift), overview.numbers()
        warnings = ["no frame shows the free antenna"] if rig.drift.of_rig and not changed["free_frames"] else []
        notes = () if source.stream is None else (*source.stream.notes, *source.stream.clocks)
        if changed["beyond"]:
            warnings.append(f"{', '.join(changed['beyond'])} changed more than drift does: run vbaa check")
        return {
            **about,
            "frames": overview.frames,
            **{status: overview.status[status] for status in STATUSES},
            "verdict": verdict.verdict.to_dict(),
            "readings": numbers["readings"],
            "set_aside": numbers["set_aside"],
            "reasons": numbers["reasons"],
            "free_frames": changed["free_frames"],
            "drift_picture_px": changed["picture_px"],
            "drift_moment_zero_std": changed["moment_zero_std"],
            "drift_beyond": changed["beyond"],
            "outside_points": overview.outside["points"],
            "warnings": [*warnings, *notes, *overview.outside_in_words(rig.camera.image_size)],
            "cpu_s": time.process_time() - begun,
        }

    def judged() -> RecordingVerdict:
        return with_unused(watch.verdict(), overview.unused, overview.frames)

    tables = source.tables(estimator, overview, watch, ground)
    return results.write(recording.name, tables, judged, summarized)


def _with_object(outcome: Outcome, recording: BatchRecording, settings: BatchSettings, results: Results) -> Outcome:
    """The outcome after writing the object's file, where that is asked for and missing."""
    path = results.object(recording.name)
    if not settings.reconstruct or path.exists() or outcome.row["verdict"]["severity"] == "wrong":
        return outcome
    from estimator.contact.common_errors import shared_errors
    from estimator.object.surface import reconstruct, touches_of
    from estimator.table.files import read_contacts
    from viz.files.object_file import write_object

    table, rig = read_contacts(results.contacts(recording.name)), Rig.load(recording.rig)
    if not table.located.any():
        return outcome
    path.parent.mkdir(parents=True, exist_ok=True)
    touches = touches_of(table, shared_errors(rig, table))
    write_object(reconstruct(touches, rig.antenna.radius_at(touches.distance_m)), path, force=True)
    return outcome


def failed(recording: BatchRecording, error: BaseException) -> Outcome:
    """The outcome of a recording without results, with the error."""
    unknown = f"something went wrong that should not ({type(error).__name__}: {clipped(str(error))})"
    sentence = sentence_of(error) or unknown
    row = {"recording": recording.name, "state": "failed", "sentence": sentence}
    row |= {"path": str(recording.path), "rig": str(recording.rig), "version": vbaa_calib.__version__}
    return Outcome(recording.name, "failed", row)


def _about(recording: BatchRecording, settings: BatchSettings) -> Row:
    """The beginning of a summary: the recording, and the digests of all that its contacts depend on."""
    rig_sha256, inputs_sha256 = sha256(recording.rig), inputs_digest(recording.path)
    about = {"rig_sha256": rig_sha256, "inputs_sha256": inputs_sha256, "version": vbaa_calib.__version__}
    # 3: recordings have a verdict; what was done before is done again
    whole = json.dumps([3, about, settings.as_dict(recording.path)], sort_keys=True).encode()
    return {
        "recording": recording.name,
        "state": "done",
        "path": str(recording.path),
        "rig": str(recording.rig),
        **about,
        "digest": hashlib.sha256(whole).hexdigest(),
    }
