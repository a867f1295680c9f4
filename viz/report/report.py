"""report.html: a recording's contacts on one page that stands alone, to be read without any other document."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path

import numpy as np

from estimator.table.contacts import ContactTable
from vbaa_calib.core.files import write_text
from vbaa_calib.rig import Rig
from viz.scene.markup import prose, section

from .cone import cone, yields
from .map import Chart, maps, mesh_arrays, scatter_across
from .object_section import Sensed
from .pictures import Picture, figure
from .plots import plots
from .style import SCRIPT, STYLE
from .tables import SummaryRow, contacts_table, events_table, origin_table, summary_table
from .time import MOST_DOTS
from .truth import Truth
from .words import facts_list, frame_facts, glossary, headline

_FOOT = "± is one standard deviation; bands, bars and ellipses are two."


@dataclass(frozen=True, eq=False)
class Report:
    """Everything that stands in a report.

    Attributes
    ----------
    title : of the page. table : the contacts, at least one row.
    sensed : what was felt. rig : adds the moment residual in the sensor's deviations.
    truth : drawn beside the estimates. summary : errors against truth, or other numbers with a goal each.
    pictures : the scene, the recording.
    origin : names and HTML of what the page was made from.
    """

    title: str
    table: ContactTable
    sensed: Sensed
    rig: Rig | None = None
    truth: Truth | None = None
    summary: Sequence[SummaryRow] = ()
    pictures: Sequence[Picture] = ()
    origin: Sequence[tuple[str, str]] = field(default=())


def write_report(path: Path, report: Report, *, force: bool = False) -> None:
    """Write the page, whole or not at all. Raises InputError when the file exists and `force` is off."""
    write_text(Path(path), page(report), force)


def page(report: Report) -> str:
    """The whole report as HTML."""
    table = report.table
    track = report.sensed.track
    phase = None if track is None else [str(name) for name in track.phase]
    parts = [
        _header(report),
        section("Pictures", _SEEN, "".join(map(figure, report.pictures))) if report.pictures else "",
        section(
            "Over time", _time(len(table)), plots(table, report.sensed, report.rig, report.truth) + _events(report)
        ),
        section("Map of the contacts", _MAP, _map(report)) if table.located.any() else "",
        _forces(report) if table.located.any() else "",
        section("Error against truth", _TRUTH, summary_table(report.summary)) if report.summary else "",
        section("Every frame", _TABLE, contacts_table(table, phase)),
        section("What the words mean", "", glossary()),
        section("Where this comes from", "", origin_table(report.origin)) if report.origin else "",
    ]
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{escape(report.title)}</title>'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><style>{STYLE}</style></head>'
        f"<body><main>{''.join(parts)}<footer>{_FOOT}</footer></main><script>{SCRIPT}</script></body></html>\n"
    )


_SEEN = "What was touched, and what the camera saw."
_TIME = (
    "Each point is a frame, the band around it ± 2 standard deviations, calibration errors included. Upright dashed "
    "lines are events: contact found or lost, slip begun or ended."
)
_MAP = (
    "World frame, equal scales. The points lie on the antenna's centreline, one radius before the object. The ellipses "
    "hold a contact with 86 % probability in each view; calibration errors move all of them together."
)
_TRUTH = "The recording is simulated, so the truth is known. Root mean square over the located frames."
_TABLE = "Every number with its standard deviation; contacts.csv holds all of them, and the covariances, in SI units."
_CONE = (
    "Left: the force of every contact in the antenna's yz plane. Right: its part along the object's normal, which "
    "comes from the touched shape, and across it and the antenna. Where the antenna slides straight across "
    "itself, the force lies on the cone's rim; where it slides along itself, too, or sticks, it lies inside."
)
_ACROSS = "The force of every contact in the antenna's yz plane."
_YIELD = "How far the contacts lie inside the object's unpressed surface: the line's slope is the compliance."


def _header(report: Report) -> str:
    words, colour = headline(report.table)
    facts = [*frame_facts(report.table, report.rig), *report.sensed.facts]
    return (
        f'<header style="--level:{colour}"><h1>{escape(report.title)}</h1>'
        f'<div class="verdict">{escape(words)}</div>{facts_list(facts)}</header>'
    )


def _time(frames: int) -> str:
    crowd = (
        " Dark: the middle of the frames that share a column of pixels; pale: from the least to the largest of them."
    )
    return _TIME + (crowd if frames > MOST_DOTS else "")


def _events(report: Report) -> str:
    track = report.sensed.track
    return "" if track is None or not track.events else f"<h3>Events</h3>{events_table(track.events)}"


def _map(report: Report) -> str:
    table, here = report.table, report.table.located
    points, lines, triangles = mesh_arrays(None if report.sensed.felt is None else report.sensed.felt.surface)
    true = np.zeros((0, 3)) if report.truth is None else report.truth.point_world_m
    return maps(
        Chart(
            table.point_world_m[here],
            table.covariance_world_m2[here],
            table.time_s[here],
            points,
            lines,
            triangles,
            true[np.isfinite(true).all(axis=1)],
        )
    )


def _forces(report: Report) -> str:
    table, here, felt = report.table, report.table.located, report.sensed
    force = 1e3 * np.stack([table.force_y_N, table.force_z_N], axis=1)[here]
    std = 1e3 * np.stack([table.force_y_std_N, table.force_z_std_N], axis=1)[here]
    drawn = [scatter_across(force, std, table.time_s[here])]
    if felt.cone is not None:
        drawn.append(cone(felt.cone))
    body = _pair(drawn) + _told(felt, "Friction")
    out = section("Force and friction", _ACROSS if felt.cone is None else _CONE, body)
    if felt.yields is not None:
        body = _pair([yields(felt.yields), _told(felt, "Stiffness")])
        out += section("How the object gives way", _YIELD, body)
    return out


def _pair(drawings: Sequence[str]) -> str:
    return f'<div class="pair">{"".join(f"<div>{drawing}</div>" for drawing in drawings)}</div>'


def _told(felt: Sensed, label: str) -> str:
    return "".join(f"<p><b>{label}.</b> {prose(fact.words)}</p>" for fact in felt.facts if fact.label == label)
