"""A drawing as SVG, in millimetres."""

from __future__ import annotations

from xml.sax.saxutils import escape

from .sheet_paper import Drawing, Label, Shape, Stroke


def as_svg(drawing: Drawing) -> str:
    """The SVG; one user unit is one millimetre."""
    width, height = (_number(side) for side in (drawing.width_mm, drawing.height_mm))
    return "\n".join(
        [
            '<?xml version="1.0" encoding="UTF-8"?>',
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}mm" height="{height}mm" '
            f'viewBox="0 0 {width} {height}">',
            f"<title>{escape(drawing.title)}</title>",
            f"<desc>{escape(drawing.subject)}</desc>",
            f'<rect width="{width}" height="{height}" fill="#fff"/>',
            '<g fill="#000" fill-rule="evenodd" font-family="Helvetica, Arial, sans-serif">',
            *(_element(mark) for mark in drawing.marks),
            "</g>",
            "</svg>",
            "",
        ]
    )


def _element(mark: Shape | Stroke | Label) -> str:
    if isinstance(mark, Shape):
        loops = ("M" + "L".join(f"{_number(x)},{_number(y)}" for x, y in loop) + "Z" for loop in mark.loops)
        return f'<path d="{"".join(loops)}"/>'
    if isinstance(mark, Stroke):
        x0, y0, x1, y1, width = map(_number, (mark.x0, mark.y0, mark.x1, mark.y1, mark.width))
        return f'<line x1="{x0}" y1="{y0}" x2="{x1}" y2="{y1}" stroke="#000" stroke-width="{width}"/>'
    weight = ' font-weight="bold"' if mark.bold else ""
    turn = f' transform="rotate(-90 {_number(mark.x)} {_number(mark.y)})"' if mark.turned else ""
    return (
        f'<text x="{_number(mark.x)}" y="{_number(mark.y)}" font-size="{_number(mark.size_mm)}" '
        f'text-anchor="{mark.anchor}"{weight}{turn}>{escape(mark.text)}</text>'
    )


def _number(value: float) -> str:
    return f"{value:.6f}".rstrip("0").rstrip(".")
