"""Opens a recording, whatever form it has."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, islice
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from estimator.table.contacts import LOCATED, ContactRow, ContactTable
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import is_bag, is_recorded, sha256
from vbaa_calib.core.polyline import arc_lengths, resample
from vbaa_calib.rig import Rig
from vbaa_calib.session import (
    Centrelines,
    Drift,
    Frame,
    Session,
    Shutter,
    Still,
    check_pictures,
    load_session,
    pictures_of,
    read_centrelines,
    read_noload,
    read_recording,
    without_moments,
)

from .contacts import Contacts, in_motion
from .estimate import STREAM, ContactEstimator
from .inputs import Batch
from .recording import (
    FrameContact,
    FramePictures,
    Ground,
    estimate_centrelines,
    estimate_pictures,
    estimate_taken,
    estimate_together,
)
from .settings import ContactSettings

if TYPE_CHECKING:
    from estimator.diagnose import RecordingWatch
    from estimator.table.overview import Overview
    from vbaa_calib.streams import MessageSource, Timing
    from vbaa_calib.streams.bags import Topics


@dataclass(frozen=True, eq=False)
class RecordedStream:
    """A bag, a video or a table of pictures.

    table : of its readings. views : by camera a source of its own ("" for none) and what is added to its times.
    unclocked : cameras of which that is to be estimated. clocks : sentences on the offsets that were.
    notes, counts : remarks from the last pass, and numbers of its messages.
    """

    path: Path
    rig: Rig
    topics: Topics
    timing: Timing
    table: Path | None = None
    no_moment: bool = False
    views: Mapping[str, tuple[str, float]] = field(default_factory=dict)
    unclocked: tuple[str, ...] = ()
    clocks: tuple[str, ...] = ()
    notes: list[str] = field(default_factory=list)
    counts: dict[str, int] = field(default_factory=dict)

    def opened(self) -> MessageSource:
        """The source for one pass. Raises InputError."""
        from vbaa_calib.streams.recorded import open_recorded  # loads what a session does without

        timing = self.timing
        known_s = None if timing.estimate_offset and timing.offset_std_s == 0.0 else timing.offset_s
        topics = replace(self.topics, wrench=self.rig.wrench_sensor is not None)
        topics.check_cameras(self.rig.cameras if self.rig.others else ())
        found = open_recorded(self.path, self.rig.lenses, self.table, known_s, topics, self.views)
        return found.without_moments() if self.no_moment else found

    def taken(self) -> Iterator[tuple[Frame, FramePictures]]:
        """The frames with pictures, in order."""
        from vbaa_calib.streams import Synchronizer, taken_frames

        source = self.opened()
        timing = replace(self.timing, moment_std_Nm=self.rig.reading_noise)
        synchronizer = Synchronizer(timing, source.channels, self.rig.image_sizes, source.notes, live=False)
        yield from taken_frames(source.messages(), synchronizer)
        self.notes[:] = [*source.notes, *synchronizer.left_out()]
        self.counts.update(synchronizer.counts)

    def clocked(self, estimator: ContactEstimator, ground: Ground | None) -> RecordedStream:
        """The stream with the offsets of its clocks, where they are to be estimated. Raises InputError where the data
        do not support it."""
        if not (self.unclocked or self.timing.estimate_offset):
            return self
        from .clock import recorded_clock_offset

        stream = self
        for name in self.unclocked:

            def opened(about_s: float, now: RecordedStream = stream, name: str = name) -> MessageSource:
                return replace(now, views={**now.views, name: (now.views[name][0], about_s)}).opened()

            offset_s, std_s, _ = recorded_clock_offset(estimator, opened, self.timing, ground, name)
            words = f"{name}'s clock: {offset_s:+.4f} s (± {1e3 * std_s:.1f} ms) are added to its times"
            views = {**stream.views, name: (stream.views[name][0], offset_s)}
            stream = replace(stream, views=views, clocks=(*stream.clocks, words))
        if not self.timing.estimate_offset:
            return replace(stream, unclocked=())
        offset_s, std_s, frames = recorded_clock_offset(estimator, stream.opened, self.timing, ground)
        words = f"the readings' clock: {offset_s:+.4f} s (± {1e3 * std_s:.1f} ms) are added to their times, by "
        timing = replace(self.timing, offset_s=offset_s, offset_std_s=std_s)
        return replace(stream, unclocked=(), timing=timing, clocks=(*stream.clocks, f"{words}{frames} pictures"))


@dataclass(frozen=True, eq=False)
class Source:
    """An opened and checked recording.

    Attributes
    ----------
    session : settings of its session; None for any other.
    frames : all of them, in order; none of a stream, where they come with their pictures.
    lines : centrelines by frame; None where each frame has its picture.
    stream : the bag, video or table of pictures.
    """

    session: Session | None
    frames: Sequence[Frame]
    lines: Centrelines | None = None
    stream: RecordedStream | None = None

    @property
    def drift(self) -> Drift | None:
        """The possible changes since the calibration, where the session states them."""
        return None if self.session is None else self.session.drift

    @property
    def shutter(self) -> Shutter:
        """The camera's shutter, as far as it is known."""
        return Shutter() if self.session is None else self.session.shutter

    def clocked(self, estimator: ContactEstimator, ground: Ground | None) -> Source:
        """The source with the offsets of a stream's clocks estimated if asked. Raises InputError where they cannot
        be."""
        return self if self.stream is None else replace(self, stream=self.stream.clocked(estimator, ground))

    def stills(self, rig: Rig, folder: Path) -> list[Still]:
        """The pictures of the recording and, where the session has some by this camera, of the free antenna.

        folder : where pictures that are taken out of a bag or video are written.
        """
        if self.stream is not None:
            return _sample_of(rig, self.stream.taken(), folder)
        assert self.session is not None
        return [*self.frames, *_free_frames(self.session, rig)]

    def together(self, estimator: ContactEstimator) -> Iterator[tuple[slice, Batch, Contacts]] | None:
        """`estimate_together` of the frames; None where they come one at a time."""
        if self.lines is None or self.shutter.exposure_s or self.shutter.readout_s:
            return None
        return estimate_together(estimator, self.frames, self.lines)

    def tables(
        self, estimator: ContactEstimator, overview: Overview, watch: RecordingWatch, ground: Ground | None = None
    ) -> Iterator[ContactTable]:
        """The rows of every frame, in order, some at a time, counted in `overview` and followed by `watch`."""
        together = self.together(estimator)
        if together is not None:
            yield from watch.followed(together, self.frames, overview)
            return

        def rows() -> Iterator[ContactRow]:
            for item in estimate_source(estimator, self, ground):
                row = ContactRow.of(item.frame, item.contact)
                watch.push(item.measured, item.contact)
                overview.add_readings(item.frame, item.measured, item.contact)
                overview.add_result(row.frame, row.status, row.reason)
                yield row

        coming = rows()
        while some := list(islice(coming, STREAM)):
            yield ContactTable.from_rows(some)


