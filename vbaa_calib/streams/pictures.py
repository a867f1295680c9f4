"""Pictures from bags and videos: all as files, or a few sharp ones."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from operator import itemgetter
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import is_bag
from vbaa_calib.sources.files import Picture, frame_picture, printable

from .bags import Topics, open_bag
from .messages import Messages, Taken
from .recorded import open_pictures

_T = TypeVar("_T")


def _recorded_pictures(path: Path, topics: Topics | None = None) -> Messages:
    """The pictures of all cameras in a bag or video. Raises InputError."""
    return (open_bag(path, topics or Topics(), None) if is_bag(path) else open_pictures(path)).messages()


def thinned(pictures: Iterable[tuple[_T, np.ndarray]], most: int) -> list[tuple[_T, np.ndarray]]:
    """The sharpest picture of each of at most 2 · `most` periods, and of consecutive ones with the same view only
    the sharpest."""
    kept: list[tuple[float, _T, np.ndarray]] = []
    length = in_last = 0
    for name, picture in pictures:
        one = (_sharpness(picture), name, picture)
        if in_last % max(length, 1) == 0:
            if len(kept) == 2 * most:
                kept = [max(kept[i : i + 2], key=itemgetter(0)) for i in range(0, len(kept), 2)]
                length *= 2
            kept.append(one)
            length, in_last = max(length, 1), 0
        elif one[0] > kept[-1][0]:
            kept[-1] = one
        in_last += 1
    different: list[tuple[float, _T, np.ndarray]] = []
    before = None
    for one in kept:
        now = _thumbnail(one[2])
        # thumbnails that differ by less of their own contrast are alike
        if before is not None and np.abs(now - before).mean() < 0.15 * (now.std() + 1.0):
            different[-1] = max(different[-1], one, key=itemgetter(0))
            continue
        different.append(one)
        before = now
    return [(name, picture) for _, name, picture in different]


def _grey(picture: np.ndarray) -> np.ndarray:
    levels = np.clip(np.rint(picture), 0, 255).astype(np.uint8)
    return levels if levels.ndim == 2 else np.asarray(cv2.cvtColor(levels, cv2.COLOR_BGR2GRAY))


def _sharpness(picture: np.ndarray) -> float:
    return float(cv2.Laplacian(_grey(picture), cv2.CV_32F).var())


def _thumbnail(picture: np.ndarray) -> np.ndarray:
    small = cv2.resize(_grey(picture), (24, 18), interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.GaussianBlur(small.astype(np.float32), (0, 0), 1.0))  # so that blur makes no difference


def stored(picture: np.ndarray, path: Path) -> Path:
    """Write a picture to a file, lossless up to eight bits; returns it. Raises InputError."""
    try:
        path.write_bytes(cv2.imencode(".png", np.clip(np.rint(picture), 0, 255).astype(np.uint8))[1].tobytes())
    except OSError as error:
        what = f"pictures cannot be unpacked there ({error.strerror})"
        raise InputError(what, where=path.parent, remedy="make room, or set TMPDIR to another disk") from None
    return path


def unpack_views(path: Path, folder: Path, topics: Topics, most: int) -> int:
    """Write sharp and different pictures of a bag or video, in grey, into a folder; returns the number of all
    pictures."""
    count = 0

    def greys() -> Iterator[tuple[int, np.ndarray]]:
        nonlocal count
        for message in _recorded_pictures(path, topics):
            if isinstance(message, Taken):
                yield count, _grey(message.image)
                count += 1

    for number, picture in thinned(greys(), most):
        stored(picture, folder / f"frame_{number:06d}.png")
    return count


class BagPictures:
    """A bag's pictures as a source for the wizard: all of them, named by their index, taken when the scene is at
    rest. PATH#TOPIC chooses one of several topics."""

    live = True

    def __init__(self, text: str) -> None:
        """Raises InputError as `open_bag` does."""
        path, _, topic = text.partition("#")
        self.name, self.ended = printable(Path(path).name), False
        self.notes: tuple[str, ...] = ()
        try:
            self._messages = _recorded_pictures(Path(path), Topics(topic, moment="none", joints="none", camera="none"))
        except InputError as error:
            if "several topics" not in str(error):
                raise
            raise InputError("has several topics for image", where=path, remedy=f"write {path}#TOPIC") from None
        self._count, self._start_s = 0, 0.0

    def skip(self) -> None:
        """Skip the next picture."""
        self.next(0.0)

    def next(self, timeout_s: float) -> Picture | None:
        """The next picture; None at the end."""
        for message in self._messages:
            if isinstance(message, Taken):
                self._start_s = self._start_s if self._count else message.time_s
                self._count += 1
                image = np.clip(np.rint(message.image), 0, 255).astype(np.uint8)
                return frame_picture(f"frame {self._count - 1}", image, message.time_s - self._start_s)
        self.close()
        return None

    def close(self) -> None:
        self.ended = True
        self._messages.close()
