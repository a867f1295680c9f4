"""Where a session has no common solution with its lens, the next lens model is tried, and that is reported."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

from benchmarks.boards import BOARD, draw, rigs
from vbaa_calib.calibrate.lens.intrinsics import LensSolution, solve_intrinsics
from vbaa_calib.calibrate.pipeline import first_solved, next_lenses
from vbaa_calib.core.errors import Diagnosis, SolveError

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
