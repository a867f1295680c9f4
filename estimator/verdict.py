"""What the numbers of a frame support: its status."""

from __future__ import annotations

import numpy as np

from .quantities import Numbers
from .solve.descend import NEAREST

FEWEST_POINTS = 5
CONTACT_EVIDENCE = 14.0
"""Least evidence for a contact. Noise exceeds it about four times in a million: χ² with 3 degrees of freedom > 28."""
LOW_SIGNAL, LOW_SIGNAL_OWN = 0.05, 0.1
"""Distances less certain than this fraction of the length, or of themselves, are not given out, nor deflections less
certain than that fraction of the length: beyond it first order no longer describes what is known."""
EDGE_ON_RAD, EDGE_ON_BLIND_RAD = 0.05, 0.15
"""Within this angle of the camera's centre the deformation plane counts as seen edge-on: with a reading only where the
distance is uncertain as well, without one always."""
WRONG_SHAPE = 3.0
"""Median misfit, in standard deviations, beyond which the shape is not that of one contact."""
RIVAL = 4.5
"""Two contacts whose costs differ by less explain a frame about equally well: three standard deviations."""
SECOND_CONTACT, HARM = 25.0, 1.0
"""Cost that a second force must take away, and deviations by which it must move the distance, to be held for real.
Over the grid of places, noise exceeds the first less than once in 10⁵ frames, also with heavy tails."""
MISLED = 10.0
"""A rung so many standard deviations off is not believed: to there its bias is known to a factor of two, and is in the
deviations."""
STEEP, STEEP_BLIND = 3.5, 2.5
"""Friction angles beyond so many of the deviations that were thought possible are not believed, with and without a
reading."""
STRANGE_RIG = 2e-5
"""The rig's steps, in deviations, follow χ²: a sum of squares this improbable says that the frame asks for another."""
DISAGREEMENT, CONTRADICTION = 4.0, 6.0
"""Misfit of a reading, in standard deviations, that is mentioned, and that which leaves nothing to be trusted."""

NO_ANTENNA, NO_CONTACT, UNOBSERVABLE, LOW = "no_antenna", "no_contact", "unobservable", "low_signal"
FAILED, TIP, OK = "failed", "tip_contact", "ok"


def statuses(numbers: Numbers) -> np.ndarray:
    """(B,) the first that applies, from what makes all else meaningless to what can be trusted."""
    with np.errstate(invalid="ignore"):
        uncertain = ~(numbers.std[:, 0] < np.minimum(LOW_SIGNAL, LOW_SIGNAL_OWN * numbers.unknowns[:, 0]))
        edge_on = numbers.edge_on_rad < EDGE_ON_RAD
        held = np.isfinite(numbers.std[:, 0])
        order = [
            (numbers.points < FEWEST_POINTS, NO_ANTENNA),
            (~numbers.finite, FAILED),
            (~(numbers.evidence >= CONTACT_EVIDENCE), NO_CONTACT),
            (edge_on & (uncertain | ~numbers.converged), UNOBSERVABLE),
            (blindly(numbers) & (numbers.edge_on_rad < EDGE_ON_BLIND_RAD), UNOBSERVABLE),
            (unexplained(numbers) | misled(numbers), FAILED),
            (uncertain & held, LOW),
            (uncertain | loose(numbers) | rivalled(numbers), UNOBSERVABLE),
            (contradiction(numbers) > CONTRADICTION, FAILED),
            (numbers.at_tip, TIP),
        ]
    return np.select([which for which, _ in order], [status for _, status in order], OK)


def rivalled(numbers: Numbers) -> np.ndarray:
    """(B,) whether another contact, apart by more than the uncertainty, explains the frame about equally well."""
    apart = np.abs(numbers.rival_unknowns - numbers.unknowns)[:, :3] > 3.0 * numbers.std[:, :3]
    return apart.any(axis=1) & (numbers.rival < RIVAL * numbers.scatter**2)


def unexplained(numbers: Numbers) -> np.ndarray:
    """(B,) whether no one contact, as contacts are thought possible, explains the frame."""
    shapeless = ~numbers.converged | (numbers.scatter > WRONG_SHAPE)
    # without a reading a steep bend along the line of sight fits almost anything, if not quite
    shapeless |= blindly(numbers) & ((numbers.scatter > 1.0) | (np.abs(numbers.unknowns[:, 3]) > STEEP_BLIND))
    return shapeless | at_clamp(numbers) | leaning(numbers) | doubled(numbers)


def blindly(numbers: Numbers) -> np.ndarray:
    """(B,) whether vision is alone, and cannot tell the contact from its mirror image but by perspective."""
    return numbers.blind & ~numbers.felt.any(axis=1)


def contradicted(numbers: Numbers) -> np.ndarray:
    """(B,) whether a frame that nothing explains is explained once its readings are left out."""
    return unexplained(numbers) & numbers.explained_alone


def at_clamp(numbers: Numbers) -> np.ndarray:
    """(B,) whether the contact lies no further from the clamp than distances are looked for."""
    return numbers.unknowns[:, 0] <= NEAREST * (1.0 + 1e-6)


def leaning(numbers: Numbers) -> np.ndarray:
    """(B,) whether the force would have to lean further from the antenna's normal than was thought possible."""
    return np.abs(numbers.unknowns[:, 3]) > STEEP


def doubled(numbers: Numbers) -> np.ndarray:
    """(B,) whether a second force explains so much more that the distance cannot be believed."""
    return (numbers.second > SECOND_CONTACT) & (numbers.second_harm > HARM)


def loose(numbers: Numbers) -> np.ndarray:
    """(B,) whether the force, and with it the contact point, is not held in some direction across the antenna.

    Without a reading also where it is not known to half its size: then its direction is not known either, and first
    order says nothing of the rest.
    """
    std, force = np.max(numbers.std[:, 1:3], axis=1), np.hypot(numbers.unknowns[:, 1], numbers.unknowns[:, 2])
    swaying = ~(0.01 * numbers.unknowns[:, 0] ** 3 * std < LOW_SIGNAL)
    return swaying | (blindly(numbers) & ~(std < 0.5 * force))


def misled(numbers: Numbers) -> np.ndarray:
    """(B,) whether the rung, a demanded one, is too low by more than its deviations can make good."""
    bias = numbers.bias[np.arange(len(numbers)), numbers.rung]
    return np.isfinite(bias) & (bias > MISLED)


def contradiction(numbers: Numbers) -> np.ndarray:
    """(B,) largest misfit of a reading in the deviations that it should have."""
    return np.max(np.abs(numbers.residual) / numbers.residual_std, axis=1)
