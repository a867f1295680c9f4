"""Long recordings through `vbaa estimate`: what it holds in memory does not grow with what it has read."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.waiting.recordings import SESSION, write_recording
from estimator.table.files import read_contacts
from tests.estimator.drawn_frames import picture, rig_of, shape

MOST_MB = 20.0
POINTS = 40

CHILD = """
import json, sys
from pathlib import Path
import vbaa_calib.core.console
from vbaa_calib.cli.main import main

every, *argv = sys.argv[1:]
samples = []


def watched(items, what, total=None):
    for index, item in enumerate(items):
        if index % int(every) == 0:
            pages = int(Path("/proc/self/statm").read_text().split()[1])
            samples.append((index, pages * 4096 / 1e6))
        yield item


vbaa_calib.core.console.progress = watched
code = main(argv)
print(json.dumps({"code": code, "samples": samples}))
"""
"""Runs the command in a process of its own and tells the resident set, MB, when frames 0, EVERY, … came out."""

needs_proc = pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="the resident set is read from /proc")


def resident(folder: Path, every: int, *more: str) -> np.ndarray:
    """(K, 2) frames and MB, of one run over a session."""
    argv = ["estimate", str(folder), "--rig", str(folder / "rig.json"), "-o", str(folder / "contacts.csv")]
    child = [sys.executable, "-c", CHILD, str(every), *argv, "--no-report", *more]
    done = subprocess.run(child, capture_output=True, text=True, check=True, cwd=Path(__file__).parents[1])
    said = json.loads(done.stdout.splitlines()[-1])
    assert said["code"] == 0, done.stderr
    return np.array(said["samples"])


def grown_MB(samples: np.ndarray, settled: int) -> float:
    """How far the resident set rises above what it was once this many frames had passed."""
    after = samples[samples[:, 0] >= settled, 1]
    assert len(after) >= 4
    return float(after.max() - after[0])


def pictures(folder: Path, count: int) -> Path:
    """A session whose recording is one small picture under many names, the joints in ever new places."""
    rig = rig_of((320, 240))
    (folder / "recording").mkdir(parents=True)
    (folder / "rig.json").write_text(json.dumps(rig.to_dict()))
    (folder / "session.yaml").write_text(SESSION)
    shown = folder / "recording" / "shown.png"
    assert cv2.imwrite(str(shown), picture(rig, shape(rig)))
    rows = ["frame,time_s,image,pan_rad,tilt_rad,moment_Nm"]
    for index in range(count):
        shown.with_name(f"{index:06d}.png").hardlink_to(shown)
        rows.append(f"{index},{index / 30:.4f},{index:06d}.png,0,{0.3 * np.sin(0.01 * index):.6f},")
    (folder / "recording" / "recording.csv").write_text("\n".join(rows) + "\n")
    return folder


@pytest.mark.slow
@needs_proc
def test_what_is_not_solved_leaves_nothing_behind(tmp_path: Path) -> None:
    """Reading, order, motion, table, file: everything but the solver, which frames of two points do not reach."""
    write_recording(tmp_path, 6_000, 2, seed=1)
    assert grown_MB(resident(tmp_path, 200), 2_000) < MOST_MB
    header, *rows = (tmp_path / "contacts.csv").read_text().splitlines()
    assert header.startswith("frame,time_s,status,")
    assert [row.split(",", 3)[::2] for row in rows] == [[str(index), "no_antenna"] for index in range(6_000)]


@needs_proc
@pytest.mark.slow
def test_some_frames(tmp_path: Path) -> None:
    write_recording(tmp_path, 1_000, POINTS, seed=2)
    assert grown_MB(resident(tmp_path, 50), 300) < MOST_MB
    assert (read_contacts(tmp_path / "contacts.csv").status == "ok").mean() > 0.95
