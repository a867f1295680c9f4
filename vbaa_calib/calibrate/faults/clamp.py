"""A clamp that slips, or an antenna that is bent, between one still and the next; and a clamp that is soft."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vbaa_calib.antenna.shape import PARAMETERS
from vbaa_calib.calibrate.antenna.bundle_adjustment import JointSolution
from vbaa_calib.calibrate.antenna.problem import ANTENNA
from vbaa_calib.core.errors import Diagnosis
from vbaa_calib.session import Load, Still

from .free_antenna import fits, scatter_with_step
from .jacobian_rows import Further, StillRows, further

USUAL = 3.0
"""Standard deviations of what a careful builder's wire has, beyond which a bow is said."""


def bow_diagnosis(joint: JointSolution) -> Diagnosis | None:
    """A bow beyond the ordinary."""
    length = joint.problem.length_m
    first = ANTENNA.start + PARAMETERS.index("bow_about_y_per_m")
    bow = joint.parameters[first : first + 2]
    std = np.sqrt(np.diag(joint.covariance)[first : first + 2])
    known = joint.problem.prior.std[first - 6 : first - 4]
    beyond = (np.abs(bow) > USUAL * known) & (np.abs(bow) > USUAL * std)
    if not beyond.any():
        return None
    size = float(np.linalg.norm(bow))
    return Diagnosis(
        "antenna_bent",
        f"the free antenna is bowed by {bow[0]:.2f} ± {std[0]:.2f} per m about y and {bow[1]:.2f} ± {std[1]:.2f} about "
        f"z: {0.5e3 * size * length**2:.0f} mm at the tip of {1e3 * length:.0f} mm",
        "straighten or replace the wire, or set it with its bow in plane C, and check gravity_world",
    )


SURE = 50.0
"""χ² beyond which a change between stills is no chance, however many were asked."""
LEAST = {"turn": 4e-3, "place": 3e-4, "bow": 0.04}
"""Least changes worth a word, rad, m and per m: a millimetre at the tip of 240 mm. Half a millimetre on the ruler and
half a per cent on the balance look like a quarter of that."""
MOST = {"turn": 0.15, "place": 5e-3, "bow": 1.5}
"""Greatest changes that are taken for what they look like: beyond, rows are wrong, or gravity."""
PLAUSIBLE = {"turn": 0.05, "place": 1e-3, "bow": 0.3}
"""Standard deviations of what may have happened."""
CLEARER = 1.5
"""χ² of a slip over that of a bend, or the other way round, for one to be named instead of the other."""
CLEAR_STD = 4.0
GIVE_SURE = 3.0
KINDS = {
    "turn": ("clamp_about_y_rad", "clamp_about_z_rad"),
    "place": ("clamp_y_m", "clamp_z_m"),
    "bow": ("bow_about_y_per_m", "bow_about_z_per_m"),
}


@dataclass(frozen=True, eq=False)
class Step:
    """A change that lasts from one still on.

    Attributes
    ----------
    kind : what changed, of `KINDS`. first : index of the first still after it. found : by how much.
    after : indices of the stills after it, in time.
    """

    kind: str
    first: int
    found: Further
    after: tuple[int, ...]

    @property
    def size(self) -> float:
        """Of the change, in its own unit."""
        return float(np.linalg.norm(self.found.values))


def steps(rows: StillRows) -> list[Step]:
    """For each kind the change, at the place in time, that explains most; stills without times are taken in order."""
    stills = [one.still for one in rows.joint.noted]
    whole = _in_time(stills)
    order = [index for index in whole if rows.moments[index] >= 0]
    best = []
    for kind, names in KINDS.items():
        columns = [ANTENNA.start + PARAMETERS.index(name) for name in names]
        found = []
        for split in range(1, len(order)):
            own = np.column_stack([rows.own(one, order[split:]) for one in columns])
            change = further(rows, own, PLAUSIBLE[kind])
            if change is not None:
                found.append(Step(kind, order[split], change, tuple(whole[whole.index(order[split]) :])))
        if found:
            best.append(max(found, key=lambda step: step.found.statistic))
    return best


