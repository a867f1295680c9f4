"""What goes into a Rerun log, read back by Rerun's own reader."""

from __future__ import annotations

from pathlib import Path

import pytest
from rerun.chunk import RrdReader

from estimator.table.files import write_contacts
from vbaa_calib.cli.main import main
from vbaa_calib.core.errors import InputError
from viz.files.rerun_log import RerunLog

from .recordings import COUNT
from .test_live import found


def test_a_log_holds_picture_scene_and_numbers(tmp_path: Path) -> None:
    path = tmp_path / "new" / "live.rrd"
    log = RerunLog(str(path))
    several = found()[:30]
    for each in several:
        log.write(each)
    log.close()
    paths = {chunk.entity_path for chunk in RrdReader(str(path)).stream()}
    assert {"/picture", "/picture/antenna", "/contact/distance_mm", "/world/contact/point"} <= paths


def test_a_table_is_shown_frame_by_frame(tmp_path: Path) -> None:
    contacts, path = tmp_path / "contacts.csv", tmp_path / "view.rrd"
    write_contacts(contacts, [each.row for each in found() if each.final])
    assert main(["view", str(contacts), "--rerun", str(path)]) == 0
    frames = [chunk.num_rows for chunk in RrdReader(str(path)).stream() if chunk.entity_path == "/contact/status"]
    assert sum(frames) == COUNT


def test_what_is_no_log_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"is no \.rrd"):
        RerunLog(str(tmp_path / "log.txt"))
    (tmp_path / "there.rrd").write_bytes(b"mine")
    with pytest.raises(InputError, match="exists already"):
        RerunLog(str(tmp_path / "there.rrd"))
