"""The board as a page with rulers, text and QR code (PDF, SVG), or for a screen in whole pixels."""

from __future__ import annotations

import io
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from xml.sax.saxutils import escape

import cv2
import numpy as np
from reportlab.graphics.barcode import qrencoder
from reportlab.pdfgen.canvas import FILL_EVEN_ODD, Canvas

from .board import AprilGrid, BoardWithIds, opencv_board, spec_line
from .sheet import PT_PER_MM, Area, Label, Loop, SheetLayout, Stroke, font_name


@dataclass(frozen=True)
class _RulerSettings:
    """Dimensions of a ruler, mm; and limits of a board's picture."""

    tick_width_mm: float = 0.12
    end_width_mm: float = 0.2  # of the two lines to measure between
    number_mm: float = 2.2  # height of its numbers
    baseline_mm: float = 4.0 + 0.75 * 2.2  # of the numbers: below the longest tick, at their height
    unit_mm: float = 2.6  # from the last tick, past half its number
    qr_quiet: int = 4  # modules of white around a QR code
    least_module_px: int = 2  # side of a marker's module in a picture
    most_pixels: int = 100_000_000  # of a picture


_RULER = _RulerSettings()


def _outlines(black: np.ndarray) -> tuple[Loop, ...]:
    """The outlines of the black cells of a (rows, columns) mask, in cells, to be filled by the rule `evenodd`.

    Neighbouring cells share an outline: viewers that smooth edges show hairlines between touching rectangles.
    """
    steps: defaultdict[tuple[int, int], list[tuple[int, int]]] = defaultdict(list)
    padded = np.pad(np.asarray(black, bool), 1)
    # edges below a cell run along x, edges beside it along y
    below, across = (np.argwhere(changes).tolist() for changes in (np.diff(padded, axis=0), np.diff(padded, axis=1)))
    for a, b in [((x - 1, y), (x, y)) for y, x in below] + [((x, y - 1), (x, y)) for y, x in across]:
        steps[a].append(b)
        steps[b].append(a)
    loops = []
    while steps:
        loop = [min(steps)]
        while len(loop) == 1 or loop[-1] != loop[0]:
            at, to = loop[-1], steps[loop[-1]].pop()
            steps[to].remove(at)
            for end in (at, to):
                if not steps[end]:
                    del steps[end]
            loop.append(to)
        ends = zip([loop[-2], *loop[:-2]], loop[:-1], loop[1:], strict=True)
        # only where it turns
        loops.append(tuple((x, y) for (ax, ay), (x, y), (bx, by) in ends if not (ax == x == bx or ay == y == by)))
    return tuple(loops)


def _board_shapes(spec: BoardWithIds) -> list[tuple[Loop, ...]]:
    """Outlines of all black squares, then of each marker, for the rule `evenodd`, mm from the print's first corner.

    The squares are one shape, since viewers snap single rectangles to whole pixels.
    """
    if isinstance(spec, AprilGrid):
        return _grid_shapes(spec)
    square, marker = 1e3 * spec.square_m, 1e3 * spec.marker_m
    board, black = opencv_board(spec), np.ones((spec.squares_y, spec.squares_x), bool)
    markers = []
    for number, corners in zip(np.ravel(board.getIds()), board.getObjPoints(), strict=True):
        column, row = (np.asarray(corners)[:, :2].mean(axis=0) // spec.square_m).astype(int).tolist()
        black[row, column] = False
        cells = cv2.aruco.generateImageMarker(board.getDictionary(), int(number), spec.modules) < 128
        at = (length * square + (square - marker) / 2 for length in (column, row))
        markers.append(_placed(_outlines(cells), marker / spec.modules, *at))
    return [_placed(_outlines(black), square, 0.0, 0.0), *markers]


def _grid_shapes(spec: AprilGrid) -> list[tuple[Loop, ...]]:
    """Outlines of an AprilGrid's squares and tags: Kalibr rotates its tags by half a turn relative to OpenCV's."""
    tag, gap = 1e3 * spec.tag_m, 1e3 * spec.pitch_m
    spots = [(column, row) for row in range(spec.rows + 1) for column in range(spec.columns + 1)]
    unit = _outlines(np.ones((1, 1), bool))
    squares = tuple(_placed(unit, gap, (tag + gap) * x, (tag + gap) * y)[0] for x, y in spots)
    family, shapes = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, spec.dictionary)), [squares]
    for index, number in enumerate(spec.marker_ids.tolist()):
        row, column = divmod(index, spec.columns)
        cells = cv2.aruco.generateImageMarker(family, number, spec.modules, borderBits=spec.border) < 128
        at = (gap + length * (tag + gap) for length in (column, row))
        shapes.append(_placed(_outlines(np.rot90(cells, 2)), tag / spec.modules, *at))
    return shapes


