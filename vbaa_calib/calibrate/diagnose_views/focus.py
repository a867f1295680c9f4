"""A lens that did not stay the same: focus or zoom that moved midway, or crept, and a picture that was shifted."""

from __future__ import annotations

import numpy as np

from ...diagnosis import Diagnosis
from .change import Change, drift, find_change, steps
from .scores import SetScores

CHANCE = 4e-4
"""Of a false alarm, of each of the four questions asked: less than 1 in 500 together."""
MATTERS = 1e-3
"""Least change of the focal length, relative, that is worth a word; of the centre, over the focal length in px."""
_GRAVE = 3e-3

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
    clear = [one for one in (step, crept) if one is not None and one.chance < CHANCE and abs(one.size) > MATTERS]
    if not clear:
        return None
    if step in clear and (crept not in clear or _explains(step, crept)):
        assert step is not None
        last, first = _sides(step, scores.names)
        words = f"the focal length changes between {last} and {first} by {_percent(step)}"
        return Diagnosis("focus_changed", words, _REMEDY, abs(step.size) > _GRAVE)
    assert crept is not None
    words = f"the focal length creeps by {_percent(crept)} from {scores.names[0]} to {scores.names[-1]}"
    return Diagnosis("focus_crept", words, _REMEDY, abs(crept.size) > _GRAVE)


def centre_moved(scores: SetScores) -> Diagnosis | None:
    """Whether the picture's centre differs before and after some picture: an image stabiliser, or a cropped mode."""
    found = []
    for parameter, axis in ((SetScores.CENTRE_X, 0), (SetScores.CENTRE_Y, 1)):
        change = find_change(scores.of(parameter), steps(len(scores.names)), scores.variance_px2)
        if change is not None and change.chance < CHANCE and abs(change.size) > MATTERS * scores.focal_px[axis]:
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
