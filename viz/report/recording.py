"""report.html: a recording's contacts on one self-contained page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from estimator.contact.overlay import STATUS_COLOURS
from estimator.table.contacts import COLUMNS, LOCATED, STATUSES, ContactTable
from vbaa_calib.rig import Rig
from viz.figures.contacts import contact_maps, forces_across, friction_cone, indentation
from viz.figures.settings import STYLE
from viz.figures.time import TimeAxis, curve, lanes, signals, with_framewise
from viz.pages.page import Table, fixed, render, with_std
from viz.report.words import frame_facts, headline
from viz.scene.readable import thinned
from viz.scene.scene import Fact, lateral_force_N

if TYPE_CHECKING:
    from estimator.object.estimate import ObjectEstimate
    from estimator.object.track import Track
    from viz.scene.truth import TrueContacts

MOST_ROWS = 500
SummaryRow = tuple[str, float, str, float | None]
"""Name, value, unit, and the goal that the value must not exceed, if there is one."""
_MODELS = {
    "linear": ("#56b4e9", "small deflections, with weight, natural curvature and clamp"),
    "elastica": ("#0072b2", "large deflections; weight, curvature, clamp and torsion in one pass"),
    "rod": ("#7c3aed", "the static rod with weight, curvature, clamp and torsion, solved without approximations"),
    "paper": ("#e69f00", "straight, weightless, rigidly clamped; small deflections"),
}
_PHASES = {
    "free": ("#cbd5e1", "nothing touches the antenna"),
    "touching": ("#56b4e9", "in contact; whether it sticks or slides is undecided"),
    "sticking": ("#c2410c", "the antenna's material at the contact does not move against the object"),
    "sliding": ("#0072b2", "it moves along the object"),
    "rolling": ("#009e73", "the contact moves along the antenna, its material does not slip"),
    "unknown": ("#64748b", "undetermined by the data"),
}
SYMBOLS = {
    "distance_m": ("l",),
    "force_y_N": ("f_y",),
    "force_z_N": ("f_z",),
    "point_world_m": ("X", "Y", "Z"),
    "moment_residual_Nm": ("residual",),
}
"""Column of contacts.csv that the report shows → its symbols there."""


@dataclass(frozen=True, eq=False)
class Report:
    """The content of a report.

    table : the contacts, at least one row. rig : adds the moment residual in the sensor's deviations.
    estimate, track, facts : what the contacts say together; None where it is undetermined.
    truth : drawn with the estimates. summary : errors against truth, or other numbers with a goal each.
    pictures : the scene, the recording, or why there is none, as HTML (`picture.html.j2`).
    origin : names and text or HTML of what the page was made from.
    drift : what has changed of the rig since its calibration, as far as it is known.
    framewise : the same frames before they were refined, drawn, too.
    """

    title: str
    table: ContactTable
    rig: Rig | None = None
    estimate: ObjectEstimate | None = None
    track: Track | None = None
    facts: Sequence[Fact] = ()
    truth: TrueContacts | None = None
    summary: Sequence[SummaryRow] = ()
    pictures: Sequence[Markup] = ()
    origin: Sequence[tuple[str, str]] = ()
    drift: Mapping[str, Any] | None = None
    framewise: ContactTable | None = None


def page(report: Report) -> str:
    """The whole report as HTML."""
    table, track = report.table, report.track
    verdict, colour = headline(table)
    outcome = {True: Markup('<span class="good">met</span>'), False: Markup('<span class="bad">missed</span>')}
    errors = [
        (name, f"{value:.4g}", unit, *(("", "") if goal is None else (f"≤ {goal:.4g}", outcome[value <= goal])))
        for name, value, unit, goal in report.summary
    ]
    use = {name: "may be used" if name in LOCATED else "no contact point" for name in STATUS_COLOURS}
    use["contradicted"] = "must not be used"
    statuses = [(_dotted(colour, name), STATUSES[name], use[name]) for name, colour in STATUS_COLOURS.items()]
    phases, models = (
        [(_dotted(colour, name), words) for name, (colour, words) in kinds.items()] for kinds in (_PHASES, _MODELS)
    )
    quantities = [(", ".join(names), _report_unit(key)[0], COLUMNS[key].meaning) for key, names in SYMBOLS.items()]
    others = (
        ("antenna frame", "", "x along the undeformed antenna from its clamp, xy the calibration plane C"),
        ("slip", "mm/s", "velocity of the antenna's material at the contact against the object at rest"),
        ("μ, α", "1, °", "coefficient of friction; half angle of the friction cone, tan α = μ"),
        ("±", "", "one standard deviation, calibration errors included; bands and ellipses are two of them"),
    )
    glossary = [
        ("Status of a frame", Table(("status", "meaning", "its numbers"), statuses)),
        ("Phase of a frame", Table(("phase", "meaning"), phases)),
        ("Mechanical model, the lowest that suffices", Table(("model", "meaning"), models)),
        ("Quantities", Table(("name", "unit", "meaning"), (*quantities, *others))),
    ]
    events = () if track is None else track.events
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
    return render(
        "recording.html.j2",
        title=report.title,
        headline=verdict,
        colour=colour,
        facts=_first_facts(table, [*frame_facts(table, report.rig), *_refined_fact(report), *report.facts]),
        pictures=report.pictures,
        times=_over_time(report),
        crowded=len(table) > STYLE.most_dots,
        events=Table(("event", "in words", "time, s", "decided after, s", "frame"), rows, ("event", "in words"), cut),
        **_contacts(report),
        summary=Table(("quantity", "error", "unit", "goal", ""), errors, ("quantity", "unit")),
        drift=_drift_table(report.drift),
        drift_figure=_drift_figure(report.drift),
        contacts=_contacts_table(table, None if track is None else track.phase.tolist()),
        glossary=glossary,
        origin=Table((), report.origin),
    )


def _refined_fact(report: Report) -> list[Fact]:
    """The gain in the distance's accuracy over frame-wise estimates."""
    if report.framewise is None:
        return []
    both = report.table.located & report.framewise.located
    before, after = (
        1e3 * np.sqrt(np.nanmean(table.distance_std_m[both] ** 2)) for table in (report.framewise, report.table)
    )
    moved = np.abs(report.table.distance_m - report.framewise.distance_m)[both] / report.framewise.distance_std_m[both]
    words = f"Distance known to {after:.2f} mm, frame by frame to {before:.2f} mm; "
    return [Fact("Refined", f"{words}moved by {np.nanmedian(moved):.1f} of the frame-wise deviations in the median.")]