def _in_time(stills: Sequence[Still]) -> list[int]:
    """Indices in the order in which the stills were taken, as far as that was noted."""
    times = [still.time_s for still in stills]
    if any(time is None for time in times):
        return list(range(len(stills)))
    return [int(index) for index in np.argsort(np.array(times, float), kind="stable")]


def step_diagnosis(joint: JointSolution, rows: StillRows, own: float) -> Diagnosis | None:
    """A slip of the clamp or a bend of the antenna between two stills, whichever explains the pictures better.

    own : scatter of the points that no model explains, see `own_scatter`. None where neither explains it all.
    """
    found = sorted(steps(rows), key=lambda step: step.found.statistic, reverse=True)
    if not found or found[0].found.statistic < SURE:
        return None
    best = found[0]
    if not LEAST[best.kind] <= best.size <= MOST[best.kind]:
        return None
    if fits(joint.noise_scale, own) and not (np.abs(best.found.values) > CLEAR_STD * best.found.std).any():
        # the stills fit as they are: only a change that is clear in itself is one
        return None
    which = [ANTENNA.start + PARAMETERS.index(name) for name in KINDS[best.kind]]
    if not fits(scatter_with_step(joint, which, best.after, PLAUSIBLE[best.kind]), own):
        return None
    rivals = [
        step for step in found[1:] if step.kind != best.kind and step.found.statistic * CLEARER > best.found.statistic
    ]
    still = joint.noted[best.first].still
    since = f"from {_named(still)} on"
    if best.kind == "bow" and not rivals:
        return Diagnosis(
            "antenna_bent_between",
            f"the antenna is bent by {_bow(best)} more {since} than before",
            "a load has bent it for good: straighten or replace the wire, then take no-load frames and loads anew, "
            "with lighter loads",
            grave=True,
        )
    slip = next((step for step in found if step.kind != "bow"), best)
    other = ", or the antenna was bent" if any(step.kind == "bow" for step in (*rivals, best)) else ""
    return Diagnosis(
        "clamp_slipped_or_antenna_bent" if other else "clamp_slipped",
        f"the clamp {_slip(slip)} {since}, which the loads do not explain{other}",
        "tighten the clamp, then take no-load frames and loads anew",
        grave=True,
    )


def soft_clamp(rows: StillRows) -> Diagnosis | None:
    """A clamp that turns elastically, by more than one that is screwed tight does."""
    index = ANTENNA.start + PARAMETERS.index("clamp_give_m")
    parameters, covariance = rows.resolved()
    value, std = float(parameters[index]), float(np.sqrt(covariance[index, index]))
    usual = float(rows.joint.problem.prior.std[index - 6])
    if value < GIVE_SURE * max(usual, std):
        return None
    return Diagnosis(
        "clamp_soft",
        f"the clamp turns with the load as {1e3 * value:.2f} ± {1e3 * std:.2f} mm more of the antenna would, a tight "
        f"one by {1e3 * usual:.1f} mm at most",
        "clamp it over a longer piece, between metal, and check where the distances are measured from",
    )


def _named(still: Still) -> str:
    kind = "load" if isinstance(still, Load) else "no-load frame"
    return f"{kind} {still.image.name}" if still.image else f"a {kind} at tilt {np.rad2deg(still.tilt_rad):.0f}°"


def _slip(step: Step) -> str:
    y, z = step.found.values
    std = step.found.std
    if step.kind == "place":
        return f"has moved by ({1e3 * y:.2f} ± {1e3 * std[0]:.2f}, {1e3 * z:.2f} ± {1e3 * std[1]:.2f}) mm in y and z"
    return (
        f"has turned by {np.rad2deg(y):.2f} ± {np.rad2deg(std[0]):.2f}° about y and {np.rad2deg(z):.2f} ± "
        f"{np.rad2deg(std[1]):.2f}° about z"
    )


def _bow(step: Step) -> str:
    (y, z), std = step.found.values, step.found.std
    return f"{y:.2f} ± {std[0]:.2f} per m about y and {z:.2f} ± {std[1]:.2f} about z"
