"""All that a set of pictures of the board says of itself once the lens is solved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from targets.board import BoardSpec
from vbaa_calib.calibrate.lens.intrinsics import LensSolution
from vbaa_calib.core.errors import Diagnosis
from vbaa_calib.detect.board.corners import BoardView

from .variety import little_variety, poorly_covered
from .view_scores import OwnScores, SetScores, set_scores

FEWEST_VIEWS = 6
KNOWN = 2e-3
"""Standard deviation up to which the pictures tell the print's aspect: those rolled by a quarter turn or a half of it
do, for the others a long board and a lens with fy > fx are the same."""
SURE, MATTERS = 5.0, 1e-3
_GRAVE = 5e-3


@dataclass(frozen=True)
class PrintAspect:
    """How much longer the print is along its y than the spec says, relative to its x, with its standard deviation."""

    excess: float
    std: float

    @property
    def known(self) -> bool:
        """Whether the pictures tell."""
        return self.std < KNOWN


def print_aspect(scores: SetScores) -> PrintAspect | None:
    """From all views, lens and poses solved along; None where too few.

    The standard deviation is the larger of that from the corners' scatter and that from the scatter between the views.
    """
    direction, residuals = scores.common(SetScores.ASPECT)
    information, count = float(direction @ direction), len(scores.names)
    if count < FEWEST_VIEWS or not information > 0.0:
        return None
    excess = float(direction @ residuals) / information
    pull = np.add.reduceat(direction * (residuals - excess * direction), scores.bounds[:-1])
    between = float(pull @ pull) * count / (count - 1)
    std = np.sqrt(max(scores.variance_px2 * information, between)) / information
    return PrintAspect(excess, float(std))


def print_stretched(scores: SetScores) -> Diagnosis | None:
    """Whether the print's x and y differ in scale; None too where the pictures cannot tell."""
    aspect = print_aspect(scores)
    if aspect is None or not aspect.known or abs(aspect.excess) < max(SURE * aspect.std, MATTERS):
        return None
    longer, other = ("y", "x") if aspect.excess > 0 else ("x", "y")
    return Diagnosis(
        "print_stretched",
        f"the print is longer along its {longer} than along its {other} by {100 * abs(aspect.excess):.2f} ± "
        f"{100 * aspect.std:.2f} %",
        "measure both rulers of the print; print it anew without scaling, or on another printer",
        abs(aspect.excess) > _GRAVE,
    )


FEWEST_VIEWS_SIDE = 6
_LEAST_SIDE = 2
_SEED, _DRAWS, _MOST_NUMBERS = 0, 40_000, 8_000_000


@dataclass(frozen=True)
class Change:
    """The pattern over the views that explains most.

    Attributes
    ----------
    index : of the pattern. size : of the change, in the parameter's unit, with its standard deviation `std`: from the
        scatter between the views, or from the residuals' variance if that says more.
    chance : of one so clear among all patterns tried, were there none.
    """

    index: int
    size: float
    std: float
    chance: float


def steps(count: int) -> np.ndarray:
    """(K, V) patterns: 0 before some view, 1 from it on; two views at least on either side."""
    return (np.arange(count) >= np.arange(_LEAST_SIDE, count - _LEAST_SIDE + 1)[:, None]).astype(float)


def drift(count: int) -> np.ndarray:
    """(1, V): from 0 at the first view to 1 at the last."""
    return np.linspace(0.0, 1.0, count)[None]


def find_change(own: OwnScores, patterns: np.ndarray, variance_px2: float) -> Change | None:
    """The pattern (K, V) that a parameter's values over the views follow best; None with too few views.

    The scatter of the views about the pattern sets the scale, not the corners' noise: a print that is not flat, or a
    lens that is not quite the model's, moves whole views. The chance is that of normal scatter of any size, by drawing.
    """
    if len(own.score) < FEWEST_VIEWS_SIDE:
        return None
    white, score = own.whitened
    shapes = patterns @ white.T
    strength = np.linalg.norm(shapes, axis=1)
    seen = strength > 1e-9 * max(float(np.linalg.norm(white)), 1e-300)
    freedom = len(score) - 1
    if not seen.any() or freedom < FEWEST_VIEWS_SIDE - 2:
        return None
    shapes = shapes[seen] / strength[seen, None]
    share = _shares(shapes, score[None])[0]
    best = int(share.argmax())
    left = float(score @ score) * (1.0 - share[best]) / freedom
    size = float(shapes[best] @ score / strength[seen][best])
    std = float(np.sqrt(max(left, variance_px2)) / strength[seen][best])
    chance = max(_chance(shapes, float(share[best])), _plain_chance(size / std, len(shapes)))
    return Change(int(np.flatnonzero(seen)[best]), size, std, chance)


