"""Pictures from files: a folder that is being filled, and the frames of a video."""

from __future__ import annotations

import math
import os
import re
import stat
import time
from collections.abc import Container
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path

import cv2
import numpy as np

from vbaa_calib.convert.child import read_in_child, read_video_head
from vbaa_calib.core.errors import Disconnected, InputError, one_line, reason_of
from vbaa_calib.core.files import most_memory, require_file
from vbaa_calib.core.images import CONVERT, OTHER_KINDS, SUFFIXES, list_images, read_gray


@dataclass(frozen=True)
class _SourceSettings:
    """Limits on what is read from files."""

    bytes_per_pixel: int = 14  # of memory that a frame takes on its way to a picture
    most_bytes: int = 1_000_000_000  # of one picture's file
    old_s: float = 10.0  # age from which a half-written picture is taken for broken
    usual_fps: float = 30.0  # frames per second of a video that does not state them
    readable_share: float = 0.95  # of a video's frames that must be read
    longest_name: int = 100  # letters of a name in a message


_FILES = _SourceSettings()


def _without_secrets(text: str) -> str:
    """A URL without user, password (everything up to the last @) and tokens."""
    secret = r"([?&;][^=&;]*(?:pass|pwd|user|usr|token|key|auth|secret|sig)[^=&;]*=)[^&;#]*"
    return re.sub(secret, r"\1***", re.sub(r"(?s)://.*@", "://***@", text), flags=re.IGNORECASE)


def printable(text: str) -> str:
    """A text for a message: one line of at most 100 characters, without secrets."""
    line = one_line(_without_secrets(text))
    return line if len(line) <= _FILES.longest_name else f"{line[: _FILES.longest_name]}…"


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture of a source, with a name that is unique in it: a file's, or "frame 12".

    image : (H, W) uint8 grey, as `core.images.read_gray` reads `data`, which is stored with `suffix`.
    content : a file's bytes, or a frame's pixels, (H, W) grey or (H, W, 3) BGR, uint8. time_s : None for files.
    """

    name: str
    image: np.ndarray
    suffix: str
    content: bytes | np.ndarray = field(repr=False)
    time_s: float | None = None

    @cached_property
    def data(self) -> bytes:
        """The bytes to store: the file's own, or the frame encoded as a colour PNG."""
        if isinstance(self.content, bytes):
            return self.content
        done, png = cv2.imencode(".png", self.content, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        if not done:
            raise InputError("cannot be stored as PNG", where=self.name, remedy="take the picture again")
        return png.tobytes()

    @cached_property
    def sha256(self) -> str:
        import hashlib  # loads OpenSSL

        return hashlib.sha256(self.data).hexdigest()


def silence_opencv() -> None:
    """Keep OpenCV's and FFmpeg's messages off the terminal."""
    # FFmpeg's level is read once, when the first capture is opened; -8 is its "quiet"
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)


def frame_picture(name: str, pixels: np.ndarray, time_s: float) -> Picture:
    """A picture from a frame (H, W) grey or (H, W, 3) BGR, uint8."""
    # libpng's grey of blue, green and red, which truncates; half a level less makes OpenCV's rounding do that
    weights = np.array([[3737 / 2**15, 19234 / 2**15, 9797 / 2**15, 2**-16 - 0.5]])
    gray = pixels if pixels.ndim == 2 else cv2.transform(pixels, weights)
    return Picture(name, gray, ".png", pixels, time_s)


@dataclass(frozen=True)
class FolderSettings:
    """Time between scans of a folder, and times after which an unchanged file counts as complete or, if unreadable,
    as broken."""

    scan_s: float = 0.25
    steady_s: float = 0.5
    patience_s: float = 3.0


@dataclass(frozen=True)
class _Watched:
    """State of a file that has not been delivered yet: size and modification time, since when, whether reading it
    failed, and whether that was reported."""

    state: tuple[int, int]
    since_s: float
    failed: bool = False
    reported: bool = False


