"""The report in words: its verdict, facts of frames and object, the meaning of its names, its sources."""

from __future__ import annotations

import platform
import shlex
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup

import vbaa_calib
from estimator.contact.overlay import STATUS_COLOURS
from estimator.object.surface.settings import SurfaceSettings
from estimator.table.contacts import STATUSES, ContactTable
from estimator.table.overview import Overview
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import sha256
from vbaa_calib.core.robust import finite_median
from vbaa_calib.rig import Rig
from viz.figures.settings import STYLE
from viz.pages.page import decimals_of, number
from viz.scene.scene import Fact, object_facts, sentence

if TYPE_CHECKING:
    from estimator.object.estimate import ObjectEstimate
    from estimator.object.track import Track

_MOST_TIMES = 8
_LOST = ("no_antenna", "failed", "unobservable", "low_signal", "not_quasistatic", "contradicted")


def object_found(table: ContactTable, rig: Rig | None) -> tuple[ObjectEstimate | None, Track | None, tuple[Fact, ...]]:
    """What the contacts determine together: the object, phases and events of the frames, and both in words.

    None stands for an undetermined result; the facts give the reason.
    """
    from estimator.object.estimate import estimate_object
    from estimator.object.track import follow

    try:
        estimate = estimate_object(table, rig)
    except InputError as error:
        why = Fact("The object", f"Nothing can be said of it: {str(error).rstrip('.')}.", "undetermined")
    else:
        return estimate, estimate.track, _facts_of(estimate)
    try:
        track = follow(table, rig)
    except InputError:
        return None, None, (why,)
    return None, track, (_event_fact(track), why)


def _facts_of(estimate: ObjectEstimate) -> tuple[Fact, ...]:
    """An object estimate in words."""
    surface = estimate.surface
    patches = len(np.unique(surface.touched_patch))
    std_mm = 1e3 * finite_median(surface.std_m)
    well = f", known to {std_mm:.2f} mm (median standard deviation)" if np.isfinite(std_mm) else ""
    kind = "a surface" if len(surface.triangles) else "lines: too narrow for a surface"
    words = f"{_contacts(len(surface.touched_m))} on {patches} patch{'es' * (patches != 1)}, joined to {kind}{well}."
    shape = Fact("Shape", " ".join([words, *map(sentence, surface.notes)]))
    return _event_fact(estimate.track), *object_facts(estimate), shape


def _contacts(count: int) -> str:
    return f"{count} contact{'s' * (count != 1)}"


def _event_fact(track: Track) -> Fact:
    """Times of contact, counts of other events, and what is undetermined."""
    names = {"first_contact": "contact", "loss": "contact lost"}
    notes = [sentence(note) for note in track.notes]
    if not track.events:
        return Fact("Over time", " ".join(["No first contact, loss or slip was found.", *notes]), "undetermined")
    contacts = [event for event in track.events if event.kind in names]
    words = []
    for event in contacts[:_MOST_TIMES]:
        when, std = "at an unknown time", event.time_std_s
        if np.isfinite(event.time_s):
            digits = min(decimals_of(std), 6) if std > 0 and np.isfinite(std) else 3
            spread = f" ± {std:.{digits}f}" if std > 0 and np.isfinite(std) else ""
            when = f"at {event.time_s:.{digits}f}{spread} s"
        words.append(f"{names[event.kind]} {when}")
    words += [f"{len(contacts) - _MOST_TIMES} more"] if len(contacts) > _MOST_TIMES else []
    for kind, verb in (("slip_start", "began"), ("slip_end", "ended")):
        count = sum(event.kind == kind for event in track.events)
        words += [f"{count} slip{'s' * (count != 1)} {verb}"] if count else []
    return Fact("Over time", " ".join([sentence("; ".join(words)), *notes]))


def headline(table: ContactTable) -> tuple[str, str]:
    """The verdict in one line, and its colour."""
    located, frames = int(table.located.sum()), len(table)
    contradicted = np.flatnonzero(table.status == "contradicted")
    if len(contradicted):
        causes = str(table.reason[contradicted[0]]).partition(" (remedy: ")[0]
        return f"{len(contradicted)} of {frames} frames must not be used: {causes}", STYLE.red
    if not located:
        free = int(np.sum(table.status == "no_contact"))
        return ("Nothing was touched" if free == frames else "No contact was located"), STYLE.slate
    std_mm = 1e3 * finite_median(table.distance_std_m[table.located])
    well = f", to {std_mm:.2f} mm along the antenna" if np.isfinite(std_mm) else ""
    lost = float(np.mean(np.isin(table.status, _LOST) | table.located & (table.bias_std > SurfaceSettings.biased_std)))
    # a larger lost part is named in the verdict's colour, too
    return f"Contact located in {located} of {frames} frames{well}", STYLE.amber if lost > 0.2 else STYLE.teal


