"""Self-contained pages from templates: style, figures and scripts are inside, and every value is escaped."""

from __future__ import annotations

import base64
import os
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from markupsafe import Markup, escape

_MOST_ROWS = 400


def _prose(text: str) -> Markup:
    """Plain text as HTML; text in backquotes is a command, a hyphen before a number elsewhere is a minus."""
    parts = str(escape(text)).split("`")
    parts[-2:] = parts[-2:] if len(parts) % 2 else ["`".join(parts[-2:])]
    parts[::2] = (re.sub(r"(?<![^\s(,±])-(?=\d)", "−", part) for part in parts[::2])
    return Markup("".join(f"<code>{part}</code>" if index % 2 else part for index, part in enumerate(parts)))


def render(template: str, **values: Any) -> str:
    """A page from one of the templates of this package."""
    return _environment().get_template(template).render(values)


@cache
def _environment() -> jinja2.Environment:
    made = jinja2.Environment(
        loader=jinja2.PackageLoader("viz.pages"),
        bytecode_cache=_compiled(),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.policies["json.dumps_kwargs"] = {"allow_nan": False}
    made.filters |= {"prose": _prose, "number": number, "base64": lambda data: base64.b64encode(data).decode()}
    return made


def _compiled() -> jinja2.BytecodeCache | None:
    """Cache of compiled templates in their own folder, as Python keeps its modules; None where it is read-only."""
    folder = Path(__file__).with_name("templates") / "__pycache__"
    with suppress(OSError):
        folder.mkdir(exist_ok=True)
    writable = os.access(folder, os.W_OK | os.X_OK) and not sys.dont_write_bytecode
    return jinja2.FileSystemBytecodeCache(str(folder)) if writable else None


@dataclass(frozen=True)
class Table:
    """Rows of cells, text or HTML; the columns named in `text` are left-aligned.

    `cut` is a sentence above a table that does not show all rows.
    """

    head: Sequence[str]
    rows: Sequence[Sequence[object]]
    text: Sequence[str] = ()
    cut: str = ""


def number(value: Any, digits: int = 4) -> str:
    """A number with `digits` significant digits; a dash for none."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if not isinstance(value, int | float) or not np.isfinite(value):
        return "–"
    return f"{value:.{digits}g}".replace("-", "−")


def fixed(value: float, decimals: int) -> str:
    """A number with `decimals` decimals, without a minus before zero."""
    text = f"{value:.{decimals}f}"
    return text.removeprefix("-") if float(text) == 0 else text.replace("-", "−")


def decimals_of(std: float) -> int:
    """Number of decimals that gives two digits of a standard deviation."""
    return int(np.clip(1 - np.floor(np.log10(std)), 0, 12))


def with_std(value: float, std: float | None, scale: float = 1.0) -> str:
    """Value and standard deviation, with two digits of the latter, as HTML."""
    value, std = scale * value, None if std is None else scale * std
    if std is None or not np.isfinite(std) or std <= 0:
        return number(value, 6)
    digits = decimals_of(std)
    return Markup(f"{value:.{digits}f} <small>± {std:.{digits}f}</small>".replace("-", "−"))


def records(rows: Any, columns: Sequence[tuple[str, str, int | None]], text_columns: int = 1) -> Table:
    """A table of mappings by columns (key, heading, decimals); missing keys are dashes."""
    found = [row for row in rows if isinstance(row, Mapping)] if isinstance(rows, list) else []
    cells = [[_cell(row.get(key), decimals) for key, _, decimals in columns] for row in found[:_MOST_ROWS]]
    head = [heading for _, heading, _ in columns]
    return Table(head, cells, head[:text_columns])


def listing(data: Any) -> Table:
    """A table of any section of rig.json: names, values, units."""
    rows = list(_flat(data)) if isinstance(data, Mapping) else []
    return Table(("what", "value", "unit"), rows[:_MOST_ROWS], ("what",))


def _cell(value: Any, decimals: int | None = None) -> str:
    if isinstance(value, str):
        return value
    if decimals is None or isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        return number(value)
    return fixed(value, decimals)


def _flat(data: Mapping[str, Any], before: str = "", depth: int = 0) -> Iterator[list[str]]:
    """Rows of a table of nested data; lists of lists, and what is deeper than three levels, are left out."""
    for key, value in data.items():
        name = f"{before}{key}"
        items = value if isinstance(value, list) else [value]
        if any(isinstance(item, Mapping) for item in items):
            for index, item in enumerate(items):
                if isinstance(item, Mapping) and depth < 3:
                    numbered = f"{name} {index + 1}" if isinstance(value, list) else name
                    yield from _flat(item, f"{numbered} · ", depth + 1)
        elif not any(isinstance(item, list) for item in items):
            yield _row(name, items)


def _row(name: str, values: Sequence[Any]) -> list[str]:
    label, unit, scale = labelled(name)
    numeric = bool(values) and all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
    written = ", ".join(number(scale * v) if numeric else _cell(v) for v in values)
    return [label, written or "–", unit if numeric else ""]


def labelled(name: str) -> tuple[str, str, float]:
    """A name of rig.json in words, the unit used on the page, and the factor to it; percent for a logarithm."""
    if name.startswith("log_"):
        return labelled(name.removeprefix("log_"))[0], "%", 100.0
    units = (
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
    found = next((unit for unit in units if name.endswith(unit[0]) or f"{unit[0]} ·" in name), None)
    suffix, unit, scale = found or ("", "", 1.0)
    return (name.replace(suffix, "", 1) if suffix else name).replace("_", " "), unit, scale
