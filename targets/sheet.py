"""The printed board: its sizes, its description in words and YAML, and its layout on a page."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import yaml
from reportlab.graphics.barcode import qrencoder
from reportlab.lib.utils import simpleSplit

from .board import DICTIONARY_SIZES, BoardSpec
from .paper import PAPERS_MM, Paper, floor_to


def _legacy_matters(spec: BoardSpec) -> bool:
    """Whether OpenCV's old and new pattern differ for this board: for an even number of rows only."""
    return spec.squares_y % 2 == 0


def board_id(spec: BoardSpec) -> str:
    """Eight hexadecimal digits that stand for what is printed: the same for the same print, always.

    Lengths count to the nanometre. The thickness is the mount's, not the print's, and does not count; nor does the
    legacy flag where both patterns are the same.
    """
    lengths = [round(1e9 * length) for length in (spec.square_m, spec.marker_m)]
    legacy = spec.legacy_pattern and _legacy_matters(spec)
    text = f"charuco {spec.squares_x} {spec.squares_y} {lengths} {spec.dictionary} {legacy}"
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def spec_line(spec: BoardSpec) -> str:
    """The specification as one line of YAML: what the QR code holds, and a board.yaml as it stands."""
    return yaml.safe_dump(spec.to_dict(), default_flow_style=True, sort_keys=False, width=10**6).strip()


def spec_document(spec: BoardSpec, note: str = "") -> str:
    """board.yaml: the keys one a line, with a remark on top."""
    head = f"# ChArUco board {board_id(spec)}" + (f", {note}" if note else "")
    return f"{head}\n{yaml.safe_dump(spec.to_dict(), sort_keys=False)}"


def size_words(spec: BoardSpec) -> str:
    """Squares, markers and dictionary for a person."""
    pattern = ""
    if _legacy_matters(spec):
        pattern = ", legacy pattern (OpenCV before 4.6)" if spec.legacy_pattern else ", pattern of OpenCV 4.6 and later"
    return (
        f"{spec.squares_x} × {spec.squares_y} squares of {1e3 * spec.square_m:.6g} mm, "
        f"markers of {1e3 * spec.marker_m:.6g} mm, {spec.dictionary}{pattern}"
    )


def qr_modules(text: str) -> np.ndarray:
    """(n, n) bool, true where the QR code is dark; its quiet zone of four modules is for the caller to leave."""
    code = qrencoder.QRCode(None, qrencoder.QRErrorCorrectLevel.M)
    code.addData(text)
    code.make()
    count = code.getModuleCount()
    return np.array([[bool(code.isDark(row, column)) for column in range(count)] for row in range(count)])


MARGIN_MM = 8.0
_MOST_MARGIN_MM = 200.0
_RULER_MM = 8.0
_QR_MM = 22.0
_GAP_MM = 3.0
SIZES = (1.0, 0.9, 0.8, 0.7)
"""Rulers, words and QR code are drawn so many times as large, the largest with which the board fits."""
LEAST_QUIET_MM, QUIET_SQUARES = 5.0, 0.35
_LEAST_RULER_MM = 30.0
_RULER_END_MM = 5.5
LINE_SPACING = 1.35
_PT_PER_MM = 72 / 25.4
_ADVICE = (
    "Print at 100 % (“actual size”), not fitted to the page. Then measure both rulers from end line to end line, "
    "best with a caliper."
)


@dataclass(frozen=True)
class Line:
    """A line of the header: its text, its size and whether it is bold."""

    text: str
    size_mm: float
    bold: bool = False


@dataclass(frozen=True)
class Layout:
    """A sheet's measures, mm, from the page's upper left corner.

    Attributes
    ----------
    board_x, board_y : the board's first corner. quiet : white that is kept around the board, at least.
    ruler_x, ruler_y : lengths of the rulers along x and y.
    header : lines of text; their room is `header_height`, which the QR code beside them may need too.
    size : of rulers, words and QR code, as a part of the usual.
    """

    paper: Paper
    width: float
    height: float
    margin: float
    quiet: float
    board_x: float
    board_y: float
    board_width: float
    board_height: float
    ruler_x: float
    ruler_y: float
    header: tuple[Line, ...]
    header_height: float
    size: float = 1.0

    @property
    def ruler(self) -> float:
        """Room for a ruler, across it."""
        return _RULER_MM * self.size

    @property
    def qr(self) -> float:
        """Room for the QR code."""
        return _QR_MM * self.size

    @property
    def orientation(self) -> str:
        """portrait or landscape."""
        return "landscape" if self.width > self.height else "portrait"


