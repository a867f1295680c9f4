"""What people and hardware get wrong is named, and where nothing is wrong nothing is reported."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from benchmarks.mistakes.judge import ALARM, NAMED_RIGHT, SILENT, Outcome
from benchmarks.mistakes.mistakes import clean_pair, drawn
from benchmarks.mistakes.recordings import DOUBTED, NAMED, RECORDING, Mistake
from benchmarks.mistakes.rigs import KINDS
from benchmarks.mistakes.sessions import SESSION

LOUD_STD = 5.0
MOST_SILENT, FEWEST_NAMED, MOST_DOUBTED = 0.0, 0.95, 0.02
"""Shares: of mistakes without a word, of those whose cause comes first, and of clean material that is doubted."""


def some(several: Sequence[Mistake[Any]], share: float) -> list[Mistake[Any]]:
    """A part of the rows, always the same."""
    rng = np.random.default_rng(51)
    return [several[index] for index in np.sort(rng.choice(len(several), round(share * len(several)), replace=False))]


def outcomes(several: Sequence[Mistake[Any]], draws: int = 1, rigs: int = 1) -> list[tuple[Mistake[Any], Outcome]]:
    """Each on so many rigs, with values and noise of its own."""
    found = []
    for index, mistake in enumerate(several):
        for number in range(index, index + rigs):
            for draw in range(draws):
                kind = KINDS[number % len(KINDS)]
                found.append((mistake, drawn(mistake, kind, (7, index, number % len(KINDS), draw))))
    return found


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


class TestRecordings:
    """As `estimate`, `live` and `batch` see them."""

    def test_a_third_of_the_mistakes(self) -> None:
        pytest.importorskip("estimator.diagnose", reason="a recording has no verdict yet")
        check(outcomes(some(RECORDING, 1 / 3)))

    @pytest.mark.slow
    def test_all_mistakes_on_all_rigs(self) -> None:
        pytest.importorskip("estimator.diagnose", reason="a recording has no verdict yet")
        check(outcomes(RECORDING, 4, len(KINDS)))


class TestSessions:
    """As `calibrate` and the wizard see them."""

    def test_some_mistakes(self) -> None:
        pytest.importorskip("vbaa_calib.diagnose.session", reason="a session has no table of hypotheses yet")
        check(outcomes(some(SESSION, 1 / 6)))

    @pytest.mark.slow
    def test_all_mistakes_on_all_rigs(self) -> None:
        pytest.importorskip("vbaa_calib.diagnose.session", reason="a session has no table of hypotheses yet")
        check(outcomes(SESSION, 2, len(KINDS)))


class TestCleanMaterial:
    """Rigs unlike ours: 60 to 500 mm, 300 to 2,000 px, upright or inclined to 60°, steel or nitinol."""

    @pytest.mark.parametrize(
        ("first", "count"), [(0, 5), pytest.param(5, 195, marks=pytest.mark.slow)], ids=["some", "many"]
    )
    def test_nothing_is_reported(self, first: int, count: int) -> None:
        found = [pair for seed in range(first, first + count) for pair in clean_pair((0, seed))]
        assert [one for _, one in found if one.severity == "wrong"] == []
        doubted = [(what, one) for what, one in found if one.severity == "doubt"]
        assert len(doubted) <= MOST_DOUBTED * len(found), doubted
        far = [(what, one) for what, one in found if one.worst_std > LOUD_STD]
        assert len(far) <= 0.01 * len(found), far
