"""What goes into a Rerun log, read back by Rerun's own reader."""

from __future__ import annotations

import socket
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from estimator.table.files import write_contacts
from vbaa_calib.cli.main import main
from viz.files.rerun_log import RerunLog, open_viewer

from .recordings import COUNT
from .test_live import found


def chunks(path: Path) -> Iterator[Any]:
    """By Rerun's own reader, which takes half a second to load."""
    from rerun.chunk import RrdReader

    return RrdReader(str(path)).stream()


def test_a_log_holds_picture_scene_and_numbers(tmp_path: Path) -> None:
    path = tmp_path / "new" / "live.rrd"
    log = RerunLog(str(path))
    several = found()[:30]
    for each in several:
        log.write(each)
    log.close()
    paths = {chunk.entity_path for chunk in chunks(path)}
    assert {"/picture", "/picture/antenna", "/contact/distance_mm", "/world/contact/point"} <= paths


def test_a_table_is_shown_frame_by_frame(tmp_path: Path) -> None:
    contacts, path = tmp_path / "contacts.csv", tmp_path / "view.rrd"
    write_contacts(contacts, [each.row for each in found() if each.final])
    assert main(["view", str(contacts), "--rerun", str(path)]) == 0
    frames = [chunk.num_rows for chunk in chunks(path) if chunk.entity_path == "/contact/status"]
    assert sum(frames) == COUNT


VIEWER = f"""#!{sys.executable}
import socket, sys, time
place = {{name: sys.argv[sys.argv.index(name) + 1] for name in ("--bind", "--port")}}
listening = socket.create_server((place["--bind"], int(place["--port"])))
print("opened at", place["--bind"], flush=True)
time.sleep(20)
"""


def test_a_viewer_that_is_opened_is_for_this_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Opened once, on loopback: Rerun's own default are all addresses. One that ends at once is an error."""
    stub = tmp_path / "rerun"
    stub.write_text(VIEWER)
    stub.chmod(0o755)
    monkeypatch.setenv("RERUN_CLI_PATH", str(stub))
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    assert {open_viewer(port), open_viewer(port)} == {f"rerun+http://127.0.0.1:{port}/proxy"}
    assert capfd.readouterr().out == "opened at 127.0.0.1\n"
    stub.write_text("#!/bin/false\n")
    with pytest.raises(OSError, match="does not open"):
        open_viewer(port + 1 if port < 65535 else port - 1)