class FolderSource:
    """The pictures of a folder: existing ones by name, then new ones as they come.

    A picture is offered once, when its size and time no longer change and it decodes; a broken one again when it
    changes.
    """

    live = False

    def __init__(
        self, folder: Path, seen: Container[str] = (), wait: bool = False, pace: FolderSettings | None = None
    ) -> None:
        """Raises InputError if the folder cannot be read, or is empty and `wait` is off."""
        self.name = printable(str(folder))
        self.notes: tuple[str, ...] = ()
        self._folder, self._seen, self._wait = folder, seen, wait
        self._pace = pace or FolderSettings()
        self._given: set[str] = set()
        self._watched: dict[str, _Watched] = {}
        self._ready: list[str] = []
        names = self._names(InputError)
        if not wait:
            list_images(folder)
        self._start_s = self._scanned_s = time.monotonic()
        for name in filter(self._is_new, names):
            if (state := self._state(name)) is not None:
                # old files are complete
                is_old = time.time() - 1e-9 * state[1] > _FILES.old_s
                self._watched[name] = _Watched(state, self._start_s - (self._pace.patience_s if is_old else 0))

    @property
    def ended(self) -> bool:
        """Whether all files of the first scan were delivered or reported; never with `wait`."""
        return not self._wait and all(watched.reported or name in self._seen for name, watched in self._watched.items())

    def next(self, timeout_s: float) -> Picture | None:
        """The next complete picture. Raises Disconnected when the folder is gone."""
        until_s = time.monotonic() + timeout_s
        while True:
            # scanning thousands of files takes long: not while some are ready
            if not self._ready:
                if time.monotonic() - self._scanned_s >= self._pace.scan_s:
                    self._scan()
                self._ready = self._unchanging()
            while self._ready:
                name = self._ready.pop(0)
                offered = self._read(name) if name not in self._seen else None
                if offered is not None:
                    return offered
            left_s = until_s - time.monotonic()
            if self.ended or left_s <= 0:
                return None
            time.sleep(min(left_s, self._pace.scan_s))

    def close(self) -> None:
        """Does nothing, since no file stays open."""

    def _unchanging(self) -> list[str]:
        """Names of unchanging files to read, in order: each is tried once, and once more when it counts as broken."""
        now_s = time.monotonic()
        unchanging = []
        for name, watched in sorted(self._watched.items()):
            wait_s = self._pace.patience_s if watched.failed else self._pace.steady_s
            if now_s - watched.since_s >= wait_s:
                if not watched.reported:
                    unchanging.append(name)
            elif watched.since_s == self._start_s and not watched.failed:
                break  # it was there at the start, and those are offered by name
        return unchanging

    def _read(self, name: str) -> Picture | None:
        """The picture in a file; None if that is incomplete, with a note once it counts as broken."""
        path, watched = self._folder / name, self._watched[name]
        try:
            data = path.read_bytes() if watched.state[0] <= _FILES.most_bytes else None
            status = path.stat()
        except FileNotFoundError:
            del self._watched[name]
            self._names(Disconnected)
            return None
        except OSError as error:
            return self._failed(name, f"{name}: cannot be read ({error.strerror}); check its permissions")
        if data is None:
            return self._failed(
                name, f"{name}: is larger than {_FILES.most_bytes / 1e9:g} GB; export a smaller picture"
            )
        state = status.st_size, status.st_mtime_ns
        if state != watched.state or len(data) != state[0]:
            self._watched[name] = _Watched(state, time.monotonic())
            return None
        try:
            image = read_gray(Path(name), data)
        except InputError as error:
            return self._failed(name, str(error))
        del self._watched[name]
        self._given.add(name)
        return Picture(name, image, path.suffix.lower(), data)

    def _failed(self, name: str, why: str) -> Picture | None:
        watched = self._watched[name]
        over = time.monotonic() - watched.since_s >= self._pace.patience_s
        self._watched[name] = replace(watched, failed=True, reported=over)
        if over:
            self.notes += (why,)
        return None

    def _scan(self) -> None:
        now_s = self._scanned_s = time.monotonic()
        there = set(filter(self._is_new, self._names(Disconnected)))
        for name in sorted(there if self._wait else there & self._watched.keys()):
            state, watched = self._state(name), self._watched.get(name)
            if state is not None and (watched is None or watched.state != state):
                self._watched[name] = _Watched(state, now_s)
        for name in self._watched.keys() - there:
            del self._watched[name]

    def _names(self, kind: type[InputError]) -> list[str]:
        """The names of the folder's pictures. Raises `kind` if it cannot be read."""
        try:
            with os.scandir(self._folder) as entries:
                names = [entry.name for entry in entries]
        except (FileNotFoundError, NotADirectoryError):
            raise kind("no such folder", where=self.name, remedy="check the path, and that the disk is there") from None
        except (OSError, ValueError) as error:
            raise kind(
                f"cannot be read ({reason_of(error)})", where=self.name, remedy="check its permissions"
            ) from None
        return sorted(filter(self._is_picture, names))

    def _is_picture(self, name: str) -> bool:
        stem, suffix = os.path.splitext(name)
        if suffix.lower() in OTHER_KINDS and name not in self._given:
            self._given.add(name)
            self.notes += (f"{printable(name)}: is not read; {CONVERT}",)
        if suffix.lower() not in SUFFIXES:
            return False
        unfinished = (".part", ".partial", ".tmp", ".temp", ".crdownload", ".download", ".filepart", ".swp")
        temporary = name.startswith((".", "~")) or os.path.splitext(stem)[1].lower() in unfinished
        if temporary or name.isprintable():
            return not temporary
        if name not in self._given:
            self._given.add(name)
            self.notes += (f"{printable(name)}: its name holds signs that cannot be printed; rename it",)
        return False

    def _is_new(self, name: str) -> bool:
        return name not in self._given and name not in self._seen

    def _state(self, name: str) -> tuple[int, int] | None:
        """Size and modification time of a regular file; None for others."""
        try:
            status = os.stat(os.path.join(self._folder, name))
        except OSError:
            return None
        return (status.st_size, status.st_mtime_ns) if stat.S_ISREG(status.st_mode) else None


