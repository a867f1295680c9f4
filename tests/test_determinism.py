"""Same seed, same result: to the last bit from process to process, and to 1e-9 whatever the number of threads."""

from __future__ import annotations

import csv
import json
import math
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
NOT_OF_THE_RESULT = ("command", "versions")
"""Keys of rig.json that say how it was made."""
CLOSE = 1e-9


def run(argv: list[str], folder: Path, threads: int, **environment: str) -> None:
    """A command of this Python in a process of its own, which works in `folder`."""
    env = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": str(threads)} | environment
    done = subprocess.run([sys.executable, *argv], cwd=folder, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]


def whole_way(folder: Path, threads: int, session: Path | None = None, **environment: str) -> Path:
    folder.mkdir()
    argv = ["-m", "tests.determinism_run", str(folder), str(threads)]
    run([*argv, *([] if session is None else [str(session)])], folder, threads, **environment)
    return folder


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One thread, hash seed 0."""
    return whole_way(tmp_path_factory.mktemp("same") / "first", 1, PYTHONHASHSEED="0")


def results(folder: Path) -> dict[str, bytes]:
    """Every file that came out, rig.json without what tells how it was made."""
    found = {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}
    rig = json.loads(found["rig.json"])
    for key in NOT_OF_THE_RESULT:
        del rig[key]
    return found | {"rig.json": json.dumps(rig).encode()}


def test_another_process_gives_the_same_bits(first: Path, tmp_path: Path) -> None:
    """With other hashes, another time zone, language and working folder."""
    other = whole_way(
        tmp_path / "somewhere else", 1, PYTHONHASHSEED="4711", TZ="Pacific/Kiritimati", LC_ALL="C", LANG="tr_TR.UTF-8"
    )
    one, two = results(first), results(other)
    assert one.keys() == two.keys()
    assert [name for name in one if one[name] != two[name]] == []
    assert len(one) > 15


def numbers(value: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """Every leaf with its place."""
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from numbers(inner, f"{key}.{name}")
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            yield from numbers(inner, f"{key}.{index}")
    else:
        yield key, value


def scale(values: dict[str, Any], key: str) -> float:
    """Of the list that a number stands in: a covariance's corner is judged by its largest entry."""
    group = key.rstrip("0123456789.")
    inside = (abs(value) for name, value in values.items() if name.startswith(group) and isinstance(value, float))
    return max((value for value in inside if math.isfinite(value)), default=0.0)


def apart(one: Any, two: Any) -> dict[str, tuple[Any, Any]]:
    """Leaves that differ by more than `CLOSE` of their list's largest."""
    mine, theirs = dict(numbers(one)), dict(numbers(two))
    assert mine.keys() == theirs.keys()
    scales: dict[str, float] = {}
    off = {}
    for key, value in mine.items():
        other = theirs[key]
        if isinstance(value, float) and isinstance(other, float):
            group = key.rstrip("0123456789.")
            largest = scales.setdefault(group, scale(mine, key))
            if value == other or (math.isnan(value) and math.isnan(other)):
                continue
            if not abs(value - other) <= CLOSE * largest:
                off[key] = (value, other)
        elif value != other:
            off[key] = (value, other)
    return off


def calibrated(folder: Path) -> dict[str, Any]:
    """What rig.json says of the rig; the covariance as deviations, each by its name, and correlations."""
    rig = json.loads((folder / "rig.json").read_text())
    covariance = np.array(rig["joint"]["covariance"])
    std = np.sqrt(np.diag(covariance))
    known = np.where(std > 0, std, 1.0)
    return {key: rig[key] for key in CALIBRATED} | {
        "std": dict(zip(rig["joint"]["parameters"], std.tolist(), strict=True)),
        "correlation": (covariance / np.outer(known, known)).tolist(),
    }


CALIBRATED = ("camera", "T_antenna_camera", "antenna", "moment_sensor", "kinematics", "image")


@pytest.mark.parametrize("threads", [2, pytest.param(5, marks=pytest.mark.slow)])
def test_threads_do_not_matter(first: Path, tmp_path: Path, threads: int) -> None:
    """Calibration and contacts from the same pictures."""
    other = whole_way(tmp_path / "threads", threads, session=first / "session")
    assert apart(calibrated(first), calibrated(other)) == {}
    assert apart(*(json.loads((folder / "numbers.json").read_text()) for folder in (first, other))) == {}
    assert [statuses(folder) for folder in (first, other)] == [["no_contact", "ok", "ok", "no_contact"]] * 2


@pytest.mark.slow
def test_pictures_do_not_depend_on_threads(first: Path, tmp_path: Path) -> None:
    other = whole_way(tmp_path / "threads", 3)
    mine, theirs = (
        {name: data for name, data in results(folder).items() if "session" in name} for folder in (first, other)
    )
    assert mine == theirs


def statuses(folder: Path) -> list[str]:
    with (folder / "contacts.csv").open() as stream:
        return [row["status"] for row in csv.DictReader(stream)]