def _placed(loops: tuple[Loop, ...], scale: float, x: float, y: float) -> tuple[Loop, ...]:
    return tuple(tuple((x + scale * u, y + scale * v) for u, v in loop) for loop in loops)


def _drawn(spec: BoardWithIds, layout: SheetLayout) -> list[Area | Stroke | Label]:
    """The marks on a page: x from its left edge to the right, y from its top edge down, mm."""
    marks: list[Area | Stroke | Label] = [
        _placed(shape, 1.0, layout.board_x, layout.board_y) for shape in _board_shapes(spec)
    ]
    code = qrencoder.QRCode(None, qrencoder.QRErrorCorrectLevel.M)
    code.addData(spec_line(spec))
    code.make()
    count = code.getModuleCount()
    dark = np.array([[bool(code.isDark(row, column)) for column in range(count)] for row in range(count)])
    # the quiet zone is within the code's room, so that the code ends at the margin
    module = layout.qr / (len(dark) + _RULER.qr_quiet)
    qr = _placed(_outlines(dark), module, layout.width - layout.margin - module * len(dark), layout.margin)
    return [*marks, *_ruler(layout, turned=False), *_ruler(layout, turned=True), *layout.header, qr]


def _ruler_origin(layout: SheetLayout) -> tuple[float, float, float, float]:
    """x and y of the horizontal ruler's zero, then x and y of the vertical one's, mm from the page's corner."""
    low = layout.margin + layout.ruler
    x0 = low + (layout.width - layout.margin - low - layout.ruler_x) / 2
    top = layout.margin + layout.header_height
    bottom = layout.height - layout.margin - layout.ruler
    y0 = bottom - (bottom - top - layout.ruler_y) / 2
    return x0, bottom, low, y0


def _ruler(layout: SheetLayout, turned: bool) -> Iterator[Stroke | Label]:
    """The ruler along x, or `turned` the one along y: line, ticks, numbers and unit."""
    right, low, left, up = _ruler_origin(layout)
    size, letters = layout.size, layout.size * _RULER.number_mm
    length = layout.ruler_y if turned else layout.ruler_x
    # Length of the tick at every so many millimetres.
    ticks_mm = {1: 1.8, 5: 2.6, 10: 3.6}
    numbers = size * (ticks_mm[10] + 0.4) if turned else size * _RULER.baseline_mm

    def at(along: float, across: float) -> tuple[float, float]:
        return (left - across, up - along) if turned else (right + along, low + across)

    yield Stroke(*at(0, 0), *at(length, 0), _RULER.tick_width_mm)
    for place in range(round(length) + 1):
        tick = max(each for every, each in ticks_mm.items() if place % every == 0)
        width = _RULER.end_width_mm if place in (0, round(length)) else _RULER.tick_width_mm
        yield Stroke(*at(place, 0), *at(place, size * tick), width)
        if place % 10 == 0:
            yield Label(*at(place, numbers), str(place), letters, centred=True, turned=turned)
    yield Label(*at(length + size * _RULER.unit_mm, numbers), "mm", letters, turned=turned)


def as_pdf(spec: BoardWithIds, layout: SheetLayout) -> bytes:
    """The PDF of a board's sheet; the same board and layout give the same bytes."""
    stream = io.BytesIO()
    size = layout.width * PT_PER_MM, layout.height * PT_PER_MM
    canvas = Canvas(stream, pagesize=size, invariant=1, pageCompression=1, lang="en")
    canvas.setTitle(layout.header[0].text)
    canvas.setSubject(spec_line(spec))
    canvas.setAuthor("vbaa-calib")
    canvas.setCreator("vbaa board")
    canvas.setKeywords("calibration board")
    canvas.setViewerPreference("PrintScaling", "None")
    for mark in _drawn(spec, layout):
        _put(canvas, mark, layout.height)
    canvas.showPage()
    canvas.save()
    return stream.getvalue()


