"""recording/centrelines.csv, read frame by frame: the file is checked once, and only its frames' byte ranges kept.

Plain files (numbers and commas) are parsed by NumPy in blocks. Any other (quotes, letters, missing cells) is first
copied row by row by the CSV reader, which names the faulty line.
"""

from __future__ import annotations

import csv
import io
import json
import math
import os
import pickle
import re
import struct
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Self

import numpy as np

from vbaa_calib.core.arrays import PLAUSIBLE
from vbaa_calib.core.csv_rows import (
    MOST_WHOLE,
    csv_rows,
    header_of,
    loaded,
    number,
    places_of,
    plain_rows,
    whole_number,
)
from vbaa_calib.core.errors import InputError, require_extra
from vbaa_calib.core.files import read_bytes, require_file

from .settings import Session
from .tables import Frame, numbers_of, wrong

_COLUMNS, _DEVIATION = ("frame", "u_px", "v_px"), "sigma_px"


@dataclass(frozen=True)
class _CentrelineSettings:
    """Limits and block sizes of reading a table of centrelines."""

    block: int = 1 << 20  # bytes that are read at once, and the longest line
    lot: int = 64  # frames that are read at once
    kept: int = 1 << 25  # bytes of a file of which all points stay in memory, most
    least_likelihood: float = 0.6  # of a network's points: pcutoff of DeepLabCut


CENTRELINES = _CentrelineSettings()


def read_centrelines(session: Session) -> Centrelines:
    """The centrelines in recording/centrelines.csv, checked completely; of several cameras the session's own, and in
    its `others` those of the rest. Raises InputError naming file and line."""
    path = session.root / "recording" / "centrelines.csv"
    return centrelines_of(path, cameras=session.in_turn)


def centrelines_of(path: Path, which: str | None = None, cameras: Sequence[str] = ()) -> Centrelines:
    """The centrelines in any file: in the form of `read_centrelines`, or by DeepLabCut (CSV, HDF5), WhiskerToolbox
    (CSV, or a folder of them), Janelia's whisk (.whiskers, or .measurements next to it) or in NWB.

    which : of several lines in a frame: an individual, a whisker's label, a line's place from 0 on; the name in the
        column antenna of a table of ours. cameras : of a table of ours with the lines of several; of the first one, and
        in its `others` of the rest.
    """
    if cameras:
        require_file(path)
    named = _by_name(path, "camera", cameras)
    if cameras:
        return _of_cameras(named, cameras, path)
    if named is not None and len(named) > 1:
        what = f"has the lines of several cameras: {', '.join(named)}"
        raise InputError(what, where=path, remedy="give a rig with these cameras, or the rows of one of them")
    if (named := _by_name(path)) is not None:
        return named[_chosen(list(named), which, path)]
    foreign = _foreign(path)
    if foreign is not None:
        return _as_ours(path, *foreign[_chosen(list(foreign), which, path)])
    if which is not None:
        raise InputError("--line is of another tracker's table", where=path, remedy="leave it out")
    require_file(path)
    found = None
    with suppress(OSError), path.open("rb") as stream:
        found = _indexed(stream)
    if found is not None and len(found[2][0]):
        return Centrelines(path, None, *found)
    copy = tempfile.TemporaryFile()  # noqa: SIM115 - it is read for as long as the mapping lives
    _copy_plainly(path, copy)
    found = _indexed(copy)
    assert found is not None
    return Centrelines(path, copy, *found)


def _of_cameras(named: dict[str, Centrelines] | None, cameras: Sequence[str], path: Path) -> Centrelines:
    """The first camera's lines, with the others' in `others`. Raises InputError for a table that does not name the
    cameras."""
    names = ", ".join(cameras)
    if named is None:
        remedy = f"name the camera of each point: {names}"
        raise InputError("has no column camera", where=path, remedy=remedy)
    if unknown := sorted(named.keys() - set(cameras)):
        raise InputError(f"there is no camera {unknown[0]}", where=path, remedy=f"name one of {names}")
    first = named.pop(cameras[0])
    first.others = named
    return first


def antennas_of(path: Path, which: str | None = None) -> dict[str, Centrelines]:
    """The lines of all antennas in a file by name, of which `which` may choose one. Raises InputError as
    `centrelines_of`."""
    named = _by_name(path)
    if named is None and (foreign := _foreign(path)) is not None:
        named = {name: _as_ours(path, *found) for name, found in foreign.items() if which in (None, name)}
    if named is None or which is not None:
        return {which or "antenna": centrelines_of(path, which)}
    return named