def _over_time(report: Report) -> list[Markup]:
    """The figures over time, one under the other."""
    table, rig, track = report.table, report.rig, report.track
    events = () if track is None else tuple((event.time_s, event.words) for event in track.events)
    clock = TimeAxis(table.time_s, events)
    drawn = [lanes(clock, "status", table.status.tolist(), STATUS_COLOURS)]
    if track is not None:
        drawn.append(lanes(clock, "phase", track.phase.tolist(), _colours(_PHASES)))
        if track.ringing.any():
            ringing = np.where(track.ringing, "ringing", "").tolist()
            drawn.append(lanes(clock, "ringing of the antenna", ringing, {"ringing": STYLE.lines[3]}))
    figures = [curve(clock, *quantity) for quantity in _quantities(report)]
    if report.framewise is not None:
        before = _quantities(replace(report, table=report.framewise))
        figures = [with_framewise(axes, clock, was[1]) for axes, was in zip(figures, before, strict=True)]
    drawn += figures
    if track is not None and np.isfinite(track.slip_std_m_s).any():
        along, across = 1e3 * track.longitudinal_m_s, 1e3 * track.lateral_m_s
        slip = [("along the antenna", STYLE.lines[0], along), ("across it", STYLE.lines[1], across)]
        title = "slip of the antenna on the object, mm/s"
        drawn.append(signals(clock, title, slip, 1e3 * track.slip_std_m_s, "the noise, at most"))
    title, residual = "moment: measured minus predicted by the fit", table.moment_residual_Nm
    if rig is not None and not rig.moment_sensor.exists:
        pass
    elif rig is None:
        unit, scale = _report_unit("moment_residual_Nm")
        nothing = np.full(len(table), np.nan)
        drawn.append(curve(clock, f"{title}, {unit}", scale * residual, nothing))
    else:
        title += ", in std of the sensor's noise"
        scaled = [("residual", STYLE.lines[2], residual / rig.moment_sensor.std_Nm)]
        drawn.append(signals(clock, title, scaled, np.ones(len(table)), "the sensor"))
    model = np.where(table.located, table.model, "").tolist()
    drawn.append(lanes(clock, "model chosen for a located contact", model, _colours(_MODELS), last=True))
    return [clock.svg(axes) for axes in drawn]


