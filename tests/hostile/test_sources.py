"""A folder that a program fills for the wizard, with things in it that are no pictures."""

from __future__ import annotations

import os
import time
from pathlib import Path

import cv2
import numpy as np

from vbaa_calib.sources.files import FolderSettings, FolderSource

from . import damage as d


def test_bombs_pipes_and_dead_links_do_not_hold_up_the_one_picture(tmp_path: Path) -> None:
    """What cannot be read is told once; what is no file is passed over; the source comes to its end."""
    assert cv2.imwrite(str(tmp_path / "good.png"), np.zeros((36, 48), np.uint8))
    (tmp_path / "bomb.png").write_bytes(d.png(20_000, 20_000, bytes(1000)))
    d.giant(10**13)(tmp_path / "giant.png")
    d.pipe(tmp_path / "pipe.png")
    d.folder(tmp_path / "folder.png")
    d.link("nowhere.png")(tmp_path / "dead.png")
    d.loop(tmp_path / "loop.png")
    d.link("/dev/zero")(tmp_path / "zero.png")
    for path in ("good.png", "bomb.png", "giant.png"):
        os.utime(tmp_path / path, (1e9, 1e9))
    source = FolderSource(tmp_path, pace=FolderSettings(scan_s=0.01, steady_s=0.0, patience_s=0.05))
    until, offered = time.monotonic() + 20.0, []
    while not source.ended and time.monotonic() < until:
        found = source.next(0.1)
        offered += [] if found is None else [found.name]
    assert source.ended
    assert offered == ["good.png"]
    assert [note.partition(":")[0] for note in source.notes] == ["bomb.png", "giant.png"]
    assert "20000x20000 px" in source.notes[0]
