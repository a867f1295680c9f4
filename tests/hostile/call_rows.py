"""Calls that cannot be: options, and outputs in places where nothing may be written."""

from __future__ import annotations

from . import damage as d
from .case import Case, Damage
from .every_file import HANDEYE

LIVE = "live rig.json session/recording/recording.csv"
REFINE = "refine contacts.csv --rig rig.json --session session"
OUTPUTS: tuple[tuple[str, str], ...] = (
    ("calibrate session -o {}", "out.json"),
    ("estimate session --rig rig.json -o {}", "out.csv"),
    ("refine contacts.csv --rig rig.json --session session -o kept.csv --update-rig {}", "out.json"),
    ("reconstruct contacts.csv --rig rig.json -o {}", "out.vtp"),
    ("view contacts.csv --screenshot {}", "out.png"),
    ("check rig.json session --html {}", "out.html"),
    ("simulate scene.yaml -o {}", "out"),
    ("live rig.json session/recording/recording.csv --bag {}", "out.mcap"),
    ("look free.png --rig rig.json -o {}", "out.png"),
    ("board --squares 5x4 -o {}", "out.pdf"),
)
"""Command, and a name of the right suffix: one for each way to write. `demo` and `bench` write whole folders and have
rows of their own."""

TO_OUTPUTS: tuple[tuple[str, str, Damage, tuple[str, ...]], ...] = (
    ("in a file", "rig.json/{}", d.nothing, ("rig.json/",)),
    ("a name of 300 letters", 300 * "n" + "{}", d.nothing, ("nnn",)),
    ("there already", "{}", d.content("mine"), ("exists already", "--force")),
    ("a pipe", "{}", d.pipe, ("out",)),
)

OVERLAY, STIFF = (
    "estimate session --rig rig.json --no-report -o kept.csv --overlay out",
    "stiffness stiffness.csv --load 1",
)
TO_OTHERS: tuple[tuple[str, str, Damage, tuple[str, ...]], ...] = (
    (OVERLAY, "a file in the way", d.content("mine"), ("out: is not a folder",)),
    (OVERLAY, "a link to itself", d.loop, ("out: is not a folder",)),
    (OVERLAY, "a link to a folder", d.link("session"), ("out: is not a folder",)),
    (OVERLAY.replace("out", 300 * "n"), "a name of 300 letters", d.nothing, ("cannot be made (File name too long)",)),
    (f"{STIFF} --distance 0.2 -o out", "a file in the way", d.content("mine"), ("exists already; give --force",)),
    (f"{STIFF} --distance 0.2 -o out --force", "a folder in the way", d.folder, ("out: is a folder",)),
    (f"{STIFF} --distance 0.2 -o {300 * 'n'}", "a name of 300 letters", d.nothing, ("File name too long",)),
    (f"{STIFF} --distance 0.2 -o out", "a link to itself", d.loop, ("out",)),
    ("bench vision --quick --out out", "a file in the way", d.content("mine"), ("out",)),
    ("demo --out out", "a file in the way", d.content("mine"), ("out: is a file",)),
    ("demo --out out", "a link to itself", d.loop, ("out: is a file",)),
    ("demo --out out", "a pipe", d.pipe, ("out: is a file",)),
    ("simulate scene.yaml --force -o out", "a link to a folder, by force", d.link("session"), ("is not a session",)),
)
"""Command, name, what lies at `out`, words."""

