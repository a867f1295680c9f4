"""The report in words: its verdict, the meaning of its names, and its sources."""

from __future__ import annotations

import platform
import shlex
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from markupsafe import Markup

import vbaa_calib
from estimator.contact.overlay import MEANINGS, STATUS_COLOURS
from estimator.object.surface.touches import BIASED_STD
from estimator.table.contacts import LOCATED, ContactTable
from vbaa_calib.core.files import sha256
from vbaa_calib.rig import Rig
from viz.figures.drawing import AMBER, SLATE, TEAL
from viz.pages.tables import Table, number
from viz.scene.facts import Fact

MANY = 0.2
"""A larger part of the frames lost is said in the verdict's colour, too."""
LARGE_RESIDUAL = 3.0
"""A moment residual of more than so many of the sensor's deviations (rms) is worth a look."""
LOST = ("no_antenna", "failed", "unobservable", "low_signal", "not_quasistatic")
MODEL_COLOURS = {"linear": "#56b4e9", "elastica": "#0072b2", "rod": "#7c3aed", "paper": "#e69f00"}
PHASE_COLOURS = {
    "free": "#cbd5e1",
    "touching": "#56b4e9",
    "sticking": "#c2410c",
    "sliding": "#0072b2",
    "rolling": "#009e73",
    "unknown": "#64748b",
}
PHASE_MEANINGS = {
    "free": "nothing touches the antenna",
    "touching": "in contact; whether it sticks or slides is undecided",
    "sticking": "the antenna's material at the contact stands still against the object",
    "sliding": "it moves along the object",
    "rolling": "the contact moves along the antenna, its material does not slip",
    "unknown": "undetermined by the data",
}
MODEL_MEANINGS = {
    "linear": "small deflections, with weight, natural curvature and clamp",
    "elastica": "large deflections; weight, curvature, clamp and torsion in one pass",
    "rod": "the static rod with weight, curvature, clamp and torsion, solved without approximations",
    "paper": "straight, weightless, rigidly clamped; small deflections",
}
_QUANTITIES = (
    ("distance l", "mm", "arc length along the antenna from its clamp to the contact"),
    (
        "f_y, f_z",
        "mN",
        "the object's force on the antenna across it: x along the undeformed antenna, xy the calibration plane C",
    ),
    ("X, Y, Z", "mm", "contact point on the antenna's centreline, world frame; the object begins one radius away"),
    ("moment residual", "µN·m", "the sensor's reading less what the fitted contact predicts"),
    ("slip", "mm/s", "velocity of the antenna's material at the contact against the object, which stands still"),
    ("μ, α", "1, °", "coefficient of friction; half angle of the friction cone, tan α = μ"),
    ("±", "", "one standard deviation, calibration errors included; bands and ellipses are two of them"),
)


def headline(table: ContactTable) -> tuple[str, str]:
    """The verdict in one line, and its colour."""
    located, frames = int(table.located.sum()), len(table)
    if not located:
        free = int(np.sum(table.status == "no_contact"))
        return ("Nothing was touched" if free == frames else "No contact was located"), SLATE
    std = table.distance_std_m[table.located]
    known = std[np.isfinite(std)]
    well = f", to {1e3 * float(np.median(known)):.2f} mm along the antenna" if len(known) else ""
    lost = float(np.isin(table.status, LOST).mean())
    lost += float(np.mean(table.located & (table.bias_std > BIASED_STD)))
    return f"Contact located in {located} of {frames} frames{well}", AMBER if lost > MANY else TEAL


def frame_facts(table: ContactTable, rig: Rig | None) -> list[Fact]:
    """What the frames say by themselves."""
    duration = float(table.time_s[-1] - table.time_s[0])
    facts = [Fact("Recording", f"{len(table)} frame{'s' * (len(table) > 1)} in {duration:.4g} s: {_counts(table)}.")]
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
    lost = np.isin(table.status, LOST)
    if lost.any():
        facts.append(Fact("Lost", f"{int(lost.sum())} frames gave no contact point: {_reasons(table, lost)}.", "look"))
    facts += _residual(table, rig)
    return facts


def _counts(table: ContactTable) -> str:
    counts = [(name, int(np.sum(table.status == name))) for name in STATUS_COLOURS]
    return ", ".join(f"{count} {name} ({MEANINGS[name]})" for name, count in counts if count)


def _reasons(table: ContactTable, lost: np.ndarray, most: int = 3) -> str:
    names, counts = np.unique(table.reason[lost].astype(str), return_counts=True)
    order = np.argsort(-counts)
    shown = [f"{names[index]} ({counts[index]} ×)" for index in order[:most]]
    return "; ".join(shown) + (f"; and {len(names) - most} other reasons" if len(names) > most else "")


def _residual(table: ContactTable, rig: Rig | None) -> list[Fact]:
    residual = table.moment_residual_Nm[np.isfinite(table.moment_residual_Nm)]
    if rig is None or not len(residual):
        return []
    rms = float(np.sqrt(np.mean((residual / rig.moment_sensor.std_Nm) ** 2)))
    if rms <= LARGE_RESIDUAL:
        return []
    words = f"picture and moment sensor disagree by {rms:.1f} times the sensor's noise (rms): `vbaa check` asks why"
    return [Fact("To look at", words + ".", "look")]


def glossary() -> list[tuple[str, Table]]:
    """Statuses, phases, models and quantities."""
    use = {name: "may be used" if name in LOCATED else "no contact point" for name in STATUS_COLOURS}
    statuses = [(dotted(colour, name), MEANINGS[name], use[name]) for name, colour in STATUS_COLOURS.items()]
    phases = [(dotted(colour, name), PHASE_MEANINGS[name]) for name, colour in PHASE_COLOURS.items()]
    models = [(dotted(colour, name), MODEL_MEANINGS[name]) for name, colour in MODEL_COLOURS.items()]
    return [
        ("Status of a frame", Table(("status", "meaning", "its numbers"), statuses)),
        ("Phase of a frame", Table(("phase", "meaning"), phases)),
        ("Mechanical model, the lowest that suffices", Table(("model", "meaning"), models)),
        ("Quantities", Table(("name", "unit", "meaning"), _QUANTITIES)),
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
        rows.append(("antenna and camera", _rig_words(rig)))
    versions = f"vbaa-calib {vbaa_calib.__version__}, Python {platform.python_version()}, NumPy {np.__version__}"
    return [*rows, ("versions", versions), ("written", f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC")]


def _rig_words(rig: Rig) -> str:
    length, diameter = 1e3 * rig.antenna.length_m, 1e3 * rig.antenna.diameter_m
    width, height = rig.camera.image_size
    return (
        f"antenna of {number(length)} mm × {number(diameter)} mm, EI = {1e3 * rig.antenna.stiffness_Nm2:.4g} mN·m²; "
        f"camera of {width} × {height} px; moment sensor's noise {1e6 * rig.moment_sensor.std_Nm:.3g} µN·m"
    )
