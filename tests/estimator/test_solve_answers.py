"""The core's fit against the plain code that it replaced."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from benchmarks.estimator.setup import Setup
from estimator import ContactEstimator
from estimator.contact.contacts import Contacts

KNOWN = dict(np.load(Path(__file__).parent / "plain_answers.npz"))
"""15 noisy frames of rods of drawn rigs (B, 80, 2) and what older estimators found in them: by the rung that was asked
for that of commit 39b4eb5, array formulas in NumPy, by default the rod of commit 2c3d1d8.
Each entry has B rows; covariance (B, 6, 6) is that of point and force."""
RIGS = {
    "calibrated": Setup(real=True, exact=False),
    "exact": Setup(real=True, exact=True),
    "fisheye": Setup(lens="fisheye", real=True, exact=False),
}
ROUNDING = 1e-3
"""In standard deviations: the rig's derivatives are taken where a rough descent ended, which need not be the same."""
NOT_SEARCHED = 0.05
"""The same without contact: the distance is then where the best force of a grid is."""
EVIDENCE = 1e-3
"""Part of it: the free antenna's derivatives by the camera's pose are now those of the rod."""


@cache
def answer(row: int) -> Contacts:
    """What is said now of one of the frames."""
    at = {name: values[row] for name, values in KNOWN.items()}
    estimator = ContactEstimator(RIGS[at["rig"]].rig(), str(at["model"]), friction=float(at["friction"]))
    return estimator.estimate_batch(
        at["points_px"][None], [at["moment_Nm"]], [at["pan_rad"]], [at["tilt_rad"]], sigma_px=0.1
    )


@pytest.mark.parametrize("row", np.flatnonzero(np.isfinite(KNOWN["moment_Nm"])))
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
