"""A session's tables: what is read of them; what is refused: tests/hostile."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from vbaa_calib.session import (
    Still,
    check_pictures,
    has_over,
    load_session,
    read_loads,
    read_noload,
    read_recording,
)

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


def test_pictures_are_checked_before_the_work(root: Path) -> None:
    pictures = [root / "noload" / "a.png", root / "noload" / "b.png"]
    check_pictures(pictures, (12, 8), "the rig's camera has")
    what = complaint(lambda: check_pictures(pictures, (640, 480), "the rig's camera has"), pictures[0])
    assert "is 12x8 px, the rig's camera has 640x480 px" in what
    pictures[1].write_bytes(pictures[0].read_bytes()[:-9])
    assert "truncated" in complaint(lambda: check_pictures(pictures, (12, 8), "x"), pictures[1])
