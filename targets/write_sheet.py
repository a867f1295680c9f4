"""The page with board, rulers, words and QR code, as PDF or SVG, in millimetres."""

from __future__ import annotations

import io
from collections.abc import Iterator
from xml.sax.saxutils import escape

from reportlab.pdfgen.canvas import FILL_EVEN_ODD, Canvas

from .board import BoardSpec, spec_line
from .paper import Drawing, Label, Shape, Stroke
from .pattern import board_shapes, outlines, placed
from .sheet import PT_PER_MM, Layout, board_id, font_name, qr_modules

_TICK_WIDTH_MM, _END_WIDTH_MM = 0.12, 0.2
_TICKS_MM = {1: 1.8, 5: 2.6, 10: 3.6}
"""Length of the tick at every so many millimetres."""
_NUMBER_MM = 2.2
_BASELINE_MM = _TICKS_MM[10] + 0.4 + 0.75 * _NUMBER_MM
_UNIT_MM = 2.6  # from the last tick, past half its number
_QR_QUIET = 4


def draw(spec: BoardSpec, layout: Layout) -> Drawing:
    """The whole page."""
    marks: list[Shape | Stroke | Label] = [
        Shape(placed(shape, 1.0, layout.board_x, layout.board_y)) for shape in board_shapes(spec)
    ]
    marks += [*_ruler(layout, turned=False), *_ruler(layout, turned=True), *layout.header, _qr(spec, layout)]
    return Drawing(layout.width, layout.height, tuple(marks), f"ChArUco board {board_id(spec)}", spec_line(spec))


def ruler_origin(layout: Layout) -> tuple[float, float, float, float]:
    """x and y of the horizontal ruler's zero, then x and y of the vertical one's, mm from the page's corner."""
    low = layout.margin + layout.ruler
    x0 = low + (layout.width - layout.margin - low - layout.ruler_x) / 2
    top = layout.margin + layout.header_height
    bottom = layout.height - layout.margin - layout.ruler
    y0 = bottom - (bottom - top - layout.ruler_y) / 2
    return x0, bottom, low, y0


def _ruler(layout: Layout, turned: bool) -> Iterator[Stroke | Label]:
    """The ruler along x, or turned that along y: line, ticks, numbers and unit."""
    right, low, left, up = ruler_origin(layout)
    size, letters = layout.size, layout.size * _NUMBER_MM
    length = layout.ruler_y if turned else layout.ruler_x
    numbers = size * (_TICKS_MM[10] + 0.4) if turned else size * _BASELINE_MM

    def at(along: float, aside: float) -> tuple[float, float]:
        return (left - aside, up - along) if turned else (right + along, low + aside)

    yield Stroke(*at(0, 0), *at(length, 0), _TICK_WIDTH_MM)
    for place, tick, width, number in _ticks(round(length)):
        yield Stroke(*at(place, 0), *at(place, size * tick), width)
        if number:
            yield Label(*at(place, numbers), number, letters, centred=True, turned=turned)
    yield Label(*at(length + size * _UNIT_MM, numbers), "mm", letters, turned=turned)


def _ticks(length: int) -> Iterator[tuple[int, float, float, str]]:
    for at in range(length + 1):
        tick = max(size for every, size in _TICKS_MM.items() if at % every == 0)
        width = _END_WIDTH_MM if at in (0, length) else _TICK_WIDTH_MM
        yield at, tick, width, str(at) if at % 10 == 0 else ""


def _qr(spec: BoardSpec, layout: Layout) -> Shape:
    dark = qr_modules(spec_line(spec))
    # the quiet zone counts as part of the code's room, so that the code ends where the text's margin does
    module = layout.qr / (len(dark) + _QR_QUIET)
    x = layout.width - layout.margin - module * len(dark)
    return Shape(placed(outlines(dark), module, x, layout.margin))


def as_pdf(drawing: Drawing) -> bytes:
    """The PDF; the same drawing gives the same bytes."""
    stream = io.BytesIO()
    size = drawing.width_mm * PT_PER_MM, drawing.height_mm * PT_PER_MM
    canvas = Canvas(stream, pagesize=size, invariant=1, pageCompression=1, lang="en")
    canvas.setTitle(drawing.title)
    canvas.setSubject(drawing.subject)
    canvas.setAuthor("vbaa-calib")
    canvas.setCreator("vbaa board")
    canvas.setKeywords("ChArUco, calibration board")
    canvas.setViewerPreference("PrintScaling", "None")
    for mark in drawing.marks:
        _put(canvas, mark, drawing.height_mm)
    canvas.showPage()
    canvas.save()
    return stream.getvalue()


def _put(canvas: Canvas, mark: Shape | Stroke | Label, height: float) -> None:
    if isinstance(mark, Shape):
        path = canvas.beginPath()
        for (x, y), *rest in mark.loops:
            path.moveTo(x * PT_PER_MM, (height - y) * PT_PER_MM)
            for u, v in rest:
                path.lineTo(u * PT_PER_MM, (height - v) * PT_PER_MM)
            path.close()
        canvas.drawPath(path, stroke=0, fill=1, fillMode=FILL_EVEN_ODD)
    elif isinstance(mark, Stroke):
        canvas.setLineWidth(mark.width * PT_PER_MM)
        ends = (mark.x0, height - mark.y0, mark.x1, height - mark.y1)
        canvas.line(*(end * PT_PER_MM for end in ends))
    else:
        canvas.saveState()
        canvas.setFont(font_name(mark.bold), mark.size_mm * PT_PER_MM)
        canvas.translate(mark.x * PT_PER_MM, (height - mark.y) * PT_PER_MM)
        canvas.rotate(90 if mark.turned else 0)
        put = canvas.drawCentredString if mark.centred else canvas.drawString
        put(0, 0, mark.text)
        canvas.restoreState()


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
    anchor = "middle" if mark.centred else "start"
    weight = ' font-weight="bold"' if mark.bold else ""
    turn = f' transform="rotate(-90 {_number(mark.x)} {_number(mark.y)})"' if mark.turned else ""
    return (
        f'<text x="{_number(mark.x)}" y="{_number(mark.y)}" font-size="{_number(mark.size_mm)}" '
        f'text-anchor="{anchor}"{weight}{turn}>{escape(mark.text)}</text>'
    )


def _number(value: float) -> str:
    return f"{value:.6f}".rstrip("0").rstrip(".")
