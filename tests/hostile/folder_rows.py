"""A session's folders missing, empty, or no folders."""

from __future__ import annotations

from . import damage as d
from .case import Case, Damage
from .every_file import CALIBRATE, CHECK, ESTIMATE

FOLDERS: tuple[tuple[str, str, str, str], ...] = (
    ("session", "session", CALIBRATE, "session: no such folder"),
    ("session", "session", ESTIMATE, "session: no such folder"),
    ("session", "session", CHECK, "session: no such folder"),
    (
        "session",
        "session",
        "view contacts.csv --rig rig.json --session session --html out.html",
        "session: no such folder",
    ),
    ("intrinsics", "session/intrinsics", CALIBRATE, "intrinsics: no such folder"),
    (
        "intrinsics",
        "session/intrinsics",
        "intrinsics session/intrinsics --board board.yaml -o o.json",
        "no such folder",
    ),
    ("plane", "session/plane", CALIBRATE, "plane: no such folder"),
    ("noload", "session/noload", CALIBRATE, "noload.csv: no such file; calibration needs the free antenna"),
    ("loads", "session/loads", CALIBRATE, "loads.csv: no such file; calibration needs known loads"),
    ("recording", "session/recording", ESTIMATE, "recording.csv: no such file"),
    ("sweep", "swept/sweep", "calibrate swept -o out.json", ""),
)
"""Kind, path, command, words of the line where it is missing."""
TO_FOLDERS: tuple[tuple[str, Damage], ...] = (
    ("empty", d.folder),
    ("a file", d.content("a text")),
    ("a pipe", d.pipe),
    ("a link to nothing", d.link("none")),
    ("a link to itself", d.loop),
    ("a link to /dev", d.link("/dev")),
)


CASES: list[Case] = [
    Case(name, kind, path, damage, line, (words,) if name == "missing" else ())
    for kind, path, line, words in FOLDERS
    for name, damage in (("missing", d.gone), *TO_FOLDERS)
    # a session needs no sweep
    if kind != "sweep" or name in ("empty", "a link to /dev")
]
