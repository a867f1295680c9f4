"""report.html: a recording's contacts on one page that stands alone, to be read without any other document."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from estimator.contact.overlay import STATUS_COLOURS
from estimator.table.contacts import ContactTable
from vbaa_calib.core.files import write_text
from vbaa_calib.rig import Rig
from viz.figures.contacts import OBJECT, VIEWS, MapData, contact_map, forces_across, friction_cone, indentation
from viz.figures.drawing import RAMP, svg
from viz.figures.time import MOST_DOTS, TimeAxis, curve, lanes, signals
from viz.pages.page import render
from viz.pages.tables import Table, fixed, with_std
from viz.scene.readable import thinned
from viz.scene.truth import TrueContacts

from .findings import ObjectFindings
from .pictures import Picture
from .words import MODEL_COLOURS, PHASE_COLOURS, dotted, frame_facts, glossary, headline

if TYPE_CHECKING:
    from estimator.object.track import Event

ALONG, ACROSS, RESIDUAL, RINGING = "#0072b2", "#c2410c", "#334155", "#7c3aed"
MOST_ROWS = 500
SummaryRow = tuple[str, float, str, float | None]
"""Name, value, unit, and the goal that the value must not exceed, if there is one."""


@dataclass(frozen=True, eq=False)
class Report:
    """Everything that stands in a report.

    Attributes
    ----------
    title : of the page. table : the contacts, at least one row.
    findings : what the contacts say together. rig : adds the moment residual in the sensor's deviations.
    truth : drawn beside the estimates. summary : errors against truth, or other numbers with a goal each.
    pictures : the scene, the recording.
    origin : names and text or HTML of what the page was made from.
    """

    title: str
    table: ContactTable
    findings: ObjectFindings
    rig: Rig | None = None
    truth: TrueContacts | None = None
    summary: Sequence[SummaryRow] = ()
    pictures: Sequence[Picture] = ()
    origin: Sequence[tuple[str, str]] = field(default=())


def write_report(path: Path, report: Report, *, force: bool = False) -> None:
    """Write the page, whole or not at all. Raises InputError when the file exists and `force` is off."""
    write_text(Path(path), page(report), force)


def page(report: Report) -> str:
    """The whole report as HTML."""
    table, findings = report.table, report.findings
    words, colour = headline(table)
    phase = None if findings.track is None else [str(name) for name in findings.track.phase]
    return render(
        "recording.html.j2",
        title=report.title,
        headline=words,
        colour=colour,
        facts=[*frame_facts(table, report.rig), *findings.facts],
        pictures=report.pictures,
        times=_over_time(report),
        crowded=len(table) > MOST_DOTS,
        events=events_table(() if findings.track is None else findings.track.events),
        **_contacts(report),
        indentation=None if findings.indentation is None else svg(indentation(findings.indentation)),
        summary=summary_table(report.summary),
        contacts=contacts_table(table, phase),
        glossary=glossary(),
        origin=Table((), report.origin),
    )


def _over_time(report: Report) -> list[Markup]:
    """The figures over time, one under the other."""
    table, rig, track = report.table, report.rig, report.findings.track
    events = () if track is None else tuple((event.time_s, event.words) for event in track.events)
    clock = TimeAxis.of(table.time_s, events)
    drawn = [lanes(clock, "status", table.status.tolist(), STATUS_COLOURS)]
    if track is not None:
        drawn.append(lanes(clock, "phase", [str(name) for name in track.phase], PHASE_COLOURS))
        if track.ringing.any():
            ringing = np.where(track.ringing, "ringing", "").tolist()
            drawn.append(lanes(clock, "ringing of the antenna", ringing, {"ringing": RINGING}))
    drawn += [curve(clock, *quantity) for quantity in _quantities(report)]
    if track is not None and np.isfinite(track.slip_std_m_s).any():
        slip = (
            ("along the antenna", ALONG, 1e3 * track.longitudinal_m_s),
            ("across it", ACROSS, 1e3 * track.lateral_m_s),
        )
        title = "slip of the antenna on the object, mm/s"
        drawn.append(signals(clock, title, slip, 1e3 * track.slip_std_m_s, "the noise, at most"))
    title, residual = "moment: read less predicted by the fit", table.moment_residual_Nm
    if rig is None:
        nothing = np.full(len(table), np.nan)
        drawn.append(curve(clock, f"{title}, µN·m", 1e6 * residual, nothing, meaning="residual"))
    else:
        title += ", in std of the sensor's noise"
        scaled = [("residual", RESIDUAL, residual / rig.moment_sensor.std_Nm)]
        drawn.append(signals(clock, title, scaled, np.ones(len(table)), "the sensor"))
    model = np.where(table.located, table.model, "").tolist()
    drawn.append(lanes(clock, "model chosen for a located contact", model, MODEL_COLOURS, last=True))
    return [clock.svg(axes) for axes in drawn]


def _quantities(report: Report) -> list[tuple[str, np.ndarray, np.ndarray, np.ndarray | None, str]]:
    """Title with its unit, value, deviation, truth and meaning of what was estimated of each frame."""
    table, truth, located = report.table, report.truth, report.table.located
    rows = [
        ("contact distance l along the antenna, mm", "distance"),
        ("force f_y, mN", "force_y"),
        ("force f_z, mN", "force_z"),
    ]
    found = []
    for title, name in rows:
        unit = "m" if name == "distance" else "N"
        value, std = (np.where(located, 1e3 * getattr(table, f"{name}{end}_{unit}"), np.nan) for end in ("", "_std"))
        true = None if truth is None else 1e3 * getattr(truth, f"{name}_{unit}")
        found.append((title, value, std, true, "estimate ± 2 std"))
    y, z = table.force_y_N, table.force_z_N
    size = np.where(located, np.hypot(y, z), np.nan)
    # whatever the correlation of the two components is, it cannot be more than that
    most = (np.abs(y) * table.force_y_std_N + np.abs(z) * table.force_z_std_N) / np.where(size > 0, size, np.nan)
    true = None if truth is None else 1e3 * np.hypot(truth.force_y_N, truth.force_z_N)
    found.append(("force across the antenna, |f|, mN", 1e3 * size, 1e3 * most, true, "estimate ± 2 std at most"))
    return found


def _contacts(report: Report) -> dict[str, Any]:
    """Map, forces and friction cone; nothing without a located contact."""
    table, findings, here = report.table, report.findings, report.table.located
    if not here.any():
        return {"maps": []}
    surface = None if findings.estimate is None else findings.estimate.surface
    true = np.zeros((0, 3)) if report.truth is None else report.truth.point_world_m
    data = MapData(
        points_m=table.point_world_m[here],
        covariance_m2=table.covariance_world_m2[here],
        time_s=table.time_s[here],
        surface_m=np.zeros((0, 3)) if surface is None else surface.points_m,
        lines=np.zeros((0, 2), int) if surface is None else surface.lines,
        triangles=np.zeros((0, 3), int) if surface is None else surface.triangles,
        truth_m=true[np.isfinite(true).all(axis=1)],
    )
    force = 1e3 * np.stack([table.force_y_N, table.force_z_N], axis=1)[here]
    std = 1e3 * np.stack([table.force_y_std_N, table.force_z_std_N], axis=1)[here]
    return {
        "maps": [svg(contact_map(data, view), f"contacts {view[0]}") for view in VIEWS],
        "ramp": RAMP,
        "lasted_s": float(np.ptp(data.time_s)),
        "enlargement": data.enlargement,
        "object_colour": OBJECT if len(data.lines) or len(data.triangles) else None,
        "true_points": len(data.truth_m),
        "across": svg(forces_across(force, std, data.time_s)),
        "cone": None if findings.cone is None else svg(friction_cone(findings.cone)),
    }


def summary_table(rows: Sequence[SummaryRow]) -> Table:
    """Values with the goals that they meet or miss."""
    cells = [
        (
            name,
            f"{value:.4g}",
            unit,
            "" if goal is None else f"≤ {goal:.4g}",
            "" if goal is None else Markup(_GOAL[value <= goal]),
        )
        for name, value, unit, goal in rows
    ]
    return Table(("quantity", "error", "unit", "goal", ""), cells, ("quantity", "unit"))


_GOAL = {True: '<span class="good">met</span>', False: '<span class="bad">missed</span>'}


def events_table(events: Sequence[Event]) -> Table:
    """Events in time; the first ones where there are very many."""
    rows = [
        (
            event.kind.replace("_", " "),
            Markup('<span class="long">{}</span>').format(event.words),
            with_std(float(event.time_s), float(event.time_std_s)) if np.isfinite(event.time_s) else "–",
            fixed(event.delay_s, 3) if np.isfinite(event.delay_s) else "–",
            event.frame,
        )
        for event in events[:MOST_ROWS]
    ]
    cut = "" if len(rows) == len(events) else f"The first {len(rows)} of {len(events)}."
    return Table(("event", "in words", "time, s", "decided after, s", "frame"), rows, ("event", "in words"), cut)


def contacts_table(table: ContactTable, phase: Sequence[str] | None) -> Table:
    """A row for every frame, evenly thinned where there are more than a page holds."""
    shown = thinned(np.arange(len(table)), MOST_ROWS)
    std_world = np.sqrt(np.clip(np.diagonal(table.covariance_world_m2, axis1=1, axis2=2), 0.0, None))
    quantities = [
        (table.distance_m, table.distance_std_m),
        (table.force_y_N, table.force_y_std_N),
        (table.force_z_N, table.force_z_std_N),
        *((table.point_world_m[:, axis], std_world[:, axis]) for axis in range(3)),
    ]
    rows = []
    for row in map(int, shown):
        status, residual = str(table.status[row]), float(table.moment_residual_Nm[row])
        numbers = [(float(value[row]), float(std[row])) for value, std in quantities]
        rows.append(
            (
                table.frame[row],
                f"{table.time_s[row]:.3f}",
                dotted(STATUS_COLOURS[status], status),
                table.model[row],
                *([] if phase is None else [phase[row]]),
                *(with_std(value, std, 1e3) if np.isfinite(value) else "" for value, std in numbers),
                fixed(1e6 * residual, 1) if np.isfinite(residual) else "",
                Markup('<small class="long">{}</small>').format(table.reason[row]),
            )
        )
    text = ("status", "model", *([] if phase is None else ["phase"]))
    numbers_head = ("l, mm", "f_y, mN", "f_z, mN", "X, mm", "Y, mm", "Z, mm", "residual, µN·m")
    cut = "" if len(shown) == len(table) else f"{len(shown)} of {len(table)} frames, evenly spread."
    return Table(("frame", "time, s", *text, *numbers_head, "reason"), rows, (*text, "reason"), cut)
