"""What may befall any file whatever it holds, over every file and every verb that reads it."""

from __future__ import annotations

from . import damage as d
from .case import Case, Damage

ESTIMATE = "estimate session --rig rig.json -o out.csv"
CALIBRATE = "calibrate session -o out.json"
CALIBRATE_SWEPT = "calibrate swept -o out.json"
HANDEYE = "handeye corners.csv --board board.yaml --poses poses.csv --camera camera.json -o out.json"
REFINE = "refine contacts.csv --rig rig.json --session session -o out.csv"
CHECK = "check rig.json session -o out.json"

TEXTS: tuple[tuple[str, str], ...] = (
    ("session/session.yaml", CALIBRATE),
    ("board.yaml", "board --spec board.yaml -o out.pdf"),
    ("rig.json", CHECK),
    ("rig.json", "budget rig.json -o out.json"),
    ("rig.json", "export rig.json --to mujoco -o out.xml"),
    ("contacts.csv", REFINE),
    ("contacts.csv", "track contacts.csv -o out.csv"),
    ("contacts.csv", "reconstruct contacts.csv -o out.ply"),
    ("session/recording/recording.csv", ESTIMATE),
    ("swept/sweep/sweep.csv", CALIBRATE_SWEPT),
    ("stiffness.csv", "stiffness stiffness.csv --load 0.01 --distance 0.2 -o out.json"),
    ("poses.csv", HANDEYE),
    ("truth.json", "view contacts.csv --truth truth.json --html out.html"),
    ("scene.yaml", "simulate scene.yaml -o out"),
    ("answers.yaml", "wizard new --answers answers.yaml --batch"),
    ("camera.json", "convert camera.json --to opencv -o out.yaml"),
)
"""Path, command: one of each verb."""

TO_TEXTS: tuple[tuple[str, Damage, tuple[str, ...]], ...] = (
    ("missing", d.gone, ("no such file",)),
    ("a folder", d.folder, ("is a folder",)),
    ("a pipe", d.pipe, ("is a pipe or a device",)),
    ("a link to nothing", d.link("none"), ("no such file",)),
    ("a link to itself", d.loop, ("symbolic links",)),
    ("a link to /dev/zero", d.link("/dev/zero"), ("is a pipe or a device",)),
    ("empty", d.content(b""), ()),
    ("zero bytes", d.zeros, ()),
    ("random bytes", d.noise, ("is not UTF-8 text",)),
    ("UTF-16", d.utf16, ("is not UTF-8 text",)),
    ("Latin-1", d.latin1, ("is not UTF-8 text",)),
)
"""What happened, how, and words of the line that is expected beside the file's name."""

PICTURES: tuple[tuple[str, str], ...] = (
    ("session/intrinsics/board_002.png", "intrinsics session/intrinsics --board board.yaml -o out.json"),
    ("session/plane/jig_000.png", CALIBRATE),
    ("free.png", "look free.png --rig rig.json -o out.png"),
    ("free.png", "look session/noload/noload_001.png --rig rig.json --background free.png"),
    ("free.png", "check rig.json --free free.png"),
    ("free.png", f"{ESTIMATE} --background free.png"),
    ("free.png", "view contacts.csv --rig rig.json --picture free.png --html out.html"),
)
"""Pictures that are named or found in a folder."""
LISTED: tuple[tuple[str, str], ...] = (
    ("session/noload/noload_001.png", CALIBRATE),
    ("session/recording/frame_0003.png", ESTIMATE),
)
"""Pictures that a table names."""

BAD_PIXELS: tuple[tuple[str, Damage, tuple[str, ...]], ...] = (
    ("empty", d.content(b""), ("is an empty file",)),
    ("zero bytes", d.zeros, ("is not a picture",)),
    ("random bytes", d.noise, ("is not a picture",)),
    ("a text", d.content("a text"), ("is not a picture",)),
    ("cut short", d.cut(0.7), ("is truncated or damaged",)),
    ("one bit flipped", d.changed(lambda data: data[:900] + bytes([data[900] ^ 4]) + data[901:]), ("damaged",)),
    ("another size", d.halved, ("240", "480")),
    ("a bomb", d.content(d.png(20_000, 20_000, bytes(1000))), ("is 20000x20000 px", "million")),
    ("one pixel", d.content(d.png(1, 1, b"\0\0")), ("480",)),
)
NO_FILES: tuple[tuple[str, Damage, tuple[str, ...]], ...] = (
    ("a folder", d.folder, ("is a folder",)),
    ("a pipe", d.pipe, ("pipe or a device",)),
    ("a link to nothing", d.link("none.png"), ("no such picture",)),
    ("a link to itself", d.loop, ("symbolic links",)),
    ("a link to /dev/zero", d.link("/dev/zero"), ("pipe or a device",)),
)
TO_PICTURES = (*NO_FILES, *BAD_PIXELS)
NOT_THERE = ("line", "is not there")
TO_LISTED = (("missing", d.gone, NOT_THERE), *((name, damage, NOT_THERE) for name, damage, _ in NO_FILES), *BAD_PIXELS)


GIANTS: tuple[tuple[str, int, str], ...] = (
    ("session/session.yaml", 300_000_000, CALIBRATE),
    ("session/recording/frame_0003.png", 10**13, ESTIMATE),
)
"""Path, bytes that the file claims, command."""
FOLDERS: tuple[tuple[str, str], ...] = (
    ("session", CALIBRATE),
    ("session", ESTIMATE),
    ("session/plane", CALIBRATE),
    ("session/recording", ESTIMATE),
)
TO_FOLDERS: tuple[tuple[str, Damage, tuple[str, ...]], ...] = (
    ("missing", d.gone, ("no such f",)),
    *((name, damage, ()) for name, damage in (
        ("empty", d.folder), ("a file", d.content("a text")), ("a pipe", d.pipe), ("a link to nothing", d.link("none")),
        ("a link to itself", d.loop), ("a link to /dev", d.link("/dev")))),
)  # fmt: skip


def cases() -> list[Case]:
    """Each file in a command that reads it, with a damage that differs from row to row: any reader refuses them all
    (`tests/fuzz/test_fuzz.py`), and each command must end as it should."""
    found = []
    for files, damages in ((TEXTS, TO_TEXTS), (PICTURES, TO_PICTURES), (LISTED, TO_LISTED), (FOLDERS, TO_FOLDERS)):
        for number, (path, line) in enumerate(files):
            name, damage, words = damages[number % len(damages)]
            own = () if files is FOLDERS else (path.rpartition("/")[2],)
            found.append(Case(name, path, damage, line, (*own, *words)))
    giants = (
        Case(f"{size:.0e} bytes", path, d.giant(size), line, (path.rpartition("/")[2], "MB, more than"))
        for path, size, line in GIANTS
    )
    return [*found, *giants]


CASES = cases()