CALLS: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    ("no such verb", "calibrat session", ("there is no verb 'calibrat'", "calibrate")),
    ("no rig", "estimate session -o out.csv", ("--rig", "vbaa estimate --help")),
    ("no threads", "estimate session --rig rig.json -o out.csv --jobs 0", ("jobs is 0", "1 or more")),
    ("contacts in a spreadsheet", "estimate session --rig rig.json -o out.xlsx", ("is neither .csv nor .parquet",)),
    (
        "onto its input",
        "estimate session --rig rig.json --force -o session/recording/recording.csv",
        ("recording.csv",),
    ),
    ("a folder without pictures", "intrinsics session --board board.yaml -o out.json", ("session: holds no pictures",)),
    ("sizes in mm", "intrinsics session/intrinsics --squares 9x6 --square 25 -o o.json", ("--square is 25 m", "0.025")),
    ("markers on circles", "intrinsics session/intrinsics --circles 4x11 --marker 0.01 -o o.json", ("--marker",)),
    ("onto the rig", "track contacts.csv --rig rig.json --force -o rig.json", ("rig.json", "is an input")),
    ("smooth without a rig", "track contacts.csv -o a.csv --smooth b.csv", ("--smooth needs --rig",)),
    ("live onto its source", f"{LIVE} -o session/recording/recording.csv --force", ("recording.csv: is an input",)),
    ("a gap of NaN", f"{LIVE} --gap nan", ("--gap is nan",)),
    ("a key of readings without any", "live rig.json - --udp-key camera.json", ("--udp-key without --udp",)),
    ("a key that others may read", "live rig.json - --udp 5999 --udp-key camera.json", ("chmod 600 camera.json",)),
    ("estimated from nothing", "estimate --rig rig.json -o out.csv", ("--centrelines",)),
    ("two sources", "estimate session --centrelines x.csv --rig rig.json -o out.csv", ("--centrelines",)),
    ("joints beyond a turn", f"{LIVE} --pan 90", ("--pan is 90", "--degrees")),
    ("a rig beside contacts", "compare rig.json contacts.csv", ("contacts.csv",)),
    ("next within no limits", "next contacts.csv --rig rig.json --tilt 1 -1", ("--tilt",)),
    ("completion of another shell", "completion tcsh", ("tcsh",)),
    ("an object in another format", "reconstruct contacts.csv -o object.stl", ("is not a .vtp, .ply or .glb",)),
    ("a batch of nothing", "batch none --rig rig.json -o out", ("none: no such recording",)),
    ("a page by another name", "report contacts.csv -o report.pdf", ("report.pdf: is not a .html",)),
    ("a session without its rig", "report contacts.csv --session session -o out.html", ("--session needs --rig",)),
    ("a picture without a rig", "view contacts.csv --picture free.png --html out.html", ("give --rig, too",)),
    ("a contact beyond the tip", "budget rig.json --distance 0.9 --force-y 0.01 --force-z 0.005", ("0.9",)),
    ("a moment without a picture", "check rig.json session --moment 0.1", ("--moment without --free",)),
    ("a tilt in degrees", "look free.png --rig rig.json --tilt 30", ("--tilt is 30", "radians")),
    ("a format that is none", "convert camera.json --to matlab -o out.m", ("invalid choice: 'matlab'",)),
    ("a camera of one", "convert ros.txt --from ros --camera-name 3 -o out.json", ("leave --camera-name out",)),
    ("an antenna of two parts", "export rig.json --to mujoco --segments 2 -o out.xml", ("segments are 2",)),
    ("a board larger than its paper", "board --squares 11x8 --square-mm 100 --paper A5 -o out.pdf", ("A5",)),
    ("onto another board's description", "board -o board.pdf", ("describes another board",)),
    ("no force", "stiffness stiffness.csv --load 0 --distance 0.2", ("the force is 0",)),
    ("a diameter in mm", "stiffness stiffness.csv --load 0.01 --distance 0.2 --diameter 0.8", ("diameter",)),
    ("the other mount", f"{HANDEYE} --mount fixed", ("if they are inverted, or the mount is the other",)),
    ("no size", HANDEYE.replace(" --camera camera.json", ""), ("size of the corners' pictures is missing",)),
    ("onto a folder of other things", "simulate scene.yaml --force -o lined/recording", ("is not a session",)),
    ("no draws", "bench vision --quick --draws 0", ("draws",)),
    ("a name that is none", "schema camera", ("'camera'",)),
    ("a check that is none", "doctor --skip everything", ("everything",)),
    ("a scene that is none", "demo --scene moon", ("'moon'",)),
    ("a folder of other things, by force", "demo --out session/loads --force", ("session/loads",)),
    ("a redo of no step", "wizard store --redo lense --batch", ("'lense'", "'lens'")),
    ("a port too high", "wizard store --port 65536 --batch", ("65536",)),
)
"""Name, command, words. What is named twice in one verb is told apart by its command."""

STREAMS: tuple[tuple[str, Damage, str], ...] = (
    ("missing", d.nothing, "no such"),
    ("a pipe", d.pipe, "is a pipe or a device"),
    ("a text", d.content("a text"), "can"),
)
"""Name, what lies at the place of a recorded stream, a word."""

CASES: list[Case] = [
    *(
        Case(name, f"none{suffix}", damage, f"live rig.json none{suffix} -o out.csv", (f"none{suffix}", word))
        for suffix in (".mcap", ".bag", ".avi", ".mp4")
        for name, damage, word in STREAMS
    ),
    *(
        Case(f"{line.split(' ', 1)[1]} {name}", output, damage, line.format(where.format(output)), words)
        for line, output in OUTPUTS
        for name, where, damage, words in TO_OUTPUTS
    ),
    *(Case(f"{name}: {line}", "out", damage, line, words) for line, name, damage, words in TO_OTHERS),
    *(Case(f"{name}: {line}", "", d.nothing, line, words) for name, line, words in CALLS),
]
