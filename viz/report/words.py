"""The report in words: its verdict, facts of frames and object, the meaning of its names, its sources."""

from __future__ import annotations

import platform
import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup

import vbaa_calib
from estimator.contact.overlay import STATUS_COLOURS
from estimator.object.surface.touches import BIASED_STD
from estimator.table.contacts import COLUMNS, LOCATED, STATUSES, ContactTable
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import sha256
from vbaa_calib.rig import Rig
from viz.figures.drawing import AMBER, SLATE, TEAL
from viz.pages.page import Table, decimals_of, number
from viz.scene.scene import Fact, object_facts, sentence

if TYPE_CHECKING:
    from estimator.object.estimate import ObjectEstimate
    from estimator.object.surface import Surface
    from estimator.object.track import Track

_MANY = 0.2
"""A larger part of the frames lost is said in the verdict's colour, too."""
_LARGE_RESIDUAL = 3.0
"""A moment residual of more than so many of the sensor's deviations (rms) is worth a look."""
_MOST_TIMES = 8
_LOST = ("no_antenna", "failed", "unobservable", "low_signal", "not_quasistatic")
MODELS = {
    "linear": ("#56b4e9", "small deflections, with weight, natural curvature and clamp"),
    "elastica": ("#0072b2", "large deflections; weight, curvature, clamp and torsion in one pass"),
    "rod": ("#7c3aed", "the static rod with weight, curvature, clamp and torsion, solved without approximations"),
    "paper": ("#e69f00", "straight, weightless, rigidly clamped; small deflections"),
}
PHASES = {
    "free": ("#cbd5e1", "nothing touches the antenna"),
    "touching": ("#56b4e9", "in contact; whether it sticks or slides is undecided"),
    "sticking": ("#c2410c", "the antenna's material at the contact stands still against the object"),
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
_UNITS = {"m": ("mm", 1e3), "N": ("mN", 1e3), "N·m": ("µN·m", 1e6)}
_OTHER_QUANTITIES = (
    ("antenna frame", "", "x along the undeformed antenna from its clamp, xy the calibration plane C"),
    ("slip", "mm/s", "velocity of the antenna's material at the contact against the object, which stands still"),
    ("μ, α", "1, °", "coefficient of friction; half angle of the friction cone, tan α = μ"),
    ("±", "", "one standard deviation, calibration errors included; bands and ellipses are two of them"),
)


def shown_unit(column: str) -> tuple[str, float]:
    """The unit in which the report shows a column of contacts.csv, and the factor to it."""
    return _UNITS[COLUMNS[column].unit]


def object_found(table: ContactTable, rig: Rig | None) -> tuple[ObjectEstimate | None, Track | None, tuple[Fact, ...]]:
    """What the contacts say together: the object, phases and events of the frames, and both in words.

    What is None is undetermined, and the facts say why.
    """
    from estimator.object.estimate import estimate_object
    from estimator.object.track import follow

    try:
        estimate = estimate_object(table, rig)
    except InputError as error:
        why = Fact("The object", f"Nothing can be said of it: {str(error).rstrip('.')}.", "undetermined")
    else:
        return estimate, estimate.track, facts_of(estimate)
    try:
        track = follow(table, rig)
    except InputError:
        return None, None, (why,)
    return None, track, (_event_fact(track), why)


def facts_of(estimate: ObjectEstimate) -> tuple[Fact, ...]:
    """An object estimate in words."""
    return _event_fact(estimate.track), *object_facts(estimate), _shape_fact(estimate.surface)


def _event_fact(track: Track) -> Fact:
    """Times of contact, counts of other events, and what is undetermined."""
    names = {"first_contact": "contact", "loss": "contact lost"}
    notes = [sentence(note) for note in track.notes]
    if not track.events:
        return Fact("In time", " ".join(["No first contact, loss or slip was found.", *notes]), "undetermined")
    contacts = [event for event in track.events if event.kind in names]
    words = [f"{names[event.kind]} {_time(event.time_s, event.time_std_s)}" for event in contacts[:_MOST_TIMES]]
    words += [f"{len(contacts) - _MOST_TIMES} more"] if len(contacts) > _MOST_TIMES else []
    for kind, verb in (("slip_start", "began"), ("slip_end", "ended")):
        count = sum(event.kind == kind for event in track.events)
        words += [f"{count} slip{'s' * (count != 1)} {verb}"] if count else []
    return Fact("In time", " ".join([sentence("; ".join(words)), *notes]))


def _time(time_s: float, std_s: float) -> str:
    if not np.isfinite(time_s):
        return "at an unknown time"
    if not (np.isfinite(std_s) and std_s > 0):
        return f"at {time_s:.3f} s"
    digits = min(decimals_of(std_s), 6)
    return f"at {time_s:.{digits}f} ± {std_s:.{digits}f} s"


def _shape_fact(surface: Surface) -> Fact:
    """How much of the object is known, and how well."""
    patches = len(np.unique(surface.touched_patch))
    known = surface.std_m[np.isfinite(surface.std_m)]
    well = f", known to {1e3 * float(np.median(known)):.2f} mm (median standard deviation)" if len(known) else ""
    kind = "a surface" if len(surface.triangles) else "lines: too narrow for a surface"
    words = f"{len(surface.touched_m)} contacts on {patches} patch{'es' * (patches != 1)}, joined to {kind}{well}."
    return Fact("Shape", " ".join([words, *(sentence(note) for note in surface.notes)]))


def headline(table: ContactTable) -> tuple[str, str]:
    """The verdict in one line, and its colour."""
    located, frames = int(table.located.sum()), len(table)
    if not located:
        free = int(np.sum(table.status == "no_contact"))
        return ("Nothing was touched" if free == frames else "No contact was located"), SLATE
    std = table.distance_std_m[table.located]
    known = std[np.isfinite(std)]
    well = f", to {1e3 * float(np.median(known)):.2f} mm along the antenna" if len(known) else ""
    lost = float(np.mean(np.isin(table.status, _LOST) | table.located & (table.bias_std > BIASED_STD)))
    return f"Contact located in {located} of {frames} frames{well}", AMBER if lost > _MANY else TEAL


def frame_facts(table: ContactTable, rig: Rig | None) -> list[Fact]:
    """What the frames say by themselves."""
    counts = [(name, int(np.sum(table.status == name))) for name in STATUS_COLOURS]
    listed = ", ".join(f"{count} {name} ({STATUSES[name]})" for name, count in counts if count)
    duration = float(table.time_s[-1] - table.time_s[0])
    facts = [Fact("Recording", f"{len(table)} frame{'s' * (len(table) > 1)} in {duration:.4g} s: {listed}.")]
    here = table.located
    if here.any():
        force = 1e3 * np.hypot(table.force_y_N, table.force_z_N)[here]
        point = 1e3 * np.sqrt(np.trace(table.covariance_world_m2[here], axis1=1, axis2=2))
        words = f"Forces of {force.min():.3g} to {force.max():.3g} mN across the antenna"
        if np.isfinite(point).any():
            middle, worst = (float(np.nanquantile(point, share)) for share in (0.5, 0.95))
            words += f"; contact points known to {middle:.2g} mm in space (median; 95 % of them to {worst:.2g} mm)"
        facts.append(Fact("How well", words + "."))
    biased = int(np.sum(here & (table.bias_std > BIASED_STD)))
    if biased:
        words = f"{biased} contacts were found with a model that is off by more than one of their standard deviations"
        facts.append(Fact("Model", f"{words}: estimate them with --model auto.", "look"))
    lost = np.isin(table.status, _LOST)
    if lost.any():
        reasons = Counter(map(str, table.reason[lost]))
        shown = [f"{name} ({count} ×)" for name, count in reasons.most_common(3)]
        shown += [f"and {len(reasons) - 3} other reasons"] if len(reasons) > 3 else []
        facts.append(Fact("Lost", f"{int(lost.sum())} frames gave no contact point: {'; '.join(shown)}.", "look"))
    residual = table.moment_residual_Nm[np.isfinite(table.moment_residual_Nm)]
    if rig is not None and len(residual):
        rms = float(np.sqrt(np.mean((residual / rig.moment_sensor.std_Nm) ** 2)))
        words = f"picture and moment sensor disagree by {rms:.1f} times the sensor's noise (rms)"
        facts += [Fact("To look at", f"{words}: `vbaa check` asks why.", "look")] if rms > _LARGE_RESIDUAL else []
    return facts


def glossary() -> list[tuple[str, Table]]:
    """Statuses, phases, models and quantities."""
    use = {name: "may be used" if name in LOCATED else "no contact point" for name in STATUS_COLOURS}
    statuses = [(dotted(colour, name), STATUSES[name], use[name]) for name, colour in STATUS_COLOURS.items()]
    phases, models = (
        [(dotted(colour, name), words) for name, (colour, words) in kinds.items()] for kinds in (PHASES, MODELS)
    )
    quantities = [(", ".join(symbols), shown_unit(name)[0], COLUMNS[name].meaning) for name, symbols in SYMBOLS.items()]
    return [
        ("Status of a frame", Table(("status", "meaning", "its numbers"), statuses)),
        ("Phase of a frame", Table(("phase", "meaning"), phases)),
        ("Mechanical model, the lowest that suffices", Table(("model", "meaning"), models)),
        ("Quantities", Table(("name", "unit", "meaning"), (*quantities, *_OTHER_QUANTITIES))),
    ]


def dotted(colour: str, name: str) -> Markup:
    """A name behind a dot of its colour."""
    return Markup('<i class="dot" style="background:{}"></i>{}').format(colour, name)


def origin(files: Mapping[str, Path | None], rig: Rig | None, argv: Sequence[str]) -> list[tuple[str, str]]:
    """What a report was made from: names and text or HTML."""
    rows: list[tuple[str, str]] = []
    if argv:
        rows.append(("command", Markup("<code>{}</code>").format(shlex.join(argv))))
    for name, path in files.items():
        if path is not None:
            digest = Markup("<br><small>sha256 {}</small>").format(sha256(path)) if path.is_file() else ""
            rows.append((name, Markup("{}{}").format(path, digest)))
    if rig is not None:
        length, diameter = number(1e3 * rig.antenna.length_m), number(1e3 * rig.antenna.diameter_m)
        antenna = f"antenna of {length} mm × {diameter} mm, EI = {1e3 * rig.antenna.stiffness_Nm2:.4g} mN·m²"
        camera = "camera of {} × {} px".format(*rig.camera.image_size)
        noise = f"moment sensor's noise {1e6 * rig.moment_sensor.std_Nm:.3g} µN·m"
        rows.append(("antenna and camera", "; ".join([antenna, camera, noise])))
    versions = f"vbaa-calib {vbaa_calib.__version__}, Python {platform.python_version()}, NumPy {np.__version__}"
    return [*rows, ("versions", versions), ("written", f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC")]
