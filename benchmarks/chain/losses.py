"""Where the chain falls short of its bound: the picture's points, or what is made of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.estimator.scenes import Scenes, joined
from benchmarks.harness import column, or_none, rms_known
from benchmarks.vision.scenes import aside_px
from estimator import ContactEstimator

from .bound import Information, at_places, equal_information
from .methods import MODELS, PAPER_RUNG, centreline
from .scenes import FRICTION_STD_RAD, Cell, Photograph

_DRAWS = 4
"""Of ideal points, for each picture."""
_FINER = 8
"""The true path is taken so many times as dense as it was drawn: to a sixteenth of a pixel."""


@dataclass(frozen=True)
class LossRow:
    """One rung on the pictures of one size and rig. Errors of the distance in the bound's standard deviations, rms.

    Attributes
    ----------
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