def _header_lines(spec: BoardSpec, width_mm: float, size: float = 1.0) -> tuple[Line, ...]:
    """What the header says, broken into lines of at most `width_mm`; the letters so many times as large as usual."""
    wanted = [
        Line(f"ChArUco board {board_id(spec)}", 4.2, bold=True),
        Line(size_words(spec), 3.0),
        Line(spec_line(spec), 2.1),
        Line(_ADVICE, 2.6),
    ]
    return tuple(
        replace(line, text=text)
        for line in (replace(line, size_mm=size * line.size_mm) for line in wanted)
        for text in simpleSplit(line.text, font_name(line.bold), line.size_mm * _PT_PER_MM, width_mm * _PT_PER_MM)
    )


def font_name(bold: bool) -> str:
    """One of the fonts that every PDF viewer has."""
    return "Helvetica-Bold" if bold else "Helvetica"


def _quiet_mm(spec: BoardSpec) -> float:
    """White around the board."""
    return max(LEAST_QUIET_MM, QUIET_SQUARES * 1e3 * spec.square_m)


def lay_out(spec: BoardSpec, paper: Paper, margin_mm: float = MARGIN_MM) -> Layout:
    """The sheet for a board on a paper, upright or lying, whichever leaves more room.

    Raises ValueError where it does not fit, with the largest square that would and the paper that would do.
    """
    _check_margin(margin_mm)
    fitting = _fitting(spec, paper, margin_mm)
    if fitting is not None:
        return fitting
    width, height = (1e3 * spec.square_m * count for count in (spec.squares_x, spec.squares_y))
    raise ValueError(
        f"a board of {width:.6g} x {height:.6g} mm with its rulers does not fit on {paper.name}: "
        + " ".join([_largest_words(spec, paper, margin_mm), _paper_words(spec, margin_mm)])
    )


def _check_margin(margin_mm: float) -> None:
    if not 0 <= margin_mm <= _MOST_MARGIN_MM:
        raise ValueError(f"the margin is {margin_mm:g} mm: 0 to {_MOST_MARGIN_MM:g} mm are needed")


def _largest_words(spec: BoardSpec, paper: Paper, margin_mm: float) -> str:
    square = largest_square_mm(spec, paper, margin_mm)
    if square is None:
        return f"no board of {spec.squares_x}x{spec.squares_y} squares does;"
    return f"the largest square that fits is {square:g} mm;"


def _paper_words(spec: BoardSpec, margin_mm: float) -> str:
    papers = (Paper(name, *size) for name, size in PAPERS_MM.items())
    name = next((paper.name for paper in papers if _fitting(spec, paper, margin_mm)), None)
    return f"{name} would do" if name else "no paper up to A0 would do"


def largest_square_mm(spec: BoardSpec, paper: Paper, margin_mm: float, step_mm: float = 0.1) -> float | None:
    """The largest square, a multiple of the step, with which a board of this layout fits; None where none does."""
    _check_margin(margin_mm)
    ratio = spec.marker_m / spec.square_m

    def fits(steps: int) -> bool:
        square_m = 1e-3 * steps * step_mm
        return _fitting(replace(spec, square_m=square_m, marker_m=ratio * square_m), paper, margin_mm) is not None

    low, high = 0, int(paper.height_mm / step_mm / 2) + 1
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if fits(middle) else (low, middle)
    return round(low * step_mm, 6) if low else None


def _fitting(spec: BoardSpec, paper: Paper, margin: float) -> Layout | None:
    pages = [(paper.width_mm, paper.height_mm), (paper.height_mm, paper.width_mm)]
    for size in SIZES:
        layouts = [layout for page in pages if (layout := _on_page(spec, paper, page, margin, size)) is not None]
        if layouts:
            return max(layouts, key=_room)
    return None


def _room(layout: Layout) -> float:
    return min(layout.width - layout.board_width, layout.height - layout.board_height - layout.header_height)


