"""The board that is taken where none is described."""

from __future__ import annotations

from .board import DICTIONARY_SIZES, BoardSpec
from .sheet_layout import MARGIN_MM, largest_square_mm
from .sheet_paper import Paper, floor_to

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

    def spec(square: float) -> BoardSpec:
        marker = MARKER_SHARE * square if marker_mm is None else marker_mm
        square_m, marker_m, thickness_m = (round(1e-3 * length, 12) for length in (square, marker, thickness_mm))
        return BoardSpec(columns, rows, square_m, marker_m, dictionary, legacy_pattern, thickness_m)

    if square_mm is not None:
        return spec(square_mm)
    if paper is None:
        return spec(_SCREEN_SQUARE_MM)
    # only squares and dictionary decide the room
    likely = BoardSpec(columns, rows, 1.0, MARKER_SHARE, dictionary, legacy_pattern)
    largest = largest_square_mm(likely, paper, margin_mm)
    if largest is None:
        raise ValueError(f"no board of {columns}x{rows} squares fits on {paper.name}; take fewer squares or more paper")
    return spec(_round_down(largest))


def _round_down(square_mm: float) -> float:
    """To 4 mm, below 12 mm to 1 mm, below 2 mm to 0.1 mm: then a module (an eighth) is a round number too."""
    step = 4.0 if square_mm >= 12 else 1.0 if square_mm >= 2 else 0.1
    return round(floor_to(square_mm, step), 6)
