"""What the numbers of a frame support: its status."""

from __future__ import annotations

import numpy as np

from estimator.solver.convergence import NEAREST
from estimator.solver.ladder import SMALL_BIAS
from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.core.robust import chi_square_p

from .quantities import Numbers

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
            (_blindly(numbers) & (numbers.edge_on_rad < EDGE_ON_BLIND_RAD), UNOBSERVABLE),
            (unexplained(numbers) | _misled(numbers), FAILED),
            (uncertain & held, LOW),
            (uncertain | loose(numbers) | _rivalled(numbers), UNOBSERVABLE),
            (contradiction(numbers) > CONTRADICTION, FAILED),
            (numbers.at_tip, TIP),
        ]
    return np.select([which for which, _ in order], [status for _, status in order], OK)


def _rivalled(numbers: Numbers) -> np.ndarray:
    """(B,) whether another contact, apart by more than the uncertainty, explains the frame about equally well."""
    apart = np.abs(numbers.rival_unknowns - numbers.unknowns)[:, :3] > 3.0 * numbers.std[:, :3]
    return apart.any(axis=1) & (numbers.rival < RIVAL * numbers.scatter**2)


def unexplained(numbers: Numbers) -> np.ndarray:
    """(B,) whether no one contact, as contacts are thought possible, explains the frame."""
    shapeless = ~numbers.converged | (numbers.scatter > WRONG_SHAPE)
    # without a reading a steep bend along the line of sight fits almost anything, if not quite
    shapeless |= _blindly(numbers) & ((numbers.scatter > 1.0) | (np.abs(numbers.unknowns[:, 3]) > STEEP_BLIND))
    return shapeless | _at_clamp(numbers) | leaning(numbers) | _doubled(numbers)


def _blindly(numbers: Numbers) -> np.ndarray:
    """(B,) whether vision is alone, and cannot tell the contact from its mirror image but by perspective."""
    return numbers.blind & ~numbers.felt.any(axis=1)


def contradicted(numbers: Numbers) -> np.ndarray:
    """(B,) whether a frame that nothing explains is explained once its readings are left out."""
    return unexplained(numbers) & numbers.explained_alone


def _at_clamp(numbers: Numbers) -> np.ndarray:
    """(B,) whether the contact lies no further from the clamp than distances are looked for."""
    return numbers.unknowns[:, 0] <= NEAREST * (1.0 + 1e-6)


def leaning(numbers: Numbers) -> np.ndarray:
    """(B,) whether the force would have to lean further from the antenna's normal than was thought possible."""
    return np.abs(numbers.unknowns[:, 3]) > STEEP


def _doubled(numbers: Numbers) -> np.ndarray:
    """(B,) whether a second force explains so much more that the distance cannot be believed."""
    return (numbers.second > SECOND_CONTACT) & (numbers.second_harm > HARM)


def loose(numbers: Numbers) -> np.ndarray:
    """(B,) whether the force, and with it the contact point, is not held in some direction across the antenna.

    Without a reading also where it is not known to half its size: then its direction is not known either, and first
    order says nothing of the rest.
    """
    std, force = np.max(numbers.std[:, 1:3], axis=1), np.hypot(numbers.unknowns[:, 1], numbers.unknowns[:, 2])
    swaying = ~(0.01 * numbers.unknowns[:, 0] ** 3 * std < LOW_SIGNAL)
    return swaying | (_blindly(numbers) & ~(std < 0.5 * force))


def _misled(numbers: Numbers) -> np.ndarray:
    """(B,) whether the rung, a demanded one, is too low by more than its deviations can make good."""
    bias = numbers.bias[np.arange(len(numbers)), numbers.rung]
    return np.isfinite(bias) & (bias > MISLED)


def contradiction(numbers: Numbers) -> np.ndarray:
    """(B,) largest misfit of a reading in the deviations that it should have."""
    return np.max(np.abs(numbers.residual) / numbers.residual_std, axis=1)


def reason(numbers: Numbers, index: int, status: str, length_m: float, asked: str) -> str:
    """One frame's: why it is not ok, which model was taken and why, and what else was noticed."""
    if status == NO_ANTENNA:
        return f"only {numbers.points[index]} usable centreline points"
    if status == NO_CONTACT:
        return "the antenna has its free shape within its uncertainty"
    if status == FAILED:
        return _failed(numbers, index, length_m)
    if status == UNOBSERVABLE:
        return _unobservable(numbers, index, length_m)
    if status == LOW:
        return f"the contact distance is known only to {1e3 * numbers.std[index, 0] * length_m:.1f} mm"
    reasons = [_model(numbers, index, asked)]
    if status == TIP:
        reasons.insert(0, "the contact cannot be told from the tip: its distance is the antenna's length")
    return "; ".join(reasons + _noticed(numbers, index))


