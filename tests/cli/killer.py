"""Verbs that write, killed without warning: what they wrote before stays whole, or is what they write.

`python -m tests.cli.killer --kills 2000` kills every verb of `CALLS`, and says what broke. A life is a fork of one
process that has loaded what verbs load, so nearly all of it goes into the verb's work. Half of them end just before a
move on the disk, the others at any instant; half find an earlier run's files, the others none.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as parquet

from estimator.table.files import write_contacts
from vbaa_calib.cli.main import VERBS, main

from ..estimator.test_next_touch import given
from ..hostile.conftest import good_files

CALLS = {
    "board": "board --spec ../board.yaml -o out.svg",
    "board pdf": "board --squares 5x4 -o out.pdf",
    "intrinsics": "intrinsics ../session/intrinsics --board ../board.yaml -o out.json --html out.html",
    "calibrate": "calibrate ../session -o out.json",
    "calibrate fleet": "calibrate ../fleet.csv -o .",
    "handeye": "handeye ../corners.csv --board ../board.yaml --poses ../poses.csv --camera ../camera.json -o out.json",
    "stiffness": "stiffness ../stiffness.csv --load 0.01 --distance 0.2 -o out.json",
    "simulate": "simulate ../scene.yaml --pictures none -o out",
    "simulate bag": "simulate ../scene.yaml -o out --bag out.mcap",
    "convert": "convert ../rig.json --to ros -o out.yaml",
    "export": "export ../rig.json --to mujoco -o out.xml",
    "budget": "budget ../rig.json -o out.json",
    "track": "track ../touches.csv --rig ../touches.json -o out.csv",
    "check": "check ../rig.json ../session -o out.json --html out.html",
    "estimate": "estimate ../session --rig ../rig.json -o out.csv --overlay out",
    "estimate parquet": "estimate ../lined --rig ../rig.json -o out.parquet --no-report",
    "live": "live ../rig.json ../session/recording/recording.csv -o out.csv",
    "compare": "compare ../contacts.csv ../contacts.csv --html out.html",
    "refine": "refine ../contacts.csv --rig ../rig.json --session ../session -o out.csv --update-rig rig.json",
    "next": "next ../touches.csv --rig ../touches.json -o out.json",
    "look": "look ../free.png --rig ../rig.json -o out.png",
    "reconstruct": "reconstruct ../touches.csv --rig ../touches.json -o out.ply",
    "reconstruct glb": "reconstruct ../touches.csv --rig ../touches.json -o out.glb",
    "report": "report ../touches.csv --rig ../touches.json -o out.html",
    "view": "view ../contacts.csv --rig ../rig.json --plain --gltf out.glb",
    "batch": "batch ../lined --rig ../rig.json --jobs 1 -o out",
    "demo": "demo --out out",
}
"""Calls in a folder that lies in the one of the good files. The answers are the same in every run."""
SLOW = ("batch", "demo", "calibrate fleet")
"""They take seconds: a tenth as many kills, and none in the short test."""
DRAWING = ("view", "demo", "batch")
"""They leave threads behind: never run by the process that forks."""
ELSEWHERE = {"wizard", "bench", "doctor", "schema", "completion"}
"""The wizard has tests of its own; the others write nothing, or figures."""
GROWING = {"live": "out.csv"}
"""What may be cut short: it is there to be read while it grows."""
_MOVES = ("open", "os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.chmod", "shutil.rmtree")
_PASSING = re.compile(rb"<th>written</th>.*?</tr>|\d{4}-\d\d-\d\d \d\d:\d\d UTC", re.DOTALL)
_TIMES = ("seconds", "cpu_s")


def prepare(folder: Path, names: list[str]) -> None:
    """What these calls read."""
    shutil.copytree(good_files(), folder, dirs_exist_ok=True)
    if any("touches" in CALLS[name] for name in names):
        table, rig = given(37)
        write_contacts(folder / "touches.csv", table.rows())
        (folder / "touches.json").write_text(json.dumps(rig.to_dict()))
    (folder / "fleet.csv").write_text("session,date\nsession,2026-01-01\nagain,2026-02-01\n")
    shutil.copytree(folder / "session", folder / "again")


def life(call: str, place: Path, move: int = 0, after_s: float = 0.0) -> tuple[int, int, str]:
    """One run of a verb: its exit code (negative: killed by that signal), its moves on the disk, what it said.

    move : it is killed just before this one; after_s : it is killed then; 0: it is not.
    """
    said, told = place.with_name("said"), place.with_name("moves")
    told.write_text("0")
    child = os.fork()
    if not child:
        code = 99
        try:
            os.chdir(place)
            for number in (1, 2):
                os.dup2(os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
            counted = _watched(place, move)
            # the signal's own action ends the process at once, as SIGKILL does
            signal.setitimer(signal.ITIMER_REAL, after_s)
            code = main([*call.split(), "--force"])
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            told.write_text(str(counted[0]))
        finally:
            os._exit(code)
    status = os.waitpid(child, 0)[1]
    return os.waitstatus_to_exitcode(status), int(told.read_text()), said.read_text()


def _watched(place: Path, last: int) -> list[int]:
    """Counts moves on the disk in a folder from now on, and ends the process before the one of this number.

    A hook of Python's stays as long as the process: hence only in a life's.
    """
    count, root = [0], str(place)

    def watch(event: str, args: tuple[Any, ...]) -> None:
        named = event in _MOVES and args and isinstance(args[0], str | bytes | os.PathLike)
        if named and os.path.abspath(os.fsdecode(args[0])).startswith(root):
            count[0] += 1
            if count[0] == last:
                os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(watch)
    return count


def contents(place: Path) -> dict[str, Any]:
    """Of every file that is not hidden, what is the same in every run."""
    files = (path for path in sorted(place.rglob("*")) if path.is_file())
    names = {str(path.relative_to(place)): path for path in files}
    return {name: _lasting(path) for name, path in names.items() if not any(p[0] == "." for p in Path(name).parts)}


def _lasting(path: Path) -> Any:
    """Without the time at which it was written, and how long that took. Raises whatever half a file makes a reader."""
    if path.suffix == ".parquet":
        return repr(parquet.read_table(path, partitioning=None).replace_schema_metadata(None).to_pylist())
    if path.name == "summary.csv":
        head, *rows = (line.split(",") for line in path.read_text().splitlines())
        return [[cell for name, cell in zip(head, row, strict=True) if name not in _TIMES] for row in rows]
    if path.name == "summary.json":
        return {name: value for name, value in json.loads(path.read_text()).items() if name not in _TIMES}
    data = path.read_bytes()
    if path.name == "scene.html":
        return data[-20:].strip()  # VTK names its arrays otherwise in every run; whole it is with its end
    return _PASSING.sub(b"", data) if path.suffix == ".html" else data


def restored(place: Path) -> None:
    """As the next writer would: a folder that was killed between its two names has the old one."""
    for left in place.glob(".*-old-????????/replaced"):
        name = place / left.parent.name[1 : -len("-old-????????")]
        if not name.exists():
            left.rename(name)


def broken(name: str, folder: Path, kills: int) -> Iterator[str]:
    """What must not be, of a verb that is killed so often."""
    call, rng = CALLS[name], np.random.default_rng(sum(map(ord, name)))
    place, whole = folder / "killed", folder / "whole"
    for each in (place, whole):
        shutil.rmtree(each, ignore_errors=True)
        each.mkdir()
    if name not in DRAWING:
        os.chdir(whole)
        main([*call.split(), "--force"])  # here, so that every life finds modules and compiled code loaded
    begun = time.monotonic()
    code, moves, said = life(call, whole)
    lasted_s, last = time.monotonic() - begun, contents(whole)
    if code or moves < 3:
        yield f"{name}: exit {code} after {moves} moves: {said}"
        return
    for number in range(kills):
        old = number % 4 < 2  # two lives upon an earlier run's files, two upon nothing or what a killed one left
        if number % 2 == 0:
            shutil.rmtree(place)
            shutil.copytree(whole, place) if old else place.mkdir()
        if rng.random() < 0.5:
            how: dict[str, Any] = {"move": int(rng.integers(1, moves + 1))}
        else:
            how = {"after_s": float(rng.uniform(1e-3, lasted_s))}
        code, _, said = life(call, place, **how)
        if code not in (0, -signal.SIGKILL, -signal.SIGALRM):
            yield f"{name} {how}: exit {code}: {said}"
        restored(place)
        found = contents(place)
        odd = sorted(each for each, value in found.items() if last.get(each) != value and each != GROWING.get(name))
        gone = sorted(set(last) - set(found)) if old else []
        if odd or gone:
            yield f"{name} {how}: {odd} are neither the old nor the new, {gone} are gone"
    code, _, said = life(call, place)
    found = contents(place)
    odd = sorted(each for each in {*found, *last} if found.get(each) != last.get(each))
    if code or odd:
        yield f"{name}: run again it ends with {code}, {odd} are not as they should be: {said}"


def killed(names: list[str], kills: int) -> Iterator[tuple[str, int, list[str]]]:
    """Each verb, how often it was killed, and what broke."""
    with tempfile.TemporaryDirectory(prefix="killed-") as made:
        folder = Path(made)
        prepare(folder, names)
        # syncing is for power cuts, which nothing here can show
        os.fsync = lambda _: None  # type: ignore[assignment]
        for name in names:
            count = max(1, kills // 10) if name in SLOW else kills
            yield name, count, list(broken(name, folder, count))


def every() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=2000, help="of all verbs together")
    parser.add_argument("--verbs", nargs="*", default=list(CALLS))
    args = parser.parse_args()
    assert {name.split()[0] for name in CALLS} | ELSEWHERE == set(VERBS)
    out, all_kills, failed, begun = os.dup(1), 0, 0, time.process_time()
    for number in (1, 2):
        os.dup2(os.open(os.devnull, os.O_WRONLY), number)
    share = sum(0.1 if name in SLOW else 1.0 for name in args.verbs)
    for name, count, wrong in killed(args.verbs, round(args.kills / share)):
        all_kills, failed = all_kills + count, failed + len(wrong)
        spent = time.process_time() + sum(os.times()[2:4]) - begun
        line = "\n  ".join([f"{name}: {count} kills, {len(wrong)} wrong, {spent:.1f} CPU s so far", *wrong])
        os.write(out, f"{line}\n".encode())
    os.write(out, f"{all_kills} kills in all, {failed} wrong\n".encode())
    raise SystemExit(1 if failed else 0)


if __name__ == "__main__":
    every()
