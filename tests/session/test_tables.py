"""A session's tables: what is read of them; what is refused: tests/hostile."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vbaa_calib.core.errors import InputError
from vbaa_calib.session import (
    Still,
    check_pictures,
    has_over,
    load_session,
    read_loads,
    read_noload,
    read_recording,
    recording_of,
    tables,
    without_moments,
)
from vbaa_calib.session.tables import _FrameColumns, numbers_of

from .files import changed, complaint, write


class TestStills:
    def test_what_is_read(self, root: Path) -> None:
        session = load_session(root)
        first, second = read_noload(session)
        assert first == Still(root / "noload" / "a.png", 0.1, 0.2, 1e-3)
        assert (second.image, second.tilt_rad) == (root / "noload" / "b.png", -0.2)
        load, last = read_loads(session)
        assert (load.distance_m, load.force_y_N, load.force_z_N) == (0.1, 0.02, 0.0)
        assert (last.distance_m, last.force_z_N) == (0.24, -0.01)

    @pytest.mark.parametrize(("name", "read"), [("noload", read_noload), ("loads", read_loads)])
    def test_when_they_were_taken(self, root: Path, name: str, read: Callable[[Any], list[Still]]) -> None:
        path = root / name / f"{name}.csv"
        header, first, second = path.read_text().splitlines()
        assert [still.time_s for still in read(load_session(root))] == [None, None]
        path.write_text(f"{header},time_s\n{first},12.5\n{second},-3\n")
        assert [still.time_s for still in read(load_session(root))] == [12.5, -3.0]
        path.write_text(f"{header},time_s\n{first},12.5\n{second},\n")
        assert "line 3: time_s is ''" in complaint(lambda: read(load_session(root)), path)


class TestOver:
    def test_pictures_and_height_belong_together(self, root: Path) -> None:
        assert not has_over(load_session(root))
        (root / "over").mkdir()
        text = complaint(lambda: has_over(load_session(root)), root / "session.yaml")
        assert "over is missing, but there is a folder over/; give over.height_m" in text
        write(root, changed("over", to={"height_m": 0.002}))
        assert has_over(load_session(root))
        (root / "over").rmdir()
        assert not has_over(load_session(root))


class TestRecording:
    def test_a_second_moment_axis(self, root: Path) -> None:
        path = root / "recording" / "recording.csv"
        assert all(math.isnan(frame.moment_z_Nm) for frame in read_recording(load_session(root)))
        path.write_text("frame,time_s,image,pan_rad,tilt_rad,moment_z_Nm\n3,0,a.png,0,0,2e-3\n4,1,b.png,0,0,\n")
        first, second = read_recording(load_session(root))
        assert first.moment_z_Nm == 2e-3
        assert math.isnan(first.moment_Nm)
        assert math.isnan(second.moment_z_Nm)

    @pytest.mark.parametrize("seed", range(60))
    def test_read_by_columns_as_by_rows(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
        rng = np.random.default_rng(seed)
        header = ["frame", "time_s", "pan_rad", "tilt_rad", "moment_Nm", *["moment_z_Nm"] * int(rng.integers(2))]
        table = np.round(rng.normal(0.0, 1.0, (9, len(header))), 6)
        table[:, 0], table[:, 1] = rng.permutation(9), np.arange(9)
        cells = [list(map(repr, row)) for row in table.tolist()]
        for _ in range(seed % 3):
            cells[rng.integers(9)][rng.integers(len(header))] = str(rng.choice(ODD))
        path = tmp_path / "recording.csv"
        path.write_text(
            "\n".join(",".join(row) for row in [header, *cells]) + str(rng.choice(["", "\n", "\r\n", "\n\n"]))
        )
        first = _frames_or_complaint(path)
        monkeypatch.setattr(tables, "plain_columns", lambda *_: None)
        assert first == _frames_or_complaint(path)

    def test_columns_are_frames(self, tmp_path: Path) -> None:
        path = tmp_path / "recording.csv"
        path.write_text("frame,time_s,pan_rad,tilt_rad,moment_Nm\n7,0,0.1,0.2,1e-3\n4,0.5,0,0,-2e-3\n9,1,0,0,0\n")
        frames = recording_of(path, with_images=False)
        assert isinstance(frames, _FrameColumns)
        assert [str(frame) for frame in frames] == [str(frames[at]) for at in range(3)]
        assert (frames[-1].frame, len(frames[1:]), frames[1:][0].moment_Nm) == (9, 2, -2e-3)
        assert list(numbers_of(frames)) == list(numbers_of(list(frames))) == [7, 4, 9]
        assert all(math.isnan(frame.moment_Nm) for frame in without_moments(frames))


ODD = ["", " 3", "1 2", "1,2", "'1'", '"2"', "nan", "inf", "1_0", "0x10", "-1", "1e400", "1e-3", "7", "2.5", "+4"]
ODD += [".5", "5.", "1e5", "x", "1d3", "٣", "9e15", "-0"]


def _frames_or_complaint(path: Path) -> str:
    """As text: moments may be NaN."""
    try:
        return str(list(recording_of(path, with_images=False)))
    except InputError as error:
        return str(error)


def test_pictures_are_checked_before_the_work(root: Path) -> None:
    pictures = [root / "noload" / "a.png", root / "noload" / "b.png"]
    check_pictures(pictures, (12, 8), "the rig's camera has")
    what = complaint(lambda: check_pictures(pictures, (640, 480), "the rig's camera has"), pictures[0])
    assert "is 12x8 px, the rig's camera has 640x480 px" in what
    pictures[1].write_bytes(pictures[0].read_bytes()[:-9])
    assert "truncated" in complaint(lambda: check_pictures(pictures, (12, 8), "x"), pictures[1])
