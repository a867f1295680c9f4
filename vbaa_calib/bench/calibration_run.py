"""Lens solves on the same corners, judged in millimetres on plane C: OpenCV, others that are installed, and ours."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..console import progress
from .averages import or_none
from .calibration_judge import error_mm
from .calibration_methods import Outcome, methods
from .calibration_rigs import Rig, draw, rigs


@dataclass(frozen=True)
class Row:
    """One method on one rig, over the draws.

    Attributes
    ----------
    error_mm : median over draws of the rms error of points on C, whose pose is told; None where the method is absent
        or mostly failed. ratio : the same over the oracle's. rms_ratio : root mean squares over draws likewise;
        None where a draw failed.
    jig_error_mm, jig_ratio, jig_rms_ratio : the same with the pose of C solved with the method's own lens.
    seconds : median time of one solve. folds : share of draws whose lens folds inside the picture.
    good_dropped : share of the good corners that were left out; None where the method does not say.
    outliers_found : share of the outliers that were left out; None as above or where there are none.
    models : the lens models chosen and how often, where there was a choice. note : why there are no numbers.
    """

    rig: str
    method: str
    error_mm: float | None = None
    ratio: float | None = None
    rms_ratio: float | None = None
    jig_error_mm: float | None = None
    jig_ratio: float | None = None
    jig_rms_ratio: float | None = None
    seconds: float | None = None
    folds: float | None = None
    good_dropped: float | None = None
    outliers_found: float | None = None
    models: str = ""
    note: str = ""


def run(draws: int, seed: int) -> list[Row]:
    """Every method on every rig over the same draws, the oracle first."""
    rows = []
    every = methods()
    for rig in progress(rigs(), "rigs", len(rigs())):
        given = [draw(rig, seed + number) for number in range(draws)]
        oracle: np.ndarray | None = None
        for name, method in every.items():
            if isinstance(method, str):
                rows.append(Row(rig.name, name, note=method))
                continue
            outcomes = method(given)
            errors = np.array([_errors(outcome, rig) for outcome in outcomes])
            oracle = errors if oracle is None else oracle
            rows.append(_row(rig, name, outcomes, errors, oracle))
    return rows


def _errors(outcome: Outcome, rig: Rig) -> tuple[float, float]:
    """Error in mm on C with its pose told, and with its pose solved."""
    if outcome.camera is None:
        return np.inf, np.inf
    return error_mm(outcome.camera, rig.camera), error_mm(outcome.camera, rig.camera, from_jig=True)


def _row(rig: Rig, name: str, outcomes: Sequence[Outcome], errors: np.ndarray, oracle: np.ndarray) -> Row:
    """One method's row; errors (D, 2) mm of its outcomes and of the oracle's."""
    cameras = [outcome.camera for outcome in outcomes if outcome.camera is not None]
    failures = [outcome.failure for outcome in outcomes if outcome.camera is None]
    chosen = Counter(outcome.model for outcome in outcomes if outcome.model)
    middle, own_rms = np.median(errors, axis=0), np.sqrt(np.mean(errors**2, axis=0))
    reference, reference_rms = np.median(oracle, axis=0), np.sqrt(np.mean(oracle**2, axis=0))
    return Row(
        rig=rig.name,
        method=name,
        error_mm=or_none(middle[0]),
        ratio=or_none(middle[0] / reference[0]),
        rms_ratio=or_none(own_rms[0] / reference_rms[0]),
        jig_error_mm=or_none(middle[1]),
        jig_ratio=or_none(middle[1] / reference[1]),
        jig_rms_ratio=or_none(own_rms[1] / reference_rms[1]),
        seconds=_mean([outcome.seconds for outcome in outcomes if outcome.camera is not None], np.median),
        folds=_mean([camera.valid_region().image_fraction < 1.0 for camera in cameras]),
        good_dropped=_mean([outcome.good_dropped for outcome in outcomes]),
        outliers_found=_mean([outcome.outliers_found for outcome in outcomes]),
        models=", ".join(f"{model} {count}" for model, count in chosen.most_common()),
        note=f"{len(failures)} of {len(outcomes)} failed: {failures[0]}" if failures else "",
    )


def _mean(values: Sequence[float | None], middle: Callable[[list[float]], np.floating] = np.mean) -> float | None:
    given = [value for value in values if value is not None]
    return float(middle(given)) if given else None