def _by_name(path: Path, column: str = "antenna", names: Iterable[str] = ()) -> dict[str, Centrelines] | None:
    """The lines in a table of ours by the names in its column antenna, or camera, with these names at least; None
    for any other file."""
    if path.suffix.lower() != ".csv" or not path.is_file() or column not in header_of(path):
        return None
    copies: dict[str, BinaryIO] = {}
    for row, columns, values in _plain_rows(path, (column,)):
        name = row[column]
        if not name:
            raise wrong(row, path, f"{column} is empty", f"name the {column} that the point is of")
        if name not in copies:
            copies[name] = tempfile.TemporaryFile()  # noqa: SIM115 - it is read for as long as the mapping lives
            copies[name].write(",".join(columns).encode() + b"\n")
        copies[name].write(values)
    for name in names:
        if name not in copies:
            copies[name] = tempfile.TemporaryFile()  # noqa: SIM115 - as above
            copies[name].write(b"frame,u_px,v_px\n")
    found = {}
    for name, copy in copies.items():
        copy.seek(0)
        indexed = _indexed(copy)
        assert indexed is not None
        found[name] = Centrelines(path, copy, *indexed)
    return found


def _as_ours(path: Path, points: np.ndarray, note: str) -> Centrelines:
    """Centrelines from points (N, 3) of frame, u, v, px, of another tracker's file. Raises InputError for impossible
    pixels."""
    copy = tempfile.TemporaryFile()  # noqa: SIM115 - as above
    copy.write(b"frame,u_px,v_px\n")
    copy.writelines(f"{frame:.0f},{u!r},{v!r}\n".encode() for frame, u, v in points.tolist())
    copy.seek(0)
    found = _indexed(copy)
    if found is None or not len(found[2][0]):
        copy.close()
        raise InputError("has no points, or impossible ones", where=path, remedy="export it again, in pixels")
    return Centrelines(path, copy, *found, note)


_Layout = tuple[int, tuple[int, ...]]
"""Number of cells in a row, and the columns of frame, u, v and, if they are there, sigma."""
_Rows = tuple[np.ndarray, np.ndarray]
"""Runs of rows of one frame (R, 3) int64: frame, first and last byte in the file or its plain copy. The cells (P, K) of
these columns, if they were kept."""


