"""recording/centrelines.csv, read frame by frame: the file is checked once, and only its frames' byte ranges kept.

Plain files (numbers and commas) are parsed by NumPy in blocks. Any other (quotes, letters, missing cells) is first
copied row by row by the CSV reader, which names the faulty line.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Self

import numpy as np

from vbaa_calib.core.arrays import FARTHEST_PX
from vbaa_calib.core.csv_rows import MOST_WHOLE, csv_rows, loaded, number, places_of, plain_rows, whole_number
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import require_file

from .settings import Session
from .tables import Frame, numbers_of, wrong

_COLUMNS, _DEVIATION = ("frame", "u_px", "v_px"), "sigma_px"
BLOCK = 1 << 20
LOT = 64
"""Frames that are read at once."""


def read_centrelines(session: Session) -> Centrelines:
    """recording/centrelines.csv, checked from the first line to the last. Raises InputError naming file and line."""
    return centrelines_of(session.root / "recording" / "centrelines.csv")


def centrelines_of(path: Path) -> Centrelines:
    """As `read_centrelines`, of any file."""
    require_file(path)
    found = None
    with suppress(OSError), path.open("rb") as stream:
        found = _indexed(stream)
    if found is not None and len(found[2]):
        return Centrelines(path, None, *found)
    copy = tempfile.TemporaryFile()  # noqa: SIM115 - it is read for as long as the mapping lives
    _copy_plainly(path, copy)
    found = _indexed(copy)
    assert found is not None
    return Centrelines(path, copy, *found)


@dataclass(frozen=True)
class _Layout:
    """Number of cells in a row, and the columns of frame, u, v and, if given, sigma."""

    count: int
    places: tuple[int, ...]


class Centrelines(Mapping[int, np.ndarray]):
    """Frame → (N, 3) of u_px, v_px, sigma_px (NaN where the column is missing), read from the file when asked for.

    Takes 24 bytes for each run of consecutive rows of one frame. Looking up a frame raises InputError if the file has
    changed since it was checked. frames (F,) : their numbers, in order.
    """

    def __init__(
        self,
        path: Path,
        copy: BinaryIO | None,
        state: tuple[int, ...],
        layout: _Layout,
        runs: np.ndarray,
    ) -> None:
        """`runs` (R, 3) int64: frame, first and last byte of its rows in the file or its plain copy."""
        self._path, self._copy, self._state, self._layout = path, copy, state, layout
        self._runs = runs[np.argsort(runs[:, 0], kind="stable")]
        self.frames = np.unique(self._runs[:, 0])
        self._lot, self._points = -1, [np.empty((0, 3))]

    def checked(self, frames: Sequence[Frame], table: str) -> Self:
        """These, unless one is of no frame of a table: raises InputError."""
        unknown = np.setdiff1d(self.frames, numbers_of(frames))
        if len(unknown):
            remedy = "give every frame its row there"
            raise InputError(f"frame {unknown[0]} is not in {table}", where=self._path, remedy=remedy)
        return self

    def __len__(self) -> int:
        return len(self.frames)

    def __iter__(self) -> Iterator[int]:
        return iter(self.frames.tolist())

    def __contains__(self, frame: object) -> bool:
        return isinstance(frame, int | np.integer) and self._place(int(frame)) is not None

    def __getitem__(self, frame: int) -> np.ndarray:
        place = self._place(frame)
        if place is None:
            raise KeyError(frame)
        lot, at = divmod(place, LOT)
        if lot != self._lot:
            self._points, self._lot = self._read(self.frames[lot * LOT : (lot + 1) * LOT]), lot
        points = self._points[at]
        # a repeated point was measured once
        _, first = np.unique(points[:, 0] + 1j * points[:, 1], return_index=True)
        return points if len(first) == len(points) else points[np.sort(first)]

    def _place(self, frame: int) -> int | None:
        at = int(np.searchsorted(self.frames, frame))
        return at if at < len(self.frames) and self.frames[at] == frame else None

    def _read(self, frames: np.ndarray) -> list[np.ndarray]:
        """The points (N, 3) of frames that follow each other."""
        first, last = np.searchsorted(self._runs[:, 0], [frames[0], frames[-1] + 1])
        table = np.empty((0, 0))
        with suppress(OSError), nullcontext(self._copy) if self._copy else self._path.open("rb") as stream:
            rows = []
            for _, begin, end in self._runs[first:last].tolist():
                stream.seek(begin)
                rows.append(stream.read(end - begin).rstrip(b"\n") + b"\n")
            if _state(stream) == self._state:
                table = loaded(b"".join(rows).decode(), self._layout.places)
        if len(table) == 0:
            remedy = "start again once nothing writes to it"
            raise InputError("has changed since it was checked", where=self._path, remedy=remedy)
        points = np.full((len(table), 3), np.nan)
        points[:, : table.shape[1] - 1] = table[:, 1:]
        return np.split(points, np.searchsorted(table[:, 0], frames[1:]))


def _state(stream: BinaryIO) -> tuple[int, ...]:
    status = os.fstat(stream.fileno())
    return status.st_ino, status.st_size, status.st_mtime_ns


def _indexed(stream: BinaryIO) -> tuple[tuple[int, ...], _Layout, np.ndarray] | None:
    """State and layout of a plain file, and (R, 3) runs of rows in it; None for any other."""
    state, line = _state(stream), stream.readline(BLOCK)
    try:
        header = [name.strip() for name in line.decode("utf-8-sig").split(",")]
        layout = _Layout(len(header), tuple(places_of(header, _COLUMNS, (_DEVIATION,), Path()).values()))
    except (UnicodeDecodeError, InputError):
        return None
    runs, at = [np.empty((0, 3), np.int64)], len(line)
    while at < state[1]:
        block, last = stream.read(min(BLOCK, state[1] - at - 1)), stream.readline(BLOCK)
        endless = len(last) == BLOCK and not last.endswith(b"\n")
        found = None if endless else _plain(block + last, layout)
        if found is None:
            return None
        runs.append(found + np.array([0, at, at]))
        at += len(block + last)
    return state, layout, np.concatenate(runs)


def _plain(block: bytes, layout: _Layout) -> np.ndarray | None:
    """(R, 3) runs of whole lines, in bytes of the block; None unless they are plain and correct."""
    rows = plain_rows(block, layout.count, layout.places) if block else None
    if rows is None:
        return None
    cells, begins, ends = rows
    if not len(cells):
        return np.empty((0, 3), np.int64)
    frame, others = cells[:, 0], cells[:, 1:]
    sound = ((frame >= 0) & (frame < MOST_WHOLE) & (frame == np.floor(frame))).all()
    if not sound or (np.abs(others) > FARTHEST_PX).any() or not (others[:, 2:] > 0.0).all():
        return None
    first = np.concatenate([[0], np.flatnonzero(np.diff(frame)) + 1])
    last = np.concatenate([first[1:], [len(frame)]]) - 1
    return np.stack([frame[first].astype(np.int64), begins[first], ends[last]], axis=1)


def _copy_plainly(path: Path, copy: BinaryIO) -> None:
    """Write the numbers as a plain file. Raises InputError naming the first wrong line."""
    columns: tuple[str, ...] = ()
    for row in csv_rows(path, _COLUMNS, (_DEVIATION,)):
        if not columns:
            columns = tuple(name for name in row if name != "line")
            copy.write(",".join(columns).encode() + b"\n")
        if _DEVIATION in row and number(row, _DEVIATION, path) <= 0:
            raise wrong(row, path, "sigma_px is not positive", "give a standard deviation in pixels")
        frame, values = whole_number(row, "frame", path), [number(row, name, path) for name in columns[1:]]
        for name, value in zip(columns[1:], values, strict=True):
            if abs(value) > FARTHEST_PX:
                raise wrong(row, path, f"{name} is {row[name]}", "give pixels: no picture is that large")
        copy.write(f"{frame},{','.join(map(repr, values))}\n".encode())
    copy.seek(0)
