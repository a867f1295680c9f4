"""Recordings of centrelines on disk, with what frames take from others: drift, motion, a rolling shutter."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from benchmarks.estimator.scenes import Scenes, push_for_deflection, rolled, scenes
from benchmarks.estimator.setup import LENGTH_M, SIGMA_PX, STIFFNESS_NM2, Setup
from estimator.table.contacts import Measured
from vbaa_calib.session import DRIFTS

RATE_HZ, PERIOD, FREE = 30.0, 120, 6
PAUSE_S = 70.0
"""Between periods: beyond it free frames are looked at anew."""
SESSION = """schema: vbaa.session/1
board: {squares_x: 9, squares_y: 6, square_m: 0.012, marker_m: 0.009}
antenna: {length_m: 0.24, diameter_m: 0.0008, youngs_modulus_Pa: 193.0e9, density_kg_m3: 7900.0}
gravity_world: null
moment_sensor: {std_Nm: 2.0e-5}
drift: lab
"""
SHUTTER = "camera: {exposure_s: 0.01, readout_s: 0.02}\n"


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
    (root / "recording").mkdir(parents=True)
    (root / "session.yaml").write_text(SESSION + SHUTTER * rolling)
    table = root / "recording" / "recording.csv"
    with table.open("w") as rows, table.with_name("centrelines.csv").open("w") as lines:
        rows.write("frame,time_s,pan_rad,tilt_rad,moment_Nm\n")
        lines.write("frame,u_px,v_px,sigma_px\n")
        for index in range(frames):
            at = index % PERIOD
            time_s = index / RATE_HZ + PAUSE_S * (index // (8 * PERIOD))
            moment = shown.moment_Nm[at] + shown.rig.moment_sensor.std_Nm * rng.normal()
            rows.write(f"{index},{time_s:.6f},0,0,{moment:.9g}\n")
            points = shown.points_px[at] + [1.0, 0.5] + SIGMA_PX * rng.normal(size=(20, 2))  # the rig has drifted
            lines.writelines(f"{index},{u:.4f},{v:.4f},{SIGMA_PX}\n" for u, v in points)
    return root


def write_measured(root: Path, several: Sequence[Measured]) -> Path:
    """A session in a new folder with the centrelines and readings of frames; none of their ends."""
    (root / "recording").mkdir(parents=True)
    (root / "session.yaml").write_text(SESSION)
    table = root / "recording" / "recording.csv"
    with table.open("w") as rows, table.with_name("centrelines.csv").open("w") as lines:
        rows.write("frame,time_s,pan_rad,tilt_rad,moment_Nm\n")
        lines.write("frame,u_px,v_px,sigma_px\n")
        for index, one in enumerate(several):
            moment = "" if np.isnan(one.moment_Nm) else f"{one.moment_Nm:.12g}"
            rows.write(f"{index},{one.time_s:.6f},{one.pan_rad:.12g},{one.tilt_rad:.12g},{moment}\n")
            for (u, v), sigma in zip(one.points_px.tolist(), one.sigma_px.tolist(), strict=True):
                lines.write(f"{index},{u:.6f},{v:.6f},{sigma:.6g}\n")
    return root
