"""Files changed at random, and all that ever broke a reader: read or refused, in bounded time and memory."""

from __future__ import annotations

from pathlib import Path

import pytest

from .fuzz import READERS, SEEDS, outcome, runs


@pytest.mark.parametrize("count", [400, pytest.param(100_000, marks=pytest.mark.slow)])
def test_changed_files_are_read_or_refused(folder: Path, count: int) -> None:
    broken = [(reader.name, came) for reader, _, came in runs(folder, count, seed=count) if came not in SOUND]
    assert broken == []


def test_good_files_are_read(folder: Path) -> None:
    for reader in READERS:
        assert outcome(reader, folder, (folder / reader.file).read_bytes()) == "read", reader.name


def test_what_once_broke_a_reader(folder: Path) -> None:
    readers = {reader.name: reader for reader in READERS}
    for seed in sorted(SEEDS.glob("*/*")):
        assert outcome(readers[seed.parent.name], folder, seed.read_bytes()) in SOUND, seed


SOUND = ("read", "refused")