def _shares(shapes: np.ndarray, scores: np.ndarray) -> np.ndarray:
    """(S, K) share of the squares of scores (S, R) that each unit shape (K, R) explains."""
    return (scores @ shapes.T) ** 2 / np.maximum((scores**2).sum(axis=1, keepdims=True), 1e-300)


def _chance(shapes: np.ndarray, share: float) -> float:
    draws = min(_DRAWS, _MOST_NUMBERS // shapes.shape[1])
    drawn = np.random.default_rng(_SEED).standard_normal((draws, shapes.shape[1]))
    return float((1 + (_shares(shapes, drawn).max(axis=1) >= share).sum()) / (1 + draws))


def _plain_chance(deviations: float, patterns: int) -> float:
    """Bound by the residuals' variance alone."""
    return min(1.0, 2.0 * patterns * float(norm.sf(abs(deviations))))


CHANCE = 4e-4
"""Of a false alarm, of each of the four questions asked: less than 1 in 500 together."""
FOCUS_MATTERS = 1e-3
"""Least change of the focal length, relative, that is worth a word; of the centre, over the focal length in px."""
_GRAVE_CHANGE = 3e-3

_REMEDY = (
    "switch autofocus and zoom off, fix them with tape, and take the pictures again; or keep those on one side only"
)


def focus_changed(scores: SetScores) -> Diagnosis | None:
    """Whether the focal length differs before and after some picture, or creeps from the first to the last.

    Seen from perspective, that is from tilted views alone: a face-on board that looks larger may as well be nearer.
    """
    count, own = len(scores.names), scores.of(SetScores.FOCAL)
    step = find_change(own, steps(count), scores.variance_px2)
    crept = find_change(own, drift(count), scores.variance_px2)
    clear = [one for one in (step, crept) if one is not None and one.chance < CHANCE and abs(one.size) > FOCUS_MATTERS]
    if not clear:
        return None
    if step in clear and (crept not in clear or _explains(step, crept)):
        assert step is not None
        last, first = _sides(step, scores.names)
        words = f"the focal length changes between {last} and {first} by {_percent(step)}"
        return Diagnosis("focus_changed", words, _REMEDY, abs(step.size) > _GRAVE_CHANGE)
    assert crept is not None
    words = f"the focal length creeps by {_percent(crept)} from {scores.names[0]} to {scores.names[-1]}"
    return Diagnosis("focus_crept", words, _REMEDY, abs(crept.size) > _GRAVE_CHANGE)


def centre_moved(scores: SetScores) -> Diagnosis | None:
    """Whether the picture's centre differs before and after some picture: an image stabiliser, or a cropped mode."""
    found = []
    for parameter, axis in ((SetScores.CENTRE_X, 0), (SetScores.CENTRE_Y, 1)):
        change = find_change(scores.of(parameter), steps(len(scores.names)), scores.variance_px2)
        if change is not None and change.chance < CHANCE and abs(change.size) > FOCUS_MATTERS * scores.focal_px[axis]:
            found.append(
                (
                    change,
                    ("to the right" if change.size > 0 else "to the left", "down" if change.size > 0 else "up")[axis],
                )
            )
    if not found:
        return None
    change, direction = min(found, key=lambda one: one[0].chance)
    last, first = _sides(change, scores.names)
    words = (
        f"the lens' centre moves between {last} and {first} by {abs(change.size):.1f} ± {change.std:.1f} px {direction}"
    )
    remedy = (
        "switch off image stabilisation and cropping, and check that the lens sits tight; then take the pictures again"
    )
    return Diagnosis("centre_moved", words, remedy, grave=True)


def _explains(step: Change | None, crept: Change | None) -> bool:
    """Whether the step is the clearer of the two."""
    return step is not None and crept is not None and abs(step.size / step.std) >= abs(crept.size / crept.std)


def _sides(step: Change, names: tuple[str, ...]) -> tuple[str, str]:
    first = int(np.flatnonzero(steps(len(names))[step.index])[0])
    return names[first - 1], names[first]


def _percent(change: Change) -> str:
    return f"{100 * change.size:+.2f} ± {100 * change.std:.2f} %"


def view_set_diagnoses(views: Sequence[BoardView], solution: LensSolution, spec: BoardSpec) -> list[Diagnosis]:
    """Faults of the set, the grave ones first: focus, the lens' centre, the print, what is missing.

    views : in the order taken; those that the solution does not use are passed over.
    """
    names = {view.name for view in solution.views}
    used = [view for view in views if view.name in names]
    if not used:
        return []
    scores = set_scores(used, solution, spec)
    judged = [] if scores is None else [focus_changed(scores), centre_moved(scores)]
    if scores is not None and not any(judged):
        # a lens that did not stay the same shifts the print's aspect by several of its standard deviations
        judged.append(print_stretched(scores))
    found = [one for one in (*judged, poorly_covered(used)) if one is not None]
    return sorted([*found, *little_variety(used, solution, spec)], key=lambda one: not one.grave)