def _put(canvas: Canvas, mark: Area | Stroke | Label, height: float) -> None:
    if isinstance(mark, tuple):
        path = canvas.beginPath()
        for (x, y), *rest in mark:
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


def as_svg(spec: BoardWithIds, layout: SheetLayout) -> str:
    """The SVG of a board's sheet; one user unit is one millimetre."""
    width, height = (_number(side) for side in (layout.width, layout.height))
    return "\n".join(
        [
            '<?xml version="1.0" encoding="UTF-8"?>',
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}mm" height="{height}mm" '
            f'viewBox="0 0 {width} {height}">',
            f"<title>{escape(layout.header[0].text)}</title>",
            f"<desc>{escape(spec_line(spec))}</desc>",
            f'<rect width="{width}" height="{height}" fill="#fff"/>',
            '<g fill="#000" fill-rule="evenodd" font-family="Helvetica, Arial, sans-serif">',
            *(_element(mark) for mark in _drawn(spec, layout)),
            "</g>",
            "</svg>",
            "",
        ]
    )


def _element(mark: Area | Stroke | Label) -> str:
    if isinstance(mark, tuple):
        loops = ("M" + "L".join(f"{_number(x)},{_number(y)}" for x, y in loop) + "Z" for loop in mark)
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


@dataclass(frozen=True)
class _ScreenBoard:
    """A board in pixels: sides of its squares and markers, and the white margin, all whole numbers.

    `spec` has its true sizes on that screen, after rounding to whole pixels. Of an AprilGrid a square is a tag with its
    gap.
    """

    spec: BoardWithIds
    square_px: int
    marker_px: int
    margin_px: int

    @property
    def size_px(self) -> tuple[int, int]:
        spec, rest = self.spec, 2 * self.margin_px
        if isinstance(spec, AprilGrid):
            counts, rest = (spec.columns, spec.rows), rest + self.square_px - self.marker_px
        else:
            counts = spec.squares_x, spec.squares_y
        return counts[0] * self.square_px + rest, counts[1] * self.square_px + rest

    @property
    def pixels(self) -> np.ndarray:
        """(rows, columns) uint8 picture, black on white."""
        if isinstance(self.spec, AprilGrid):
            return np.pad(self.spec.drawing(self.marker_px), self.margin_px, constant_values=255)
        return np.asarray(opencv_board(self.spec).generateImage(self.size_px, marginSize=self.margin_px))


def on_screen(wanted: BoardWithIds, px_per_mm: float) -> _ScreenBoard:
    """The board nearest to the wanted one with squares, markers, modules and gaps of whole pixels.

    Raises ValueError where a module would be smaller than two pixels, or the picture too large.
    """
    low, high = (0.5, 500.0)
    if not low <= px_per_mm <= high:
        raise ValueError(f"the screen has {px_per_mm:g} pixels per mm: {low:g} to {high:g} are needed")
    if isinstance(wanted, AprilGrid):
        name, lengths_m = "tag", (wanted.tag_m, wanted.tag_m)
    else:
        name, lengths_m = "square", (wanted.square_m, wanted.marker_m)
    square, marker = (1e3 * length * px_per_mm for length in lengths_m)
    module = round(marker / wanted.modules)
    if module < _RULER.least_module_px:
        least = _RULER.least_module_px * wanted.modules / px_per_mm * square / marker
        raise ValueError(
            f"{name}s of {1e3 * lengths_m[0]:g} mm are {square:.1f} pixels there, too few to draw the markers; "
            f"take {name}s of {least:.3g} mm or more"
        )
    marker_px = module * wanted.modules
    if isinstance(wanted, AprilGrid):
        side = marker_px + max(1, round(wanted.spacing * marker_px))
        spacing = side / marker_px - 1.0
        spec: BoardWithIds = replace(wanted, tag_m=round(1e-3 * marker_px / px_per_mm, 12), spacing=round(spacing, 12))
    else:
        side = marker_px + 2 * max(1, round((square - marker_px) / 2))
        square_m, marker_m = (round(1e-3 * pixels / px_per_mm, 12) for pixels in (side, marker_px))
        spec = replace(wanted, square_m=square_m, marker_m=marker_m)
    board = _ScreenBoard(spec, side, marker_px, (side + 1) // 2)
    width, height = board.size_px
    if width * height > _RULER.most_pixels:
        raise ValueError(f"the picture would have {width} x {height} pixels, more than any screen")
    return board
