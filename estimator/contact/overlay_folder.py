"""The folder of debug pictures: one per frame, whatever its status, and a page that shows them all."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from html import escape
from pathlib import Path

import cv2
import numpy as np

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import replacing_folder

from .estimate import ContactEstimator
from .overlay import MEANINGS, STATUS_COLOURS, frame_picture, in_brief
from .recording import FrameContact

PAGE = "index.html"
OURS = '<meta name="generator" content="vbaa estimate --overlay">'
"""A folder whose page has this line may be replaced."""
THUMBNAILS, THUMBNAIL_WIDTH = "thumbnails", 320
JPEG = [
    *(cv2.IMWRITE_JPEG_QUALITY, 92),
    *(cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444),  # thin coloured lines stay sharp
]

_STYLE = """
  body { margin: 0; background: #14171c; color: #e5e7eb;
         font: 15px/1.45 system-ui, -apple-system, "Segoe UI", Roboto, sans-serif; }
  main { max-width: 1500px; margin: 0 auto; padding: 22px; }
  h1 { font-size: 20px; margin: 0 0 14px; }
  input[name=status] { position: absolute; opacity: 0; }
  label { display: inline-block; margin: 0 8px 10px 0; padding: 4px 13px; border-radius: 99px; cursor: pointer;
          border: 2px solid var(--level, #94a3b8); }
  input:focus-visible + label { outline: 2px solid #fff; outline-offset: 2px; }
  input:checked + label { background: var(--level, #94a3b8); color: #fff; text-shadow: 0 0 3px #000;
                          box-shadow: inset 0 0 0 99px rgba(0, 0, 0, .3); }
  .frames { display: grid; grid-template-columns: repeat(auto-fill, minmax(230px, 1fr)); gap: 14px; margin-top: 8px; }
  .frames a { color: inherit; text-decoration: none; background: #1f242c; border-radius: 8px; overflow: hidden;
              border-top: 4px solid var(--level); }
  .frames img { width: 100%; display: block; } .frames p { margin: 8px 11px 10px; overflow-wrap: anywhere; }
  .frames b { float: right; } .frames small { color: #9ca3af; display: block; clear: both; }
"""


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
    counts = Counter(entry.status for entry in entries)
    known = [status for status in STATUS_COLOURS if counts[status]]
    hidden = "".join(f"  #only-{status}:checked ~ .frames a:not(.{status}) {{ display: none; }}\n" for status in known)
    buttons = [_button("all", f"all {len(entries)}", "checked", "")]
    for status in known:
        title = f"{status} {counts[status]}"
        buttons.append(_button(f"only-{status}", title, f'title="{escape(MEANINGS[status])}"', _level(status)))
    cards = "".join(_card(entry) for entry in sorted(entries, key=lambda entry: entry.frame))
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">{OURS}\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>What was seen of the antenna</title>\n<style>{_STYLE}{hidden}</style></head>\n"
        f"<body><main><h1>What was seen of the antenna, frame by frame</h1>\n{''.join(buttons)}\n"
        f'<div class="frames">\n{cards}</div></main></body></html>\n'
    )


def _level(status: str) -> str:
    return f'style="--level: {STATUS_COLOURS[status]}"'


def _button(name: str, words: str, extra: str, style: str) -> str:
    return f'<input type="radio" name="status" id="{name}" {extra}><label for="{name}" {style}>{escape(words)}</label>'


def _card(entry: Entry) -> str:
    return (
        f'<a class="{entry.status}" href="{entry.name}.jpg" {_level(entry.status)}>'
        f'<img loading="lazy" src="{THUMBNAILS}/{entry.name}.jpg" alt="frame {entry.frame}, {entry.status}">'
        f"<p><b>{entry.status}</b>frame {entry.frame}"
        f"<small>{entry.time_s:.2f} s: {escape(entry.words)}</small></p></a>\n"
    )
