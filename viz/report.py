"""report.html: one page with picture, plots and tables in it, that opens anywhere and needs nothing beside it."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from estimator.table import STATUSES, ContactTable
from vbaa_calib.errors import InputError
from vbaa_calib.files import write_text

from .svg import curve, strip

SummaryRow = tuple[str, float, str, float | None]
"""Name, value, unit, and the goal that the value must not exceed, if there is one."""

STATUS_COLOURS = dict(
    zip(
        STATUSES,
        ("#0d9488", "#cbd5e1", "#22c55e", "#a855f7", "#f59e0b", "#3b82f6", "#64748b", "#dc2626"),
        strict=True,
    )
)

_STYLE = """
  :root { color-scheme: light; }
  body { margin: 0; background: #eef2f7; color: #1f2937;
         font: 15px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, sans-serif; }
  main { max-width: 1040px; margin: 0 auto; padding: 32px 24px 64px; }
  h1 { font-size: 26px; margin: 0 0 4px; } h2 { font-size: 18px; margin: 0 0 12px; }
  p.lead { color: #6b7280; margin: 0 0 24px; }
  section { background: #fff; border-radius: 12px; padding: 20px 24px; margin: 0 0 20px;
            box-shadow: 0 1px 4px rgba(31, 41, 55, .10); }
  img { width: 100%; border-radius: 8px; display: block; }
  svg { width: 100%; height: auto; display: block; margin: 0 0 10px; }
  svg text { font-size: 12px; fill: #6b7280; } svg text.title { font-size: 13px; font-weight: 600; fill: #1f2937; }
  svg .grid { stroke: #e5e7eb; stroke-width: 1; }
  .scroll { overflow: auto; max-height: 560px; }
  table { border-collapse: collapse; width: 100%; font-size: 13px; font-variant-numeric: tabular-nums; }
  th { position: sticky; top: 0; background: #fff; text-align: right; font-weight: 600; color: #6b7280;
       border-bottom: 1px solid #d1d5db; padding: 6px 8px; white-space: nowrap; }
  td { text-align: right; padding: 4px 8px; border-bottom: 1px solid #f1f5f9; white-space: nowrap; }
  th.text, td.text { text-align: left; } td small { color: #6b7280; }
  i.dot { display: inline-block; width: 9px; height: 9px; border-radius: 50%; margin-right: 6px; }
  .good { color: #0f766e; } .bad { color: #b91c1c; font-weight: 600; }
"""


def write_report(
    path: Path,
    title: str,
    picture: Path | None,
    table: ContactTable,
    truth: Mapping[str, Any] | None = None,
    summary: Sequence[SummaryRow] = (),
    *,
    force: bool = False,
) -> None:
    """Write report.html, whole or not at all.

    Parameters
    ----------
    picture : a PNG of the scene, or None.
    truth : contents of truth.json, where known: its frames are drawn beside the estimates.
    summary : errors against truth, or any other numbers with a goal each.

    Raises
    ------
    InputError : the picture cannot be read, truth does not fit, or the file exists and `force` is off.
    """
    located = int(np.sum(table.located))
    duration = float(table.time_s[-1] - table.time_s[0])
    sections = [
        _section("Error against truth", _summary(summary)) if summary else "",
        _section("Scene", _picture(Path(picture))) if picture is not None else "",
        _section("Over the frames", _plots(table, _truth_columns(table, truth))),
        _section("Contacts", _contacts(table)),
    ]
    lead = f"{len(table)} frames in {duration:.1f} s, {located} with a located contact. Uncertainties are ± 1 std."
    page = (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><style>{_STYLE}</style></head>'
        f'<body><main><h1>{escape(title)}</h1><p class="lead">{lead}</p>{"".join(sections)}</main></body></html>\n'
    )
    write_text(Path(path), page, force)


def _section(heading: str, body: str) -> str:
    return f"<section><h2>{escape(heading)}</h2>{body}</section>"


def _picture(path: Path) -> str:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", where=path, remedy="write the picture first") from None
    if not data.startswith(b"\x89PNG"):
        raise InputError("is not a PNG", where=path, remedy="give the picture that vbaa view --screenshot wrote")
    return f'<img alt="the scene" src="data:image/png;base64,{base64.b64encode(data).decode()}">'


def _summary(rows: Sequence[SummaryRow]) -> str:
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
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(body)}</tbody></table>"


def _truth_columns(table: ContactTable, truth: Mapping[str, Any] | None) -> dict[str, np.ndarray]:
    """Distance and force of truth.json's frames in the order of the table, NaN where there is no contact."""
    if truth is None:
        return {}
    columns = {name: np.full(len(table), np.nan) for name in ("distance_m", "force_y_N", "force_z_N")}
    try:
        frames = {int(frame["frame"]): frame for frame in truth["frames"]}
        for row, number in enumerate(table.frame):
            frame = frames.get(int(number))
            if frame is not None and frame["in_contact"]:
                columns["distance_m"][row] = frame["distance_m"]
                _, columns["force_y_N"][row], columns["force_z_N"][row] = frame["force_N"]
    except (KeyError, TypeError, ValueError) as error:
        remedy = "give the truth.json that vbaa simulate wrote"
        raise InputError(f"frames are not as expected ({error!r})", where="truth.json", remedy=remedy) from None
    return columns


def _plots(table: ContactTable, truth: Mapping[str, np.ndarray]) -> str:
    """Status strip, then distance and both forces over the frames."""
    quantities = (
        ("contact distance along the antenna", "distance_m", "distance_std_m", 1e3, "mm"),
        ("force y", "force_y_N", "force_y_std_N", 1e3, "mN"),
        ("force z", "force_z_N", "force_z_std_N", 1e3, "mN"),
    )
    plots = [strip("status", table.frame, table.status.tolist(), STATUS_COLOURS)]
    for title, name, std, scale, unit in quantities:
        true = scale * truth[name] if truth else None
        plots.append(curve(title, unit, table.frame, scale * getattr(table, name), scale * getattr(table, std), true))
    return "".join(plots)


def _contacts(table: ContactTable) -> str:
    names = ("distance, mm", "f_y, mN", "f_z, mN", "X, mm", "Y, mm", "Z, mm", "moment residual, µN·m")
    head = "".join(f"<th>{name}</th>" for name in names)
    std_world = np.sqrt(np.diagonal(table.covariance_world_m2, axis1=1, axis2=2))
    body = []
    for row in range(len(table)):
        status = str(table.status[row])
        cells = [
            _number(1e3 * table.distance_m[row], 1e3 * table.distance_std_m[row], 2),
            _number(1e3 * table.force_y_N[row], 1e3 * table.force_y_std_N[row], 2),
            _number(1e3 * table.force_z_N[row], 1e3 * table.force_z_std_N[row], 2),
            *(_number(1e3 * table.point_world_m[row, i], 1e3 * std_world[row, i], 2) for i in range(3)),
            _number(1e6 * table.moment_residual_Nm[row], np.nan, 0),
        ]
        body.append(
            f'<tr><td>{table.frame[row]}</td><td>{table.time_s[row]:.2f}</td><td class="text">'
            f'<i class="dot" style="background:{STATUS_COLOURS[status]}"></i>{escape(status)}</td>'
            f"{''.join(f'<td>{cell}</td>' for cell in cells)}"
            f'<td class="text"><small>{escape(str(table.reason[row]))}</small></td></tr>'
        )
    return (
        f'<div class="scroll"><table><thead><tr><th>frame</th><th>time, s</th><th class="text">status</th>{head}'
        f'<th class="text">reason</th></tr></thead><tbody>{"".join(body)}</tbody></table></div>'
    )


def _number(value: float, std: float, digits: int) -> str:
    if not np.isfinite(value):
        return ""
    return f"{value:.{digits}f}" + (f" <small>± {std:.{digits}f}</small>" if np.isfinite(std) else "")
