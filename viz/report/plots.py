"""What the report shows over time, plot by plot."""

from __future__ import annotations

import numpy as np

from estimator.contact.overlay import STATUS_COLOURS
from estimator.table.contacts import ContactTable
from vbaa_calib.rig import Rig

from .clock import Clock
from .object_section import Sensed
from .time import curve, lanes, signals
from .truth import Truth
from .words import MODEL_COLOURS, PHASE_COLOURS

ALONG, ACROSS = "#0072b2", "#c2410c"
RESIDUAL, RINGING = "#334155", "#7c3aed"


def plots(table: ContactTable, sensed: Sensed, rig: Rig | None, truth: Truth | None) -> str:
    """All of them, one under the other, on one time axis."""
    track = sensed.track
    events = () if track is None else tuple((event.time_s, event.words) for event in track.events)
    clock = Clock.of(table.time_s, events)
    drawn = [lanes("status", clock, table.status.tolist(), STATUS_COLOURS)]
    if track is not None:
        drawn.append(lanes("phase", clock, [str(name) for name in track.phase], PHASE_COLOURS))
        if track.ringing.any():
            ringing = np.where(track.ringing, "ringing", "").tolist()
            drawn.append(lanes("ringing of the antenna", clock, ringing, {"ringing": RINGING}))
    drawn += _measured(table, clock, truth)
    if track is not None and np.isfinite(track.slip_std_m_s).any():
        drawn.append(_slip(clock, track.longitudinal_m_s, track.lateral_m_s, track.slip_std_m_s))
    drawn.append(_moment(table, clock, rig))
    model = np.where(table.located, table.model, "").tolist()
    drawn.append(lanes("model chosen for a located contact", clock, model, MODEL_COLOURS, last=True))
    return f'<div class="times">{"".join(drawn)}</div>'


def _measured(table: ContactTable, clock: Clock, truth: Truth | None) -> list[str]:
    rows = (
        ("contact distance l along the antenna", "distance_m", "distance_std_m", "mm"),
        ("force f_y", "force_y_N", "force_y_std_N", "mN"),
        ("force f_z", "force_z_N", "force_z_std_N", "mN"),
    )
    located = table.located
    drawn = []
    for title, name, std, unit in rows:
        true = None if truth is None else 1e3 * getattr(truth, name)
        value, own = (np.where(located, 1e3 * getattr(table, key), np.nan) for key in (name, std))
        drawn.append(curve(title, unit, clock, value, own, true))
    y, z = table.force_y_N, table.force_z_N
    size = np.where(located, np.hypot(y, z), np.nan)
    # whatever the correlation of the two components is, it cannot be more than that
    most = (np.abs(y) * table.force_y_std_N + np.abs(z) * table.force_z_std_N) / np.where(size > 0, size, np.nan)
    true = None if truth is None else 1e3 * np.hypot(truth.force_y_N, truth.force_z_N)
    title = "force across the antenna, |f|"
    drawn.append(curve(title, "mN", clock, 1e3 * size, 1e3 * most, true, "estimate ± 2 std at most"))
    return drawn


def _slip(clock: Clock, along_m_s: np.ndarray, across_m_s: np.ndarray, std_m_s: np.ndarray) -> str:
    values = (("along the antenna", ALONG, 1e3 * along_m_s), ("across it", ACROSS, 1e3 * across_m_s))
    return signals("slip of the antenna on the object", "mm/s", clock, values, 1e3 * std_m_s, "the noise, at most")


def _moment(table: ContactTable, clock: Clock, rig: Rig | None) -> str:
    residual = table.moment_residual_Nm
    if rig is None:
        nothing = np.full(len(table), np.nan)
        title = "moment: read less what the fit predicts"
        return curve(title, "µN·m", clock, 1e6 * residual, nothing, meaning="residual")
    scaled = residual / rig.moment_sensor.std_Nm
    title, unit = "moment: read less what the fit predicts", "in standard deviations of the sensor's noise"
    return signals(title, unit, clock, [("residual", RESIDUAL, scaled)], np.ones(len(table)), "the sensor")
