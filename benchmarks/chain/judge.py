"""Errors of answers, and where the time goes between a picture and its contact."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from benchmarks.chain.methods import MODELS, PAPER_RUNG, Answers, centreline, frame_of, seen
from benchmarks.chain.scenes import FRICTION_STD_RAD, Cell, Information, Photograph, at_places, equal_information
from benchmarks.estimator.scenes import Scenes, joined
from benchmarks.harness import column, or_none, processor_seconds, rms_known
from benchmarks.vision.scenes import aside_px
from estimator import ContactEstimator
from estimator.contact.recording import detect, measured
from vbaa_calib.detect.whisker.antenna import find_along, pixels, width_px
from vbaa_calib.detect.whisker.centreline import Centreline

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


def typical_seconds(works: Sequence[Callable[[], object]], repeats: int) -> float:
    """Median over several pieces of work of the least processor time of each."""
    return float(np.median([processor_seconds(work, repeats) for work in works]))


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


@dataclass(frozen=True)
class StageRow:
    """One stage of the way with the rung chosen automatically, two looks at a picture.

    ms, ms_recording : of one thread, of a picture that comes alone and of each in a recording.
    share : of the whole, for a picture that comes alone.
    """

    size: str = column("picture")
    stage: str = column("stage")
    ms: float = column("ms", ".3f")
    ms_recording: float = column("recording", ".3f")
    share: float = column("share %", ".1f", 100)


def stages(pages: Cell, read_s: float, timed: int, repeats: int) -> list[StageRow]:
    """Reading the picture alone for comparison, each stage, and their sum."""
    estimator = ContactEstimator(pages.rig, friction=FRICTION_STD_RAD)
    few = pages.photographs[:timed]
    steps = [_steps(estimator, one) for one in few]
    alone = {name: 1e3 * typical_seconds([step[name] for step in steps], repeats) for name in steps[0]}
    lens, rough, fit = "lens taken off the points", "rough fit", "fit"
    alone[fit] -= alone[lens]
    once, twice = (list(seen(estimator, pages.photographs, looks)) for looks in (False, True))
    rough_ms, fit_ms = (
        1e3 * processor_seconds(work, repeats) / len(pages)
        for work in (partial(estimator.rough, once), lambda: list(estimator.run(twice)))
    )
    together = alone | {rough: rough_ms, fit: max(fit_ms - alone[lens], 0.0)}
    whole, whole_together = sum(alone.values()), sum(together.values())
    rows = [("(reading it once)", 1e3 * read_s, 1e3 * read_s)]
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


_DRAWS = 4
"""Of ideal points, for each picture."""
_FINER = 8
"""The true path is taken so many times as dense as it was drawn: to a sixteenth of a pixel."""


@dataclass(frozen=True)
class LossRow:
    """One rung on the pictures of one size and rig. Errors of the distance in the bound's standard deviations, rms.

    noiseless : from points without noise: what the model leaves out, and what friction and the rig, which are not what
        they were expected to be, do to it.
    ideal : from points with the least noise that the picture allows: what model and solver make of perfect sight.
    picture : from the pictures.
    points : noise of the points that were found over the least; kept : share of the antenna's columns with a point.
    stated : deviations that the points come with over the noise that they have.
    None where there is no number.
    """

    size: str = column("picture")
    rig: str = column("rig")
    model: str = column("rung")
    noiseless: float | None = column("no noise", ".2f")
    ideal: float | None = column("best points", ".2f")
    picture: float | None = column("picture", ".2f")
    points: float | None = column("points", ".2f")
    kept: float = column("kept %", ".1f", 100)
    stated: float | None = column("stated", ".2f")


@dataclass(frozen=True, eq=False)
class _FoundPoints:
    """The points of one picture: their errors (N,) over the least noise, stated deviations over it; as in `LossRow`."""

    errors: np.ndarray
    stated: np.ndarray
    kept: float


def losses(
    pages: Cell,
    informations: Sequence[Information],
    bound_m: np.ndarray,
    of_bound: Mapping[str, float | None],
    seed: int,
) -> list[LossRow]:
    """Every rung but the lowest, which knows no weight; `of_bound` is what each reached from the pictures."""
    rng = np.random.default_rng([seed, 1])
    estimator = ContactEstimator(pages.rig)
    found = [found_points(estimator, one, known) for one, known in zip(pages.photographs, informations, strict=True)]
    errors, stated = (np.concatenate([getattr(one, name) for one in found]) for name in ("errors", "stated"))
    points, size = or_none(rms_known(errors)), or_none(rms_known(stated))
    places, sigma_px = equal_information(informations)
    clean = joined(
        [replace(at_places(replace(one.truth, sigma_px=sigma_px), places), rig=pages.rig) for one in pages.photographs]
    )
    noisy = clean.noisy(rng, _DRAWS)
    rows = []
    for model in [model for model in MODELS if model != PAPER_RUNG]:
        fit = ContactEstimator(pages.rig, model=model, friction=FRICTION_STD_RAD)
        noiseless, ideal = (_of_bound(fit, frames, bound_m) for frames in (clean, noisy))
        rows.append(
            LossRow(
                size=pages.name,
                rig=pages.known,
                model=model,
                noiseless=noiseless,
                ideal=ideal,
                picture=of_bound.get(model),
                points=points,
                kept=float(np.mean([one.kept for one in found])),
                stated=size / points if size and points else None,
            )
        )
    return rows


def found_points(estimator: ContactEstimator, photograph: Photograph, known: Information) -> _FoundPoints:
    """The points that the second look finds, by the path that the picture was drawn from."""
    line = centreline(estimator, photograph)
    path = photograph.drawing.tube.pixels
    fine = np.linspace(0, len(path) - 1, _FINER * len(path))
    dense = np.stack([np.interp(fine, np.arange(len(path)), axis) for axis in path.T], axis=1)
    least = np.interp(line.points_px[:, 0], known.column, known.sigma_px)
    return _FoundPoints(
        errors=aside_px(dense, line.points_px)[0] / least,
        stated=line.sigma_px * estimator.rig.image.noise_scale / least,
        kept=len(line.points_px) / len(known.column),
    )


def _of_bound(fit: ContactEstimator, frames: Scenes, bound_m: np.ndarray) -> float | None:
    """Rms error of the distances in the bound's deviations (K,), every picture's frames in a row."""
    found = fit.estimate_batch(
        frames.points_px, frames.moment_Nm, frames.pan_rad, frames.tilt_rad, sigma_px=frames.sigma_px
    )
    each = np.repeat(bound_m, len(frames) // len(bound_m))
    return or_none(rms_known((found.distance_m - frames.distance_m) / each))
