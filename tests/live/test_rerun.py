"""What goes into a Rerun log, read back by Rerun's own reader."""

from __future__ import annotations

from pathlib import Path

import pytest
import rerun

from vbaa_calib.core.errors import InputError
from viz.files.rerun_log import RerunLog

from .test_live import found


def test_a_log_holds_picture_scene_and_numbers(tmp_path: Path) -> None:
    path = tmp_path / "live.rrd"
    log = RerunLog(str(path))
    several = found()[:30]
    for each in several:
        log.write(each)
    log.close()
    recording = rerun.dataframe.load_recording(str(path)) if hasattr(rerun, "dataframe") else None
    if recording is None:
        from rerun.recording import load_recording

        recording = load_recording(str(path))
    paths = {str(column.entity_path) for column in recording.schema().component_columns()}
    assert {"/picture", "/picture/antenna", "/contact/distance_mm", "/world/contact/point"} <= paths


def test_what_is_no_log_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"is no \.rrd"):
        RerunLog(str(tmp_path / "log.txt"))
    (tmp_path / "there.rrd").write_bytes(b"mine")
    with pytest.raises(InputError, match="exists already"):
        RerunLog(str(tmp_path / "there.rrd"))
