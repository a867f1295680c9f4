"""The board for a screen: whole pixels everywhere, and a spec that says what it is; and boards chosen for a paper."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from targets.board import BoardSpec, corner_points, opencv_board
from targets.sheet import PAPERS_MM, fill_in, lay_out, paper_named
from targets.write_sheet import as_pixels, on_screen


@pytest.mark.parametrize("seed", range(6))
def test_every_module_is_whole_pixels(seed: int) -> None:
    """For random boards and densities: reduced to one pixel a module, then enlarged, the picture is the same."""
    rng = np.random.default_rng(seed)
    bits, square = int(rng.integers(4, 8)), float(rng.uniform(0.015, 0.03))
    marker, counts = square * float(rng.uniform(0.6, 0.85)), rng.integers(3, 10, 2).tolist()
    density = float(rng.uniform(3, 8))
    board = on_screen(BoardSpec(*counts, square, marker, f"DICT_{bits}X{bits}_250", bool(rng.integers(2))), density)
    module, gap = board.marker_px // (bits + 2), (board.square_px - board.marker_px) // 2
    side = board.square_px
    assert (board.marker_px, side) == (module * (bits + 2), board.marker_px + 2 * gap)
    picture = as_pixels(board)[board.margin_px : -board.margin_px, board.margin_px : -board.margin_px]
    for square_px in picture.reshape(counts[1], side, counts[0], side).swapaxes(1, 2).reshape(-1, side, side):
        inner = square_px[gap:-gap, gap:-gap]
        assert (np.kron(inner[::module, ::module], np.ones((module, module))) == inner).all()
    assert board.spec.square_m == pytest.approx(1e-3 * side / density, abs=1e-11)
    assert abs(side - 1e3 * square * density) <= (bits + 2) / 2 + 1


def test_corners_are_found_where_the_spec_says() -> None:
    """A detector's corners, in mm by the pixel density, against the spec that is written."""
    density = 110 / 25.4
    board = on_screen(BoardSpec(9, 6, 0.0213, 0.0157, legacy_pattern=True), density)
    corners, ids, _, _ = cv2.aruco.CharucoDetector(opencv_board(board.spec)).detectBoard(as_pixels(board))
    found = (np.reshape(corners, (-1, 2)) + 0.5 - board.margin_px) / density
    assert len(found) == board.spec.corner_count
    assert np.abs(found - 1e3 * corner_points(board.spec)[np.ravel(ids), :2]).max() < 0.02


def test_what_no_screen_shows_is_refused() -> None:
    """Too coarse, and the size named does do; too many pixels."""
    with pytest.raises(ValueError, match=r"too few to draw the markers; take squares of 8 mm or more"):
        on_screen(BoardSpec(9, 6, 0.004, 0.003), 2.0)
    on_screen(BoardSpec(9, 6, 0.008, 0.006), 2.0)
    with pytest.raises(ValueError, match="more than any screen"):
        on_screen(BoardSpec(40, 40, 0.02, 0.015, "DICT_4X4_1000"), 30.0)


def test_default_boards_fit_their_paper_and_are_odd() -> None:
    """Whatever the paper: an odd number of rows, for which the legacy flag means nothing, and a round square."""
    squares = {}
    for name in [*PAPERS_MM, "100x150", "3000x2000"]:
        spec = fill_in(paper=paper_named(name))
        lay_out(spec, paper_named(name))
        assert spec.squares_y % 2 == 1
        squares[name] = round(1e3 * spec.square_m, 6)
    assert (squares["A4"], squares["Letter"], squares["A3"]) == (20.0, 20.0, 32.0)


def test_what_is_given_is_kept() -> None:
    """And the dictionary grows with the board."""
    spec = fill_in((9, 6), 24.0, 17.0, dictionary="DICT_5X5_50", legacy_pattern=True, thickness_m=0.0031)
    assert spec == BoardSpec(9, 6, 0.024, 0.017, "DICT_5X5_50", True, 0.0031)
    assert fill_in((20, 30), 10.0).dictionary == "DICT_4X4_1000"