def _recording_files(path: Path) -> list[Path]:
    """The files of a recording other than its pictures. Raises InputError where there is no recording."""
    if is_stream(path):
        table = path.with_suffix(".csv")
        inside = sorted(each for each in path.iterdir() if each.is_file()) if path.is_dir() else [path]
        return [*inside, table] if not is_bag(path) and table.is_file() else inside
    root = _session_root(path)
    files = [root / "session.yaml", root / "recording" / "recording.csv"]
    lines = root / "recording" / "centrelines.csv"
    return [*files, lines] if lines.exists() else files


def is_stream(path: Path) -> bool:
    """Whether a recording is a bag or video, not a session or its centrelines."""
    return is_recorded(path) and not _stands_for_session(path)


def _stands_for_session(path: Path) -> bool:
    return path.name == "centrelines.csv" and path.is_file() and path.parent.name == "recording"


def _session_root(path: Path) -> Path:
    """The session of a recording, for which its centrelines.csv may stand."""
    return path.parent.parent if _stands_for_session(path) else path


def _unpacked(
    rig: Rig, taken: Iterable[tuple[Frame, FramePictures]], folder: Path
) -> Iterator[tuple[Frame, FramePictures]]:
    """Frames with their pictures written to files in a folder."""
    from vbaa_calib.streams.pictures import stored

    for frame, pictures in taken:
        several = pictures if isinstance(pictures, Mapping) else {rig.camera_name: pictures}
        others = {
            name: stored(image, folder / f"{frame.frame:06d}-{name}.png")
            for name, image in several.items()
            if image is not None
        }
        yield replace(frame, image=others.pop(rig.camera_name, None), others=others), pictures