def _colours(kinds: Mapping[str, tuple[str, str]]) -> dict[str, str]:
    return {name: colour for name, (colour, _) in kinds.items()}


def _quantities(report: Report) -> list[tuple[str, np.ndarray, np.ndarray, np.ndarray | None, np.ndarray | None]]:
    """Title with unit, value, standard deviation, true value and shared standard deviation of each estimated
    quantity."""
    table, truth, located = report.table, report.truth, report.table.located
    found = []
    for name, words, shared in (
        ("distance_m", "contact distance l along the antenna", table.distance_shared_std_m),
        ("force_y_N", "force f_y", table.force_shared_std_N[:, 1]),
        ("force_z_N", "force f_z", table.force_shared_std_N[:, 2]),
    ):
        unit, scale = _report_unit(name)
        columns = (getattr(table, name), _std(table, name), shared)
        value, std, common = (np.where(located, scale * one, np.nan) for one in columns)
        true = None if truth is None else scale * getattr(truth, name)
        found.append((f"{words}, {unit}", value, std, true, common))
    size, std = (np.where(located, scale * one, np.nan) for one in lateral_force_N(table))
    true = None if truth is None else scale * np.hypot(truth.force_y_N, truth.force_z_N)
    return [*found, (f"force across the antenna, |f|, {unit}", size, std, true, None)]


def _std(table: ContactTable, name: str) -> np.ndarray:
    """Standard deviations of a column of the table; NaN where it has none."""
    if name == "point_world_m":
        return np.sqrt(np.clip(np.diagonal(table.covariance_world_m2, axis1=1, axis2=2), 0.0, None))
    stem, _, unit = name.rpartition("_")
    return np.asarray(getattr(table, f"{stem}_std_{unit}", np.full(len(table), np.nan)))


def _contacts(report: Report) -> dict[str, Any]:
    """Figures of the located contacts: maps, forces, friction cone and indentation; none without such a contact."""
    table, estimate, truth = report.table, report.estimate, report.truth
    if not table.located.any():
        return {"maps": [], "indentation": None}
    contacts = table.picked(table.located)
    true_m = np.zeros((0, 3)) if truth is None else truth.point_world_m
    true_m = true_m[np.isfinite(true_m).all(axis=1)]
    surface = None if estimate is None else estimate.surface
    maps, factor = contact_maps(contacts, surface, true_m)
    cone = pressed = None
    if estimate is not None:
        touched = table.picked(estimate.surface.touched_row)
        radius_m = 0.0 if report.rig is None else report.rig.antenna.radius_at(touched.distance_m)
        mu, stiffness = (np.nan, np.nan) if truth is None else (truth.friction, truth.stiffness_N_m)
        cone = friction_cone(estimate.friction, touched.force_world_N, mu).svg()
        pressed = indentation(estimate.surface, touched, radius_m, 1.0 / stiffness).svg()
    return {
        "maps": [axes.svg(f"contacts {axes.title}") for axes in maps],
        "ramp": STYLE.ramp,
        "lasted_s": float(np.ptp(contacts.time_s)),
        "enlargement": factor,
        "object_colour": STYLE.slate if surface is not None and len(surface.lines) + len(surface.triangles) else None,
        "true_points": len(true_m),
        "across": forces_across(contacts).svg(),
        "cone": cone,
        "indentation": pressed,
    }


