"""Tables of the report: the contacts with their uncertainties, errors against truth, and where all of it comes from."""

from __future__ import annotations

import platform
import shlex
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import vbaa_calib
from estimator.contact.overlay import STATUS_COLOURS
from estimator.table.contacts import ContactTable
from vbaa_calib.core.files import sha256
from vbaa_calib.rig import Rig
from viz.check.tables import fixed, with_std
from viz.check.tables import table as table_of

from .map import spread_out
from .words import rig_words

if TYPE_CHECKING:
    from estimator.object.track import Event

SummaryRow = tuple[str, float, str, float | None]
"""Name, value, unit, and the goal that the value must not exceed, if there is one."""
MOST_ROWS = 500
_HEAD = ("l, mm", "f_y, mN", "f_z, mN", "X, mm", "Y, mm", "Z, mm", "residual, µN·m")


def summary_table(rows: Sequence[SummaryRow]) -> str:
    """Values with the goals that they meet or miss."""
    body = []
    for name, value, unit, goal in rows:
        verdict = ""
        if goal is not None:
            verdict = '<span class="good">met</span>' if value <= goal else '<span class="bad">missed</span>'
        limit = "" if goal is None else f"≤ {goal:.4g}"
        body.append(
            f'<tr><td class="text">{escape(name)}</td><td>{value:.4g}</td><td class="text">{escape(unit)}</td>'
            f"<td>{limit}</td><td>{verdict}</td></tr>"
        )
    head = '<th class="text">quantity</th><th>error</th><th class="text">unit</th><th>goal</th><th></th>'
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{"".join(body)}</tbody></table></div>'


def events_table(events: Sequence[Event]) -> str:
    """What happened when; the first ones where there are very many."""
    rows = [
        [
            escape(event.kind.replace("_", " ")),
            f'<span class="told">{escape(event.words)}</span>',
            with_std(float(event.time_s), float(event.time_std_s)) if np.isfinite(event.time_s) else "–",
            fixed(event.delay_s, 3) if np.isfinite(event.delay_s) else "–",
            str(event.frame),
        ]
        for event in events[:MOST_ROWS]
    ]
    left = "" if len(rows) == len(events) else f"<p>The first {len(rows)} of {len(events)}.</p>"
    return left + table_of(("event", "in words", "time, s", "decided after, s", "frame"), rows, text_columns=2)


def contacts_table(table: ContactTable, phase: Sequence[str] | None) -> str:
    """A row for every frame, evenly thinned where there are more than a page holds."""
    shown = spread_out(len(table), MOST_ROWS)
    std_world = np.sqrt(np.clip(np.diagonal(table.covariance_world_m2, axis1=1, axis2=2), 0.0, None))
    rows = "".join(_row(table, phase, int(index), std_world[index]) for index in shown)
    names = ["frame", "time, s", "status", "model", *(["phase"] if phase is not None else []), *_HEAD, "reason"]
    text = ("status", "model", "phase", "reason")
    head = "".join(f'<th class="text">{name}</th>' if name in text else f"<th>{name}</th>" for name in names)
    left = "" if len(shown) == len(table) else f"<p>{len(shown)} of {len(table)} frames, evenly spread.</p>"
    return f'{left}<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>'


def _row(table: ContactTable, phase: Sequence[str] | None, row: int, std_world: np.ndarray) -> str:
    status = str(table.status[row])
    cells = [
        _number(table.distance_m[row], table.distance_std_m[row], 1e3),
        _number(table.force_y_N[row], table.force_y_std_N[row], 1e3),
        _number(table.force_z_N[row], table.force_z_std_N[row], 1e3),
        *(_number(table.point_world_m[row, i], std_world[i], 1e3) for i in range(3)),
    ]
    residual = table.moment_residual_Nm[row]
    cells.append(fixed(1e6 * float(residual), 1) if np.isfinite(residual) else "")
    moved = "" if phase is None else f'<td class="text">{escape(str(phase[row]))}</td>'
    return (
        f'<tr><td>{table.frame[row]}</td><td>{table.time_s[row]:.3f}</td><td class="text">'
        f'<i class="dot" style="background:{STATUS_COLOURS[status]}"></i>{escape(status)}</td>'
        f'<td class="text">{escape(str(table.model[row]))}</td>{moved}'
        f"{''.join(f'<td>{cell}</td>' for cell in cells)}"
        f'<td class="text reason"><small>{escape(str(table.reason[row]))}</small></td></tr>'
    )


def _number(value: float, std: float, scale: float) -> str:
    return with_std(float(value), float(std), scale) if np.isfinite(value) else ""


def origin(files: Mapping[str, Path | None], rig: Rig | None, argv: Sequence[str]) -> list[tuple[str, str]]:
    """Where a report comes from: names and HTML."""
    rows = [("command", f"<code>{escape(shlex.join(argv))}</code>")] if argv else []
    for name, path in files.items():
        if path is not None:
            digest = f"<br><small>sha256 {sha256(path)}</small>" if path.is_file() else ""
            rows.append((name, f"{escape(str(path))}{digest}"))
    if rig is not None:
        rows.append(("what the rig is", escape(rig_words(rig))))
    versions = f"vbaa-calib {vbaa_calib.__version__}, Python {platform.python_version()}, NumPy {np.__version__}"
    return [*rows, ("versions", versions), ("written", f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC")]


def origin_table(rows: Sequence[tuple[str, str]]) -> str:
    """As HTML."""
    body = "".join(f'<tr><td>{escape(name)}</td><td class="path">{value}</td></tr>' for name, value in rows)
    return f'<table class="words"><tbody>{body}</tbody></table>'
