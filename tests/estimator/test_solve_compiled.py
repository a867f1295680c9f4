"""The compiled solver against the plain code that it replaced, and against itself uncompiled."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from dataclasses import fields
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from benchmarks.estimator.setup import Setup
from estimator import ContactEstimator
from estimator.contact.contacts import Contacts
from estimator.solver.numbers import FitNumbers

KNOWN = dict(np.load(Path(__file__).parent / "plain_answers.npz"))
"""15 noisy frames of rods of drawn rigs (B, 80, 2) and what older estimators found in them: by the rung that was asked
for that of commit 39b4eb5, array formulas in NumPy, by default the rod of commit 2c3d1d8.
Each entry has B rows; covariance (B, 6, 6) is that of point and force."""
RIGS = {
    "calibrated": Setup(real=True, exact=False),
    "exact": Setup(real=True, exact=True),
    "fisheye": Setup(lens="fisheye", real=True, exact=False),
}
ROUNDING = 5e-4
"""In standard deviations: the rig's derivatives are taken where a rough descent ended, which need not be the same."""
NOT_SEARCHED = 0.05
"""The same without contact: the distance is then where the best force of a grid is."""
EVIDENCE = 1e-3
"""Part of it: the free antenna's derivatives by the camera's pose are now those of the rod."""
UNCOMPILED = """
import pickle, sys
from tests.estimator.test_solve_compiled import answer
pickle.dump([answer(int(row), every=4).numbers for row in sys.argv[1:]], sys.stdout.buffer)
"""


@cache
def answer(row: int, every: int = 1) -> Contacts:
    """What is said now of one of the frames, from every point, every second, ..."""
    at = {name: values[row] for name, values in KNOWN.items()}
    estimator = ContactEstimator(RIGS[at["rig"]].rig(), str(at["model"]), friction=float(at["friction"]))
    points = at["points_px"][None, ::every]
    return estimator.estimate_batch(points, [at["moment_Nm"]], [at["pan_rad"]], [at["tilt_rad"]], sigma_px=0.1)


@pytest.mark.parametrize("row", range(len(KNOWN["rig"])))
def test_the_answers_of_the_plain_code(row: int) -> None:
    found, said = answer(row), {name: values[row] for name, values in KNOWN.items()}
    assert found.status[0] == said["status"]
    assert found.numbers.rung[0] == said["rung"]
    if said["status"] == "failed":
        return  # its numbers are those of wherever it was given up
    std, covariance = said["std"], said["covariance"]
    rounding = NOT_SEARCHED if said["status"] == "no_contact" else ROUNDING
    free = std == 0.0
    np.testing.assert_array_equal(found.numbers.unknowns[0][free], said["unknowns"][free])
    off = (found.numbers.unknowns[0] - said["unknowns"])[~free] / std[~free]
    assert np.abs(off).max() < rounding
    np.testing.assert_allclose(found.numbers.std[0], std, rtol=rounding)
    size = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    assert (np.abs(found.numbers.covariance[0] - covariance) <= rounding * size).all()
    assert found.numbers.evidence[0] == pytest.approx(said["evidence"], rel=EVIDENCE)


@pytest.mark.slow
def test_uncompiled_it_says_the_same() -> None:
    """The same functions run by Python, on a few points of frames of three rigs."""
    rows = [0, 3, 10, 11]
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", UNCOMPILED, *map(str, rows)],
        capture_output=True,
        check=False,
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        cwd=Path(__file__).parents[2],
    )
    assert done.returncode == 0, done.stderr.decode()[-2000:]
    plain: list[FitNumbers] = pickle.loads(done.stdout)
    for row, numbers in zip(rows, plain, strict=True):
        compiled = answer(row, every=4).numbers
        for f in fields(numbers):
            told, expected = getattr(compiled, f.name), getattr(numbers, f.name)
            if f.metadata["dtype"] is not float and f.name != "evaluations":
                np.testing.assert_array_equal(told, expected, err_msg=f.name)
        np.testing.assert_allclose(compiled.std, numbers.std, rtol=ROUNDING)
        off = np.abs(compiled.unknowns - numbers.unknowns)
        assert (off <= ROUNDING * numbers.std).all()
        assert (
            np.abs(compiled.force_N - numbers.force_N) <= ROUNDING * np.sqrt(np.diag(numbers.covariance[0])[3:])
        ).all()
