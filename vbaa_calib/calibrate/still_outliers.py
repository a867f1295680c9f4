"""Which stills do not fit the others: a picture of something else, or a load that was noted wrong."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .load_readings import ReadingGroups

FALSE_STILL = 3.0
"""A still whose points lie this many times further off than the median still's is left out."""
FALSE_READING_STD = 5.0
"""Deviations by which a still's own place and weight may have to be off for it to fit, before it is left out."""


def fitting(
    distances: Sequence[np.ndarray], scale: float, groups: ReadingGroups, errors: np.ndarray, kept: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Which stills fit (F,), and how far each one's points lie off, in scaled deviations (F,).

    A still is judged after its own readings were let go. Without that one that is out, and whose place no other still
    shares, could never come back: nothing else tells what its readings are off by.

    Parameters
    ----------
    distances : per still (N, 1 + ... + K) whitened distances, then their slopes, the last K by the readings.
    scale : of the points' deviations. errors : (K,) what the readings are off by so far. kept : (F,) who took part.
    """
    rms, needed = np.empty(len(distances)), np.zeros(len(distances))
    for index, block in enumerate(distances):
        left, own = block[:, 0] / scale, _own(groups, index, kept)
        if len(own):
            columns = block[:, block.shape[1] - groups.count :][:, own] / scale
            inner = np.eye(len(own)) + columns.T @ columns
            step = -np.linalg.solve(inner, columns.T @ left + errors[own])
            left, needed[index] = left + columns @ step, float(np.linalg.norm(errors[own] + step))
        rms[index] = np.sqrt((left**2).mean())
    return (rms < FALSE_STILL * np.median(rms)) & (needed < FALSE_READING_STD), rms


def _own(groups: ReadingGroups, index: int, kept: np.ndarray) -> np.ndarray:
    """The readings of a still that no other still that takes part has."""
    others = kept & (np.arange(len(kept)) != index)
    found = [
        int(group[index])
        for group in (groups.distance, groups.force)
        if group[index] >= 0 and not (others & (group == group[index])).any()
    ]
    return np.array(found, int)