def _sample_of(rig: Rig, taken: Iterable[tuple[Frame, FramePictures]], folder: Path) -> list[Still]:
    """Some pictures of each camera from a bag or video, written to files in a folder."""
    from vbaa_calib.streams.pictures import thinned

    def judged() -> Iterator[tuple[tuple[Frame, FramePictures], np.ndarray]]:
        """Each frame with the picture by which it is judged: that of the first camera that has one."""
        for frame, pictures in taken:
            several = list(pictures.values()) if isinstance(pictures, Mapping) else [pictures]
            there = next((one for one in several if one is not None), None)
            if there is not None:
                yield (frame, pictures), there

    chosen = (one for one, _ in thinned(judged(), ContactSettings.sampled_pictures))
    return [frame for frame, _ in _unpacked(rig, chosen, folder)]


def open_source(
    path: Path, rig: Rig, no_moment: bool = False, topics: Topics | None = None, timing: Timing | None = None
) -> Source:
    """Open a session folder, or its recording/centrelines.csv; a bag; a video with readings in the .csv of its name.

    no_moment : ignore the moment readings. topics, timing : of bags and videos. Raises InputError for
    what is wrong in it.
    """
    if is_stream(path):
        from vbaa_calib.streams import Timing
        from vbaa_calib.streams.bags import Topics

        readings = path.with_suffix(".csv")
        table = readings if readings.is_file() and not is_bag(path) else None
        stream = RecordedStream(path, rig, topics or Topics(), timing or Timing(), table, no_moment)
        stream.opened()  # what is wrong is told at once
        return Source(None, (), None, stream)
    session = _of_rig(load_session(_session_root(path)), rig)
    frames = read_recording(session)
    if no_moment:
        frames = without_moments(frames)
    pictures = pictures_of(frames)
    for name, one in rig.cameras.items():
        own = [frame.others[name] for frame in frames if name in frame.others] if name in rig.others else pictures
        check_pictures(own, one.camera.image_size, "the rig was calibrated at")
    lines = None if pictures else read_centrelines(session).checked(frames, "recording.csv")
    return Source(session, frames, lines)


def _of_rig(session: Session, rig: Rig) -> Session:
    """The session of the rig's first camera. Raises InputError where the two have different cameras, or antennas of
    different lengths."""
    where, own_m, other_m = session.root / "session.yaml", rig.antenna.length_m, session.antenna.length_m
    if not rig.antennas and abs(own_m - other_m) > 1e-3 * own_m:
        what = f"antenna.length_m is {other_m:g}, the rig's {own_m:g}"
        raise InputError(what, where=where, remedy="give the rig.json of this antenna, or calibrate it")
    if not session.cameras and rig.others:
        what = f"it names no cameras, the rig has {', '.join(rig.cameras)}"
        raise InputError(what, where=where, remedy="say whose its pictures are, as cameras: {left: {}, right: {}}")
    if len(session.cameras) > 1 or rig.others:
        if unknown := [name for name in session.cameras if name not in rig.cameras]:
            what = f"the rig has no camera {unknown[0]}, but {', '.join(rig.cameras)}"
            raise InputError(what, where=where, remedy="calibrate this session's cameras, or name them as there")
        return session.of_camera(rig.camera_name) if rig.camera_name in session.cameras else session
    return session


def estimate_source(
    estimator: ContactEstimator, source: Source, ground: Ground | None = None, folder: Path | None = None
) -> Iterator[FrameContact]:
    """The contacts of every frame of a recording, in order, with a note on those that the shutter affects. folder :
    where a stream's pictures are written, if anywhere."""
    if source.stream is not None:
        taken = source.stream.taken()
        found = estimate_taken(estimator, taken if folder is None else _unpacked(estimator.rig, taken, folder), ground)
    elif source.lines is None:
        found = estimate_pictures(estimator, source.frames, ground)
    else:
        found = estimate_centrelines(estimator, source.frames, source.lines)
    return _marked_by_shutter(found, source.shutter, estimator.rig.camera.image_size[1])


