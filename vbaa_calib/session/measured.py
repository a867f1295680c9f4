"""What of a session was measured and cannot be made again by a command: no output may take its place."""

from __future__ import annotations

import os
from pathlib import Path

from ..errors import InputError
from ..images import SUFFIXES

FOLDERS = ("intrinsics", "plane", "sweep", "over", "noload", "loads", "recording")
FILES = ("session.yaml", "board.yaml", "truth.json", "wizard.json")
TABLES = ("recording.csv", "centrelines.csv", "sweep.csv", "noload.csv", "loads.csv")


def refuse_measured(output: Path, root: Path) -> None:
    """Raises InputError where `output` is a file of the session in `root` that holds measurements, even by force."""
    if not os.path.lexists(output):
        return
    place, inside = Path(os.path.realpath(output)), Path(os.path.realpath(root))
    if not place.is_relative_to(inside):
        return
    *folders, name = place.relative_to(inside).parts or ("",)
    taken = Path(name).suffix.lower() in SUFFIXES or name in TABLES
    if (not folders and name in FILES) or (folders and folders[0] in FOLDERS and taken):
        raise InputError("is an input of this command", where=output, remedy="take another name")
