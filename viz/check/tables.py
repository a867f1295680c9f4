"""Tables of the check report: rows of numbers, and whatever a rig.json's quality section holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

NOT_RECORDED = '<p class="none">not recorded</p>'
_UNITS = (
    ("_percent", "%", 1.0),
    ("_kg_m3", "kg/m³", 1.0),
    ("_kg_m", "g/m", 1e3),
    ("_Nm2", "N·m²", 1.0),
    ("_Nm_per_s", "µN·m/s", 1e6),
    ("_Nm_per_row", "µN·m per row", 1e6),
    ("_Nm", "mN·m", 1e3),
    ("_per_m", "1/m", 1.0),
    ("_mrad", "mrad", 1.0),
    ("_rad", "mrad", 1e3),
    ("_mm", "mm", 1.0),
    ("_m", "mm", 1e3),
    ("_px", "px", 1.0),
    ("_N", "mN", 1e3),
    ("_s", "s", 1.0),
)
_DEEPEST = 3
_MOST_ROWS = 400


def number(value: Any, digits: int = 4) -> str:
    """A number as a person writes it; a dash where there is none."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if not isinstance(value, int | float) or not np.isfinite(value):
        return "–"
    return f"{value:.{digits}g}".replace("-", "−")


def fixed(value: float, decimals: int) -> str:
    """A number with so many decimals, without a minus where nothing is left of it."""
    text = f"{value:.{decimals}f}"
    return text.removeprefix("-") if float(text) == 0 else text.replace("-", "−")


def with_std(value: float, std: float | None, scale: float = 1.0) -> str:
    """A number with the digits that its standard deviation leaves it, and that."""
    value, std = scale * value, None if std is None else scale * std
    if std is None or not np.isfinite(std) or std <= 0:
        return number(value, 6)
    digits = int(np.clip(1 - np.floor(np.log10(std)), 0, 12))
    return f"{value:.{digits}f} <small>± {std:.{digits}f}</small>".replace("-", "−")


def table(head: Sequence[str], rows: Sequence[Sequence[str]], text_columns: int = 1) -> str:
    """Cells are HTML already; the first `text_columns` stand to the left."""
    if not rows:
        return NOT_RECORDED
    kind = ["text" if index < text_columns else "" for index in range(len(head))]
    top = "".join(f'<th class="{style}">{escape(name)}</th>' for name, style in zip(head, kind, strict=True))
    body = "".join(
        "<tr>" + "".join(f'<td class="{style}">{cell}</td>' for cell, style in zip(row, kind, strict=True)) + "</tr>"
        for row in rows
    )
    return f'<div class="scroll"><table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>'


def records(rows: Any, columns: Sequence[tuple[str, str, int | None]], text_columns: int = 1) -> str:
    """A table of mappings by (key, heading, decimals); a key that a row does not have is a dash."""
    found = [row for row in rows if isinstance(row, Mapping)] if isinstance(rows, list) else []
    cells = [[_cell(row.get(key), decimals) for key, _, decimals in columns] for row in found[:_MOST_ROWS]]
    return table([heading for _, heading, _ in columns], cells, text_columns)


def listing(data: Any) -> str:
    """Whatever a section of rig.json holds: names, values, units."""
    rows = list(_flat(data)) if isinstance(data, Mapping) else []
    return table(("what", "value", "unit"), rows[:_MOST_ROWS])


def scaled(rows: Any, key: str, factor: float) -> list[Mapping[str, Any]]:
    """The mappings among rows, the number at a key in other units."""
    found = [row for row in rows if isinstance(row, Mapping)] if isinstance(rows, list) else []
    return [{**row, key: factor * row[key]} if isinstance(row.get(key), int | float) else row for row in found]


def at(data: Any, *keys: str) -> Any:
    """What lies at a path of keys; None where the path ends."""
    for key in keys:
        data = data.get(key) if isinstance(data, Mapping) else None
    return data


def _cell(value: Any, decimals: int | None = None) -> str:
    if isinstance(value, str):
        return escape(value)
    if decimals is None or isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        return number(value)
    return fixed(value, decimals)


def _flat(data: Mapping[str, Any], before: str = "", depth: int = 0) -> list[list[str]]:
    rows: list[list[str]] = []
    for key, value in data.items():
        name = f"{before}{key}"
        if isinstance(value, Mapping):
            rows += _flat(value, f"{name} · ", depth + 1) if depth < _DEEPEST else []
        elif isinstance(value, list) and any(isinstance(item, Mapping) for item in value):
            for index, item in enumerate(value):
                if isinstance(item, Mapping) and depth < _DEEPEST:
                    rows += _flat(item, f"{name} {index + 1} · ", depth + 1)
        elif isinstance(value, list) and any(isinstance(item, list) for item in value):
            continue
        else:
            rows.append(_row(name, value))
    return rows


def _row(name: str, value: Any) -> list[str]:
    found = next((unit for unit in _UNITS if name.endswith(unit[0]) or f"{unit[0]} ·" in name), None)
    unit, scale = (found[1], found[2]) if found else ("", 1.0)
    label = name.replace(found[0], "", 1) if found else name
    values = value if isinstance(value, list) else [value]
    numeric = bool(values) and all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
    shown = ", ".join(number(scale * v) if numeric else _cell(v) for v in values)
    return [escape(label.replace("_", " ")), shown or "–", escape(unit if numeric else "")]