def frame_facts(table: ContactTable, rig: Rig | None) -> list[Fact]:
    """Facts about the frames one by one."""
    counts = [(name, int(np.sum(table.status == name))) for name in STATUS_COLOURS]
    listed = ", ".join(f"{count} {name} ({STATUSES[name]})" for name, count in counts if count)
    duration = float(table.time_s[-1] - table.time_s[0])
    facts = [Fact("Recording", f"{len(table)} frame{'s' * (len(table) > 1)} in {duration:.4g} s: {listed}.")]
    here = table.located
    if here.any():
        force = 1e3 * np.hypot(table.force_y_N, table.force_z_N)[here]
        point = 1e3 * np.sqrt(np.trace(table.covariance_world_m2[here], axis1=1, axis2=2))
        if partly := int(np.isnan(force).sum()):
            words = f"Forces, in {partly} of {len(force)} contacts known across the line of sight only"
        else:
            words = f"Forces of {force.min():.3g} to {force.max():.3g} mN across the antenna"
        if np.isfinite(point).any():
            middle, worst = (float(np.nanquantile(point, share)) for share in (0.5, 0.95))
            words += f"; contact points known to {middle:.2g} mm in space (median; 95 % of them to {worst:.2g} mm)"
        facts.append(Fact("Accuracy", words + "."))
    biased = int(np.sum(here & (table.bias_std > SurfaceSettings.biased_std)))
    if biased:
        words = f"{_contacts(biased)} found with a model that is off by more than one standard deviation of the contact"
        facts.append(Fact("Model", f"{words}: estimate again with --model auto.", "look"))
    lost = np.isin(table.status, _LOST)
    if lost.any():
        overview = Overview()
        for frame, status, reason in zip(table.frame[lost], table.status[lost], table.reason[lost], strict=True):
            overview.add_result(int(frame), str(status), str(reason))
        reasons = overview.numbers()["reasons"]
        items = [f"{one['reason']} ({one['frames']} ×)" for one in reasons[:3]]
        items += [f"and {len(reasons) - 3} other reason{'s' * (len(reasons) != 4)}"] if len(reasons) > 3 else []
        count = int(lost.sum())
        words = f"{count} frame{'s' * (count != 1)} gave no contact point: {'; '.join(items)}."
        facts.append(Fact("Lost", words, "look"))
    residual = table.moment_residual_Nm[np.isfinite(table.moment_residual_Nm)]
    if rig is not None and rig.moment_sensor.exists and len(residual):
        rms = float(np.sqrt(np.mean((residual / rig.moment_sensor.std_Nm) ** 2)))
        words = f"picture and moment sensor disagree by {rms:.1f} times the sensor's noise (rms)"
        # rms of the moment residual, in standard deviations of the sensor, from which it is reported
        facts += [Fact("To look at", f"{words}: `vbaa check` asks why.", "look")] if rms > 3.0 else []
    return facts


def origin(files: Mapping[str, Path | None], rig: Rig | None, argv: Sequence[str]) -> list[tuple[str, str]]:
    """The inputs of a report: names, and text or HTML."""
    rows: list[tuple[str, str]] = []
    if argv:
        rows.append(("command", Markup("<code>{}</code>").format(shlex.join(argv))))
    for name, path in files.items():
        if path is not None:
            digest = Markup("<br><small>sha256 {}</small>").format(sha256(path)) if path.is_file() else ""
            rows.append((name, Markup("{}{}").format(path, digest)))
    if rig is not None:
        length = number(1e3 * rig.antenna.length_m)
        antenna = f"antenna of {length} mm × {rig.antenna.thickness}, EI = {1e3 * rig.antenna.stiffness_Nm2:.4g} mN·m²"
        camera = "camera of {} × {} px".format(*rig.camera.image_size)
        sensor = rig.moment_sensor
        noise = f"moment sensor's noise {1e6 * sensor.std_Nm:.3g} µN·m" if sensor.exists else "no moment sensor"
        if rig.wrench_sensor is not None:
            noise += f"; {', '.join(rig.wrench_sensor.components)} are read, too"
        rows.append(("antenna and camera", "; ".join([antenna, camera, noise])))
    versions = f"vbaa-calib {vbaa_calib.__version__}, Python {platform.python_version()}, NumPy {np.__version__}"
    return [*rows, ("versions", versions), ("written", f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC")]
