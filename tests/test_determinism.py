"""Same seed, same result: to the last bit from process to process, and alike whatever the number of threads."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import cv2
import pytest

from benchmarks.processors import apart, of_contacts, of_rig
from estimator.table.files import read_contacts
from vbaa_calib.rig import Rig

from . import determinism_run
from .csv_files import read_rows

ROOT = Path(__file__).parents[1]
NOT_OF_THE_RESULT = ("command", "versions")
"""Keys of rig.json that say how it was made."""
CLOSE = 1e-4
"""Deviations."""


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
    """One thread, in this process."""
    folder, threads = tmp_path_factory.mktemp("same"), cv2.getNumThreads()
    cv2.setNumThreads(1)
    determinism_run.whole_way(folder, None)
    cv2.setNumThreads(threads)
    return folder


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


@pytest.mark.slow
@pytest.mark.parametrize("threads", [2, 5])
def test_threads_do_not_matter(first: Path, tmp_path: Path, threads: int) -> None:
    """Calibration and contacts from the same pictures."""
    other = whole_way(tmp_path / "threads", threads, session=first / "session")
    rigs = [of_rig(Rig.load(folder / "rig.json")) for folder in (first, other)]
    contacts = [of_contacts(read_contacts(folder / "contacts.csv")) for folder in (first, other)]
    for pair in (rigs, contacts):
        found = apart(*pair)
        assert found.statuses == []
        assert found.most <= CLOSE, found.where
    for folder in (first, other):
        statuses = [row["status"] for row in read_rows(folder / "contacts.csv")]
        assert statuses == ["no_contact", "ok", "ok", "no_contact"]


@pytest.mark.slow
def test_pictures_do_not_depend_on_threads(first: Path, tmp_path: Path) -> None:
    other = whole_way(tmp_path / "threads", 3)
    mine, theirs = (
        {name: data for name, data in results(folder).items() if "session" in name} for folder in (first, other)
    )
    assert mine == theirs
