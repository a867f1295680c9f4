"""A sheet's marks: the board, the rulers along both axes, the text and the QR code."""

from __future__ import annotations

from collections.abc import Iterator

from .board import BoardSpec
from .sheet_layout import LINE_SPACING, Layout
from .sheet_paper import Drawing, Label, Shape, Stroke
from .sheet_pattern import board_shapes, outlines, placed
from .sheet_words import board_id, qr_modules, spec_line

TICK_WIDTH_MM, END_WIDTH_MM = 0.12, 0.2
TICKS_MM = {1: 1.8, 5: 2.6, 10: 3.6}
"""Length of the tick at every so many millimetres."""
NUMBER_MM = 2.2
_BASELINE_MM = TICKS_MM[10] + 0.4 + 0.75 * NUMBER_MM
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
            yield Label(x0 + at, y0 + size * _BASELINE_MM, number, size * NUMBER_MM, anchor="middle")
    yield Label(x0 + layout.ruler_x + size * _UNIT_MM, y0 + size * _BASELINE_MM, "mm", size * NUMBER_MM)


def _ruler_along_y(layout: Layout) -> Iterator[Stroke | Label]:
    (_, _, x0, y0), size = ruler_origin(layout), layout.size
    beside, letters = x0 - size * (TICKS_MM[10] + 0.4), size * NUMBER_MM
    yield Stroke(x0, y0 - layout.ruler_y, x0, y0, TICK_WIDTH_MM)
    for at, length, width, number in _ticks(round(layout.ruler_y)):
        yield Stroke(x0 - size * length, y0 - at, x0, y0 - at, width)
        if number:
            yield Label(beside, y0 - at, number, letters, anchor="middle", turned=True)
    yield Label(beside, y0 - layout.ruler_y - size * _UNIT_MM, "mm", letters, turned=True)


def _ticks(length: int) -> Iterator[tuple[int, float, float, str]]:
    for at in range(length + 1):
        tick = max(size for every, size in TICKS_MM.items() if at % every == 0)
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