def _on_page(spec: BoardSpec, paper: Paper, page: tuple[float, float], margin: float, size: float) -> Layout | None:
    width, height = page
    ruler, end = _RULER_MM * size, _RULER_END_MM * size
    text_width = width - 2 * margin - _QR_MM * size - _GAP_MM
    if text_width < 15:
        return None
    header = _header_lines(spec, text_width, size)
    header_height = max(_QR_MM * size, LINE_SPACING * sum(line.size_mm for line in header))
    quiet = _quiet_mm(spec)
    board_width, board_height = (1e3 * spec.square_m * count for count in (spec.squares_x, spec.squares_y))
    left, right = margin + ruler + quiet, margin + quiet
    top, bottom = margin + header_height + quiet, margin + ruler + quiet
    # whole centimetres, with room for the unit behind the last number
    ruler_x = floor_to(width - margin - ruler - margin - 2 * end, 10.0)
    ruler_y = floor_to(height - margin - header_height - _GAP_MM - ruler - margin - 2 * end, 10.0)
    free = 1e-9 + width - left - right - board_width, 1e-9 + height - top - bottom - board_height
    if min(free) < 0 or min(ruler_x, ruler_y) < _LEAST_RULER_MM:
        return None
    return Layout(
        paper,
        width,
        height,
        margin,
        quiet,
        # in the page's middle, or as near to it as the rulers let it
        board_x=max(left, (width - board_width) / 2),
        board_y=min(max(top, (height - board_height) / 2), height - bottom - board_height),
        board_width=board_width,
        board_height=board_height,
        ruler_x=ruler_x,
        ruler_y=ruler_y,
        header=header,
        header_height=header_height,
        size=size,
    )


# Odd by odd: with an odd number of rows OpenCV's old and new patterns are the same, so that the legacy flag cannot be
# wrong. 60 corners, and 38 markers that one picture need not show all.
SQUARES = (11, 7)
# Three quarters: a marker of six modules leaves white of one module around itself.
MARKER_SHARE = 0.75
_FAMILY, _USUAL = "DICT_4X4", 100
_SCREEN_SQUARE_MM = 20.0


def fill_in(
    squares: tuple[int, int] | None = None,
    square_mm: float | None = None,
    marker_mm: float | None = None,
    dictionary: str | None = None,
    legacy_pattern: bool = False,
    thickness_mm: float = 0.0,
    paper: Paper | None = None,
    margin_mm: float = MARGIN_MM,
) -> BoardSpec:
    """The spec with what was left out filled in: the largest round square that fits on the paper, or 20 mm without one.

    Raises ValueError where that makes no board, or where none fits.
    """
    columns, rows = squares or SQUARES
    if dictionary is None:
        enough = [size for size in DICTIONARY_SIZES if size >= max(_USUAL, columns * rows // 2)]
        if not enough:
            raise ValueError(
                f"{columns}x{rows} squares are too many: at most {2 * DICTIONARY_SIZES[-1] + 1} have markers"
            )
        dictionary = f"{_FAMILY}_{enough[0]}"

    pattern: dict[str, Any] = {
        "squares_x": columns,
        "squares_y": rows,
        "dictionary": dictionary,
        "legacy_pattern": legacy_pattern,
    }

    def spec(square: float) -> BoardSpec:
        marker = MARKER_SHARE * square if marker_mm is None else marker_mm
        square_m, marker_m, thickness_m = (round(1e-3 * length, 12) for length in (square, marker, thickness_mm))
        return BoardSpec(**pattern, square_m=square_m, marker_m=marker_m, thickness_m=thickness_m)

    if square_mm is not None:
        return spec(square_mm)
    if paper is None:
        return spec(_SCREEN_SQUARE_MM)
    # only squares and dictionary decide the room
    likely = BoardSpec(**pattern, square_m=1.0, marker_m=MARKER_SHARE)
    largest = largest_square_mm(likely, paper, margin_mm)
    if largest is None:
        raise ValueError(f"no board of {columns}x{rows} squares fits on {paper.name}; take fewer squares or more paper")
    return spec(_round_down(largest))


def _round_down(square_mm: float) -> float:
    """To 4 mm, below 12 mm to 1 mm, below 2 mm to 0.1 mm: then a module (an eighth) is a round number too."""
    step = 4.0 if square_mm >= 12 else 1.0 if square_mm >= 2 else 0.1
    return round(floor_to(square_mm, step), 6)
