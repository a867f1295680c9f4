"""Errors of answers, and the time that reading a picture takes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.chain.methods import Answers
from benchmarks.chain.scenes import Photograph
from benchmarks.harness import or_none, processor_seconds, rms_known

ASTRAY_BOUND, ASTRAY_STATED = 5.0, 4.0
"""A number is wrong and confident when it is off by more than both: the bound's standard deviations, and its own."""


def verdict(found: Answers, photographs: Sequence[Photograph], bound_m: np.ndarray) -> dict[str, Any]:
    """The columns of `chain.ChainRow` that judge K answers, with the bound's standard deviations (K,) m."""
    error = found.distance_m - np.array([one.distance_m for one in photographs])
    force = np.array([one.force_N[1:] for one in photographs])
    off = np.linalg.norm(found.force_N - force, axis=1) / np.linalg.norm(force, axis=1)
    turned = (found.force_N * force[:, ::-1] * [-1.0, 1.0]).sum(axis=1), (found.force_N * force).sum(axis=1)
    astray = np.abs(error) > np.maximum(ASTRAY_BOUND * bound_m, ASTRAY_STATED * np.nan_to_num(found.std_m))
    known = np.isfinite(error)
    scaled, plain = (or_none(rms_known(each)) for each in (error / bound_m, 1e3 * error))
    weight = bound_m[known] ** 2
    return {
        "l_rms_mm": plain,
        # a few pictures with wide bounds make most of it
        "l_rms_error_mm": None
        if plain is None
        else plain * float(np.linalg.norm(weight) / weight.sum() / np.sqrt(2.0)),
        "l_median_mm": float(np.median(1e3 * np.abs(error[known]))) if known.any() else None,
        "of_bound": scaled,
        "of_bound_error": None if scaled is None else scaled / float(np.sqrt(2.0 * known.sum())),
        "force_percent": or_none(rms_known(1e2 * off)),
        "direction_deg": or_none(rms_known(np.degrees(np.arctan2(*turned)))),
        "answered": float(known.mean()),
        "wrong": float((known & astray).mean()),
    }


_BEYOND_CACHE_BYTES = 256 * 2**20
"""So much is read in turn that nothing of it is still in a processor's cache when its turn comes again."""


def reading_seconds(size: tuple[int, int], repeats: int) -> float:
    """Reading every byte of an 8-bit picture of (width, height) once out of memory.

    By summing eight bytes at a time, or by a copy, the faster way.
    """
    words = size[0] * size[1] // 8
    store = np.ones((max(_BEYOND_CACHE_BYTES // (8 * words), 1), words), np.uint64)
    once = np.empty(words, np.uint64)

    def copied() -> None:
        for picture in store:
            np.copyto(once, picture)

    ways = (lambda: [picture.sum() for picture in store], copied)
    return min(processor_seconds(way, repeats) for way in ways) / len(store)
