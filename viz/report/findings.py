"""What the contacts of a recording say together, for the report: events, object, friction, stiffness."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from estimator.table.contacts import ContactTable
from vbaa_calib.core.errors import InputError
from viz.figures.contacts import ConeData, IndentationData
from viz.scene.facts import Fact, friction_fact, sentence, stiffness_fact
from viz.scene.truth import TrueContacts

if TYPE_CHECKING:
    from estimator.object.estimate import ObjectEstimate
    from estimator.object.surface import Surface
    from estimator.object.track import Track
    from vbaa_calib.rig import Rig

MOST_TIMES = 8


@dataclass(frozen=True, eq=False)
class ObjectFindings:
    """What the contacts say together. What is None is undetermined; `facts` say why.

    Attributes
    ----------
    estimate : of the object. track : phases, slip and events of the table's frames, also without any contact.
    cone, indentation : data of the figures of friction and stiffness.
    facts : events, friction, stiffness and shape in words.
    """

    estimate: ObjectEstimate | None = None
    track: Track | None = None
    cone: ConeData | None = None
    indentation: IndentationData | None = None
    facts: tuple[Fact, ...] = ()


def object_findings(table: ContactTable, rig: Rig | None, truth: TrueContacts | None) -> ObjectFindings:
    """Estimate the object. Where that is impossible, the facts say why; events in time may still be known."""
    from estimator.object.estimate import estimate_object
    from estimator.object.track import follow

    try:
        return findings_of(estimate_object(table, rig), table, rig, truth)
    except InputError as error:
        why = Fact("The object", f"Nothing can be said of it: {str(error).rstrip('.')}.", "undetermined")
    try:
        track = follow(table, rig)
    except InputError:
        return ObjectFindings(facts=(why,))
    return ObjectFindings(track=track, facts=(_event_fact(track), why))


def findings_of(
    estimate: ObjectEstimate, table: ContactTable, rig: Rig | None, truth: TrueContacts | None
) -> ObjectFindings:
    """An object estimate in words, and as data of its figures."""
    friction, surface, compliance = estimate.friction, estimate.surface, estimate.surface.compliance
    row, normal = surface.touched_row, surface.touched_normal
    size, angle = np.linalg.norm(table.force_world_N[row], axis=1), friction.lateral_rad
    radius_m = 0.0 if rig is None else rig.antenna.diameter_m / 2
    variance = np.einsum("pi,pij,pj->p", normal, table.covariance_world_m2[row], normal)
    return ObjectFindings(
        estimate,
        estimate.track,
        ConeData(
            normal_N=size * np.cos(angle),
            tangential_N=size * np.sin(angle),
            tangential_std_N=size * friction.lateral_std_rad,
            used_as=friction.used_as,
            mu=friction.mu if friction.determined else np.nan,
            interval=(float(friction.interval[0]), float(friction.interval[1])),
            true_mu=np.nan if truth is None else truth.friction,
        ),
        IndentationData(
            force_N=(table.force_world_N[row] * normal).sum(axis=1),
            indentation_m=((surface.touched_m - table.point_world_m[row]) * normal).sum(axis=1) + radius_m,
            std_m=np.sqrt(np.clip(variance, 0.0, None)),
            compliance_m_N=compliance.compliance_m_N if compliance.determined else np.nan,
            compliance_std_m_N=compliance.std_m_N if compliance.determined else np.nan,
            true_compliance_m_N=np.nan if truth is None else truth.compliance_m_N,
        ),
        (_event_fact(estimate.track), friction_fact(friction), stiffness_fact(compliance), _shape_fact(surface)),
    )


def _counted(kind: str, count: int) -> str:
    """How often an event happened: "3 slips began"."""
    verb = {"slip_start": "began", "slip_end": "ended"}.get(kind)
    return f"{count} slip{'s' * (count != 1)} {verb}" if verb else f"{kind} {count} time{'s' * (count != 1)}"


def _event_fact(track: Track) -> Fact:
    """Times of contact, counts of other events, and what is undetermined."""
    names = {"first_contact": "contact", "loss": "contact lost"}
    notes = [sentence(note) for note in track.notes]
    if not track.events:
        return Fact("In time", " ".join(["No first contact, loss or slip was found.", *notes]), "undetermined")
    contacts = [event for event in track.events if event.kind in names]
    words = [f"{names[event.kind]} {_time(event.time_s, event.time_std_s)}" for event in contacts[:MOST_TIMES]]
    words += [f"{len(contacts) - MOST_TIMES} more"] if len(contacts) > MOST_TIMES else []
    others = Counter(event.kind for event in track.events if event.kind not in names)
    words += [_counted(kind, others[kind]) for kind in sorted(others, reverse=True)]
    return Fact("In time", " ".join([sentence("; ".join(words)), *notes]))


def _time(time_s: float, std_s: float) -> str:
    if not np.isfinite(time_s):
        return "at an unknown time"
    if not (np.isfinite(std_s) and std_s > 0):
        return f"at {time_s:.3f} s"
    digits = int(np.clip(1 - np.floor(np.log10(std_s)), 0, 6))
    return f"at {time_s:.{digits}f} ± {std_s:.{digits}f} s"


def _shape_fact(surface: Surface) -> Fact:
    """How much of the object is known, and how well."""
    patches = len(np.unique(surface.touched_patch))
    known = surface.std_m[np.isfinite(surface.std_m)]
    well = f", known to {1e3 * float(np.median(known)):.2f} mm (median standard deviation)" if len(known) else ""
    kind = "a surface" if len(surface.triangles) else "lines: too narrow for a surface"
    words = f"{len(surface.touched_m)} contacts on {patches} patch{'es' * (patches != 1)}, joined to {kind}{well}."
    return Fact("Shape", " ".join([words, *(sentence(note) for note in surface.notes)]))
