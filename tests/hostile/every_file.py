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

TEXTS: tuple[tuple[str, str, str], ...] = (
    ("session.yaml", "session/session.yaml", CALIBRATE),
    ("session.yaml", "session/session.yaml", ESTIMATE),
    ("session.yaml", "session/session.yaml", CHECK),
    ("session.yaml", "session/session.yaml", "intrinsics session/intrinsics --board session/session.yaml -o out.json"),
    ("session.yaml", "session/session.yaml", "view contacts.csv --rig rig.json --session session --html out.html"),
    ("session.yaml", "session/session.yaml", REFINE),
    ("board.yaml", "board.yaml", "intrinsics session/intrinsics --board board.yaml -o out.json"),
    ("board.yaml", "board.yaml", "board --spec board.yaml -o out.pdf"),
    ("rig.json", "rig.json", ESTIMATE),
    ("rig.json", "rig.json", CHECK),
    ("rig.json", "rig.json", "look session/recording/frame_0003.png --rig rig.json -o out.png"),
    ("rig.json", "rig.json", "budget rig.json -o out.json"),
    ("rig.json", "rig.json", REFINE),
    ("rig.json", "rig.json", "track contacts.csv --rig rig.json -o out.csv"),
    ("rig.json", "rig.json", "reconstruct contacts.csv --rig rig.json -o out.vtp"),
    ("rig.json", "rig.json", "report contacts.csv --rig rig.json -o out.html"),
    ("rig.json", "rig.json", "view contacts.csv --rig rig.json --html out.html"),
    ("rig.json", "rig.json", "convert rig.json --to ros -o out.yaml"),
    ("rig.json", "rig.json", "export rig.json --to mujoco -o out.xml"),
    ("camera.json", "camera.json", "convert camera.json --to opencv -o out.yaml"),
    ("contacts.csv", "contacts.csv", REFINE),
    ("contacts.csv", "contacts.csv", "track contacts.csv -o out.csv"),
    ("contacts.csv", "contacts.csv", "reconstruct contacts.csv -o out.ply"),
    ("contacts.csv", "contacts.csv", "report contacts.csv -o out.html"),
    ("contacts.csv", "contacts.csv", "view contacts.csv --html out.html"),
    ("recording.csv", "session/recording/recording.csv", ESTIMATE),
    ("recording.csv", "session/recording/recording.csv", REFINE),
    ("centrelines.csv", "lined/recording/centrelines.csv", "estimate lined --rig rig.json -o out.csv"),
    ("noload.csv", "session/noload/noload.csv", CALIBRATE),
    ("noload.csv", "session/noload/noload.csv", CHECK),
    ("loads.csv", "session/loads/loads.csv", CALIBRATE),
    ("loads.csv", "session/loads/loads.csv", CHECK),
    ("sweep.csv", "swept/sweep/sweep.csv", CALIBRATE_SWEPT),
    ("stiffness.csv", "stiffness.csv", "stiffness stiffness.csv --load 0.01 --distance 0.2 -o out.json"),
    ("poses.csv", "poses.csv", HANDEYE),
    ("corners.csv", "corners.csv", HANDEYE),
    ("truth.json", "truth.json", "report contacts.csv --truth truth.json -o out.html"),
    ("truth.json", "truth.json", "view contacts.csv --truth truth.json --html out.html"),
    ("scene.yaml", "scene.yaml", "simulate scene.yaml -o out"),
    ("answers.yaml", "answers.yaml", "wizard new --answers answers.yaml --batch"),
    ("wizard.json", "store/wizard.json", "wizard store --batch"),
    ("ros", "ros.txt", "convert ros.txt --from ros -o out.json"),
    ("opencv", "opencv.txt", "convert opencv.txt --from opencv -o out.json"),
    ("kalibr", "kalibr.txt", "convert kalibr.txt --from kalibr --camera-name cam0 -o out.json"),
    ("mrcal", "mrcal.txt", "convert mrcal.txt --from mrcal -o out.json"),
    ("colmap", "colmap.txt", "convert colmap.txt --camera-name 3 -o out.json"),
    ("numbers", "numbers.txt", "convert numbers.txt -o out.json"),
    ("orbslam", "orbslam.txt", "convert orbslam.txt --from orbslam -o out.json"),
    ("cahvor", "cahvor.txt", "convert cahvor.txt --from cahvor -o out.json"),
)
"""Kind, path, command."""

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

OBJECTS = tuple(
    (f"object{suffix}", f"object{suffix}", f"view contacts.csv --object object{suffix} --html out.html")
    for suffix in (".vtp", ".ply", ".glb")
)
TO_OBJECTS: tuple[tuple[str, Damage, tuple[str, ...]], ...] = (
    *TO_TEXTS[:6],
    *((name, damage, ("holds no mesh",)) for name, damage, _ in TO_TEXTS[6:9]),
    ("cut short", d.cut(0.5), ("holds no mesh",)),
    ("its end is missing", d.cut(0.97), ("holds no mesh",)),
)

