"""The page with board, rulers, words and QR code, as PDF or SVG, in millimetres."""

from __future__ import annotations

import io
from collections.abc import Iterator
from xml.sax.saxutils import escape

from reportlab.pdfgen.canvas import FILL_EVEN_ODD, Canvas

from .board import BoardSpec
from .paper import Drawing, Label, Shape, Stroke
from .pattern import board_shapes, outlines, placed
from .sheet import LINE_SPACING, Layout, board_id, font_name, qr_modules, spec_line

TICK_WIDTH_MM, END_WIDTH_MM = 0.12, 0.2
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
    marks += [*_ruler_along_x(layout), *_ruler_along_y(layout), *_header(layout), _qr(spec, layout)]
    return Drawing(layout.width, layout.height, tuple(marks), f"ChArUco board {board_id(spec)}", spec_line(spec))


def ruler_origin(layout: Layout) -> tuple[float, float, float, float]:
    """x and y of the horizontal ruler's zero, then x and y of the vertical one's, mm from the page's corner."""
    low = layout.margin + layout.ruler
    x0 = low + (layout.width - layout.margin - low - layout.ruler_x) / 2
    top = layout.margin + layout.header_height
    bottom = layout.height - layout.margin - layout.ruler
    y0 = bottom - (bottom - top - layout.ruler_y) / 2
    return x0, bottom, low, y0


def _ruler_along_x(layout: Layout) -> Iterator[Stroke | Label]:
    (x0, y0, _, _), size = ruler_origin(layout), layout.size
    yield Stroke(x0, y0, x0 + layout.ruler_x, y0, TICK_WIDTH_MM)
    for at, length, width, number in _ticks(round(layout.ruler_x)):
        yield Stroke(x0 + at, y0, x0 + at, y0 + size * length, width)
        if number:
            yield Label(x0 + at, y0 + size * _BASELINE_MM, number, size * _NUMBER_MM, anchor="middle")
    yield Label(x0 + layout.ruler_x + size * _UNIT_MM, y0 + size * _BASELINE_MM, "mm", size * _NUMBER_MM)


def _ruler_along_y(layout: Layout) -> Iterator[Stroke | Label]:
    (_, _, x0, y0), size = ruler_origin(layout), layout.size
    beside, letters = x0 - size * (_TICKS_MM[10] + 0.4), size * _NUMBER_MM
    yield Stroke(x0, y0 - layout.ruler_y, x0, y0, TICK_WIDTH_MM)
    for at, length, width, number in _ticks(round(layout.ruler_y)):
        yield Stroke(x0 - size * length, y0 - at, x0, y0 - at, width)
        if number:
            yield Label(beside, y0 - at, number, letters, anchor="middle", turned=True)
    yield Label(beside, y0 - layout.ruler_y - size * _UNIT_MM, "mm", letters, turned=True)


def _ticks(length: int) -> Iterator[tuple[int, float, float, str]]:
    for at in range(length + 1):
        tick = max(size for every, size in _TICKS_MM.items() if at % every == 0)
        width = END_WIDTH_MM if at in (0, length) else TICK_WIDTH_MM
        yield at, tick, width, str(at) if at % 10 == 0 else ""


def _header(layout: Layout) -> Iterator[Label]:
    y = layout.margin
    for line in layout.header:
        yield Label(layout.margin, y + line.size_mm, line.text, line.size_mm, line.bold)
        y += LINE_SPACING * line.size_mm


def _qr(spec: BoardSpec, layout: Layout) -> Shape:
    dark = qr_modules(spec_line(spec))
    # the quiet zone counts as part of the code's room, so that the code ends where the text's margin does
    module = layout.qr / (len(dark) + _QR_QUIET)
    x = layout.width - layout.margin - module * len(dark)
    return Shape(placed(outlines(dark), module, x, layout.margin))


_PT_PER_MM = 72 / 25.4


def as_pdf(drawing: Drawing) -> bytes:
    """The PDF; the same drawing gives the same bytes."""
    stream = io.BytesIO()
    size = drawing.width_mm * _PT_PER_MM, drawing.height_mm * _PT_PER_MM
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
            path.moveTo(x * _PT_PER_MM, (height - y) * _PT_PER_MM)
            for u, v in rest:
                path.lineTo(u * _PT_PER_MM, (height - v) * _PT_PER_MM)
            path.close()
        canvas.drawPath(path, stroke=0, fill=1, fillMode=FILL_EVEN_ODD)
    elif isinstance(mark, Stroke):
        canvas.setLineWidth(mark.width * _PT_PER_MM)
        ends = (mark.x0, height - mark.y0, mark.x1, height - mark.y1)
        canvas.line(*(end * _PT_PER_MM for end in ends))
    else:
        canvas.saveState()
        canvas.setFont(font_name(mark.bold), mark.size_mm * _PT_PER_MM)
        canvas.translate(mark.x * _PT_PER_MM, (height - mark.y) * _PT_PER_MM)
        canvas.rotate(90 if mark.turned else 0)
        put = {"start": canvas.drawString, "middle": canvas.drawCentredString, "end": canvas.drawRightString}
        put[mark.anchor](0, 0, mark.text)
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
    weight = ' font-weight="bold"' if mark.bold else ""
    turn = f' transform="rotate(-90 {_number(mark.x)} {_number(mark.y)})"' if mark.turned else ""
    return (
        f'<text x="{_number(mark.x)}" y="{_number(mark.y)}" font-size="{_number(mark.size_mm)}" '
        f'text-anchor="{mark.anchor}"{weight}{turn}>{escape(mark.text)}</text>'
    )


def _number(value: float) -> str:
    return f"{value:.6f}".rstrip("0").rstrip(".")
