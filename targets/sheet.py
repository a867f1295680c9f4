"""The printed board: papers, description in words and YAML, layout on a page, and the page's marks."""

from __future__ import annotations

import hashlib
import math
import re
from bisect import bisect_left
from dataclasses import dataclass, replace
from typing import Any

import yaml
from reportlab.lib.utils import simpleSplit

from .board import DICTIONARY_SIZES, AprilGrid, BoardSpec, BoardWithIds, spec_line

Loop = tuple[tuple[float, float], ...]
"""A closed polygon's corners (x, y), the last joined to the first."""
Area = tuple[Loop, ...]
"""A black area: outlines in mm, filled by the even–odd rule (SVG's and PDF's `evenodd`)."""
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


@dataclass(frozen=True)
class _PrintSettings:
    """Sizes on a printed sheet, mm."""

    least_mm: float = 60.0  # shorter side of a paper
    most_mm: float = 5000.0  # longer side of a paper: a PDF page without user units ends at 5080 mm
    margin_mm: float = 8.0  # that printers leave white
    most_margin_mm: float = 200.0
    ruler_mm: float = 8.0  # height of a ruler with its numbers
    ruler_end_mm: float = 5.5  # room past a ruler's end lines
    least_ruler_mm: float = 30.0
    qr_mm: float = 22.0  # side of the QR code
    gap_mm: float = 3.0  # between header, rulers and board
    least_quiet_mm: float = 5.0  # white around the board
    quiet_squares: float = 0.35  # the same, in squares of the board; the larger of both is left
    line_spacing: float = 1.35  # of the text, in its size
    # scales of rulers, text and QR code; the largest with which the board fits is taken
    sizes: tuple[float, ...] = (1.0, 0.9, 0.8, 0.7)
    squares: tuple[int, int] = (11, 7)  # of a board: with an odd number of rows OpenCV's old and new patterns agree
    marker_share: float = 0.75  # of the square: a marker of six modules then has a white margin of one
    family: str = "DICT_4X4"  # of dictionaries
    usual_markers: int = 100  # that a board's dictionary has at least
    screen_square_mm: float = 20.0  # of a board on a screen


SHEET = _PrintSettings()


def paper_named(text: str) -> tuple[float, float]:
    """Width and height, mm, of an upright paper by its name, or by its size such as 210x297. Raises ValueError."""
    for name, size in PAPERS_MM.items():
        if text.strip().lower() == name.lower():
            return size
    number = r"(\d+(?:\.\d+)?)"
    found = re.fullmatch(rf"\s*{number}\s*[xX×]\s*{number}\s*(?:mm)?\s*", text)
    if not found:
        raise ValueError(
            f"paper is {text!r}: {', '.join(PAPERS_MM)} or width x height in mm, such as 300x200, is needed"
        )
    width, height = sorted(float(side) for side in found.groups())
    if width < SHEET.least_mm or height > SHEET.most_mm:
        raise ValueError(f"paper is {text!r}: sides from {SHEET.least_mm:g} to {SHEET.most_mm:g} mm are needed")
    return width, height


def paper_name(paper: tuple[float, float]) -> str:
    """The name of a paper of width and height, mm, such as A4, or 300x200 where it has none."""
    return next((name for name, size in PAPERS_MM.items() if size == paper), f"{paper[0]:g}x{paper[1]:g}")


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
    """Text on a baseline that starts or is centred at (x, y) mm; `turned` text reads upwards."""

    x: float
    y: float
    text: str
    size_mm: float
    bold: bool = False
    centred: bool = False
    turned: bool = False


def board_id(spec: BoardWithIds) -> str:
    """Eight hexadecimal digits that identify the print.

    Lengths count to the nanometre; the mount's thickness does not count, nor the legacy flag where both patterns agree.
    """
    if isinstance(spec, AprilGrid):
        text = str(replace(spec, thickness_m=0.0, stretch=0.0, stretch_std=None).to_dict())
    else:
        lengths = [round(1e9 * length) for length in (spec.square_m, spec.marker_m)]
        text = f"charuco {spec.squares_x} {spec.squares_y} {lengths} {spec.dictionary} {spec.starts_with_marker}"
        text += f" {spec.marker_ids.tolist()}" if spec.first_id or spec.ids else ""
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def _title(spec: BoardWithIds) -> str:
    """Kind and id of the board."""
    return f"{'AprilGrid' if isinstance(spec, AprilGrid) else 'ChArUco board'} {board_id(spec)}"


def spec_document(spec: BoardWithIds, note: str = "") -> str:
    """The text of board.yaml, with a comment on top."""
    head = f"# {_title(spec)}" + (f", {note}" if note else "")
    return f"{head}\n{yaml.safe_dump(spec.to_dict(), sort_keys=False)}"


