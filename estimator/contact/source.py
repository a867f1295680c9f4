"""Where a recording comes from: the one place that opens what holds it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import sha256
from vbaa_calib.rig import Rig
from vbaa_calib.session import (
    Centrelines,
    Frame,
    Session,
    Still,
    check_pictures,
    load_session,
    read_noload,
    read_recording,
)

from .estimate import ContactEstimator
from .recording import FrameContact, Ground, estimate_centrelines, estimate_pictures, recorded_lines
from .shutter import checked


@dataclass(frozen=True, eq=False)
class Source:
    """A recording that was opened and checked.

    Attributes
    ----------
    session : settings of its session.
    frames : all of them, in order.
    lines : centrelines by frame; None where each frame has its picture.
    """

    session: Session
    frames: Sequence[Frame]
    lines: Centrelines | None

    @property
    def divisible(self) -> bool:
        """Whether other processes may open parts of it."""
        return self.lines is None or self.lines.portable

    def stills(self, rig: Rig) -> list[Still]:
        """Its pictures and, where the session has some of this camera, those of the free antenna."""
        return [*self.frames, *free_stills(self.session, rig)]


def recording_files(path: Path) -> list[Path]:
    """The files that a recording is made of, beside its pictures. Raises InputError for what holds none."""
    root = _session_root(path)
    files = [root / "session.yaml", root / "recording" / "recording.csv"]
    lines = root / "recording" / "centrelines.csv"
    return [*files, lines] if lines.exists() else files


def _session_root(path: Path) -> Path:
    """The session of a recording, which its centrelines.csv may stand for."""
    if path.name == "centrelines.csv" and path.is_file() and path.parent.name == "recording":
        return path.parent.parent
    return path


def open_source(path: Path, rig: Rig, no_moment: bool = False) -> Source:
    """Open a session folder, or its recording/centrelines.csv. Raises InputError for what is wrong in it.

    no_moment : leave the moment readings aside.
    """
    session = load_session(_session_root(path))
    frames = read_recording(session)
    if no_moment:
        frames = without_moments(frames)
    pictures = [frame.image for frame in frames if frame.image is not None]
    check_pictures(pictures, rig.camera.image_size, "the rig was calibrated at")
    return Source(session, frames, None if pictures else recorded_lines(session, frames))


def estimate_source(
    estimator: ContactEstimator, source: Source, ground: Ground | None = None
) -> Iterator[FrameContact]:
    """Every frame of a recording, in order, those in which the shutter matters marked."""
    if source.lines is None:
        found = estimate_pictures(estimator, source.frames, ground)
    else:
        found = estimate_centrelines(estimator, source.frames, source.lines)
    return checked(found, source.session.shutter, estimator.rig.camera.image_size[1])


def inputs_digest(path: Path) -> str:
    """Hex digest of what a recording is made of: its tables' contents, its pictures' names, sizes and times of change.

    Raises InputError where a file is missing or cannot be read.
    """
    files = recording_files(path)
    said: list[object] = [[file.name, sha256(file)] for file in files]
    session = load_session(_session_root(path))
    for frame in () if files[-1].name == "centrelines.csv" else read_recording(session):
        if frame.image is not None:
            status = frame.image.stat()
            said.append([str(frame.image.relative_to(session.root)), status.st_size, status.st_mtime_ns])
    return hashlib.sha256(json.dumps(said).encode()).hexdigest()


def without_moments(frames: Sequence[Frame]) -> list[Frame]:
    """Frames for vision alone."""
    return [replace(frame, moment_Nm=np.nan, moment_z_Nm=np.nan) for frame in frames]


def free_stills(session: Session, rig: Rig) -> list[Still]:
    """The pictures of the free antenna, where this session has some of this camera."""
    try:
        stills = list(read_noload(session))
        check_pictures([still.image for still in stills if still.image], rig.camera.image_size, "the rig's are")
    except InputError:  # they are not needed
        return []
    return stills
