"""What people and hardware get wrong is named, and where nothing is wrong nothing is reported."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import product
from typing import Any

import pytest

from benchmarks.mistakes.mistakes import ALARM, NAMED_RIGHT, RECORDED, SILENT, TABLES, TAKEN, Outcome, clean_pair, drawn
from benchmarks.mistakes.recordings import DOUBTED, NAMED, Mistake
from benchmarks.mistakes.rigs import KINDS

LOUD_STD = 5.0
MOST_SILENT, FEWEST_NAMED, MOST_DOUBTED = 0.0, 0.95, 0.02
"""Shares: of mistakes without a word, of those whose cause comes first, and of clean material that is doubted."""


QUICK = {
    TAKEN: ((32, 0, 0), (35, 1, 0), (39, 0, 0)),
    RECORDED: ((2, 2, 0), (17, 0, 3), (26, 0, 2), (34, 0, 1), (42, 1, 0), (47, 2, 0), (64, 0, 0)),
}
"""Rows with the other tests, one of each kind, with the rig and draw on which it is decided soonest. Of sessions, from
pictures to rig, few: their rows, sensor and jig alone in tests/calibrate/test_diagnose.py."""


def outcomes(name: str, cases: Iterable[tuple[int, int, int]]) -> list[tuple[Mistake[Any], Outcome]]:
    """These rows of a table, each on a rig, with values and noise of its own."""
    table = TABLES[name]
    return [(table[row], drawn(name, table[row], rig, (7, row, draw))) for row, rig, draw in cases]


def every_case(name: str, draws: int) -> Iterable[tuple[int, int, int]]:
    """All rows of a table on all rigs."""
    return product(range(len(TABLES[name])), range(len(KINDS)), range(draws))


def check(found: Sequence[tuple[Mistake[Any], Outcome]]) -> None:
    """Named, or doubted at least; no row is far off without a word; no false alarm."""
    words = {f"{mistake.what}: {one}" for mistake, one in found if one.what in (SILENT, ALARM)}
    assert len(words) <= MOST_SILENT * len(found), words
    far = {f"{mistake.what}: {one}" for mistake, one in found if one.silent_std > LOUD_STD}
    assert far == set()
    named = {mistake.what: one.what == NAMED_RIGHT for mistake, one in found if mistake.must == NAMED}
    missed = [what for what, right in named.items() if not right]
    assert len(missed) <= max((1.0 - FEWEST_NAMED) * len(named), 1.0), missed
    assert all(mistake.must != DOUBTED or one.severity != "none" for mistake, one in found)


@pytest.mark.parametrize("name", [RECORDED, TAKEN])
def test_some_mistakes(name: str) -> None:
    check(outcomes(name, QUICK[name]))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "draws"), [(RECORDED, 4), (TAKEN, 2)])
def test_all_mistakes_on_all_rigs(name: str, draws: int) -> None:
    check(outcomes(name, every_case(name, draws)))


@pytest.mark.parametrize(
    ("first", "count"), [(0, 2), pytest.param(2, 198, marks=pytest.mark.slow)], ids=["some", "many"]
)
def test_nothing_is_reported_of_clean_material(first: int, count: int) -> None:
    """Rigs unlike ours: 60 to 500 mm, 300 to 2,000 px, upright or inclined to 60°, steel or nitinol."""
    found = [pair for seed in range(first, first + count) for pair in clean_pair((0, seed))]
    assert [one for _, one in found if one.severity == "wrong"] == []
    doubted = [(what, one) for what, one in found if one.severity == "doubt"]
    assert len(doubted) <= MOST_DOUBTED * len(found), doubted
    far = [(what, one) for what, one in found if one.worst_std > LOUD_STD]
    assert len(far) <= 0.01 * len(found), far
