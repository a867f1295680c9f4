"""docs/theory_bounds.md, a point of the centreline: what one column of pixels says of a bar's place across it.

σ_c = (σ_g/H)·√(b√π/(1 − exp(−w²/4b²))), noise σ_g, height H, width w, blurred by b.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.vision.judge import bound_px
from benchmarks.vision.scenes import PLAIN, Bend, Shot, light, variance


def stated(noise: float, height: float, width: float, blur: float) -> float:
    return float(noise / height * np.sqrt(blur * np.sqrt(np.pi) / -np.expm1(-((width / (2.0 * blur)) ** 2))))


@pytest.mark.parametrize(("width", "blur"), [(1.5, 2.0), (3.0, 0.7), (20.0, 1.0)])
def test_by_summing_over_pixels(width: float, blur: float) -> None:
    """Level and height free as well: they are even where the place is odd, and cost nothing."""
    at = np.arange(-40.0, 41.0) + 0.0
    edge = [np.exp(-(((at + side * width / 2) / blur) ** 2) / 2) / (blur * np.sqrt(2 * np.pi)) for side in (1, -1)]
    assert 1.0 / np.linalg.norm(edge[0] - edge[1]) == pytest.approx(stated(1.0, 1.0, width, blur), rel=1e-2)


@pytest.mark.parametrize(
    ("width", "blur", "worse", "slack"),
    [(1.5, 0.6, 1.0, 0.1), (1.5, 1.6, 1.0, 0.1), (8.0, 0.6, 1.0, 0.1), (8.0, 1.6, 1.0, 0.1), (20.0, 0.6, 1.34, 0.04)],
)
def test_the_drawn_antenna_is_within_a_tenth_of_it(width: float, blur: float, worse: float, slack: float) -> None:
    """`bound_px` of drawn pictures: a lit tube with shaded flanks, of which H is the mean height.

    Shading rounds the edges of a tube of 20 px.
    """
    spec = replace(PLAIN, blur_px=blur, electrons_per_grey=1e6, read_noise=3.0)
    shot = Shot((300, 120), Bend((20.0, 60.0), 0.0, 250.0), width, spec)
    height = (light(shot) - light(shot, antenna=False))[:, 100].sum() / width
    noise = float(np.sqrt(variance(shot.spec, light(shot))[60, 5]))
    found = bound_px(shot, np.array([[100.0, 60.0]]))[0]
    assert found / stated(noise, height, width, np.hypot(blur, 12**-0.5)) == pytest.approx(worse, abs=slack)
