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
    ("session/session.yaml", ESTIMATE),
    ("session/session.yaml", CHECK),
    ("session/session.yaml", "intrinsics session/intrinsics --board session/session.yaml -o out.json"),
    ("session/session.yaml", "view contacts.csv --rig rig.json --session session --html out.html"),
    ("session/session.yaml", REFINE),
    ("board.yaml", "intrinsics session/intrinsics --board board.yaml -o out.json"),
    ("board.yaml", "board --spec board.yaml -o out.pdf"),
    ("rig.json", ESTIMATE),
    ("rig.json", CHECK),
    ("rig.json", "look session/recording/frame_0003.png --rig rig.json -o out.png"),
    ("rig.json", "budget rig.json -o out.json"),
    ("rig.json", REFINE),
    ("rig.json", "track contacts.csv --rig rig.json -o out.csv"),
    ("rig.json", "reconstruct contacts.csv --rig rig.json -o out.vtp"),
    ("rig.json", "report contacts.csv --rig rig.json -o out.html"),
    ("rig.json", "view contacts.csv --rig rig.json --html out.html"),
    ("rig.json", "convert rig.json --to ros -o out.yaml"),
    ("rig.json", "export rig.json --to mujoco -o out.xml"),
    ("camera.json", "convert camera.json --to opencv -o out.yaml"),
    ("contacts.csv", REFINE),
    ("contacts.csv", "track contacts.csv -o out.csv"),
    ("contacts.csv", "reconstruct contacts.csv -o out.ply"),
    ("contacts.csv", "report contacts.csv -o out.html"),
    ("contacts.csv", "view contacts.csv --html out.html"),
    ("session/recording/recording.csv", ESTIMATE),
    ("session/recording/recording.csv", REFINE),
    ("lined/recording/centrelines.csv", "estimate lined --rig rig.json -o out.csv"),
    ("session/noload/noload.csv", CALIBRATE),
    ("session/noload/noload.csv", CHECK),
    ("session/loads/loads.csv", CALIBRATE),
    ("session/loads/loads.csv", CHECK),
    ("swept/sweep/sweep.csv", CALIBRATE_SWEPT),
    ("stiffness.csv", "stiffness stiffness.csv --load 0.01 --distance 0.2 -o out.json"),
    ("poses.csv", HANDEYE),
    ("corners.csv", HANDEYE),
    ("truth.json", "report contacts.csv --truth truth.json -o out.html"),
    ("truth.json", "view contacts.csv --truth truth.json --html out.html"),
    ("scene.yaml", "simulate scene.yaml -o out"),
    ("answers.yaml", "wizard new --answers answers.yaml --batch"),
    ("store/wizard.json", "wizard store --batch"),
    ("ros.txt", "convert ros.txt --from ros -o out.json"),
    ("opencv.txt", "convert opencv.txt --from opencv -o out.json"),
    ("kalibr.txt", "convert kalibr.txt --from kalibr --camera-name cam0 -o out.json"),
    ("mrcal.txt", "convert mrcal.txt --from mrcal -o out.json"),
    ("colmap.txt", "convert colmap.txt --camera-name 3 -o out.json"),
    ("numbers.txt", "convert numbers.txt -o out.json"),
    ("orbslam.txt", "convert orbslam.txt --from orbslam -o out.json"),
    ("cahvor.txt", "convert cahvor.txt --from cahvor -o out.json"),
)
"""Path, command."""

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
    (f"object{suffix}", f"view contacts.csv --object object{suffix} --html out.html")
    for suffix in (".vtp", ".ply", ".glb")
)
TO_OBJECTS: tuple[tuple[str, Damage, tuple[str, ...]], ...] = (
    *TO_TEXTS[:6],
    *((name, damage, ("holds no mesh",)) for name, damage, _ in TO_TEXTS[6:9]),
    ("cut short", d.cut(0.5), ("holds no mesh",)),
    ("its end is missing", d.cut(0.97), ("holds no mesh",)),
)

