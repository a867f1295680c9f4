"""The recordings of a batch, from folders, patterns, or a CSV of them; each with its rig and a unique name."""

from __future__ import annotations

import glob
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from vbaa_calib.core.csv_rows import csv_rows
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import require_file

_MOST = 50_000


@dataclass(frozen=True)
class BatchRecording:
    """One recording of a batch. `name` is its partition of the data set."""

    name: str
    path: Path
    rig: Path


def recordings_of(named: Sequence[str], rig: Path | None) -> list[BatchRecording]:
    """Recordings from folders and patterns with the one rig, and from CSV files with the columns recording and,
    optionally, rig and name.

    Raises InputError for what names no recording, a recording without a rig, and names that stand twice.
    """
    found: list[tuple[str, Path, Path | None]] = []
    for each in named:
        path = Path(each)
        if path.suffix == ".csv" and path.name != "centrelines.csv":
            found += _listed(path, rig)
        elif path.exists():
            found.append(("", path, rig))
        else:
            places = sorted(Path(place) for place in glob.glob(each, recursive=True)) if glob.has_magic(each) else []
            if not places:
                raise InputError("no such recording", where=each, remedy="name a session folder, a pattern or a CSV")
            found += [("", place, rig) for place in places]
    return _named(found)


def _listed(table: Path, rig: Path | None) -> list[tuple[str, Path, Path | None]]:
    """Name ("" without one), recording and rig of each row of a table."""
    rows = list(islice(csv_rows(table, ("recording",), ("rig", "name")), _MOST + 1))
    if len(rows) > _MOST:
        raise InputError(f"lists more than {_MOST} recordings", where=table, remedy="make several batches of them")
    return [
        (row.get("name", ""), table.parent / row["recording"], table.parent / row["rig"] if row.get("rig") else rig)
        for row in rows
    ]


def _named(found: Sequence[tuple[str, Path, Path | None]]) -> list[BatchRecording]:
    """Recordings with unique names: those of the list, else the folder's, preceded by as many parent folders as are
    needed."""
    places = [path.resolve() for _, path, _ in found]
    for twice in (path for path, count in Counter(places).items() if count > 1):
        raise InputError("is given twice", where=twice, remedy="name every recording once")
    depth = 1
    while len({path.parts[-depth:] for path in places}) < len(places):
        depth += 1
    recordings: list[BatchRecording] = []
    for (name, path, rig), place in zip(found, places, strict=True):
        if rig is None:
            raise InputError("has no rig", where=path, remedy="give --rig, or a column rig in the CSV")
        require_file(rig)
        name = name or re.sub(r"[^\w.-]+", "_", "-".join(place.parts[-depth:]).strip("/-")) or "recording"
        if not re.fullmatch(r"\w[\w.-]*", name) or len(name) > 100:
            remedy = "give a name of letters, digits, ., - and _, in a column name of a CSV"
            raise InputError(f"the name {name!r} is none for a folder", where=path, remedy=remedy)
        recordings.append(BatchRecording(name, place, rig.resolve()))
    names = Counter(each.name.lower() for each in recordings)  # some disks tell no case
    for each in recordings:
        if names[each.name.lower()] > 1:
            remedy = "give each its own in a column name of a CSV"
            raise InputError(f"the name {each.name} stands twice", where=each.path, remedy=remedy)
    return recordings