def _failed(numbers: Numbers, index: int, length_m: float) -> str:
    scatter, lean = numbers.scatter[index], abs(numbers.unknowns[index, 3])
    if not numbers.finite[index]:
        return "the fit left the domain of the model"
    if _misled(numbers)[index] and not unexplained(numbers)[index]:
        rung = int(numbers.rung[index])
        return (
            f"{RUNGS[rung]} is too low for this frame, some {numbers.bias[index, rung]:.0f} std off: take a higher rung"
        )
    two = ""
    if _doubled(numbers)[index]:
        places = sorted((numbers.unknowns[index, 0], numbers.second_place[index]))
        near, far = (1e3 * length_m * place for place in places)
        two = f"two contacts explain it better, near {near:.0f} and {far:.0f} mm, or the rig is off"
    if contradicted(numbers)[index]:
        why = "picture and moment contradict each other: without the reading all is well, so check the sensor"
        return f"{why}; or {two}" if two else why
    if two:
        return f"the shape is not that of one contact: {two}"
    if _at_clamp(numbers)[index]:
        return f"the contact lies nearer to the clamp than {1e3 * NEAREST * length_m:.0f} mm, where none is looked for"
    if leaning(numbers)[index]:
        return f"the force would have to lean {lean:.1f} times as far from the normal as friction is thought to tilt it"
    if scatter > WRONG_SHAPE or (scatter > 1.0 and _blindly(numbers)[index]):
        return f"the shape is not that of one contact: points lie {scatter:.1f} std off or more"
    if not numbers.converged[index]:
        return "the fit did not converge"
    return f"picture and moment contradict each other by {contradiction(numbers)[index]:.0f} std: check the sensor"


def _unobservable(numbers: Numbers, index: int, length_m: float) -> str:
    if numbers.edge_on_rad[index] < (EDGE_ON_BLIND_RAD if _blindly(numbers)[index] else EDGE_ON_RAD):
        return f"the camera sees the deformation plane edge-on, {np.degrees(numbers.edge_on_rad[index]):.1f}° off"
    if not np.isfinite(numbers.std[index, 0]):
        return "nothing in picture and moment holds the contact distance"
    if loose(numbers)[index]:
        return "nothing in picture and moment holds the force in one direction across the antenna"
    near, far = (1e3 * length_m * u[index, 0] for u in (numbers.unknowns, numbers.rival_unknowns))
    rolls = (np.degrees(np.arctan2(u[index, 2], u[index, 1])) for u in (numbers.unknowns, numbers.rival_unknowns))
    here, there = (f"at {d:.0f} mm pushed towards {r:.0f}°" for d, r in zip((near, far), rolls, strict=True))
    return f"two contacts explain it about equally well: {here}, and {there} from y"


def _model(numbers: Numbers, index: int, asked: str) -> str:
    """Which rung was taken, and why."""
    rung, bias = int(numbers.rung[index]), numbers.bias[index]
    name = RUNGS[rung]
    if asked != "auto":
        too_low = f", and is {bias[rung]:.1f} std off, which is in the deviations" if bias[rung] > SMALL_BIAS else ""
        return f"{name} was asked for{too_low}"
    low = [index for index in range(rung) if bias[index] > SMALL_BIAS]
    if not low:
        return f"{name}: its bias is {bias[rung]:.2f} std"
    return f"{name}: {RUNGS[low[-1]]} would be {bias[low[-1]]:.1f} std off"


def _noticed(numbers: Numbers, index: int) -> list[str]:
    noticed = []
    if numbers.scatter[index] > 1.0:
        noticed.append(f"the points scatter {numbers.scatter[index]:.1f} times more than they should")
    strange = float(numbers.strange[index])
    if chi_square_p(strange, max(int(numbers.rig_axes[index]), 1)) < STRANGE_RIG:
        noticed.append(f"the rig's parameters had to move by {np.sqrt(strange):.0f} std to fit: check the rig")
    if contradiction(numbers)[index] > DISAGREEMENT:
        noticed.append(f"picture and moment disagree by {contradiction(numbers)[index]:.0f} std")
    return noticed
