"""Centrelines, from a table read a frame at a time or from other trackers' files: the same numbers."""

from __future__ import annotations

import pickle
import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from vbaa_calib.cli.main import main
from vbaa_calib.core.errors import InputError
from vbaa_calib.session import Centrelines, centrelines, centrelines_of, read_centrelines
from vbaa_calib.session.centrelines import CENTRELINES

from ..small_scene import small_rig

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
    """Bytes that are read at once, the last to the end of a line; of the smaller ones none are kept."""
    kept = CENTRELINES.kept if request.param == CENTRELINES.block else 0
    monkeypatch.setattr(centrelines, "CENTRELINES", replace(CENTRELINES, block=request.param, kept=kept))
    return int(request.param)


CHANGES = {
    "as it is": lambda whole: whole,
    "no end of line at the end": lambda whole: whole.rstrip("\n"),
    "ends of lines as Windows has them": lambda whole: whole.replace("\n", "\r\n"),
    "ends of lines as old Macs had them": lambda whole: whole.replace("\n", "\r"),
    "a byte order mark": lambda whole: "\ufeff" + whole,
    "semicolons": lambda whole: whole.replace(",", ";"),
    "decimal commas": lambda whole: whole.replace(",", ";").replace(".", ","),
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
    monkeypatch.setattr(centrelines, "CENTRELINES", replace(CENTRELINES, lot=7, kept=0))
    lines, expected = read(tmp_path, change(text(ORDERED))), grouped(ORDERED)
    assert_same(lines, expected)
    assert_same(lines, dict(reversed(expected.items())))


def test_a_point_that_stands_twice_was_measured_once(tmp_path: Path) -> None:
    """Wherever it stands; the first is kept, and the order."""
    points = [(0, 5.0, 1.0, 0.1), (0, 2.0, 1.0, 0.2), (1, 2.0, 1.0, 0.3), (0, 5.0, 1.0, 0.4), (0, 2.0, 3.0, 0.5)]
    lines = read(tmp_path, text(points))
    assert lines[0].tolist() == [[5.0, 1.0, 0.1], [2.0, 1.0, 0.2], [2.0, 3.0, 0.5]]
    assert lines[1].tolist() == [[2.0, 1.0, 0.3]]


FRAMES = (0, 3)
POINTS = {frame: np.array([[10.0 + frame, 20.0], [30.5, 22.25 + frame], [50.0, 30.0]]) for frame in FRAMES}
PARTS = ("base", "middle", "tip")


def deeplabcut(path: Path, individuals: tuple[str, ...] = ("",), unsure: float = 0.1) -> None:
    """Of each individual the same points; the last part of frame 3 is unsure."""
    columns = [(who, part, axis) for who in individuals for part in PARTS for axis in ("x", "y", "likelihood")]
    heads = {"scorer": ["net"] * len(columns)}
    heads |= {"individuals": [who for who, _, _ in columns]} if individuals != ("",) else {}
    heads |= {"bodyparts": [part for _, part, _ in columns], "coords": [axis for _, _, axis in columns]}
    lines = [",".join([name, *cells]) for name, cells in heads.items()]
    for frame in FRAMES:
        sure = [0.99, 0.99, unsure if frame == 3 else 0.99]
        cells = [f"{x},{y},{p}" for (x, y), p in zip(POINTS[frame], sure, strict=True)]
        lines.append(",".join([str(frame), *cells * len(individuals)]))
    path.write_text("\n".join(lines) + "\n")


def whisker_toolbox(path: Path, copies: int = 1) -> None:
    rows = [f'{frame},"{",".join(map(str, p[:, 0]))}","{",".join(map(str, p[:, 1]))}"' for frame, p in POINTS.items()]
    path.write_text("Frame,X,Y\n" + "\n".join(row for row in rows for _ in range(copies)) + "\n")


def whisker_toolbox_folder(path: Path) -> None:
    path.mkdir()
    for frame, points in POINTS.items():
        (path / f"{frame:07d}.csv").write_text("X,Y\n" + "".join(f"{u},{v}\n" for u, v in points))


def whisk(path: Path, with_labels: bool = True) -> None:
    """Two traces a frame: a hair, and the whisker, whose label is 0."""
    data, rows = b"bwhiskbin1\0\0", b""
    for frame, points in POINTS.items():
        for number, line in ((0, points + 100.0), (1, points)):
            data += struct.pack("<3i", number, frame, len(line)) + line.T.astype("<f4").tobytes()
            data += bytes(8 * len(line))
            rows += struct.pack("<10ic", 0, frame, number, number - 1, 0, 0, 4, 5, 0, 8, b"x") + bytes(16 * 8)
    path.with_suffix(".whiskers").write_bytes(data + struct.pack("<i", 4))
    if with_labels:
        path.with_suffix(".measurements").write_bytes(b"measv3\0\0" + struct.pack("<2i", 4, 8) + rows)


def whiskiwrap(path: Path, labels: tuple[int, ...] = (0xFFFF, 0)) -> None:
    """WhiskiWrap's HDF5: a row and two lists of pixels for each whisker, of two in a frame."""
    h5py = pytest.importorskip("h5py")
    kinds = [("fid", "<u4"), ("wid", "<u2"), ("label", "<u2")]
    rows = [(frame, number, label) for frame in FRAMES for number, label in enumerate(labels)]
    with h5py.File(path, "w") as file:
        file["summary"] = np.array(rows, kinds)
        for axis, name in enumerate(("pixels_x", "pixels_y")):
            pixels = file.create_dataset(name, (len(rows),), h5py.vlen_dtype(np.float32))
            for row, (frame, number, _) in enumerate(rows):
                pixels[row] = POINTS[frame][:, axis] + 100.0 * (number != len(labels) - 1)


def ndx_whisk(path: Path, traced: bool = True) -> None:
    """A WhiskerMeasurementTable, whose columns are data sets, and the .whiskers file that it was made of next to it."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        table = file.create_group("processing/behavior/whisker_measurements")
        table.attrs["neurodata_type"] = "WhiskerMeasurementTable"
        for name, column in (
            ("frame_id", np.repeat(FRAMES, 2)),
            ("whisker_id", [0, 1, 0, 1]),
            ("label", [0xFFFF, 0] * 2),
        ):
            table[name] = np.array(column, np.uint64)
        for name in ("tip_x", "tip_y", "follicle_x", "follicle_y"):
            table[name] = np.ones(4)
    if traced:
        whisk(path, with_labels=False)


def deeplabcut_hdf5(path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    columns = [("net", part, axis) for part in PARTS for axis in ("x", "y", "likelihood")]
    rows = np.zeros(2, [("index", "<i8"), ("values_block_0", "<f8", (9,))])
    for row, frame in zip(rows, FRAMES, strict=True):
        row["index"], row["values_block_0"] = frame, np.column_stack([POINTS[frame], np.ones(3)]).ravel()
    with h5py.File(path, "w") as file:
        table = file.create_group("df_with_missing").create_dataset("table", data=rows)
        table.attrs["values_block_0_kind"] = np.bytes_(pickle.dumps(columns, protocol=0))


FILES: list[tuple[str, str, Callable[[Path], None]]] = [
    ("DeepLabCut", "a.csv", lambda path: deeplabcut(path, unsure=0.99)),
    ("DeepLabCut of a single animal among several columns", "a.csv", lambda path: deeplabcut(path, ("ant",), 0.99)),
    ("DeepLabCut, HDF5", "a.h5", deeplabcut_hdf5),
    ("WhiskerToolbox", "a.csv", whisker_toolbox),
    ("WhiskerToolbox, a file a frame", "lines", whisker_toolbox_folder),
    ("whisk's measurements", "a.measurements", whisk),
    ("whisk's traces", "a.whiskers", whisk),
    ("WhiskiWrap's HDF5", "a.hdf5", whiskiwrap),
    ("ndx-whisk's table and traces", "a.nwb", ndx_whisk),
]


@pytest.mark.parametrize(("name", "make"), [pytest.param(*row[1:], id=row[0]) for row in FILES])
def test_its_points_are_read(tmp_path: Path, name: str, make: Callable[[Path], None]) -> None:
    make(tmp_path / name)
    lines = centrelines_of(tmp_path / name)
    assert list(lines) == list(FRAMES)
    assert lines.note
    for frame, points in POINTS.items():
        np.testing.assert_allclose(lines[frame][:, :2], points, atol=1e-6)


def test_labels_that_tell_no_lines_apart_are_not_taken(tmp_path: Path) -> None:
    """All alike, as WhiskiWrap writes them, or none, before whisk has classified: two whiskers are no antenna."""
    for labels in ((0, 0), (0xFFFF, 0xFFFF)):
        whiskiwrap(tmp_path / "a.h5", labels)
        with pytest.raises(InputError, match="has 2 lines: 0, 1"):
            centrelines_of(tmp_path / "a.h5")
        lines = centrelines_of(tmp_path / "a.h5", "1")
        assert "tell no lines apart" in lines.note
        np.testing.assert_allclose(lines[3][:, :2], POINTS[3])


def test_several_lines_are_asked_about(tmp_path: Path) -> None:
    """Never taken together: two whiskers are no antenna."""
    deeplabcut(tmp_path / "two.csv", ("left", "right"))
    whisker_toolbox(tmp_path / "lines.csv", copies=2)
    whisk(tmp_path / "a.whiskers", with_labels=False)
    for name, which in (("two.csv", "right"), ("lines.csv", "1"), ("a.whiskers", "1")):
        with pytest.raises(InputError, match=r"has 2 lines: .*; say which is the antenna: --line"):
            centrelines_of(tmp_path / name)
        np.testing.assert_allclose(centrelines_of(tmp_path / name, which)[0][:, :2], POINTS[0])
        with pytest.raises(InputError, match="no line nobody"):
            centrelines_of(tmp_path / name, "nobody")


def test_a_pickle_that_asks_for_code_is_refused(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        rows = np.zeros(1, [("index", "<i8"), ("values_block_0", "<f8", (1,))])
        table = file.create_group("df").create_dataset("table", data=rows)
        table.attrs["values_block_0_kind"] = np.bytes_(b"cos\nsystem\n(S'true'\ntR.")
    with pytest.raises(InputError, match=r"os\.system"):
        centrelines_of(tmp_path / "a.h5")


def test_contacts_from_deeplabcut(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """On the command line: what was read is said."""
    deeplabcut(tmp_path / "a.csv")
    call = ["estimate", "--centrelines", str(tmp_path / "a.csv"), "--rig", str(small_rig() / "rig.json"), "--no-report"]
    assert main([*call, "-o", str(tmp_path / "contacts.csv")]) in (0, 1)
    assert "3 parts a frame (base, middle, tip)" in capsys.readouterr().err
    assert len((tmp_path / "contacts.csv").read_text().splitlines()) == 3