PICTURES: tuple[tuple[str, str, str], ...] = (
    ("board_002.png", "session/intrinsics/board_002.png", CALIBRATE),
    (
        "board_002.png",
        "session/intrinsics/board_002.png",
        "intrinsics session/intrinsics --board board.yaml -o out.json",
    ),
    ("jig_000.png", "session/plane/jig_000.png", CALIBRATE),
    ("jig_000.png", "session/plane/jig_000.png", CHECK),
    ("board_003.png", "swept/sweep/board_003.png", CALIBRATE_SWEPT),
    ("free.png", "free.png", "look free.png --rig rig.json -o out.png"),
    ("free.png", "free.png", "look session/noload/noload_001.png --rig rig.json --background free.png"),
    ("free.png", "free.png", "check rig.json --free free.png"),
    ("jig.png", "jig.png", "check rig.json --jig jig.png"),
    ("free.png", "free.png", f"{ESTIMATE} --background free.png"),
    ("free.png", "free.png", "view contacts.csv --rig rig.json --picture free.png --html out.html"),
)
"""Pictures that are named or found in a folder."""
LISTED: tuple[tuple[str, str, str], ...] = (
    ("noload_001.png", "session/noload/noload_001.png", CALIBRATE),
    ("noload_001.png", "session/noload/noload_001.png", CHECK),
    ("loads_002.png", "session/loads/loads_002.png", CALIBRATE),
    ("frame_0003.png", "session/recording/frame_0003.png", ESTIMATE),
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


GIANTS: tuple[tuple[str, str, int, str], ...] = (
    ("session.yaml", "session/session.yaml", 300_000_000, CALIBRATE),
    ("rig.json", "rig.json", 300_000_000, ESTIMATE),
    ("stiffness.csv", "stiffness.csv", 10**13, "stiffness stiffness.csv --load 0.01 --distance 0.2 -o out.json"),
    ("object.vtp", "object.vtp", 10**13, "view contacts.csv --object object.vtp --html out.html"),
    ("frame_0003.png", "session/recording/frame_0003.png", 10**13, ESTIMATE),
)
"""Kind, path, bytes that the file claims, command."""
SOUND = {(kind, name) for kind in ("centrelines.csv", "wizard.json") for name in ("missing", "a link to nothing")} | {
    ("centrelines.csv", "a link to itself")
}
"""What is none of the harm: a session without centrelines has pictures, one without wizard.json was not begun."""


FOLDERS: tuple[tuple[str, str, str], ...] = (
    ("session", "session", CALIBRATE),
    ("session", "session", ESTIMATE),
    ("session", "session", CHECK),
    ("session", "session", "view contacts.csv --rig rig.json --session session --html out.html"),
    ("intrinsics", "session/intrinsics", CALIBRATE),
    ("intrinsics", "session/intrinsics", "intrinsics session/intrinsics --board board.yaml -o o.json"),
    ("plane", "session/plane", CALIBRATE),
    ("noload", "session/noload", CALIBRATE),
    ("loads", "session/loads", CALIBRATE),
    ("recording", "session/recording", ESTIMATE),
)
TO_FOLDERS: tuple[tuple[str, Damage, tuple[str, ...]], ...] = (
    ("missing", d.gone, ("no such f",)),
    *((name, damage, ()) for name, damage in (
        ("empty", d.folder), ("a file", d.content("a text")), ("a pipe", d.pipe), ("a link to nothing", d.link("none")),
        ("a link to itself", d.loop), ("a link to /dev", d.link("/dev")))),
)  # fmt: skip
DRAWN = 2
"""Damages of a file in each command: any reader refuses them all (`tests/fuzz/test_properties.py`), and each command
must end as it should."""


def cases() -> list[Case]:
    """Each file in each command that reads it, with damages that differ from row to row."""
    groups = ((TEXTS, TO_TEXTS), (OBJECTS, TO_OBJECTS), (PICTURES, TO_PICTURES), (LISTED, TO_LISTED))
    found = []
    for files, damages in (*groups, (FOLDERS, TO_FOLDERS)):
        for number, (kind, path, line) in enumerate(files):
            fit = [one for one in damages if (kind, one[0]) not in SOUND]
            for name, damage, words in (fit[(DRAWN * number + more) % len(fit)] for more in range(DRAWN)):
                named = () if files is FOLDERS else (path.rpartition("/")[2],)
                found.append(Case(name, kind, path, damage, line, (*named, *words)))
    giants = (
        Case(f"{size:.0e} bytes", kind, path, d.giant(size), line, (path.rpartition("/")[2], "MB, more than"))
        for kind, path, size, line in GIANTS
    )
    return [*found, *giants]


CASES = cases()
