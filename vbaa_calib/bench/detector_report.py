"""The verdict on a detector of corners, in words."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from .detector_test import OPENCV, OURS, Row

BIASED_PX = 0.08
"""A mean error that no chance makes: the detectors at hand stay below 0.02 px."""
HALF_PX = (0.35, 0.65)
GOOD_PX = 0.1
_FOUND = 0.5


def mean_bias_px(rows: Sequence[Row], detector: str) -> np.ndarray:
    """(2,) mean error along u and v, over the conditions under which half the corners or more are found; else NaN."""
    measured = [row.bias_px for row in rows if row.detector == detector and row.measured and row.found >= _FOUND]
    return np.median(measured, axis=0) if measured else np.full(2, np.nan)


def is_sound(rows: Sequence[Row]) -> bool:
    """Whether neither detector is off as a whole, nor silent under every condition."""
    biases = np.array([mean_bias_px(rows, detector) for detector in (OPENCV, OURS)])
    return bool((np.abs(biases) < BIASED_PX).all())


def verdict(rows: Sequence[Row]) -> list[str]:
    """Sentences: whether OpenCV, and what we make of its corners, can be trusted, and down to which size of squares."""
    return [*_of_opencv(mean_bias_px(rows, OPENCV)), *_of_ours(rows)]


def _of_opencv(bias: np.ndarray) -> list[str]:
    name = f"OpenCV {cv2.__version__}"
    if not np.isfinite(bias).all():
        return [
            f"{name} finds this board under none of the conditions: are its squares too many, or its markers too thin?"
        ]
    shift = f"({bias[0]:+.2f}, {bias[1]:+.2f}) px"
    if np.abs(bias).max() < BIASED_PX:
        return [f"{name} finds this board's corners without bias: {shift} in the mean."]
    if ((np.abs(bias) > HALF_PX[0]) & (np.abs(bias) < HALF_PX[1])).any():
        return [
            f"{name} is half a pixel off, {shift}: it counts pixels from a corner of the first one, as versions before "
            "4.14 did. Update it."
        ]
    return [f"{name} is off by {shift} in the mean. Update it, or report it."]


def _of_ours(rows: Sequence[Row]) -> list[str]:
    bias = mean_bias_px(rows, OURS)
    if not np.isfinite(bias).all():
        return []
    sentences = []
    if np.abs(bias).max() >= BIASED_PX:
        sentences.append(
            f"The corners used here are off by ({bias[0]:+.2f}, {bias[1]:+.2f}) px: do not calibrate with them."
        )
    good = [
        row for row in rows if row.detector == OURS and row.measured and row.found >= _FOUND and row.rms_px <= GOOD_PX
    ]
    if not good:
        return [*sentences, f"Under no condition tried are corners within {GOOD_PX} px rms: the markers leave no room."]
    smallest = min(row.square_px for row in good)
    sentences.append(f"Our corners are within {GOOD_PX} px rms from squares of {smallest:g} px on.")
    pulls = [row.error_per_std for row in good if row.error_per_std is not None]
    if pulls and max(pulls) > 1.5:
        sentences.append(
            f"Errors are up to {max(pulls):.1f} times what noise alone makes: in sharp pictures with little noise "
            "the detector's own bias from corner to corner rules."
        )
    return sentences


def as_text(rows: Sequence[Row]) -> str:
    """The table."""
    lines = [
        "square px  blur px  detector     found   bias u, v px        rms   median    worst  error/std",
        "----------------------------------------------------------------------------------------------",
    ]
    for row in rows:
        head = f"{row.square_px:9g} {row.blur_px:8g}  {row.detector:<11} {100 * row.found:5.0f} %"
        if not row.measured:
            lines.append(f"{head}   too few to measure")
            continue
        pull = "" if row.error_per_std is None else f"{row.error_per_std:10.2f}"
        bias = f"{row.bias_px[0]:+.3f}, {row.bias_px[1]:+.3f}"
        lines.append(f"{head}  {bias:>16} {row.rms_px:9.3f} {row.median_px:8.3f} {row.worst_px:8.3f} {pull}")
    return "\n".join(lines)
