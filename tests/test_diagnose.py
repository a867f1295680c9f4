"""Score tests of extra parameters, problems without rows, and the decision between hypotheses, against whole solves."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from vbaa_calib.core.errors import Diagnosis
from vbaa_calib.core.least_squares import SQUARES, Linearised
from vbaa_calib.diagnose.decision import Explanation, causes, decide, diagnose

ROWS, SIZE, EXTRA = 40, 4, 2


def linear(rng: np.random.Generator, scale: float = 1.0) -> tuple[Linearised, np.ndarray]:
    """A linear problem at its minimum, and the columns of extra parameters, in units that differ by `scale`."""
    jacobian = rng.normal(size=(ROWS, SIZE)) * scale ** np.arange(SIZE)
    jacobian[-SIZE:] = np.eye(SIZE) * scale ** np.arange(SIZE)
    columns = rng.normal(size=(ROWS, EXTRA))
    columns[-SIZE:] = 0.0
    residuals = rng.normal(size=ROWS) + columns @ [3.0, -2.0]
    parameters = -np.linalg.lstsq(jacobian, residuals, rcond=None)[0]
    at = Linearised(parameters, residuals + jacobian @ parameters, jacobian, SIZE, True, SQUARES)
    return at, columns


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("scale", [1.0, 1e3])
def test_score_test_is_the_whole_solve(seed: int, scale: float) -> None:
    """Extra parameters, their covariance and evidence are those of the problem with them among its own."""
    at, columns = linear(np.random.default_rng(seed), scale)
    prior = np.array([0.5, 5.0])
    found = at.score_test(columns, prior)
    assert found is not None
    jacobian = np.vstack([np.hstack([at.jacobian, columns]), np.hstack([np.zeros((EXTRA, SIZE)), np.diag(1 / prior)])])
    residuals = np.concatenate([at.residuals, np.zeros(EXTRA)])
    size = np.linalg.norm(jacobian, axis=0)
    whole = np.linalg.inv((jacobian / size).T @ (jacobian / size)) / np.outer(size, size)
    step = -whole @ (jacobian.T @ residuals)
    assert found.values == pytest.approx(step[SIZE:], rel=1e-6)
    assert found.covariance == pytest.approx(whole[SIZE:, SIZE:], rel=1e-6)
    gained = 0.5 * float(residuals @ residuals - (residuals + jacobian @ step) @ (residuals + jacobian @ step))
    occam = 0.5 * float(np.log(np.linalg.det(found.covariance / np.outer(prior, prior))))
    assert found.log_evidence == pytest.approx(gained + occam, rel=1e-6)


def test_what_others_explain_is_not_tested() -> None:
    """Columns within the span of the problem's own say nothing."""
    at, _ = linear(np.random.default_rng(0))
    assert at.score_test(at.jacobian @ np.ones((SIZE, 1)), 1.0) is None
    assert at.score_test(np.zeros((ROWS, 1)), 1.0) is None


def test_without_rows_and_with_further_ones() -> None:
    """A problem without rows is at its own minimum, and a forecast is the covariance with the rows in it."""
    at, _ = linear(np.random.default_rng(1))
    rows = np.arange(ROWS) < 10
    rest = at.without(rows)
    jacobian = at.jacobian[~rows]
    assert rest.jacobian.T @ rest.residuals == pytest.approx(np.zeros(SIZE), abs=1e-9)
    assert rest.with_rows(at.jacobian[rows]).covariance() == pytest.approx(at.covariance(), rel=1e-9)
    assert rest.covariance() == pytest.approx(np.linalg.inv(jacobian.T @ jacobian), rel=1e-9)


def offered(name: str, odds: float, after: int = -1, covers: tuple[str, ...] = ()) -> Explanation[int]:
    applied = None if after < 0 else lambda: after
    return Explanation(Diagnosis(name, name, f"undo {name}", "wrong"), odds, applied, covers)


def test_the_likeliest_is_named_and_near_ones_with_it() -> None:
    """Alone from a lead of 2 on, else with those that come as near."""
    assert [one.diagnosis.name for one in decide([offered("a", 9.0), offered("b", 12.0)])] == ["b"]
    assert [one.diagnosis.name for one in decide([offered("a", 11.0), offered("b", 12.0)])] == ["b", "a"]
    assert [one.diagnosis.name for one in decide([offered("a", 11.0), offered("b", 12.0, covers=("a",))])] == ["b"]


def test_what_is_likely_but_not_sure_is_a_doubt() -> None:
    """Between the two thresholds a cause is reported as a doubt, and nothing is sought behind it."""
    [likely] = decide([offered("a", 3.7, after=1), offered("b", 1.0)])
    assert likely.diagnosis.severity == "doubt"
    assert likely.applied is None
    [sure] = decide([offered("a", 7.0, after=1), offered("b", 4.0)])
    assert sure.diagnosis.severity == "wrong"
    assert sure.applied is not None
    assert not decide([offered("a", 1.0)])


def test_a_second_mistake_is_sought_behind_the_first() -> None:
    """Each round looks at the observations with what was found put right, and names nothing twice."""

    def table(data: int) -> Iterator[Explanation[int]]:
        yield offered("first", 50.0, after=1)
        if data == 1:
            yield offered("second", 8.0, after=2)
            yield offered("third", 7.0)

    found = diagnose(0, [table])
    assert [one.name for one in found][:2] == ["first", "second"]
    assert "third" in found[1].words


def test_a_cause_that_leaves_a_misfit_is_the_nearest_only() -> None:
    """As named where nothing is left; else not the only one, and of less than half of the misfit no name at all."""
    found = [[offered("a", 20.0)]]
    assert causes(found, left=0.0) == [found[0][0].diagnosis]
    for left, name in ((10.0, "a"), (30.0, "unexplained")):
        [most] = causes(found, left)
        assert (most.name, most.severity) == (name, "wrong")
        assert most.words != "a"
