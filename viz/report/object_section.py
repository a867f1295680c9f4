"""What was felt, prepared for the report: phases and events, object, friction, stiffness, each with its words."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from estimator.table.contacts import ContactTable
from vbaa_calib.core.errors import InputError

from .cone import ConeData, YieldData
from .truth import Truth

if TYPE_CHECKING:
    from estimator.object.estimate import Felt
    from estimator.object.friction import Friction
    from estimator.object.surface import Compliance, Surface
    from estimator.object.track import Track
    from vbaa_calib.rig import Rig


TOLD_EVENTS = {"first_contact": "contact", "loss": "contact lost"}


@dataclass(frozen=True)
class Fact:
    """A line of the verdict. `kind` is "told", "open" for what the data cannot tell, or "look" for what is amiss."""

    label: str
    words: str
    kind: str = "told"


@dataclass(frozen=True, eq=False)
class Sensed:
    """What the contacts say together. What is None could not be said; `facts` say why.

    Attributes
    ----------
    felt : everything. track : phases, slip and events of the table's frames, known also where nothing was touched.
    cone, yields : what friction's and the stiffness' pictures show.
    facts : events, friction, stiffness and shape in words.
    """

    felt: Felt | None = None
    track: Track | None = None
    cone: ConeData | None = None
    yields: YieldData | None = None
    facts: tuple[Fact, ...] = field(default=())


def sensed(table: ContactTable, rig: Rig | None, truth: Truth | None) -> Sensed:
    """Feel the object. Where that cannot be done, the only fact is why; what happened when may still be known."""
    from estimator.object.estimate import feel

    try:
        felt = feel(table, rig)
    except InputError as error:
        track = _followed(table, rig)
        events = () if track is None else _event_facts(track)
        why = Fact("The object", f"Nothing can be said of it: {str(error).rstrip('.')}.", "open")
        return Sensed(track=track, facts=(*events, why))
    return described(felt, table, rig, truth)


def _followed(table: ContactTable, rig: Rig | None) -> Track | None:
    from estimator.object.track import follow

    try:
        return follow(table, rig)
    except InputError:
        return None


def described(felt: Felt, table: ContactTable, rig: Rig | None, truth: Truth | None) -> Sensed:
    """What was felt in words, and as what is drawn of it."""
    facts = (
        *_event_facts(felt.track),
        _friction_fact(felt.friction),
        _stiffness_fact(felt.surface.compliance),
        *_shape_facts(felt.surface),
    )
    radius_m = 0.0 if rig is None else rig.antenna.diameter_m / 2
    return Sensed(
        felt,
        felt.track,
        _cone_data(felt, table, np.nan if truth is None else truth.friction),
        _yield_data(felt.surface, table, radius_m, np.nan if truth is None else truth.compliance_m_N),
        facts,
    )


def _event_facts(track: Track, most: int = 8) -> list[Fact]:
    """When contact began and ended, `most` times at most, how often other things happened, and what was not told."""
    events, notes = track.events, [_sentence(note) for note in track.notes]
    if not events:
        return [Fact("In time", " ".join(["No first contact, loss or slip was found.", *notes]), "open")]
    named = [event for event in events if event.kind in TOLD_EVENTS]
    told = [f"{TOLD_EVENTS[event.kind]} {_when(event.time_s, event.time_std_s)}" for event in named[:most]]
    told += [f"{len(named) - most} more"] if len(named) > most else []
    others = Counter(event.kind.replace("_", " ") for event in events if event.kind not in TOLD_EVENTS)
    told += [f"{count} × {kind}" for kind, count in sorted(others.items())]
    return [Fact("In time", " ".join([_sentence("; ".join(told)), *notes]))]


def _when(time_s: float, std_s: float) -> str:
    if not np.isfinite(time_s):
        return "at a time that is not known"
    if not (np.isfinite(std_s) and std_s > 0):
        return f"at {time_s:.3f} s"
    digits = int(np.clip(1 - np.floor(np.log10(std_s)), 0, 6))
    return f"at {time_s:.{digits}f} ± {std_s:.{digits}f} s"


def _friction_fact(friction: Friction) -> Fact:
    """μ with its interval, or why it cannot be told."""
    if not friction.told:
        return Fact("Friction", _sentence(f"The data cannot tell: {friction.reason}"), "open")
    low, high = friction.interval
    alpha = np.degrees(friction.cone_half_angle_rad)
    return Fact(
        "Friction",
        f"μ = {friction.mu:.3f} ± {friction.std:.3f} (95 %: {low:.3f} to {high:.3f}), a friction cone of "
        f"α = {alpha:.1f}° to each side{_because(friction.reason)}.",
    )


def _stiffness_fact(compliance: Compliance) -> Fact:
    """The object's stiffness with its interval, or its bound, or why it cannot be told."""
    low, high = compliance.interval_N_m
    if not compliance.told:
        bound = np.isfinite(low) and low > 0
        words = compliance.reason if bound else f"The data cannot tell: {compliance.reason}"
        return Fact("Stiffness", _sentence(words), "open")
    most = f"to {high:.4g} N/m" if np.isfinite(high) else "upwards"
    words = f"{compliance.stiffness_N_m:.4g} N/m (95 %: {low:.4g} {most})."
    return Fact("Stiffness", words)


def _shape_facts(surface: Surface) -> list[Fact]:
    """How much of the object is known, and how well."""
    patches = len(np.unique(surface.touched_patch))
    known = surface.std_m[np.isfinite(surface.std_m)]
    well = f", known to {1e3 * float(np.median(known)):.2f} mm (median standard deviation)" if len(known) else ""
    kind = "a surface" if len(surface.triangles) else "curves, no surface: the contacts span no area"
    words = f"{len(surface.touched_m)} contacts on {patches} patch{'es' * (patches != 1)}, joined to {kind}{well}."
    return [Fact("Shape", " ".join([words, *(_sentence(note) for note in surface.notes)]))]


def _because(reason: str) -> str:
    return f"; {reason.rstrip('.')}" if reason else ""


def _sentence(note: str) -> str:
    return note[:1].upper() + note[1:].rstrip(".") + "."


def _cone_data(felt: Felt, table: ContactTable, true_mu: float) -> ConeData:
    """Forces of the touches along and across the object's normal."""
    friction, surface = felt.friction, felt.surface
    size = np.linalg.norm(table.force_world_N[surface.touched_row], axis=1)
    angle, std = friction.lateral_rad, friction.lateral_std_rad
    normal = size * np.cos(angle)
    return ConeData(
        normal,
        size * np.sin(angle),
        size * std,
        friction.used_as,
        friction.mu if friction.told else np.nan,
        (float(friction.interval[0]), float(friction.interval[1])),
        true_mu,
    )


def _yield_data(
    surface: Surface, table: ContactTable, antenna_radius_m: float, true_compliance_m_N: float
) -> YieldData:
    """How far each contact lies inside the unpressed surface, over the force along its normal."""
    row, normal = surface.touched_row, surface.touched_normal
    inside = ((surface.touched_m - table.point_world_m[row]) * normal).sum(axis=1) + antenna_radius_m
    force = (table.force_world_N[row] * normal).sum(axis=1)
    variance = np.einsum("pi,pij,pj->p", normal, table.covariance_world_m2[row], normal)
    compliance = surface.compliance
    told = compliance.told
    return YieldData(
        force,
        inside,
        np.sqrt(np.clip(variance, 0.0, None)),
        compliance.compliance_m_N if told else np.nan,
        compliance.std_m_N if told else np.nan,
        true_compliance_m_N,
    )
