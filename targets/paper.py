"""Papers by name or by size, and the marks that a sheet is made of."""

from __future__ import annotations

import re
from dataclasses import dataclass

from .pattern import Loop

PAPERS_MM = {
    "A5": (148.0, 210.0),
    "A4": (210.0, 297.0),
    "Letter": (215.9, 279.4),
    "Legal": (215.9, 355.6),
    "A3": (297.0, 420.0),
    "Tabloid": (279.4, 431.8),
    "A2": (420.0, 594.0),
    "A1": (594.0, 841.0),
    "A0": (841.0, 1189.0),
}
"""Upright, the smallest first."""
_LEAST_MM, _MOST_MM = 60.0, 5000.0  # a PDF page without user units ends at 5080 mm


@dataclass(frozen=True)
class Paper:
    """A sheet of paper, upright: `width_mm` ≤ `height_mm`. `name` is how it was asked for."""

    name: str
    width_mm: float
    height_mm: float


def paper_named(text: str) -> Paper:
    """A paper by its name, or by its size such as 210x297, in mm. Raises ValueError."""
    for name, (width, height) in PAPERS_MM.items():
        if text.strip().lower() == name.lower():
            return Paper(name, width, height)
    number = r"(\d+(?:\.\d+)?)"
    found = re.fullmatch(rf"\s*{number}\s*[xX×]\s*{number}\s*(?:mm)?\s*", text)
    if not found:
        raise ValueError(
            f"paper is {text!r}: {', '.join(PAPERS_MM)} or width x height in mm, such as 300x200, is needed"
        )
    width, height = sorted(float(side) for side in found.groups())
    if width < _LEAST_MM or height > _MOST_MM:
        raise ValueError(f"paper is {text!r}: sides from {_LEAST_MM:g} to {_MOST_MM:g} mm are needed")
    return Paper(f"{width:g}x{height:g}", width, height)


@dataclass(frozen=True)
class Shape:
    """A black area: outlines in mm, filled by the even-odd rule."""

    loops: tuple[Loop, ...]


@dataclass(frozen=True)
class Stroke:
    """A straight line from (x0, y0) to (x1, y1), mm, with flat ends."""

    x0: float
    y0: float
    x1: float
    y1: float
    width: float


@dataclass(frozen=True)
class Label:
    """Text on a baseline that begins or is centred at (x, y) mm; `turned` reads upwards."""

    x: float
    y: float
    text: str
    size_mm: float
    bold: bool = False
    centred: bool = False
    turned: bool = False


@dataclass(frozen=True)
class Drawing:
    """A page: x from its left edge to the right, y from its top edge down, mm."""

    width_mm: float
    height_mm: float
    marks: tuple[Shape | Stroke | Label, ...]
    title: str
    subject: str