def _drift_table(drift: Mapping[str, Any] | None) -> Table:
    """The rig's changes, parameter by parameter, with their prior standard deviations."""
    drift = drift or {"parameters": {}, "beyond": ()}
    marks = dict.fromkeys(drift["beyond"], "beyond")
    rows = [
        (name, f"{one['change']:.3g}", f"{one['std']:.2g}", f"{one['prior_std']:.2g}", marks.get(name, ""))
        for name, one in drift["parameters"].items()
    ]
    return Table(("parameter", "change", "std", "thought possible, std", ""), rows, ("parameter",))


def _drift_figure(drift: Mapping[str, Any] | None) -> Markup | None:
    """The largest changes over time, in prior standard deviations; None with a single group of frames."""
    past = [one for one in (drift or {}).get("over_time", []) if one["time_s"] is not None]
    if drift is None or len(past) < 2:
        return None
    names, prior = zip(*((name, one["prior_std"]) for name, one in drift["parameters"].items()), strict=True)
    size = len(names)
    change = np.array([one["change"][:size] for one in past]) / np.maximum(prior, 1e-300)
    most = np.argsort(-np.abs(change).max(axis=0))[: len(STYLE.lines)]
    clock = TimeAxis(np.array([one["time_s"] for one in past], float))
    values = [(names[index], colour, change[:, index]) for index, colour in zip(most, STYLE.lines, strict=True)]
    title = "change since the calibration, in std of what was thought possible"
    return clock.svg(signals(clock, title, values, np.ones(len(past)), "what was thought possible"))


def _contacts_table(table: ContactTable, phase: Sequence[str] | None) -> Table:
    """A row for every frame, evenly thinned where there are more than fit on a page; its columns are `SYMBOLS`."""
    rows = thinned(np.arange(len(table)), MOST_ROWS)
    part = table.picked(rows)
    columns: dict[str, Sequence[object]] = {
        "frame": part.frame.tolist(),
        "time, s": [f"{time_s:.3f}" for time_s in part.time_s],
        "status": [_dotted(STATUS_COLOURS[status], status) for status in part.status],
        "model": part.model.tolist(),
    }
    if phase is not None:
        columns["phase"] = [phase[row] for row in rows]
    text = [name for name in columns if name in ("status", "model", "phase")]

    def cell(value: float, std: float, scale: float) -> str:
        if not np.isfinite(value):
            return ""
        return with_std(float(value), float(std), scale) if np.isfinite(std) else fixed(scale * float(value), 1)

    for name, symbols in SYMBOLS.items():
        unit, scale = _report_unit(name)
        values, std = (one.reshape(len(part), -1).T for one in (getattr(part, name), _std(part, name)))
        for symbol, value, own in zip(symbols, values, std, strict=True):
            columns[f"{symbol}, {unit}"] = [cell(*pair, scale) for pair in zip(value, own, strict=True)]
    columns["reason"] = [Markup('<small class="long">{}</small>').format(reason) for reason in part.reason]
    cut = "" if len(rows) == len(table) else f"{len(rows)} of {len(table)} frames, evenly spread."
    return Table(tuple(columns), list(zip(*columns.values(), strict=True)), (*text, "reason"), cut)


def _report_unit(column: str) -> tuple[str, float]:
    """The unit in which the report prints a column of contacts.csv, and the factor to it."""
    return {"m": ("mm", 1e3), "N": ("mN", 1e3), "N·m": ("µN·m", 1e6)}[COLUMNS[column].unit]


def _dotted(colour: str, name: str) -> Markup:
    """A name after a dot of its colour."""
    return Markup('<i class="dot" style="background:{}"></i>{}').format(colour, name)


def _first_facts(table: ContactTable, facts: Sequence[Fact]) -> list[Fact]:
    """All facts, the most important first: whether the result may be used, why not, and what was touched."""
    doubts = [fact.label for fact in facts if fact.kind == "look"]
    named = f": see {', '.join(doubts)} below" if doubts else ""
    words = f"Look first{named}." if doubts else "No frame was lost, and no check of these frames failed."
    if not table.located.any():
        words = f"No contact to trust or doubt{named}."
    first = sorted(facts, key=lambda fact: fact.label not in ("Verdict", "Shape"))
    return [Fact("Trust", words, "look" if doubts else ""), *first]
