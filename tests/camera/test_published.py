"""Numbers that kornia's own tests publish: OpenCV's inverse of five coefficients, and a case without an end there."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from kornia.geometry.calibration import undistort_points

from vbaa_calib import Camera


def test_opencv_vector_of_kornia() -> None:
    """Three pixels through five coefficients. The published numbers are OpenCV's after five steps, to 1e-4 px or so."""
    matrix = np.array([[1731.5, 0.0, 622.89], [0.0, 1732.0, 535.37], [0.0, 0.0, 1.0]])
    camera = Camera("opencv", (1280, 1024), matrix, np.array([-0.1007, 0.2650, -0.0018, 0.0007, -0.2597]))
    given = np.array([[1028.0374, 788.7520], [1025.1218, 716.8726], [1022.1792, 645.1857]])
    ideal, valid = camera.unproject_normalized(given)
    undistorted = ideal * matrix[[0, 1], [0, 1]] + matrix[:2, 2]
    published = np.array([[1030.5992, 790.65533], [1027.3059, 718.10020], [1024.0700, 645.90600]])
    assert valid.all()
    np.testing.assert_allclose(undistorted, published, atol=2e-3)


def test_where_the_fixed_point_falls_into_a_two_cycle() -> None:
    """k1 = 0.5 three focal lengths out: kornia's iteration jumps between two wrong answers, the layer is exact."""
    matrix = np.array([[100.0, 0.0, 4.0], [0.0, 100.0, 3.0], [0.0, 0.0, 1.0]])
    camera = Camera("opencv", (4000, 7), matrix, np.array([0.5, 0.0, 0.0, 0.0]))
    ray = np.array([[3.0, 0.0, 1.0]])
    pixel, seen = camera.project(ray)
    ideal, valid = camera.unproject_normalized(pixel)
    assert seen.all()
    assert valid.all()
    np.testing.assert_allclose(ideal, [[3.0, 0.0]], atol=1e-12)

    theirs = [
        undistort_points(
            torch.from_numpy(pixel), torch.from_numpy(matrix), torch.tensor([0.5, 0, 0, 0]).double(), num_iters=steps
        )[0, 0].item()
        for steps in (50, 51, 52)
    ]
    assert theirs[0] == pytest.approx(theirs[2], abs=1e-6), "a two-cycle"
    assert min(abs(u - 304.0) for u in theirs) > 1.0
