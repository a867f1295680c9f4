"""Printable sheets, judged by what another program makes of them: PDFium draws, OpenCV reads; boards for screens."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pypdfium2
import pytest

from targets.board import BoardSpec, corner_points, opencv_board, spec_line
from targets.sheet import SheetLayout, lay_out, paper_named
from targets.write_sheet import _board_shapes, _ruler_origin, as_pdf, on_screen
from vbaa_calib.detect.board.board_file import load_board

A4_BOARD = BoardSpec(11, 7, 0.020, 0.015)
PITCH_MM = 0.02


def drawn(spec: BoardSpec, paper: str, dpi: float) -> tuple[np.ndarray, SheetLayout, np.ndarray]:
    """The PDF as PDFium draws it, grey; the layout; pixels per mm along x and y."""
    layout = lay_out(spec, paper_named(paper))
    page = pypdfium2.PdfDocument(as_pdf(spec, layout))[0]
    picture = page.render(scale=dpi / 72, grayscale=True).to_numpy().squeeze()
    size_mm = np.array(page.get_size()) * 25.4 / 72
    np.testing.assert_allclose(size_mm, (layout.width, layout.height), atol=1e-3)
    return picture, layout, np.array(picture.shape[::-1]) / size_mm


CASES = [
    (A4_BOARD, "A4", 600),
    (BoardSpec(9, 6, 0.024, 0.018), "Letter", 300),
    (BoardSpec(8, 12, 0.0173, 0.0121, "DICT_5X5_50", legacy_pattern=True), "A4", 300),
    (BoardSpec(7, 5, 0.04, 0.028, "DICT_7X7_1000"), "A3", 200),
    (BoardSpec(5, 8, 0.0131, 0.0092, "DICT_6X6_250"), "120x190", 400),
]


@pytest.mark.parametrize(("spec", "paper", "dpi"), CASES, ids=lambda value: getattr(value, "dictionary", str(value)))
def test_corners_stand_where_the_spec_says(spec: BoardSpec, paper: str, dpi: int) -> None:
    """Every corner's place on the page, and the pitch of the whole board in x and y, within 0.02 mm."""
    picture, layout, px_per_mm = drawn(spec, paper, dpi)
    corners, ids, _, _ = cv2.aruco.CharucoDetector(opencv_board(spec)).detectBoard(picture)
    assert len(ids) == spec.corner_count
    found = (np.reshape(corners, (-1, 2))[np.argsort(np.ravel(ids))] + 0.5) / px_per_mm
    expected = 1e3 * corner_points(spec)[:, :2] + (layout.board_x, layout.board_y)
    assert np.abs(found - expected).max() < PITCH_MM
    for axis in (0, 1):
        first, last = np.argmin(expected[:, axis]), np.argmax(expected[:, axis])
        assert abs(np.ptp(found[[first, last], axis]) - np.ptp(expected[:, axis])) < PITCH_MM


@pytest.mark.parametrize("seed", range(6))
def test_random_boards_are_drawn_as_opencv_draws_them(seed: int) -> None:
    """Filled outlines against `generateImage`, pixel by pixel, for random counts, dictionaries and both patterns."""
    rng = np.random.default_rng(seed)
    bits, module, gap = int(rng.integers(4, 8)), int(rng.integers(2, 5)), int(rng.integers(2, 9))
    side = (bits + 2) * module + 2 * gap
    counts, marker = rng.integers(2, 12, 2).tolist(), side - 2 * gap
    spec = BoardSpec(*counts, 1e-3 * side, 1e-3 * marker, f"DICT_{bits}X{bits}_100", bool(rng.integers(2)))
    width, height = spec.squares_x * side, spec.squares_y * side
    black = np.zeros((height, width), bool)
    for shape in _board_shapes(spec):
        for loop in shape:
            corners = np.round(np.array(loop)).astype(int)
            np.testing.assert_allclose(loop, corners, atol=1e-9)
            black ^= inside(corners, width, height)
    assert (np.where(black, 0, 255) == opencv_board(spec).generateImage((width, height))).all()


