"""Where the time goes between a picture and its contact."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from estimator import ContactEstimator
from estimator.recording import look, measured

from ..detect.antenna import find_along, pixels, width_px
from ..detect.centreline import Centreline
from .chain_clock import Reading, seconds, typical_seconds
from .chain_methods import frame_of, seen
from .chain_scenes import FRICTION_STD_RAD, Cell, Photograph


@dataclass(frozen=True)
class StageRow:
    """One stage of the way with the rung chosen automatically, two looks at a picture.

    Attributes
    ----------
    ms, ms_recording : of one thread, of a picture that comes alone and of each in a recording.
    share : of the whole, for a picture that comes alone.
    """

    size: str
    stage: str
    ms: float
    ms_recording: float
    share: float


def stages(pages: Cell, read: Reading, timed: int, repeats: int) -> list[StageRow]:
    """Reading the picture alone for comparison, each stage, and their sum."""
    estimator = ContactEstimator(pages.rig, friction=FRICTION_STD_RAD)
    few = pages.photographs[:timed]
    steps = [_steps(estimator, one) for one in few]
    alone = {name: 1e3 * typical_seconds([step[name] for step in steps], repeats) for name in steps[0]}
    lens, rough, fit = "lens taken off the points", "rough fit", "fit"
    alone[fit] -= alone[lens]
    fits = max(_fits_together(estimator, pages.photographs, repeats) - alone[lens], 0.0)
    together = alone | {rough: _roughs_together(estimator, pages.photographs, repeats), fit: fits}
    whole, whole_together = sum(alone.values()), sum(together.values())
    rows = [("(reading it once)", 1e3 * read.memory_s, 1e3 * read.memory_s)]
    rows += [(name, alone[name], together[name]) for name in alone]
    rows.append(("all", whole, whole_together))
    return [StageRow(pages.name, name, ms, recorded, ms / whole) for name, ms, recorded in rows]


def _steps(estimator: ContactEstimator, photograph: Photograph) -> dict[str, Callable[[], object]]:
    """Stage → what to call, given what the stages before it found. The fit takes the lens off by itself."""
    rig, frame, image = estimator.rig, frame_of(photograph), photograph.image
    first = look(rig, frame, image)
    given = measured(rig, frame, first)
    (rough,) = estimator.rough([given])
    assert rough is not None
    (offered,) = seen(estimator, [photograph])
    return {
        "first look": partial(look, rig, frame, image),
        "rough fit": partial(estimator.rough, [given]),
        "second look": partial(_again, estimator, photograph, rough.points_m),
        "lens taken off the points": partial(rig.camera.normalized_with_slopes, offered.points_px),
        "fit": partial(estimator.measure, offered),
    }


def _again(estimator: ContactEstimator, photograph: Photograph, points_m: np.ndarray) -> Centreline:
    """The look along the fitted shape, as `recording.look_again` takes it."""
    rig, to_camera = estimator.rig, estimator.rig.T_antenna_camera.inverse()
    guide = pixels(rig.camera, to_camera, points_m)
    width = width_px(rig.camera, to_camera, points_m, rig.antenna.diameter_m)
    return find_along(photograph.image, guide, width, rig.image.bright)


def _roughs_together(estimator: ContactEstimator, photographs: Sequence[Photograph], repeats: int) -> float:
    """ms of the rough fit for each picture, all of them in one batch."""
    offered = list(seen(estimator, photographs, twice=False))
    return 1e3 * seconds(lambda: estimator.rough(offered), repeats) / len(offered)


def _fits_together(estimator: ContactEstimator, photographs: Sequence[Photograph], repeats: int) -> float:
    """ms of the fit for each picture, all of them fitted in a stream."""
    offered = list(seen(estimator, photographs))
    return 1e3 * seconds(lambda: list(estimator.run(offered)), repeats) / len(offered)