def size_words(spec: BoardWithIds) -> str:
    """Squares or tags, markers and dictionary in words."""
    if isinstance(spec, AprilGrid):
        tags = f"{spec.columns} × {spec.rows} tags of {1e3 * spec.tag_m:.6g} mm, {1e3 * spec.pitch_m:.6g} mm apart"
        return f"{tags}, {spec.dictionary}, ids from {spec.first_id}"
    pattern = f", ids from {spec.first_id}" if spec.first_id else ""
    if spec.squares_y % 2 == 0:
        pattern += (
            ", legacy pattern (OpenCV before 4.6)" if spec.legacy_pattern else ", pattern of OpenCV 4.6 and later"
        )
    return (
        f"{spec.squares_x} × {spec.squares_y} squares of {1e3 * spec.square_m:.6g} mm, "
        f"markers of {1e3 * spec.marker_m:.6g} mm, {spec.dictionary}{pattern}"
    )


PT_PER_MM = 72 / 25.4


@dataclass(frozen=True)
class SheetLayout:
    """Dimensions of a sheet, mm, from the page's upper left corner.

    board_x, board_y : the board's first corner. quiet : least white margin around the board.
    ruler_x, ruler_y : lengths of the rulers along x and y.
    header : lines of text; `header_height` is the room for them and the QR code next to them.
    size : scale of rulers, text and QR code.
    """

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
    header: tuple[Label, ...]
    header_height: float
    size: float

    @property
    def ruler(self) -> float:
        """Space for a ruler, across it, mm."""
        return SHEET.ruler_mm * self.size

    @property
    def qr(self) -> float:
        return SHEET.qr_mm * self.size

    @property
    def orientation(self) -> str:
        return "landscape" if self.width > self.height else "portrait"


def font_name(bold: bool) -> str:
    """One of the fonts that every PDF viewer has."""
    return "Helvetica-Bold" if bold else "Helvetica"


def lay_out(spec: BoardWithIds, paper: tuple[float, float], margin_mm: float = SHEET.margin_mm) -> SheetLayout:
    """The layout of a board on a paper, in the orientation that leaves more space.

    Raises ValueError if it does not fit, with the largest fitting square and the smallest sufficient paper.
    """
    fitting = _fitting(spec, paper, margin_mm)
    if fitting is not None:
        return fitting
    width, height = (1e3 * side for side in spec.size_m)
    name = "tag" if isinstance(spec, AprilGrid) else "square"
    counts = (spec.columns, spec.rows) if isinstance(spec, AprilGrid) else (spec.squares_x, spec.squares_y)
    square = _largest_square_mm(spec, paper, margin_mm)
    none = f"no board of {counts[0]}x{counts[1]} {name}s does"
    smaller = f"the largest {name} that fits is {square:g} mm" if square else none
    larger = (name for name, size in PAPERS_MM.items() if _fitting(spec, size, margin_mm))
    raise ValueError(
        f"a board of {width:.6g} x {height:.6g} mm with its rulers does not fit on {paper_name(paper)}: {smaller}; "
        f"{next(larger, 'no paper up to A0')} would do"
    )


def _largest_square_mm(spec: BoardWithIds, paper: tuple[float, float], margin_mm: float) -> float | None:
    """The largest square or tag, in steps of 0.1 mm, with which a board of this layout fits; None if none does."""

    def is_too_large(tenths: int) -> bool:
        side_m = 1e-3 * tenths * 0.1
        if isinstance(spec, AprilGrid):
            return _fitting(replace(spec, tag_m=side_m), paper, margin_mm) is None
        marker_m = spec.marker_m / spec.square_m * side_m
        return _fitting(replace(spec, square_m=side_m, marker_m=marker_m), paper, margin_mm) is None

    tenths = bisect_left(range(1, int(paper[1] / 0.1 / 2) + 1), True, key=is_too_large)
    return round(tenths * 0.1, 6) if tenths else None


def _fitting(spec: BoardWithIds, paper: tuple[float, float], margin: float) -> SheetLayout | None:
    if not 0 <= margin <= SHEET.most_margin_mm:
        raise ValueError(f"the margin is {margin:g} mm: 0 to {SHEET.most_margin_mm:g} mm are needed")
    pages = [paper, paper[::-1]]
    for size in SHEET.sizes:
        layouts = [layout for page in pages if (layout := _on_page(spec, page, margin, size)) is not None]
        if layouts:
            # the one with the most white around the board
            return max(
                layouts,
                key=lambda layout: min(
                    layout.width - layout.board_width, layout.height - layout.board_height - layout.header_height
                ),
            )
    return None