def inside(corners: np.ndarray, width: int, height: int) -> np.ndarray:
    """(height, width) bool: pixels inside a polygon of horizontal and vertical edges, by the even-odd rule."""
    turns = np.zeros((height, width + 1), int)
    for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if ax == bx:
            turns[min(ay, by) : max(ay, by), ax] += 1
    return np.cumsum(turns, axis=1)[:, :width] % 2 == 1


@pytest.mark.parametrize("paper", ["A4", "200x150"])
def test_rulers_are_measured_on_the_drawing(paper: str) -> None:
    """End line to end line along both rulers, and every tick between, in the picture."""
    spec = BoardSpec(7, 5, 0.012, 0.009)
    picture, layout, px_per_mm = drawn(spec, paper, 400)
    x0, y_line, x_line, y0 = _ruler_origin(layout)
    row = picture[round((y_line + 1.0) * px_per_mm[1])]
    column = picture[:, round((x_line - 1.0) * px_per_mm[0])]
    left, right = round((x0 - 2) * px_per_mm[0]), round((x0 + layout.ruler_x + 2) * px_per_mm[0])
    ticks_x = tick_places(row[left:right], left) / px_per_mm[0]
    top, low = round((y0 - layout.ruler_y - 2) * px_per_mm[1]), round((y0 + 2) * px_per_mm[1])
    ticks_y = tick_places(column[top:low], top) / px_per_mm[1]
    for ticks, length in ((ticks_x, layout.ruler_x), (ticks_y, layout.ruler_y)):
        assert len(ticks) == length + 1
        assert abs(ticks[-1] - ticks[0] - length) < PITCH_MM
        assert np.abs(np.diff(ticks) - 1).max() < 2 * PITCH_MM


def tick_places(line: np.ndarray, offset: int) -> np.ndarray:
    """Centres of the dark stretches of one row of pixels, by their darkness."""
    dark = 255.0 - line
    starts = np.flatnonzero((dark[1:] > 0) & (dark[:-1] == 0)) + 1
    ends = np.flatnonzero((dark[1:] == 0) & (dark[:-1] > 0)) + 1
    places = np.arange(len(dark)) + 0.5
    return offset + np.array([dark[a:b] @ places[a:b] / dark[a:b].sum() for a, b in zip(starts, ends, strict=True)])


@pytest.mark.parametrize("case", CASES, ids=lambda case: case[0].dictionary)
def test_qr_code_is_a_board_file(case: tuple[BoardSpec, str, int], tmp_path: Path) -> None:
    """What a reader takes from the print is a board.yaml as it stands."""
    spec, paper, _ = case
    picture, layout, px_per_mm = drawn(spec, paper, 300)
    corner = np.array([layout.width - layout.margin - 25, layout.margin + 25]) * px_per_mm
    code = picture[: int(corner[1]), int(corner[0]) :]
    text = cv2.QRCodeDetector().detectAndDecode(code)[0] or cv2.QRCodeDetectorAruco().detectAndDecode(code)[0]
    assert text == spec_line(spec)
    (tmp_path / "board.yaml").write_text(text)
    assert load_board(tmp_path / "board.yaml") == spec


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
    picture = board.pixels[board.margin_px : -board.margin_px, board.margin_px : -board.margin_px]
    for square_px in picture.reshape(counts[1], side, counts[0], side).swapaxes(1, 2).reshape(-1, side, side):
        inner = square_px[gap:-gap, gap:-gap]
        assert (np.kron(inner[::module, ::module], np.ones((module, module))) == inner).all()
    assert board.spec.square_m == pytest.approx(1e-3 * side / density, abs=1e-11)
    assert abs(side - 1e3 * square * density) <= (bits + 2) / 2 + 1


def test_corners_are_found_where_the_spec_says() -> None:
    """A detector's corners, in mm by the pixel density, against the spec that is written."""
    density = 110 / 25.4
    board = on_screen(BoardSpec(9, 6, 0.0213, 0.0157, legacy_pattern=True), density)
    corners, ids, _, _ = cv2.aruco.CharucoDetector(opencv_board(board.spec)).detectBoard(board.pixels)
    found = (np.reshape(corners, (-1, 2)) + 0.5 - board.margin_px) / density
    assert len(found) == board.spec.corner_count
    assert np.abs(found - 1e3 * corner_points(board.spec)[np.ravel(ids), :2]).max() < 0.02