class Centrelines(Mapping[int, np.ndarray]):
    """Mapping from a frame to its points (N, 3): u_px, v_px, sigma_px (NaN where the column is missing), read from
    the file on access, or kept if it is small.

    Takes 24 bytes for each run of consecutive rows of one frame. Looking up a frame raises InputError if the file has
    changed since it was checked. frames (F,) : their numbers, in order. note : on how another tracker's were read.
    others : those of further cameras, by name.
    """

    def __init__(
        self, path: Path, copy: BinaryIO | None, state: tuple[int, ...], layout: _Layout, rows: _Rows, note: str = ""
    ) -> None:
        runs, self._cells = rows
        if (np.diff(self._cells[:, 0]) < 0).any():
            self._cells = self._cells[np.argsort(self._cells[:, 0], kind="stable")]
        self._path, self._copy, self._state, self._layout, self.note = path, copy, state, layout, note
        self._runs = runs[np.argsort(runs[:, 0], kind="stable")]
        self.frames = np.unique(self._runs[:, 0])
        self._first, self._last, self._points = 0, -1, list[np.ndarray]()
        self._repeated = False  # whether a frame may have a point twice
        self.others: dict[str, Centrelines] = {}

    def checked(self, frames: Sequence[Frame], table: str) -> Self:
        """These centrelines, if all their frames are in a table; raises InputError otherwise."""
        unknown = np.setdiff1d(self.frames, numbers_of(frames))
        if len(unknown):
            remedy = "give every frame its row there"
            raise InputError(f"frame {unknown[0]} is not in {table}", where=self._path, remedy=remedy)
        for other in self.others.values():
            other.checked(frames, table)
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
        at, follows = place - self._first, place == self._last + 1
        if not 0 <= at < len(self._points):
            # those that will be asked for next come with it
            count = CENTRELINES.lot if follows else 1
            self._points, self._first = self._read(self.frames[place : place + count]), place
            at = 0
        points, self._last = self._points[at], place
        if not self._repeated:
            return points
        # a repeated point was measured once
        _, first = np.unique(points[:, 0] + 1j * points[:, 1], return_index=True)
        return points if len(first) == len(points) else points[np.sort(first)]

    def together(self, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The points of several frames (F,), (P, 3) as of one, frame by frame, and how many each has."""
        places = np.searchsorted(self.frames, frames)
        if len(frames) and places[-1] < len(self.frames) and (np.diff(places) == 1).all():
            own = self.frames[places[0] : places[-1] + 1]
            points, begins, repeated = self._points_of(own) if (own == frames).all() else (None, None, True)
            if points is not None and begins is not None and not repeated:
                return points, np.diff(begins, append=len(points))
        nothing = np.empty((0, 3))
        several = [self.get(frame, nothing) for frame in frames.tolist()]
        return np.concatenate([nothing, *several]), np.array([len(each) for each in several], int)

    def _place(self, frame: int) -> int | None:
        at = int(np.searchsorted(self.frames, frame))
        return at if at < len(self.frames) and self.frames[at] == frame else None

    def _read(self, frames: np.ndarray) -> list[np.ndarray]:
        """The points (N, 3) of consecutive frames."""
        points, begins, self._repeated = self._points_of(frames)
        return np.split(points, begins[1:])

    def _points_of(self, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray, bool]:
        """The points (P, 3) of consecutive frames, where each frame's begin, and whether any may be there twice."""
        table = np.empty((0, 0))
        with suppress(OSError), nullcontext(self._copy) if self._copy else self._path.open("rb") as stream:
            found = self._cells_of(frames, stream)
            if _state(stream) == self._state:
                table = found
        if len(table) == 0:
            remedy = "start again once nothing writes to it"
            raise InputError("has changed since it was checked", where=self._path, remedy=remedy)
        points = np.full((len(table), 3), np.nan)
        points[:, : table.shape[1] - 1] = table[:, 1:]
        begins = np.searchsorted(table[:, 0], frames)
        further = np.diff(points[:, :2], axis=0)
        further[begins[1:] - 1] = np.nan  # from one frame's last point to the next one's first
        if any((np.isnan(further) | (way * further > 0.0)).all(axis=0).any() for way in (1.0, -1.0)):
            return points, begins, False  # in order along one axis
        along = table[np.lexsort((table[:, 1], table[:, 0])), :2]
        return points, begins, bool((along[1:] == along[:-1]).all(axis=1).any())

    def _cells_of(self, frames: np.ndarray, stream: BinaryIO) -> np.ndarray:
        """The rows (P, K) of consecutive frames, in their order."""
        ends = [frames[0], frames[-1] + 1]
        if len(self._cells):
            return self._cells[slice(*np.searchsorted(self._cells[:, 0], ends))]
        runs, rows = self._runs[slice(*np.searchsorted(self._runs[:, 0], ends))], list[bytes]()
        gaps = np.flatnonzero(runs[1:, 1] != runs[:-1, 2]) + 1  # those next to each other are read together
        for begin, end in zip(runs[[0, *gaps], 1].tolist(), runs[[*(gaps - 1), -1], 2].tolist(), strict=True):
            stream.seek(begin)
            rows.append(stream.read(end - begin).rstrip(b"\n") + b"\n")
        return loaded(b"".join(rows), *self._layout)


def _state(stream: BinaryIO) -> tuple[int, ...]:
    status = os.fstat(stream.fileno())
    return status.st_ino, status.st_size, status.st_mtime_ns


def _indexed(stream: BinaryIO) -> tuple[tuple[int, ...], _Layout, _Rows] | None:
    """State, layout and rows of a plain file; None for any other."""
    state, line = _state(stream), stream.readline(CENTRELINES.block)
    try:
        header = [name.strip() for name in line.decode("utf-8-sig").split(",")]
        layout = len(header), tuple(places_of(header, _COLUMNS, (_DEVIATION,), Path()).values())
    except (UnicodeDecodeError, InputError):
        return None
    runs, at, cells = [np.empty((0, 3), np.int64)], len(line), [np.empty((0, len(layout[1])))]
    while at < state[1]:
        block, last = stream.read(min(CENTRELINES.block, state[1] - at - 1)), stream.readline(CENTRELINES.block)
        endless = len(last) == CENTRELINES.block and not last.endswith(b"\n")
        found = None if endless else _plain(block + last, layout)
        if found is None:
            return None
        runs.append(found[0] + np.array([0, at, at]))
        cells += [found[1]] if state[1] <= CENTRELINES.kept else []
        at += len(block + last)
    return state, layout, (np.concatenate(runs), np.concatenate(cells))


def _plain(block: bytes, layout: _Layout) -> _Rows | None:
    """Rows of whole lines, in bytes of the block; None unless they are plain and correct."""
    rows = plain_rows(block, *layout) if block else None
    if rows is None:
        return None
    cells, begins, ends = rows
    if not len(cells):
        return np.empty((0, 3), np.int64), cells
    frame, others = cells[:, 0], cells[:, 1:]
    sound = ((frame >= 0) & (frame < MOST_WHOLE) & (frame == np.floor(frame))).all()
    if not sound or (np.abs(others) > PLAUSIBLE.pixel_px).any() or not (others[:, 2:] > 0.0).all():
        return None
    first = np.concatenate([[0], np.flatnonzero(np.diff(frame)) + 1])
    last = np.concatenate([first[1:], [len(frame)]]) - 1
    return np.stack([frame[first].astype(np.int64), begins[first], ends[last]], axis=1), cells


def _copy_plainly(path: Path, copy: BinaryIO) -> None:
    """Copy the numbers into a plain file. Raises InputError naming the first wrong line."""
    for line, (_, columns, values) in enumerate(_plain_rows(path)):
        copy.write(values if line else ",".join(columns).encode() + b"\n" + values)
    copy.seek(0)


def _plain_rows(path: Path, more: tuple[str, ...] = ()) -> Iterator[tuple[dict[str, str], tuple[str, ...], bytes]]:
    """Checked rows of a table, each with `more` columns of text: their cells, the names of their numbers, and these
    as a line of a plain file. Raises InputError naming the first wrong line."""
    for row in csv_rows(path, _COLUMNS + more, (_DEVIATION,)):
        columns = tuple(name for name in row if name not in ("line", *more))
        if _DEVIATION in row and number(row, _DEVIATION, path) <= 0:
            raise wrong(row, path, "sigma_px is not positive", "give a standard deviation in pixels")
        frame, values = whole_number(row, "frame", path), [number(row, name, path) for name in columns[1:]]
        for name, value in zip(columns[1:], values, strict=True):
            if abs(value) > PLAUSIBLE.pixel_px:
                raise wrong(row, path, f"{name} is {row[name]}", "give pixels: no picture is that large")
        yield row, columns, f"{frame},{','.join(map(repr, values))}\n".encode()


_Lines = dict[str, tuple[np.ndarray, str]]
"""Of another tracker's file, by name: points (N, 3) of frame, u, v, px, frame by frame, and a note on them."""


def _foreign(path: Path) -> _Lines | None:
    """The lines in another tracker's file; None for a table of ours. Raises InputError."""
    suffix = path.suffix.lower()
    if os.path.isdir(path):
        return _numbered_tables(path)
    if suffix in (".whiskers", ".measurements"):
        return _whisk(path)
    if suffix in (".h5", ".hdf5", ".nwb"):
        return _hdf5(path)
    require_file(path)
    try:
        with path.open(encoding="utf-8-sig") as stream:
            first = stream.readline(CENTRELINES.block)
    except (OSError, UnicodeDecodeError):
        return None
    names = [name.strip().lower() for name in first.split(",")]
    if names[0] in ("scorer", "individuals", "bodyparts"):
        return _of_parts(path, *_network_table(path))
    if names == ["frame", "x", "y"]:
        return _lists(path)
    return None


def _rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """The cells of a table's lines, with their numbers."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            yield from enumerate(csv.reader(stream), 1)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"cannot be read ({error})", where=path, remedy="export it again") from None


def _floats(cells: Sequence[str], path: Path, line: int) -> list[float]:
    """Numbers of cells, NaN for empty ones. Raises InputError with file and line."""
    try:
        return [float(cell) if cell.strip() else math.nan for cell in cells]
    except ValueError:
        raise InputError("a cell is no number", where=f"{path} line {line}", remedy="export it again") from None


def _network_table(path: Path) -> tuple[list[tuple[str, ...]], np.ndarray, np.ndarray]:
    """Columns (individual, part, x|y|likelihood), frames (F,) and values (F, C) of DeepLabCut's CSV."""
    heads: dict[str, list[str]] = {}
    frames: list[float] = []
    values: list[list[float]] = []
    for line, cells in _rows(path):
        if cells and cells[0].lower() in ("scorer", "individuals", "bodyparts", "coords"):
            heads[cells[0].lower()] = cells[1:]
        elif cells:
            numbers = _floats(cells, path, line)
            if len(cells) != 1 + len(heads.get("coords", ())):
                raise InputError(f"has {len(cells)} cells", where=f"{path} line {line}", remedy="export it again")
            frames.append(numbers[0])
            values.append(numbers[1:])
    coords = heads.get("coords", [])
    if not values or any(len(heads.get(key, coords)) != len(coords) for key in ("individuals", "bodyparts")):
        raise InputError("is no table of DeepLabCut", where=path, remedy="scorer, bodyparts and coords come first")
    parts = zip(heads.get("individuals", [""] * len(coords)), heads.get("bodyparts", coords), coords, strict=True)
    return list(parts), np.array(frames), np.array(values)


def _of_parts(path: Path, columns: Sequence[tuple[str, ...]], frames: np.ndarray, values: np.ndarray) -> _Lines:
    """The points of each individual that have a high enough likelihood."""
    individuals = list(dict.fromkeys(each[0] for each in columns))
    found: _Lines = {}
    for name in [each for each in individuals if each != "single" or len(individuals) == 1]:
        place = {(part, coordinate): at for at, (who, part, coordinate) in enumerate(columns) if who == name}
        parts = list(dict.fromkeys(part for part, _ in place))
        if any((part, coordinate) not in place for part in parts for coordinate in "xy"):
            raise InputError("has a part without x and y", where=path, remedy="export it again")
        u, v = (values[:, [place[part, coordinate] for part in parts]] for coordinate in "xy")
        sure = np.isfinite(u) & np.isfinite(v)
        known = sure.sum()
        for at, part in enumerate(parts):
            if (part, "likelihood") in place:
                sure[:, at] &= values[:, place[part, "likelihood"]] >= CENTRELINES.least_likelihood
        points = np.stack([np.broadcast_to(frames[:, None], u.shape)[sure], u[sure], v[sure]], axis=1)
        note = f"{len(parts)} parts a frame ({', '.join(parts)[:80]}); {known - sure.sum()} of {known} points"
        found[name] = points, f"{note} are left out: a likelihood below {CENTRELINES.least_likelihood:g}"
    return found


def _chosen(names: Sequence[str], which: str | None, path: Path) -> str:
    """The name of the chosen line. Raises InputError where there are several and none is chosen."""
    if which is None and len(names) != 1:
        what = f"has {len(names)} lines: {', '.join(map(str, names))}"
        raise InputError(what, where=path, remedy="say which is the antenna: --line NAME")
    if which is not None and which not in names:
        raise InputError(f"has no line {which}", where=path, remedy=f"there are {', '.join(names)}")
    return which if which is not None else names[0]


def _picked(lines: Sequence[tuple[str, int, np.ndarray]], more: str = "") -> _Lines:
    """Lines by name from (name, frame, (n, 2) px), with `more` added to their notes."""
    found: _Lines = {}
    for name in sorted({name for name, _, _ in lines}, key=lambda name: (len(name), name)):
        kept = sorted(((frame, line) for who, frame, line in lines if who == name), key=lambda each: each[0])
        points = [np.column_stack([np.full(len(line), frame), line]) for frame, line in kept]
        found[name] = np.concatenate([np.empty((0, 3)), *points]), f"{len(kept)} lines{more}"
    return found


def _lists(path: Path) -> _Lines:
    """WhiskerToolbox's lines in one file: per row a frame, then all x and all y, each in quotes."""
    lines, count = [], dict[int, int]()
    for line, cells in _rows(path):
        if line == 1 or not cells:
            continue
        x, y = (_floats(cell.split(","), path, line) for cell in [*cells[1:], "", ""][:2])
        frame = _floats(cells[:1], path, line)[0]
        if len(x) != len(y) or not frame >= 0:
            raise InputError(
                "has no frame number, or numbers of x and y that differ",
                where=f"{path} line {line}",
                remedy="export it again",
            )
        number = count.get(int(frame), 0)
        count[int(frame)] = number + 1
        lines.append((str(number), int(frame), np.column_stack([x, y])))
    return _picked(lines)


def _numbered_tables(path: Path) -> _Lines:
    """WhiskerToolbox's lines with columns x,y in a file per frame, named by its number."""
    lines = []
    for each in sorted(path.glob("*.csv")):
        if each.stem.isdecimal():
            rows = [(line, cells) for line, cells in _rows(each) if cells and re.match(r"[-+.\d]", cells[0].strip())]
            found = [_floats(cells[:2], each, line) for line, cells in rows]
            lines.append(("", int(each.stem), np.reshape(found, (-1, 2))))
    if not lines:
        remedy = "a folder of 000001.csv and so on is needed, with x,y"
        raise InputError("is a folder that holds no lines", where=path, remedy=remedy)
    return _picked(lines)


def _whisk(path: Path) -> _Lines:
    """The lines of Janelia's whisk, named by the labels of the measurements file next to them."""
    traces, measured = path.with_suffix(".whiskers"), path.with_suffix(".measurements")
    if not traces.is_file():
        what = "holds where whiskers begin and end, not their lines"
        raise InputError(what, where=path, remedy=f"put {traces.name} next to it, or export lines")
    return _labelled(traces, _traces(traces), _labels(measured) if measured.is_file() else {})


def _labelled(
    path: Path, lines: Sequence[tuple[int, int, np.ndarray]], labels: Mapping[tuple[int, int], int]
) -> _Lines:
    """The lines (whisker, frame, (n, 2) px) of each label, by labels (frame, whisker) → label; by whisk's own
    numbers where the labels distinguish nothing."""
    found = [(labels.get((frame, whisker), -1), frame, points) for whisker, frame, points in lines]
    named = [(str(label), frame, points) for label, frame, points in found if label >= 0]
    if named and len({each[:2] for each in named}) == len(named):
        more = f" by label; {len(found) - len(named)} without one are left out"
    else:
        named = [(str(whisker), frame, points) for whisker, frame, points in lines]
        more = f" by whisk's own number in each frame{': its labels tell no lines apart' if labels else ''}"
    return _picked(named, more)


def _traces(path: Path) -> list[tuple[int, int, np.ndarray]]:
    """Traces (whisker, frame, (n, 2) px) in a .whiskers file as whisk writes it (whiskbin1, whisker_io_whiskbin.c):
    of each all x, y, thickness and score, and at the end their number."""
    head, data, lines = b"bwhiskbin1\0\0", read_bytes(path), list[tuple[int, int, np.ndarray]]()
    if not data.startswith(head):
        remedy = "convert it: whisker_convert OLD NEW whiskbin1"
        raise InputError("is no .whiskers file of the kind whiskbin1", where=path, remedy=remedy)
    at = len(head)
    while at + 12 <= len(data):
        whisker, frame, count = struct.unpack_from("<3i", data, at)
        at, start = at + 12 + 16 * count, at + 12
        if min(whisker, frame, count) < 0 or at > len(data):
            break
        lines.append((whisker, frame, np.frombuffer(data, "<f4", 2 * count, start).reshape(2, count).T.astype(float)))
    if data[at:] != struct.pack("<i", len(lines)):
        raise InputError("is truncated", where=path, remedy="trace again, or copy it again")
    return lines


def _labels(path: Path) -> dict[tuple[int, int], int]:
    """(frame, whisker) → label, from a .measurements file (measurements_io_v3.c)."""
    data = read_bytes(path)
    rows, columns = struct.unpack_from("<2i", data.ljust(16, b"\0"), 8)
    size = 41 + 16 * columns
    if not data.startswith(b"measv3\0\0") or min(rows, columns) < 0 or len(data) != 16 + rows * size:
        raise InputError("is no table of whisk that is known here", where=path, remedy="measure again")
    heads = [struct.unpack_from("<4i", data, 16 + row * size) for row in range(rows)]
    return {(frame, whisker): label for _, frame, whisker, label in heads}


def _hdf5(path: Path) -> _Lines:
    """The lines in DeepLabCut's HDF5, or the poses in an NWB file."""
    from vbaa_calib.convert.child import read_in_child  # which needs sessions

    require_file(path)
    require_extra("h5py", "trackers")
    try:
        found = read_in_child(_read_hdf5, path)
    except ValueError as error:
        raise InputError(f"cannot be read ({error!s:.200})", where=path, remedy="export it as CSV") from None
    if "whiskers" in found:
        return _whisk_tables(path, found)
    columns = [tuple(each) for each in json.loads(str(found["columns"]))]
    return _of_parts(path, columns, found["frames"], found["values"])


def _whisk_tables(path: Path, found: Mapping[str, np.ndarray]) -> _Lines:
    """The lines in whisk's HDF5, or in the .whiskers file next to it, by whiskers (W, 3) of frame, number and label."""
    labels = {(frame, number): label for frame, number, label in found["whiskers"].tolist()}
    if "points" in found:
        parts = np.split(found["points"], np.cumsum(found["counts"])[:-1])
        lines = [
            (number, frame, part) for (frame, number, _), part in zip(found["whiskers"].tolist(), parts, strict=True)
        ]
        return _labelled(path, lines, labels)
    traces = path.with_suffix(".whiskers")
    if not traces.is_file():
        what = "its WhiskerMeasurementTable (ndx-whisk) has follicle and tip, not lines"
        raise InputError(what, where=path, remedy=f"put {traces.name}, which it was made of, next to it")
    return _labelled(traces, _traces(traces), labels)


def _read_hdf5(path: Path) -> dict[str, np.ndarray]:
    """`columns` (JSON of [individual, part, coordinate]), `frames` (F,), `values` (F, C) of a tracker's HDF5 or NWB;
    for whisk `whiskers` (W, 3) of frame, number and label and, where it has lines, `points` (N, 2) px, `counts`
    (W,).

    Raises
    ------
    ValueError : it holds none.
    """
    import h5py

    with h5py.File(path, "r") as file:
        if all(name in file for name in ("summary", "pixels_x", "pixels_y")):  # WhiskiWrap
            lines = [np.concatenate([np.empty(0), *file[name]]) for name in ("pixels_x", "pixels_y")]
            counts = np.array([len(line) for line in file["pixels_x"]], int)
            whiskers = _numbered(file["summary"], "fid" if "fid" in file["summary"].dtype.names else "time")
            return {"whiskers": whiskers, "points": np.stack(lines, axis=1), "counts": counts}
        groups = (each for each in file.values() if isinstance(each, h5py.Group))
        table = next((each["table"] for each in groups if "table" in each), None)
        if table is not None and table.dtype.names and "values_block_0" in table.dtype.names:
            columns = _pickled(bytes(table.attrs["values_block_0_kind"]))
            named = [[each[1] if len(each) == 4 else "", *each[-2:]] for each in columns]
            frames, values = np.asarray(table["index"], float), np.asarray(table["values_block_0"], float)
            return {"columns": np.array(json.dumps(named)), "frames": frames, "values": values}
        series, measured = list[tuple[str, Any]](), list[Any]()

        def visit(name: str, node: Any) -> None:
            kind = node.attrs.get("neurodata_type", "")
            if "WhiskerMeasurementTable" in str(kind):
                measured.append(node)
            if "data" in node and "PoseEstimationSeries" in str(kind):
                series.append((name.rpartition("/")[2], node))

        file.visititems(lambda name, node: visit(name, node) if isinstance(node, h5py.Group) else None)
        if measured and not series:
            return {"whiskers": np.concatenate([_numbered(node, "frame_id") for node in measured])}
        if not series:
            raise ValueError("it holds no poses")
        named, values_of = [], []
        for name, node in series:
            xy = np.asarray(node["data"], float)
            sure = np.asarray(node["confidence"], float) if "confidence" in node else np.ones(len(xy))
            named += [["", name, coordinate] for coordinate in ("x", "y", "likelihood")]
            values_of += [xy[:, 0], xy[:, 1], sure]
        values = np.stack(values_of, axis=1)
        return {"columns": np.array(json.dumps(named)), "frames": np.arange(len(values), dtype=float), "values": values}


def _numbered(table: Any, frame: str) -> np.ndarray:
    """(W, 3) frame, number and label (−1 without) of whisk's table in HDF5."""
    names = table.dtype.names if hasattr(table, "dtype") else table.keys()
    number = next(name for name in ("whisker_id", "wid", "id") if name in names)
    columns = [np.asarray(table[name], np.int64) for name in (frame, number)]
    labels = np.asarray(table["label"]).astype(np.int16) if "label" in names else np.full(len(columns[0]), -1)
    return np.stack([*columns, labels.astype(np.int64)], axis=1)


def _pickled(data: bytes) -> Any:
    """The lists and texts in a pickle. Raises ValueError for a pickle with anything else."""

    def refuse(module: str, name: str) -> Any:
        raise ValueError(f"its columns ask for {module}.{name}")

    reader = pickle._Unpickler(io.BytesIO(data))
    vars(reader)["find_class"] = refuse
    return reader.load()
