"""centrelines.csv, read a frame at a time: the same numbers, however the file is laid out and wherever a block ends."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from vbaa_calib.core.errors import InputError
from vbaa_calib.session import Centrelines, centrelines, read_centrelines

HEADER = "frame,u_px,v_px,sigma_px"
ORDERED = [(frame, frame + 0.1 * k, 100.0 - k, 0.1 + 0.01 * k) for frame in range(30) for k in range(1 + frame % 4)]


def read(folder: Path, content: str | bytes) -> Centrelines:
    path = folder / "recording" / "centrelines.csv"
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return read_centrelines(SimpleNamespace(root=folder, in_turn=()))


def text(rows: list[tuple[int, float, float, float]]) -> str:
    return "\n".join([HEADER, *(",".join(map(repr, row)) for row in rows)]) + "\n"


def grouped(rows: list[tuple[int, float, float, float]]) -> dict[int, np.ndarray]:
    """By frame, in the order of the file: by another way."""
    found: dict[int, list[tuple[float, ...]]] = {}
    for frame, *point in rows:
        found.setdefault(frame, []).append(tuple(point))
    return {frame: np.array(points) for frame, points in found.items()}


def assert_same(lines: Centrelines, expected: dict[int, np.ndarray]) -> None:
    assert sorted(lines) == sorted(expected)
    assert len(lines) == len(expected)
    for frame, points in expected.items():
        np.testing.assert_array_equal(lines[frame], points)


@pytest.fixture(params=[64, 1 << 20])
def block(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    """Bytes that are read at once, the last to the end of a line."""
    monkeypatch.setattr(centrelines, "BLOCK", request.param)
    return int(request.param)


CHANGES = {
    "as it is": lambda whole: whole,
    "no end of line at the end": lambda whole: whole.rstrip("\n"),
    "ends of lines as Windows has them": lambda whole: whole.replace("\n", "\r\n"),
    "ends of lines as old Macs had them": lambda whole: whole.replace("\n", "\r"),
    "a byte order mark": lambda whole: "\ufeff" + whole,
    "semicolons": lambda whole: whole.replace(",", ";"),
    "tabs": lambda whole: whole.replace(",", "\t"),
    "comments": lambda whole: "# tracked, by hand\n" + whole.replace("\n7,", "\n# a new day\n7,"),
    "blank lines between": lambda whole: whole.replace("\n", "\n\n"),
    "blank rows between": lambda whole: whole.replace("\n", "\n,,,\n", 3),
    "spaces": lambda whole: whole.replace(",", " , "),
    "quotes": lambda whole: whole.replace("\n7,", '\n"7",'),
    "a quoted end of line": lambda whole: whole.replace("\n8,", '\n"8\n",', 1),
    "a column of words": lambda whole: whole.replace("\n", ',"a, b"\n').replace('"a, b"', "note", 1),
    "a column of bare words": lambda whole: whole.replace("\n", ",ä\n").replace("ä", "note", 1),
    "an empty column first": lambda whole: "note" + "".join(f",{line}\n" for line in whole.splitlines()),
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES.keys())
@pytest.mark.usefixtures("block")
def test_the_same_numbers_however_they_are_written(tmp_path: Path, change) -> None:
    assert_same(read(tmp_path, change(text(ORDERED))), grouped(ORDERED))


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES.keys())
def test_the_same_numbers_in_any_order(tmp_path: Path, change, monkeypatch: pytest.MonkeyPatch) -> None:
    """Read a few frames at a time."""
    monkeypatch.setattr(centrelines, "LOT", 7)
    lines, expected = read(tmp_path, change(text(ORDERED))), grouped(ORDERED)
    assert_same(lines, expected)
    assert_same(lines, dict(reversed(expected.items())))


@settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.lists(
        st.tuples(
            st.integers(0, 2**53 - 1),
            st.floats(-1e6, 1e6),
            st.floats(-1e7, 1e7),
            st.floats(1e-300, 1e7),
        ),
        min_size=1,
        max_size=30,
        unique_by=lambda row: row[:3],
    )
)
def test_every_bit_of_a_number_comes_back(tmp_path: Path, rows: list[tuple[int, float, float, float]]) -> None:
    assert_same(read(tmp_path, text(rows)), grouped(rows))


def test_a_point_that_stands_twice_was_measured_once(tmp_path: Path) -> None:
    """Wherever it stands; the first is kept, and the order."""
    points = [(0, 5.0, 1.0, 0.1), (0, 2.0, 1.0, 0.2), (1, 2.0, 1.0, 0.3), (0, 5.0, 1.0, 0.4), (0, 2.0, 3.0, 0.5)]
    lines = read(tmp_path, text(points))
    assert lines[0].tolist() == [[5.0, 1.0, 0.1], [2.0, 1.0, 0.2], [2.0, 3.0, 0.5]]
    assert lines[1].tolist() == [[2.0, 1.0, 0.3]]


def test_a_file_that_changes_meanwhile_is_noticed(tmp_path: Path) -> None:
    lines = read(tmp_path, text(ORDERED))
    path = tmp_path / "recording" / "centrelines.csv"
    for content in (text([(row[0] + 1, *row[1:]) for row in ORDERED]), text(ORDERED)[:40], "x" * len(text(ORDERED))):
        path.write_text(content)
        with pytest.raises(InputError, match="has changed since it was checked"):
            lines[20]
    path.unlink()
    with pytest.raises(InputError, match="has changed since it was checked"):
        lines[20]
