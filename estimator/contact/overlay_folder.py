"""The folder of debug pictures: one per frame, whatever its status, and a page that shows them all."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import jinja2
import numpy as np

from estimator.table.contacts import STATUSES
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import replacing_folder

from .estimate import ContactEstimator
from .overlay import STATUS_COLOURS, frame_picture, in_brief
from .recording import FrameContact

PAGE = "index.html"
OURS = '<meta name="generator" content="vbaa estimate --overlay">'
"""A folder whose page has this line may be replaced."""
THUMBNAILS, THUMBNAIL_WIDTH = "thumbnails", 320
JPEG = [
    *(cv2.IMWRITE_JPEG_QUALITY, 92),
    *(cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444),  # thin coloured lines stay sharp
]


@dataclass(frozen=True)
class Entry:
    """One frame's line on the page: `name` of its picture without suffix, and what it says."""

    frame: int
    time_s: float
    status: str
    name: str
    words: str


def refuse_folder(path: Path, force: bool) -> None:
    """Raises InputError unless debug pictures may be written to `path`; a folder of other things is never replaced."""
    parent = Path(os.path.realpath(path)).parent
    if not parent.is_dir():
        raise InputError("its folder does not exist", where=path, remedy=f"create {path.parent} first")
    if not os.access(parent, os.W_OK | os.X_OK):
        raise InputError("its folder is read-only", where=path, remedy="write somewhere else")
    if not os.path.lexists(path):
        return
    if not path.is_dir() or path.is_symlink():
        raise InputError("is not a folder", where=path, remedy="take another name")
    if not force:
        raise InputError("exists already", where=path, remedy="give --force to replace it, or another name")
    page = path / PAGE
    ours = page.is_file() and OURS.encode() in page.read_bytes()[:500]
    if any(path.iterdir()) and not ours:
        raise InputError("holds other things than debug pictures", where=path, remedy="take another name")


@contextmanager
def overlaid(
    found: Iterable[FrameContact], estimator: ContactEstimator, path: Path, force: bool
) -> Iterator[Iterator[FrameContact]]:
    """The same frames, each drawn into the folder as it passes; the folder is there once all went well."""
    refuse_folder(path, force)
    with replacing_folder(path) as folder:
        (folder / THUMBNAILS).mkdir()
        entries: list[Entry] = []
        yield _drawn(found, estimator, folder, entries)
        (folder / PAGE).write_text(page(entries), encoding="utf-8")


def _drawn(
    found: Iterable[FrameContact], estimator: ContactEstimator, folder: Path, entries: list[Entry]
) -> Iterator[FrameContact]:
    for item in found:
        frame, status = item.frame, item.contact.status
        entry = Entry(frame.frame, frame.time_s, status, f"frame_{frame.frame:06d}_{status}", in_brief(item.contact))
        _write(frame_picture(estimator, item), estimator.rig.camera.image_size, folder, entry.name)
        entries.append(entry)
        yield item


def _write(image: np.ndarray, image_size: tuple[int, int], folder: Path, name: str) -> None:
    """The picture, and a thumbnail of its part above the legend."""
    rows = round(image.shape[1] * image_size[1] / image_size[0])
    small = (THUMBNAIL_WIDTH, max(1, round(THUMBNAIL_WIDTH * rows / image.shape[1])))
    thumbnail = cv2.resize(image[:rows], small, interpolation=cv2.INTER_AREA)
    for place, pixels in ((folder, image), (folder / THUMBNAILS, thumbnail)):
        (place / f"{name}.jpg").write_bytes(cv2.imencode(".jpg", pixels, JPEG)[1].tobytes())


def page(entries: list[Entry]) -> str:
    """The page: thumbnails in the order of the frames, and buttons that show one status alone. No scripts."""
    loader = jinja2.PackageLoader("estimator.contact", package_path="")
    environment = jinja2.Environment(
        loader=loader, autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    counts = Counter(entry.status for entry in entries)
    return environment.get_template("overlay.html.j2").render(
        generator=OURS,
        entries=sorted(entries, key=lambda entry: entry.frame),
        counts={status: counts[status] for status in STATUS_COLOURS if counts[status]},
        meanings=STATUSES,
        colours=STATUS_COLOURS,
        thumbnails=THUMBNAILS,
    )
