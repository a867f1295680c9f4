"""The straight line beyond the contact: a baseline, right where the antenna is a linear beam."""

from __future__ import annotations

import numpy as np
import torch

from estimator.paper.two_point import straight_line_contact
from vbaa_calib.antenna import linear

EI, LENGTH = 3.9e-3, 0.24


def scenes(count: int, seed: int):
    """x (n, 200), y, contact and force of noise-free scenes."""
    rng = np.random.default_rng(seed)
    contact, force = rng.uniform(0.05, 0.9, count) * LENGTH, 0.1 * rng.normal(size=count)
    x = np.broadcast_to(np.linspace(0.0, LENGTH, 200), (count, 200))
    return x, linear.deflection(x, contact[:, None], force[:, None], EI), contact, force


def test_exact_on_the_straight_part_and_improved_towards_it() -> None:
    x, y, contact, force = scenes(500, 1)
    found = straight_line_contact(x, y, contact, EI, rounds=1)
    np.testing.assert_allclose(found.contact_m, contact, rtol=1e-10)
    np.testing.assert_allclose(found.force_y_N, force, rtol=1e-10)
    np.testing.assert_array_equal(found.points, (x >= contact[:, None]).sum(-1))
    errors = [
        np.abs(straight_line_contact(x, y, 0.7 * contact, EI, rounds).contact_m / contact - 1.0).max()
        for rounds in (1, 3)
    ]
    assert errors[0] > 1e-3
    assert errors[1] < 1e-9


def test_missing_points_are_left_out() -> None:
    x, y, contact, _ = scenes(50, 2)
    holes = np.random.default_rng(3).random(y.shape) < 0.4
    found = straight_line_contact(x, np.where(holes, np.nan, y), 1.01 * contact, EI, 1)
    np.testing.assert_allclose(found.contact_m, contact, rtol=1e-10)


def test_too_little_left_is_nan() -> None:
    x, y, *_ = scenes(3, 4)
    for guess, seen in ((LENGTH, y), (np.nan, y), (0.1, np.full_like(y, np.nan)), (0.1, 0.0 * y)):
        found = straight_line_contact(x, seen, np.full(3, guess), EI)
        assert np.isnan(found.contact_m).all()
        assert np.isnan(found.force_y_N).all()


def test_torch_agrees_and_one_frame_needs_no_batch() -> None:
    x, y, contact, _ = scenes(40, 5)
    expected = straight_line_contact(x, y, 0.9 * contact, EI)
    found = straight_line_contact(torch.from_numpy(x.copy()), torch.from_numpy(y), 0.9 * contact, EI)
    assert isinstance(found.contact_m, torch.Tensor)
    np.testing.assert_allclose(found.contact_m.numpy(), expected.contact_m, rtol=1e-9)
    one = straight_line_contact(x[0], y[0], 0.9 * contact[0], EI)
    np.testing.assert_allclose(one.contact_m, expected.contact_m[0], rtol=1e-12)
