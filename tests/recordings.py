"""Recordings of centrelines on disk, with what frames take from others: drift, motion, a rolling shutter."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from benchmarks.estimator.scenes import Scenes, push_for_deflection, rolled, scenes
from benchmarks.estimator.setup import LENGTH_M, SIGMA_PX, STIFFNESS_NM2, Setup
from benchmarks.waiting.recordings import write_session
from estimator.table.contacts import Measured
from vbaa_calib.session import DRIFTS

RATE_HZ, PERIOD, FREE = 30.0, 120, 6
PAUSE_S = 70.0
"""Between periods: beyond it free frames are looked at anew."""
DRIFT, SHUTTER = "drift: lab\n", "camera: {exposure_s: 0.01, readout_s: 0.02}\n"


@cache
def _period() -> Scenes:
    """Free frames, strokes that pause and swing, and frames between them, without noise."""
    turn = 2.0 * np.pi * np.arange(PERIOD) / PERIOD
    distance = LENGTH_M * (0.55 + 0.2 * np.sin(turn))
    size = push_for_deflection(0.0065 + 0.0015 * np.cos(turn), distance, STIFFNESS_NM2)
    size = size * (1.0 + 0.3 * np.sin(np.arange(PERIOD)) * (np.abs(turn - 4.0) < 0.4))
    size[-FREE:] = 0.0
    return scenes(Setup().rig(), distance, rolled(size, 0.4 * np.sin(2.0 * turn)), points=20)


def write_rig(path: Path) -> Path:
    """rig.json of the recordings' rig."""
    path.write_text(json.dumps(replace(_period().rig, drift=DRIFTS["lab"]).to_dict()))
    return path


def write_recording(root: Path, frames: int, seed: int = 0, *, rolling: bool = False) -> Path:
    """A session with centrelines in a new folder; `rolling`: by a camera whose shutter matters."""
    shown, rng = _period(), np.random.default_rng(seed)

    def frame(index: int) -> Measured:
        at = index % PERIOD
        moment = float(shown.moment_Nm[at] + shown.rig.moment_sensor.std_Nm * rng.normal())
        points = shown.points_px[at] + [1.0, 0.5] + SIGMA_PX * rng.normal(size=(20, 2))  # the rig has drifted
        time_s = index / RATE_HZ + PAUSE_S * (index // (8 * PERIOD))
        return Measured(points, np.full(20, SIGMA_PX), moment, 0.0, 0.0, time_s=time_s)

    return write_session(root, map(frame, range(frames)), DRIFT + SHUTTER * rolling)
