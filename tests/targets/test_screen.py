"""The board for a screen: whole pixels everywhere, and a spec that says what it is."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from targets.board import BoardSpec, corner_points, opencv_board
from targets.paper import PAPERS_MM, paper_named
from targets.screen import as_pixels, on_screen
from targets.sheet import MARKER_SHARE, SQUARES, fill_in, lay_out


@pytest.mark.parametrize("seed", range(12))
def test_pixels_are_those_of_opencv(seed: int) -> None:
    """For random boards and pixel densities."""
    rng = np.random.default_rng(seed)
    bits = int(rng.integers(4, 8))
    square = float(rng.uniform(0.015, 0.03))
    spec = BoardSpec(
        int(rng.integers(3, 10)),
        int(rng.integers(3, 10)),
        square,
        square * float(rng.uniform(0.6, 0.85)),
        f"DICT_{bits}X{bits}_250",
        bool(rng.integers(2)),
    )
    board = on_screen(spec, float(rng.uniform(3, 8)))
    reference = opencv_board(board.spec).generateImage(board.size_px, marginSize=board.margin_px)
    assert (as_pixels(board) == reference).all()
    assert board.marker_px == (bits + 2) * board.module_px
    assert (board.square_px - board.marker_px) % 2 == 0
    assert board.spec.square_m == pytest.approx(1e-3 * board.square_px / board.px_per_mm, abs=1e-11)
    assert abs(board.square_px - 1e3 * square * board.px_per_mm) <= (bits + 2) / 2 + 1


def test_corners_are_found_where_the_spec_says() -> None:
    """A detector's corners, in mm by the pixel density, against the spec that is written."""
    board = on_screen(BoardSpec(9, 6, 0.0213, 0.0157, legacy_pattern=True), 110 / 25.4)
    corners, ids, _, _ = cv2.aruco.CharucoDetector(opencv_board(board.spec)).detectBoard(as_pixels(board))
    found = (np.reshape(corners, (-1, 2)) + 0.5 - board.margin_px) / board.px_per_mm
    assert len(found) == board.spec.corner_count
    assert np.abs(found - 1e3 * corner_points(board.spec)[np.ravel(ids), :2]).max() < 0.02


def test_what_no_screen_shows_is_refused() -> None:
    """Too coarse, too fine, too many pixels."""
    spec = BoardSpec(9, 6, 0.02, 0.015)
    with pytest.raises(ValueError, match=r"too few to draw the markers; take squares of 8 mm or more"):
        on_screen(BoardSpec(9, 6, 0.004, 0.003), 2.0)
    on_screen(BoardSpec(9, 6, 0.008, 0.006), 2.0)
    for density in (0.0, -4.0, float("nan"), float("inf"), 1e9):
        with pytest.raises(ValueError, match="pixels per mm"):
            on_screen(spec, density)
    with pytest.raises(ValueError, match="more than any screen"):
        on_screen(BoardSpec(40, 40, 0.02, 0.015, "DICT_4X4_1000"), 30.0)


def test_default_boards_fit_their_paper_and_are_odd() -> None:
    """Whatever the paper: an odd number of rows, for which the legacy flag means nothing, and a round square."""
    assert SQUARES[1] % 2 == 1
    squares = {}
    for name in [*PAPERS_MM, "100x150", "3000x2000"]:
        paper = paper_named(name)
        spec = fill_in(paper=paper)
        lay_out(spec, paper)
        squares[name] = round(1e3 * spec.square_m, 6)
        assert spec.marker_m == pytest.approx(MARKER_SHARE * spec.square_m)
    assert (squares["A4"], squares["Letter"], squares["A3"]) == (20.0, 20.0, 32.0)


def test_what_is_given_is_kept() -> None:
    """And the dictionary grows with the board."""
    spec = fill_in((9, 6), 24.0, 17.0, "DICT_5X5_50", True, 3.1)
    assert spec == BoardSpec(9, 6, 0.024, 0.017, "DICT_5X5_50", True, 0.0031)
    assert fill_in((20, 30), 10.0).dictionary == "DICT_4X4_1000"
    with pytest.raises(ValueError, match="too many"):
        fill_in((100, 100), 10.0)
    with pytest.raises(ValueError, match="no board of 200x10 squares fits on A5"):
        fill_in((200, 10), paper=paper_named("A5"), margin_mm=60.0)