def inputs_digest(path: Path) -> str:
    """Hex digest of a recording's inputs: its tables' contents, its pictures' names, sizes and modification times.

    Raises InputError where a file is missing or cannot be read.
    """
    import hashlib

    files = _recording_files(path)
    if is_stream(path):
        # bags and videos are too large to be read twice
        stats = [(file.name, file.stat()) for file in files]
        return hashlib.sha256(json.dumps([(n, s.st_size, s.st_mtime_ns) for n, s in stats]).encode()).hexdigest()
    listed: list[object] = [[file.name, sha256(file)] for file in files]
    session = load_session(_session_root(path))
    for frame in () if files[-1].name == "centrelines.csv" else read_recording(session):
        for image in ([] if frame.image is None else [frame.image]) + list(frame.others.values()):
            status = image.stat()
            listed.append([str(image.relative_to(session.root)), status.st_size, status.st_mtime_ns])
    return hashlib.sha256(json.dumps(listed).encode()).hexdigest()


def _free_frames(session: Session, rig: Rig) -> list[Still]:
    """The pictures of the free antenna, where this session has some by this camera."""
    try:
        frames = list(read_noload(session))
        check_pictures([still.image for still in frames if still.image], rig.camera.image_size, "the rig's are")
    except InputError:  # they are not needed
        return []
    return frames


# Blur by an even movement moves no point: the line lies where the antenna is in the middle of the exposure. A rolling
# shutter reads the rows one after the other: a point lies where the antenna is when its row is read, not the clamp's.


def _marked_by_shutter(found: Iterable[FrameContact], shutter: Shutter, rows: int) -> Iterator[FrameContact]:
    """A recording's frames in order, with a note on those in which the motion matters. rows : of the pictures.

    Each comes out once the next one is known, where the shutter is known.
    """
    if not (shutter.exposure_s or shutter.readout_s):
        yield from found
        return
    before = waiting = None
    for item in chain(found, [None]):
        if waiting is not None:
            # an antenna that comes to rest, or starts from it, may be at rest in the picture itself
            speeds = [_speeds(waiting, other, rows) for other in (before, item) if other is not None]
            slower = min(speeds, key=np.max, default=np.zeros(1))
            yield _marked(waiting, slower, shutter, rows) if slower.any() else waiting
        before, waiting = waiting, item


def _speeds(item: FrameContact, other: FrameContact, rows: int) -> np.ndarray:
    """(N,) speeds of the frame's points, px/s, if the antenna moves as fast as between it and the other; 0 where no
    time passed, or a line is missing."""
    after_s = abs(other.frame.time_s - item.frame.time_s)
    here, there = item.measured.points_px, other.measured.points_px
    if len(here) < 2 or len(there) < 2 or not after_s > 0.0:
        return np.zeros(1)
    # points that are listed in no order make a path of any length
    spacing_px = max(0.1, float(arc_lengths(there)[-1]) / (100 * rows))
    from scipy.spatial import cKDTree  # slow to load

    gap, at = cKDTree(resample(there, spacing_px)[0]).query(here)
    gap[(at == 0) | (at == at.max())] = 0.0  # beyond its ends, the distance is along the line
    return np.asarray(gap / after_s)


def _marked(item: FrameContact, speeds: np.ndarray, shutter: Shutter, rows: int) -> FrameContact:
    """The frame with the effect of a motion at these speeds (N,), px/s, on its points, if it matters."""
    contact, v = item.contact, item.measured.points_px[:, 1]
    off_px = speeds * shutter.readout_s * np.abs(v - v[0]) / rows
    off_std = off_px / item.measured.sigma_px
    worst, exposure_px = int(off_std.argmax()), float(speeds.max()) * shutter.exposure_s
    if contact.status in LOCATED and off_std[worst] > ContactSettings.carried:
        reason = (
            f"the antenna moves by {float(speeds.max()) * shutter.readout_s:.1f} px while the sensor is read out, "
            f"which puts points {off_px[worst]:.2f} px off, {off_std[worst]:.0f} std: move slower, or use a global "
            "shutter"
        )
        contact = in_motion(contact, reason)
    elif exposure_px > ContactSettings.blurred_px:
        blur = f"moves by {exposure_px:.0f} px during the exposure: expose shorter, or move slower"
        contact = replace(
            contact, reason="; ".join(reason for reason in (contact.reason, f"the antenna {blur}") if reason)
        )
    return replace(item, contact=contact)