_AGAIN = "record or copy it again, or turn it into a folder of pictures"


@lru_cache
def _frame_size(path: Path, *_: int) -> tuple[float, float]:
    """(width, height) px of a video, cached until the file changes. Raises ValueError for one that cannot be read."""
    width, height = read_in_child(read_video_head, path)["size"].tolist()
    return width, height


def _refuse_large(path: Path) -> None:
    """Raises InputError for a video with frames beyond the memory limit, found in a process of its own, since a
    small file may announce frames that fill the memory."""
    require_file(path, "video")
    status = path.stat()
    try:
        width, height = _frame_size(path.absolute(), status.st_size, status.st_mtime_ns)
    except ValueError:
        raise InputError("is not a video that can be read", where=printable(str(path)), remedy=_AGAIN) from None
    if width * height * _FILES.bytes_per_pixel > most_memory(status.st_size):
        what = f"has frames of {width:.0f}x{height:.0f} px, more than a video of its size may have"
        raise InputError(what, where=printable(str(path)), remedy=_AGAIN)


class VideoSource:
    """Every frame of a video, named by its index. In the wizard frames are taken when the scene is at rest, as from
    a live stream."""

    live = True

    def __init__(self, path: Path, seen: Container[str] = ()) -> None:
        """Raises InputError if the file is not a readable video."""
        silence_opencv()
        self.name = printable(path.name)
        self.notes: tuple[str, ...] = ()
        self.ended, self._seen, self._index, self._time_s = False, seen, 0, -math.inf
        _refuse_large(path)
        self._capture = cv2.VideoCapture(str(path.absolute()), cv2.CAP_FFMPEG)
        # in the sensor's own orientation, as pictures are read
        self._capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
        if not self._capture.isOpened() or not self._capture.grab():
            self._capture.release()
            raise InputError("is not a video that can be read", where=printable(str(path)), remedy=_AGAIN)
        self._frame_count = self._capture.get(cv2.CAP_PROP_FRAME_COUNT)
        fps = self._capture.get(cv2.CAP_PROP_FPS)
        self._fps = fps if 1 <= fps <= 1000 else _FILES.usual_fps

    def skip(self) -> None:
        """Skip the next frame."""
        if not self.ended:
            self._stamp()
            self._advance()

    def _advance(self) -> None:
        self._index += 1
        if not self._capture.grab():
            if self._index < _FILES.readable_share * self._frame_count:
                part = f"{self._index} of its {self._frame_count:.0f} frames can be read"
                self.notes += (f"{self.name} is cut off or damaged: {part}",)
            self.close()

    def next(self, timeout_s: float) -> Picture | None:
        """The next frame; None at the end."""
        while not self.ended:
            name, time_s = f"frame {self._index}", self._stamp()
            read, pixels = (False, None) if name in self._seen else self._capture.retrieve()
            self._advance()
            if read and pixels is not None and pixels.size:
                return frame_picture(name, pixels, time_s)
        return None

    def close(self) -> None:
        self.ended = True
        self._capture.release()

    def _stamp(self) -> float:
        """The frame's time since the video's beginning, s; one frame interval after the last if the file has none."""
        time_s = self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1000
        if not math.isfinite(time_s) or time_s < 0 or time_s <= self._time_s:
            time_s = 0.0 if self._index == 0 else self._time_s + 1 / self._fps
        self._time_s = time_s
        return time_s
