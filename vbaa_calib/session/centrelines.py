"""recording/centrelines.csv, a frame at a time: the file is checked whole, and only the places of its frames are kept.

Files of the usual kind (numbers and commas) go through NumPy in blocks; from the first block on that holds anything
else (quotes, letters, a cell too few) the file is read row by row, which knows what to say of each.
"""

from __future__ import annotations

import csv
import io
import os
from array import array
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from vbaa_calib.core.csv_rows import check_count, no_csv, no_rows, number, places_of, whole_number
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import require_file

from .rows import wrong
from .settings import Session

COLUMNS, DEVIATION = ("frame", "u_px", "v_px"), "sigma_px"
_FAR_PX = 1e7
"""Places and deviations beyond it are slips of the pen."""
BLOCK = 1 << 20
ENDLESS = "a line of more than 1 MB"
_MOST_FRAME = 2**53
_NEWLINE, _RETURN, _COMMA = b"\n\r,"


def read_centrelines(session: Session) -> Centrelines:
    """recording/centrelines.csv, checked from the first line to the last. Raises InputError naming file and line."""
    path = session.root / "recording" / "centrelines.csv"
    require_file(path)
    try:
        with path.open("rb") as stream:
            return _indexed(stream, path)
    except UnicodeDecodeError:
        raise InputError("is not UTF-8 text", where=path, remedy="save it as UTF-8") from None
    except OSError as error:
        what = f"cannot be read ({error.strerror})"
        raise InputError(what, where=path, remedy="check the path and its permissions") from None


@dataclass(frozen=True)
class Layout:
    """Cells of a row, and where the frame's, u's, v's and, where it is given, the deviation's stand."""

    header: tuple[str, ...]
    places: tuple[int, ...]


class Centrelines(Mapping[int, np.ndarray]):
    """Frame → (N, 3) of u_px, v_px, sigma_px (NaN where the column is missing), read from the file when asked for.

    Takes 24 bytes for each run of rows of one frame: for each frame, where its points stand together.

    Raises InputError, when asked for a frame, if the file is no longer the one that was checked.
    """

    def __init__(self, path: Path, state: tuple[int, ...], layout: Layout, runs: np.ndarray) -> None:
        """`runs` (R, 3) int64: frame, and the bytes of the file from which on and up to which its rows stand."""
        self._path, self._state, self._layout = path, state, layout
        self._runs = runs[np.argsort(runs[:, 0], kind="stable")]
        self._frames = np.unique(self._runs[:, 0])

    def __len__(self) -> int:
        return len(self._frames)

    def __iter__(self) -> Iterator[int]:
        return iter(self._frames.tolist())

    def __contains__(self, frame: object) -> bool:
        return isinstance(frame, int | np.integer) and len(self._of(int(frame))) > 0

    def __getitem__(self, frame: int) -> np.ndarray:
        runs = self._of(frame)
        if len(runs) == 0:
            raise KeyError(frame)
        table = np.empty((0, 0))
        with suppress(OSError), self._path.open("rb") as stream:
            rows = [_between(stream, begin, end) for _, begin, end in runs.tolist()]
            if _state(stream) == self._state:
                table = _numbers(b"".join(rows).decode(), self._layout)
        if len(table) == 0:
            remedy = "start again once nothing writes to it"
            raise InputError("has changed since it was checked", where=self._path, remedy=remedy)
        points = np.full((len(table), 3), np.nan)
        points[:, : table.shape[1] - 1] = table[:, 1:]
        # a point that stands there twice was measured once
        _, first = np.unique(points[:, 0] + 1j * points[:, 1], return_index=True)
        return points if len(first) == len(points) else points[np.sort(first)]

    def _of(self, frame: int) -> np.ndarray:
        first, last = np.searchsorted(self._runs[:, 0], [frame, frame + 1])
        return self._runs[first:last]


def _state(stream: BinaryIO) -> tuple[int, ...]:
    status = os.fstat(stream.fileno())
    return status.st_ino, status.st_size, status.st_mtime_ns


def _between(stream: BinaryIO, begin: int, end: int) -> bytes:
    stream.seek(begin)
    rows = stream.read(end - begin)
    return rows if rows.endswith((b"\n", b"\r")) else rows + b"\n"


def _indexed(stream: BinaryIO, path: Path) -> Centrelines:
    state, lines = _state(stream), _Lines(stream)
    header = next(_cells(lines, path), [])
    if not header:
        raise InputError("is empty", where=path, remedy=f"the first line must name the columns {','.join(COLUMNS)}")
    places = places_of(header, COLUMNS, (DEVIATION,), path)
    layout = Layout(tuple(header), tuple(places.values()))
    runs, at, line = [np.empty((0, 3), np.int64)], lines.at, lines.number
    stream.seek(at)
    while block := stream.read(BLOCK) + stream.readline(BLOCK):
        ended = block.count(b"\n")
        if len(block) == 2 * BLOCK and not block.endswith(b"\n") and b"\r" not in block:
            raise no_csv(csv.Error(ENDLESS), f"{path} line {line + ended + 1}")
        found = _plain(block, layout)
        if found is None:
            stream.seek(at)
            runs.append(_row_by_row(_Lines(stream, at, line), layout, places, path))
            break
        runs.append(found + np.array([0, at, at]))
        at, line = at + len(block), line + ended
    every = np.concatenate(runs)
    if not len(every):
        raise no_rows(path)
    return Centrelines(path, state, layout, every)


