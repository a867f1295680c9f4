"""What a change of structure must not change: this tree's results against those of an older commit, on this machine.

    python -m benchmarks.unchanged REVISION [--within 1e-9] [--keep FOLDER]

Both trees run three demo scenes from simulation to object. Results of a commit are kept in FOLDER and not measured
twice. Exit code 1, and a line for each difference, where they are apart.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import io
import json
import math
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from benchmarks.waiting.trees import HERE, VBAA, Tree, older

SCENES = ("demo", "upright_knife", "steep_sphere")
_OURS_ALONE = ("created", "command", "versions", "inputs", "seconds", "argv", "rig_file", "session", "files", "report")
"""Keys of JSON files about the run, not its result."""


STEPS = (
    "simulate {scene} -o session",
    "calibrate session -o rig.json",
    "check rig.json session -o check_written.json --json",
    "estimate session --rig rig.json -o contacts.csv --no-report --json",
    "track contacts.csv --rig rig.json -o track.csv",
    "reconstruct contacts.csv --rig rig.json -o object.ply",
    "budget rig.json --json",
    "convert rig.json --to opencv -o camera.yaml",
)


def record(tree: Tree, folder: Path) -> None:
    """Run the scenes with a tree and leave their results in a folder, simulated pictures as digests."""
    for scene in SCENES:
        place = folder / scene
        place.mkdir(parents=True, exist_ok=True)
        for step in STEPS:
            said = tree.run("-c", VBAA, *step.format(scene=scene).split(), cwd=place).said
            if "--json" in step:
                (place / f"{step.split()[0]}.json").write_text(said)
        files = sorted(path for path in (place / "session").rglob("*") if path.is_file())
        digests = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
        (place / "simulated.json").write_text(json.dumps(digests, indent=0))
        shutil.rmtree(place / "session")
    (folder / "done").touch()


def against(revision: str, within: float, keep: Path) -> list[str]:
    """Differences, one line each; results of `revision` are taken from `keep` where it has them."""
    then = older(revision)
    old, new = keep / then.folder.parent.name / "scenes", keep / "this" / "scenes"
    if not (old / "done").exists():
        record(then, old)
    shutil.rmtree(new, ignore_errors=True)
    record(HERE, new)
    return list(differences(old, new, within))


def differences(old: Path, new: Path, within: float) -> Iterator[str]:
    """What two folders of results say differently; numbers count as equal within a relative tolerance."""
    names = sorted({str(path.relative_to(root)) for root in (old, new) for path in root.rglob("*") if path.is_file()})
    for name in names:
        if not (old / name).exists() or not (new / name).exists():
            yield f"{name}: {'not there before' if (new / name).exists() else 'gone'}"
        elif name.endswith((".csv", ".json")):
            yield from (f"{name}: {line}" for line in _apart(_read(old / name), _read(new / name), within, ""))
        elif (old / name).read_bytes() != (new / name).read_bytes() and not (within and name.endswith(".ply")):
            yield f"{name}: other bytes"


def _read(path: Path) -> Any:
    text = path.read_text(encoding="utf-8")
    return json.loads(text) if path.suffix == ".json" else list(csv.DictReader(io.StringIO(text)))


def _apart(one: Any, other: Any, within: float, where: str) -> Iterator[str]:
    if isinstance(one, dict) and isinstance(other, dict):
        for key in [*one, *(key for key in other if key not in one)]:
            if key not in _OURS_ALONE:
                yield from _apart(one.get(key), other.get(key), within, f"{where}.{key}")
    elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        for place, pair in enumerate(zip(one, other, strict=True)):
            yield from _apart(*pair, within, f"{where}[{place}]")
    elif one != other and not _close(one, other, within):
        yield f"{where}: {str(one)[:80]} → {str(other)[:80]}"


def _close(one: Any, other: Any, within: float) -> bool:
    try:
        return math.isclose(float(one), float(other), rel_tol=within, abs_tol=0.0)
    except (TypeError, ValueError):
        return False


def main() -> int:
    """The command line above."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("revision", nargs="?", default="HEAD")
    parser.add_argument("--within", type=float, default=0.0, help="relative tolerance of numbers (default: none)")
    parser.add_argument("--keep", type=Path, default=Path(tempfile.gettempdir(), "vbaa-unchanged"))
    args = parser.parse_args()
    apart = against(args.revision, args.within, args.keep)
    print("\n".join(apart) or "unchanged")
    return int(bool(apart))


if __name__ == "__main__":
    sys.exit(main())
