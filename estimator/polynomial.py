"""Many small polynomials at once: arrays or tensors (n, degree + 1) of coefficients in rising powers."""

from __future__ import annotations

import numpy as np

from vbaa_calib.arrays import Array, like, namespace


def real_roots(rising: Array) -> Array:
    """Real roots (n, degree) of polynomials (n, degree + 1) in rising powers; NaN in place of the complex ones."""
    xp = namespace(rising)
    degree = rising.shape[1] - 1
    with np.errstate(all="ignore"):
        monic = rising / rising[:, -1:]
        usable = (abs(monic) < np.inf).all(-1)[:, None]
        shifted = xp.broadcast_to(like(rising, np.eye(degree, degree - 1, -1)), (len(rising), degree, degree - 1))
        last = xp.where(usable, -monic[:, :-1], 0.0)[..., None]
        roots = xp.linalg.eigvals(xp.concat([shifted, last], -1))
        size, real = abs(roots), xp.real(roots)
        real = xp.where(usable & (abs(xp.imag(roots)) <= 1e-6 * size), real, np.nan)
        slope = monic[:, 1:] * like(rising, np.arange(1, degree + 1))
        # the companion matrix's eigenvalues carry its norm's rounding; Newton's steps take that off simple roots
        for _ in range(2):
            step = _value(monic, real) / _value(slope, real)
            real = xp.where(abs(step) < 1e-3 * abs(real), real - step, real)
    return real


def _value(rising: Array, at: Array) -> Array:
    total = 0.0 * at
    for power in reversed(range(rising.shape[1])):
        total = total * at + rising[:, power, None]
    return total
