"""What a change of structure must not change: this tree's results against those of an older commit, on this machine.

    python -m benchmarks.unchanged REVISION [--within 1e-9] [--only scenes hostile bench] [--keep FOLDER]

Both trees run the same things: three demo scenes from simulation to object (`scenes`), every row of the hostile suite
(`hostile`: exit code, files and lines named), the quick benchmark tables without their clock columns (`bench`).
Results of a commit are kept in FOLDER and not measured twice. Exit code 1, and a line for each difference, where
they are apart.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import io
import json
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]
SCENES = ("demo", "upright_knife", "steep_sphere")
PARTS = ("scenes", "hostile", "bench")
SUBJECTS = ("metric", "calibration", "vision", "estimator", "object", "chain", "coverage", "paper")
"""Those whose tables are not timings alone."""
_CLOCK = re.compile(
    r"(^|_)(s|ms|us|seconds|read|live|batch)(_|$)|per_s$|us_per|_ms$|(^|_)time|^ratio$|MB|share|typical|exponent"
)
"""Columns of a benchmark table that hang on the clock; `ratio` is of times in metric.csv alone."""
_OURS_ALONE = ("created", "command", "versions", "inputs", "seconds", "argv", "rig_file", "session", "files", "report")
"""Keys of JSON files about the run, not its result."""


# --- what one tree gives; the working directory is that tree, and comes first on sys.path


def record(part: str, folder: Path) -> None:
    """Run one part with the tree in the working directory and leave its results in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    {"scenes": _scenes, "hostile": _hostile, "bench": _bench}[part](folder)


def _scenes(folder: Path) -> None:
    for name in SCENES:
        place = folder / name
        place.mkdir(exist_ok=True)
        steps = (
            f"simulate {name} -o session",
            "calibrate session -o rig.json",
            "check rig.json session -o check_written.json --json",
            "estimate session --rig rig.json -o contacts.csv --no-report --json",
            "track contacts.csv --rig rig.json -o track.csv",
            "reconstruct contacts.csv --rig rig.json -o object.ply",
            "budget rig.json --json",
            "convert rig.json --to kalibr -o kalibr.yaml",
        )
        for step in steps:
            said = _vbaa(step, place)
            if "--json" in step:
                (place / f"{step.split()[0]}.json").write_text(said)
        files = sorted(path for path in (place / "session").rglob("*") if path.is_file())
        digests = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
        (place / "simulated.json").write_text(json.dumps(digests, indent=0))
        shutil.rmtree(place / "session")


def _bench(folder: Path) -> None:
    for subject in SUBJECTS:
        _vbaa(f"bench {subject} --quick --out {folder} --force", Path.cwd())
    for path in folder.glob("*.png"):
        path.unlink()
    for subject in SUBJECTS:
        (folder / f"{subject}.json").unlink(missing_ok=True)


def _vbaa(line: str, place: Path) -> str:
    """What the command prints. A part in which one fails is none."""
    environment = os.environ | {"PYTHONPATH": str(Path.cwd()), "OMP_NUM_THREADS": "1"}
    command = [
        sys.executable,
        "-c",
        "import sys; from vbaa_calib.cli.main import main; sys.exit(main())",
        *line.split(),
    ]
    done = subprocess.run(command, cwd=place, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{place}: vbaa {line}: exit {done.returncode}: {done.stderr.strip()[-300:]}")
    return done.stdout


def _hostile(folder: Path) -> None:
    plugin = _Refusals()
    code = pytest.main(
        ["tests/hostile/test_refused.py::test_it_is_refused", "-q", "--no-header", "-p", "no:cacheprovider"], [plugin]
    )
    if code or not plugin.found:
        raise SystemExit(f"{Path.cwd()}: the hostile rows fail (pytest: {code}, {len(plugin.found)} rows)")
    (folder / "refusals.json").write_text(json.dumps(plugin.found, indent=0, sort_keys=True))


class _Refusals:
    """Plugin of pytest: notes code, files and lines of every row instead of judging them."""

    def __init__(self) -> None:
        self.found: dict[str, list[Any]] = {}

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        sys.modules["tests.hostile.test_refused"].expect_refused = self._note  # type: ignore[attr-defined]

    def _note(self, code: int, _out: str, err: str, _words: object) -> None:
        row = os.environ["PYTEST_CURRENT_TEST"].partition("[")[2].rpartition("]")[0]
        places = re.findall(r"[\w/.-]+\.(?:csv|json|yaml|png|txt|vtp|ply|glb)\b|line \d+", err)
        self.found[row] = [code, sorted(set(places))]


# --- two trees side by side


def against(revision: str, parts: list[str], within: float, keep: Path) -> list[str]:
    """Differences, one line each; results of `revision` are taken from `keep` where it has them."""
    commit = _git("rev-parse", revision)
    apart = []
    for part in parts:
        old = keep / commit / part
        if not (old / "done").exists():
            with tempfile.TemporaryDirectory() as name:
                tree = Path(name, "tree")
                _git("worktree", "add", "--detach", str(tree), commit)
                try:
                    _run_part(part, tree, old)
                finally:
                    _git("worktree", "remove", "--force", str(tree))
        new = keep / "this" / part
        shutil.rmtree(new, ignore_errors=True)
        _run_part(part, ROOT, new)
        apart += [f"{part}/{line}" for line in differences(old, new, within)]
    return apart


def _run_part(part: str, tree: Path, folder: Path) -> None:
    # -P: this script's folder has a `coverage`, which is not the package of that name
    command = [sys.executable, "-P", str(Path(__file__).resolve()), "--record", part, "--keep", str(folder.resolve())]
    done = subprocess.run(command, cwd=tree, env=os.environ | {"PYTHONPATH": str(tree)}, check=False)
    if done.returncode or not any(path.stat().st_size for path in folder.rglob("*")):
        raise SystemExit(f"{part} of {tree} failed: there is nothing to compare")
    (folder / "done").touch()


def _git(*words: str) -> str:
    return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()


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
    if path.suffix == ".json":
        return json.loads(text)
    rows = csv.DictReader(io.StringIO(text))
    clock = path.parent.name == "bench"
    return [{key: cell for key, cell in row.items() if not (clock and _CLOCK.search(key))} for row in rows]


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
    """The command line above; `--record PART` is what it calls in each tree."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("revision", nargs="?", default="HEAD")
    parser.add_argument("--within", type=float, default=0.0, help="relative tolerance of numbers (default: none)")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--keep", type=Path, default=Path(tempfile.gettempdir(), "vbaa-unchanged"))
    parser.add_argument("--record", choices=PARTS, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.record:
        sys.path.insert(0, str(Path.cwd()))
        record(args.record, args.keep)
        return 0
    apart = against(args.revision, args.only, args.within, args.keep)
    print("\n".join(apart) or "unchanged")
    return int(bool(apart))


if __name__ == "__main__":
    sys.exit(main())
