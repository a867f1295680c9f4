"""Where a session has no common solution with its lens, the next lens model is tried, and that is reported."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import pytest

from benchmarks.boards import BOARD, draw, rigs
from vbaa_calib.calibrate.lens.intrinsics import LensSolution, solve_intrinsics
from vbaa_calib.calibrate.pipeline import first_solved, next_lenses
from vbaa_calib.core.errors import Diagnosis, InputError, SolveError, VbaaError

VIEWS = draw(rigs()[0], 1).views


@cache
def lenses() -> tuple[LensSolution, ...]:
    first = solve_intrinsics(VIEWS, BOARD)
    return first, *next_lenses(first, VIEWS, BOARD)


def test_other_models_follow_by_expected_error_and_say_so() -> None:
    first, *others = lenses()
    expected = {one.model: one.expected_error_px for one in first.comparison if one.monotonic}
    assert first.model not in [one.model for one in others]
    errors = [expected[one.model] for one in others]
    assert errors == sorted(errors)
    assert len(errors) >= 2
    assert max(errors) < 3.0
    for other in others:
        (named,) = [one for one in other.verdict.diagnoses if one.name == "lens_passed_over"]
        assert first.model in named.words
        assert other.model in named.words
        assert "was given" not in other.verdict.words


def first(solve: Callable[[LensSolution], str], *causes: Diagnosis) -> str:
    return first_solved(lenses()[0], lambda: lenses()[1:], solve, lambda: causes)


def test_the_first_lens_that_converges_is_taken() -> None:
    failing = {one.model for one in lenses()[:2]}

    def solve(lens: LensSolution) -> str:
        if lens.model in failing:
            raise SolveError("no common solution")
        return lens.model

    assert first(solve) == lenses()[2].model


def test_without_any_the_models_that_were_tried_are_named() -> None:
    def solve(lens: LensSolution) -> str:
        raise SolveError(f"not with {lens.model}")

    with pytest.raises(SolveError, match=f"not with {lenses()[0].model}") as raised:
        first(solve)
    assert ", ".join(one.model for one in lenses()) in str(raised.value)


@pytest.mark.parametrize("error", [InputError("a column is missing"), SolveError("no common solution")])
def test_what_is_wrong_with_the_input_is_wrong_with_any_lens(error: VbaaError) -> None:
    """No other lens is tried where the input is refused, or a cause is found."""
    tried = []

    def solve(lens: LensSolution) -> str:
        tried.append(lens.model)
        raise error

    with pytest.raises(VbaaError, match=r"column|the forces have the other sign"):
        first(solve, Diagnosis("load_sign", "the forces have the other sign", "turn them round", "wrong"))
    assert len(tried) == 1