def _plain(block: bytes, layout: Layout) -> np.ndarray | None:
    """(R, 3) runs of whole lines, by bytes of the block; None where anything is unusual, let alone wrong."""
    if b'"' in block or block.count(b"\r") != block.count(b"\r\n"):
        return None
    data = np.frombuffer(block if block.endswith(b"\n") else block + b"\n", np.uint8)
    ends = np.flatnonzero(data == _NEWLINE) + 1
    begins = np.concatenate([[0], ends[:-1]])
    filled = ends - begins > 1 + (data[begins] == _RETURN)
    commas = np.add.reduceat(data == _COMMA, begins, dtype=np.int64)
    if (commas[filled] != len(layout.header) - 1).any():
        return None
    if not filled.any():
        return np.empty((0, 3), np.int64)
    try:
        table = _loaded(block.decode("ascii"), layout)
    except ValueError:  # UnicodeDecodeError is one, too
        return None
    frame = table[:, 0]
    sound = (np.abs(table[:, 1:]) <= _FAR_PX).all() and (
        (frame >= 0) & (frame < _MOST_FRAME) & (frame == np.floor(frame))
    ).all()
    if not sound or len(table) != filled.sum() or not (table[:, 3:] > 0.0).all():
        return None
    first = np.concatenate([[0], np.flatnonzero(np.diff(frame)) + 1])
    last = np.concatenate([first[1:], [len(frame)]]) - 1
    runs = [frame[first].astype(np.int64), begins[filled][first], np.minimum(ends[filled][last], len(block))]
    return np.stack(runs, axis=1)


def _loaded(text: str, layout: Layout) -> np.ndarray:
    """(N, 3 or 4) the wanted columns of rows. Raises ValueError for what is no number."""
    return np.loadtxt(io.StringIO(text), delimiter=",", comments=None, usecols=layout.places, ndmin=2)


def _numbers(text: str, layout: Layout) -> np.ndarray:
    """The same of rows that were checked, quoted ones included."""
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    try:
        return _loaded(text, layout)
    except ValueError:
        rows = [cells for cells in csv.reader(io.StringIO(text)) if any(cell.strip() for cell in cells)]
        return np.array([[float(cells[place]) for place in layout.places] for cells in rows])


class _Lines:
    """Text lines of a file of bytes, ended as any system ends them. `at` is the byte where the next one begins, and
    `number` counts those that were given out."""

    def __init__(self, stream: BinaryIO, at: int = 0, number: int = 0) -> None:
        self.at, self.number = at, number
        self._pieces = _pieces(stream)

    def __iter__(self) -> _Lines:
        return self

    def __next__(self) -> str:
        piece = next(self._pieces)
        text = piece.decode("utf-8" if self.at else "utf-8-sig")
        self.at, self.number = self.at + len(piece), self.number + 1
        return text.rstrip("\r\n") + "\n"


def _pieces(stream: BinaryIO) -> Iterator[bytes]:
    rest = b""
    while part := stream.readline(BLOCK):
        *whole, rest = (rest + part).splitlines(keepends=True)
        yield from whole
        if rest.endswith(b"\n"):  # a \r may be the first half of an end
            yield rest
            rest = b""
        elif len(rest) >= 2 * BLOCK:
            raise csv.Error(ENDLESS)
    if rest:
        yield rest


def _cells(lines: _Lines, path: Path) -> Iterator[list[str]]:
    reader = csv.reader(lines, strict=True)
    try:
        for row in reader:
            cells = [cell.strip() for cell in row]
            if any(cells):
                yield cells
    except csv.Error as error:
        raise no_csv(error, f"{path} line {lines.number}") from None


def _row_by_row(lines: _Lines, layout: Layout, places: Mapping[str, int], path: Path) -> np.ndarray:
    """(R, 3) runs of the rest of a file. Raises InputError naming the first line that is wrong."""
    runs, begin = array("q"), lines.at
    for cells in _cells(lines, path):
        check_count(cells, layout.header, f"{path} line {lines.number}")
        row = {name: cells[at] for name, at in places.items()} | {"line": str(lines.number)}
        if DEVIATION in row and number(row, DEVIATION, path) <= 0:
            raise wrong(row, path, "sigma_px is not positive", "give a standard deviation in pixels")
        frame = whole_number(row, "frame", path)
        for name in places.keys() - {"frame"}:
            if abs(number(row, name, path)) > _FAR_PX:
                raise wrong(row, path, f"{name} is {row[name]}", "give pixels: no picture is that large")
        if runs and runs[-3] == frame:
            runs[-1] = lines.at
        else:
            runs.extend((frame, begin, lines.at))
        begin = lines.at
    return np.frombuffer(runs, np.int64).reshape(-1, 3) if runs else np.empty((0, 3), np.int64)