PICTURES: tuple[tuple[str, str], ...] = (
    ("session/intrinsics/board_002.png", CALIBRATE),
    ("session/intrinsics/board_002.png", "intrinsics session/intrinsics --board board.yaml -o out.json"),
    ("session/plane/jig_000.png", CALIBRATE),
    ("session/plane/jig_000.png", CHECK),
    ("swept/sweep/board_003.png", CALIBRATE_SWEPT),
    ("free.png", "look free.png --rig rig.json -o out.png"),
    ("free.png", "look session/noload/noload_001.png --rig rig.json --background free.png"),
    ("free.png", "check rig.json --free free.png"),
    ("jig.png", "check rig.json --jig jig.png"),
    ("free.png", f"{ESTIMATE} --background free.png"),
    ("free.png", "view contacts.csv --rig rig.json --picture free.png --html out.html"),
)
"""Pictures that are named or found in a folder."""
LISTED: tuple[tuple[str, str], ...] = (
    ("session/noload/noload_001.png", CALIBRATE),
    ("session/noload/noload_001.png", CHECK),
    ("session/loads/loads_002.png", CALIBRATE),
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
    ("rig.json", 300_000_000, ESTIMATE),
    ("stiffness.csv", 10**13, "stiffness stiffness.csv --load 0.01 --distance 0.2 -o out.json"),
    ("object.vtp", 10**13, "view contacts.csv --object object.vtp --html out.html"),
    ("session/recording/frame_0003.png", 10**13, ESTIMATE),
)
"""Path, bytes that the file claims, command."""
SOUND = {(kind, name) for kind in ("centrelines.csv", "wizard.json") for name in ("missing", "a link to nothing")} | {
    ("centrelines.csv", "a link to itself")
}
"""What is none of the harm: a session without centrelines has pictures, one without wizard.json was not begun."""


FOLDERS: tuple[tuple[str, str], ...] = (
    ("session", CALIBRATE),
    ("session", ESTIMATE),
    ("session", CHECK),
    ("session", "view contacts.csv --rig rig.json --session session --html out.html"),
    ("session/intrinsics", CALIBRATE),
    ("session/intrinsics", "intrinsics session/intrinsics --board board.yaml -o o.json"),
    ("session/plane", CALIBRATE),
    ("session/noload", CALIBRATE),
    ("session/loads", CALIBRATE),
    ("session/recording", ESTIMATE),
)
TO_FOLDERS: tuple[tuple[str, Damage, tuple[str, ...]], ...] = (
    ("missing", d.gone, ("no such f",)),
    *((name, damage, ()) for name, damage in (
        ("empty", d.folder), ("a file", d.content("a text")), ("a pipe", d.pipe), ("a link to nothing", d.link("none")),
        ("a link to itself", d.loop), ("a link to /dev", d.link("/dev")))),
)  # fmt: skip


def cases() -> list[Case]:
    """Each file in each command that reads it, with a damage that differs from row to row: any reader refuses them all
    (`tests/fuzz/test_fuzz.py`), and each command must end as it should."""
    groups = ((TEXTS, TO_TEXTS), (OBJECTS, TO_OBJECTS), (PICTURES, TO_PICTURES), (LISTED, TO_LISTED))
    found = []
    for files, damages in (*groups, (FOLDERS, TO_FOLDERS)):
        for number, (path, line) in enumerate(files):
            own = path.rpartition("/")[2]
            fit = [one for one in damages if (own, one[0]) not in SOUND]
            name, damage, words = fit[number % len(fit)]
            found.append(Case(name, path, damage, line, (*(() if files is FOLDERS else (own,)), *words)))
    giants = (
        Case(f"{size:.0e} bytes", path, d.giant(size), line, (path.rpartition("/")[2], "MB, more than"))
        for path, size, line in GIANTS
    )
    return [*found, *giants]


CASES = cases()
