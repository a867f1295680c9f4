"""Answers held against the truth and the bound."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .averages import or_none, rms_known
from .chain_methods import Answers
from .chain_scenes import Photograph

ASTRAY_BOUND, ASTRAY_STATED = 5.0, 4.0
"""A number is wrong and confident when it is off by more than both: the bound's standard deviations, and its own."""


@dataclass(frozen=True)
class Verdict:
    """What a method's answers are worth; None without any. The attributes are those of `chain_run.ChainRow`."""

    l_rms_mm: float | None
    l_rms_error_mm: float | None
    l_median_mm: float | None
    of_bound: float | None
    of_bound_error: float | None
    force_percent: float | None
    direction_deg: float | None
    answered: float
    wrong: float


def verdict(found: Answers, photographs: Sequence[Photograph], bound_m: np.ndarray) -> Verdict:
    """Of K answers, with the bound's standard deviations (K,) m."""
    error = found.distance_m - np.array([one.distance_m for one in photographs])
    force = np.array([one.force_N[1:] for one in photographs])
    off = np.linalg.norm(found.force_N - force, axis=1) / np.linalg.norm(force, axis=1)
    turned = (found.force_N * force[:, ::-1] * [-1.0, 1.0]).sum(axis=1), (found.force_N * force).sum(axis=1)
    astray = np.abs(error) > np.maximum(ASTRAY_BOUND * bound_m, ASTRAY_STATED * np.nan_to_num(found.std_m))
    known = np.isfinite(error)
    scaled, plain = (or_none(rms_known(each)) for each in (error / bound_m, 1e3 * error))
    weight = bound_m[known] ** 2
    return Verdict(
        l_rms_mm=plain,
        # a few pictures with wide bounds make most of it
        l_rms_error_mm=None if plain is None else plain * float(np.linalg.norm(weight) / weight.sum() / np.sqrt(2.0)),
        l_median_mm=float(np.median(1e3 * np.abs(error[known]))) if known.any() else None,
        of_bound=scaled,
        of_bound_error=None if scaled is None else scaled / float(np.sqrt(2.0 * known.sum())),
        force_percent=or_none(rms_known(1e2 * off)),
        direction_deg=or_none(rms_known(np.degrees(np.arctan2(*turned)))),
        answered=float(known.mean()),
        wrong=float((known & astray).mean()),
    )