def _on_page(spec: BoardWithIds, page: tuple[float, float], margin: float, size: float) -> SheetLayout | None:
    width, height = page
    ruler, end = SHEET.ruler_mm * size, SHEET.ruler_end_mm * size
    text_width = width - 2 * margin - SHEET.qr_mm * size - SHEET.gap_mm
    if text_width < 15:
        return None
    header = _header(spec, margin, text_width, size)
    header_height = max(SHEET.qr_mm * size, SHEET.line_spacing * sum(line.size_mm for line in header))
    side_m = spec.tag_m if isinstance(spec, AprilGrid) else spec.square_m
    quiet = max(SHEET.least_quiet_mm, SHEET.quiet_squares * 1e3 * side_m)
    board_width, board_height = (1e3 * side for side in spec.size_m)
    left, right = margin + ruler + quiet, margin + quiet
    top, bottom = margin + header_height + quiet, margin + ruler + quiet
    # whole centimetres, with room for the unit behind the last number
    ruler_x = _floor_to(width - margin - ruler - margin - 2 * end, 10.0)
    ruler_y = _floor_to(height - margin - header_height - SHEET.gap_mm - ruler - margin - 2 * end, 10.0)
    free = 1e-9 + width - left - right - board_width, 1e-9 + height - top - bottom - board_height
    if min(free) < 0 or min(ruler_x, ruler_y) < SHEET.least_ruler_mm:
        return None
    # in the page's middle, or as near to it as the rulers let it
    board_x = max(left, (width - board_width) / 2)
    board_y = min(max(top, (height - board_height) / 2), height - bottom - board_height)
    board = board_x, board_y, board_width, board_height
    return SheetLayout(width, height, margin, quiet, *board, ruler_x, ruler_y, header, header_height, size)


def _header(spec: BoardWithIds, margin: float, width_mm: float, size: float) -> tuple[Label, ...]:
    advice = (
        "Print at 100 % (“actual size”), not fitted to the page. Then measure both rulers from end line to end line, "
        "best with a caliper."
    )
    texts = (
        (_title(spec), 4.2, True),
        (size_words(spec), 3.0, False),
        (spec_line(spec), 2.1, False),
        (advice, 2.6, False),
    )
    labels, y = [], margin
    for text, usual, bold in texts:
        letters = size * usual
        for line in simpleSplit(text, font_name(bold), letters * PT_PER_MM, width_mm * PT_PER_MM):
            labels.append(Label(margin, y + letters, line, letters, bold))
            y += SHEET.line_spacing * letters
    return tuple(labels)


def _floor_to(value: float, step: float) -> float:
    """The largest multiple of `step` up to `value`, with tolerance for rounding."""
    return step * math.floor(value / step + 1e-9)


def fill_in(
    squares: tuple[int, int] | None = None,
    square_mm: float | None = None,
    marker_mm: float | None = None,
    paper: tuple[float, float] | None = None,
    margin_mm: float = SHEET.margin_mm,
    **other: Any,
) -> BoardSpec:
    """A spec from partial data; the default square is the largest round one that fits on the paper, 20 mm without a
    paper.

    other : further fields of BoardSpec. Raises ValueError if they make no board, or none fits.
    """
    columns, rows = squares or SHEET.squares
    other |= {"squares_x": columns, "squares_y": rows}
    if other.get("dictionary") is None:
        enough = [size for size in DICTIONARY_SIZES if size >= max(SHEET.usual_markers, columns * rows // 2)]
        if not enough:
            most = 2 * DICTIONARY_SIZES[-1] + 1
            raise ValueError(f"{columns}x{rows} squares are too many: at most {most} have markers")
        other["dictionary"] = f"{SHEET.family}_{enough[0]}"
    if square_mm is None and paper is not None:
        # the room depends on squares and dictionary only
        largest = _largest_square_mm(BoardSpec(square_m=1.0, marker_m=SHEET.marker_share, **other), paper, margin_mm)
        if largest is None:
            what = f"no board of {columns}x{rows} squares fits on {paper_name(paper)}"
            raise ValueError(f"{what}; take fewer squares or more paper")
        # a module (an eighth) is then round, too
        square_mm = round(_floor_to(largest, 4.0 if largest >= 12 else 1.0 if largest >= 2 else 0.1), 6)
    square = SHEET.screen_square_mm if square_mm is None else square_mm
    marker = SHEET.marker_share * square if marker_mm is None else marker_mm
    return BoardSpec(square_m=round(1e-3 * square, 12), marker_m=round(1e-3 * marker, 12), **other)
