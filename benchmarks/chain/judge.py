"""Errors of answers, and where the time goes between a picture and its contact."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from benchmarks.harness import column, or_none, rms_known
from estimator import ContactEstimator
from estimator.contact.recording import detect, measured
from vbaa_calib.detect.whisker.antenna import find_along, pixels, width_px
from vbaa_calib.detect.whisker.centreline import Centreline

from .methods import Answers, frame_of, seen
from .scenes import FRICTION_STD_RAD, Cell, Photograph

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
_LONG_S = 0.25


@dataclass(frozen=True)
class Reading:
    """Reading every byte of one picture once.

    Attributes
    ----------
    memory_s : out of memory. cache_s : again and again, out of whatever cache holds it.
    """

    memory_s: float
    cache_s: float


def seconds(work: Callable[[], object], repeats: int) -> float:
    """Least processor time, of all threads together, over so many calls, after one to warm up.

    What takes longer than `_LONG_S` is timed once. With one thread it is the time that passes on a machine with nothing
    else to do; what BLAS does in others, if OMP_NUM_THREADS lets it, counts too.
    """
    begun = time.process_time()
    work()
    least = time.process_time() - begun
    if least > _LONG_S:
        return least
    for _ in range(repeats):
        begun = time.process_time()
        work()
        least = min(least, time.process_time() - begun)
    return least


def typical_seconds(works: Sequence[Callable[[], object]], repeats: int) -> float:
    """Median over several pieces of work of the least time of each."""
    return float(np.median([seconds(work, repeats) for work in works]))


def reading(size: tuple[int, int], repeats: int, room_bytes: int = _BEYOND_CACHE_BYTES) -> Reading:
    """For 8-bit pictures of (width, height): by summing them eight bytes at a time, or by a copy, the faster way."""
    words = size[0] * size[1] // 8
    store = np.ones((max(room_bytes // (8 * words), 1), words), np.uint64)
    once = np.empty(words, np.uint64)

    def summed(pictures: np.ndarray) -> None:
        for picture in pictures:
            picture.sum()

    def copied(pictures: np.ndarray) -> None:
        for picture in pictures:
            np.copyto(once, picture)

    again = np.broadcast_to(store[:1], store.shape)
    memory, cache = (
        min(seconds(partial(way, pictures), repeats) for way in (summed, copied)) / len(store)
        for pictures in (store, again)
    )
    return Reading(memory, cache)


@dataclass(frozen=True)
class StageRow:
    """One stage of the way with the rung chosen automatically, two looks at a picture.

    Attributes
    ----------
    ms, ms_recording : of one thread, of a picture that comes alone and of each in a recording.
    share : of the whole, for a picture that comes alone.
    """

    size: str = column("picture")
    stage: str = column("stage")
    ms: float = column("ms", ".3f")
    ms_recording: float = column("recording", ".3f")
    share: float = column("share %", ".1f", 100)


def stages(pages: Cell, read: Reading, timed: int, repeats: int) -> list[StageRow]:
    """Reading the picture alone for comparison, each stage, and their sum."""
    estimator = ContactEstimator(pages.rig, friction=FRICTION_STD_RAD)
    few = pages.photographs[:timed]
    steps = [_steps(estimator, one) for one in few]
    alone = {name: 1e3 * typical_seconds([step[name] for step in steps], repeats) for name in steps[0]}
    lens, rough, fit = "lens taken off the points", "rough fit", "fit"
    alone[fit] -= alone[lens]
    once, twice = (list(seen(estimator, pages.photographs, looks)) for looks in (False, True))
    rough_ms, fit_ms = (
        1e3 * seconds(work, repeats) / len(pages)
        for work in (partial(estimator.rough, once), lambda: list(estimator.run(twice)))
    )
    together = alone | {rough: rough_ms, fit: max(fit_ms - alone[lens], 0.0)}
    whole, whole_together = sum(alone.values()), sum(together.values())
    rows = [("(reading it once)", 1e3 * read.memory_s, 1e3 * read.memory_s)]
    rows += [(name, alone[name], together[name]) for name in alone]
    rows.append(("all", whole, whole_together))
    return [StageRow(pages.name, name, ms, recorded, ms / whole) for name, ms, recorded in rows]


def _steps(estimator: ContactEstimator, photograph: Photograph) -> dict[str, Callable[[], object]]:
    """Stage → what to call, given what the stages before it found. The fit takes the lens off by itself."""
    rig, frame, image = estimator.rig, frame_of(photograph), photograph.image
    first = detect(rig, frame, image)
    given = measured(rig, frame, first)
    (rough,) = estimator.rough([given])
    assert rough is not None
    (offered,) = seen(estimator, [photograph])
    fitted_m = rough.points_m

    def second_look() -> Centreline:
        """Along the fitted shape, as `recording.detect_again` takes it."""
        to_camera = rig.T_antenna_camera.inverse()
        guide = pixels(rig.camera, to_camera, fitted_m)
        width = width_px(rig.camera, to_camera, fitted_m, rig.antenna.diameter_m)
        return find_along(image, guide, width, rig.image.bright)

    return {
        "first look": partial(detect, rig, frame, image),
        "rough fit": partial(estimator.rough, [given]),
        "second look": second_look,
        "lens taken off the points": partial(rig.camera.normalized_with_slopes, offered.points_px),
        "fit": partial(estimator.measure, offered),
    }
