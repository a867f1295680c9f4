"""A disk that is full or read-only: exit 2, one line that says so, and nothing is left on it."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from .case import expect_refused, run, tree

LINES = (
    "convert camera.json --to ros -o disk/out.yaml",
    "board --squares 5x4 -o disk/out.pdf",
    "estimate session --rig rig.json --no-report -o disk/out.csv",
    "estimate session --rig rig.json --no-report -o kept.csv --overlay disk/out",
    "live rig.json session/recording/recording.csv -o disk/out.csv",
    "live rig.json session/recording/recording.csv --bag disk/out.mcap",
    "batch lined --rig rig.json --jobs 1 -o disk/out",
    "look free.png --rig rig.json -o disk/out.png",
    "reconstruct contacts.csv --rig rig.json -o disk/out.glb",
    "report contacts.csv -o disk/out.html",
    "wizard disk/out --answers answers.yaml --batch",
)
"""One for every way of writing; the other verbs' go the same ways."""
LONG = ("calibrate session -o disk/out.json", "simulate scene.yaml -o disk/out", "demo --out disk/out")
"""They work for seconds before they write."""


def mount(*options: str) -> None:
    subprocess.run(["mount", "-t", "tmpfs", *options], check=True, capture_output=True)


@pytest.fixture
def disk(folder: Path) -> Iterator[Path]:
    """A disk of 64 kB in the case's folder. Skips where none may be mounted."""
    place = folder / "disk"
    place.mkdir()
    try:
        mount("-o", "size=64k", "tmpfs", str(place))
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("only root may mount a small disk, and not everywhere")
    try:
        yield place
    finally:
        subprocess.run(["umount", "-l", str(place)], check=True, capture_output=True)


def fill(disk: Path, left: int) -> None:
    """With one file, but for so many bytes."""
    with (disk / "full").open("wb", buffering=0) as stream:
        try:
            while True:
                stream.write(bytes(4096))
        except OSError:
            stream.truncate(max(0, stream.tell() - left))


@pytest.mark.parametrize("line", [*LINES, *(pytest.param(line, marks=pytest.mark.slow) for line in LONG)])
def test_a_full_disk(line: str, disk: Path, capfd: pytest.CaptureFixture[str]) -> None:
    fill(disk, 0)
    before = tree(disk)
    capfd.readouterr()
    code = run(line)
    said = capfd.readouterr()
    last = said.err.strip().splitlines()[-1]
    assert (code, said.out) == (2, ""), said.err
    assert last.startswith("vbaa: ")
    assert "No space left on device" in last
    assert "; " in last
    kept = {name: what for name, what in tree(disk).items() if not name.startswith("out")}
    assert kept == before
    # these go on in what they have begun
    assert line.startswith(("demo", "wizard", "live", "batch")) or set(tree(disk)) == set(before)


@pytest.mark.parametrize("line", [*LINES, *LONG])
def test_a_disk_that_may_not_be_written(line: str, disk: Path, capfd: pytest.CaptureFixture[str]) -> None:
    mount("-o", "remount,ro", "tmpfs", str(disk))
    capfd.readouterr()
    code = run(line)
    said = capfd.readouterr()
    expect_refused(code, "", said.err, ("disk/out",))
    assert tree(disk) == {}
