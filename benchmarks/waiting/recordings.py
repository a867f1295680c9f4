"""Sessions of centrelines; recordings whose motion repeats, of as many frames as are asked for."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from benchmarks.estimator.scenes import Scenes, push_for_deflection, rolled, scenes
from benchmarks.estimator.setup import LENGTH_M, SIGMA_PX, STIFFNESS_NM2, Setup
from estimator.table.contacts import Measured

_RATE_HZ, _PERIOD = 30.0, 240
"""Frames a second, and frames after which the motion begins anew: 8 s. Noise is always fresh."""
_REACH, _DEFLECTION_M, _ROLL_RAD = (0.35, 0.75), (0.005, 0.008), 0.4
SESSION = """schema: vbaa.session/1
board: {squares_x: 9, squares_y: 6, square_m: 0.012, marker_m: 0.009}
antenna: {length_m: 0.24, diameter_m: 0.0008, youngs_modulus_Pa: 193.0e9, density_kg_m3: 7900.0}
gravity_world: null
moment_sensor: {std_Nm: 2.0e-5}
"""


def write_session(root: Path, several: Iterable[Measured], more: str = "") -> Path:
    """A session with the centrelines and readings of frames, none of their ends. more : lines of session.yaml."""
    (root / "recording").mkdir(parents=True)
    (root / "session.yaml").write_text(SESSION + more)
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


def _period(points: int) -> Scenes:
    """One period of the motion without noise: so many points of every frame, evenly along the antenna, under an upright
    camera."""
    turn = 2.0 * np.pi * np.arange(_PERIOD) / _PERIOD
    distance = LENGTH_M * _between(_REACH, np.sin(turn))
    size = push_for_deflection(_between(_DEFLECTION_M, np.cos(turn)), distance, STIFFNESS_NM2)
    return scenes(Setup().rig(), distance, rolled(size, _ROLL_RAD * np.sin(2.0 * turn)), points=points)


def _between(ends: tuple[float, float], share: np.ndarray) -> np.ndarray:
    """From −1 to 1 as from one end to the other."""
    return 0.5 * (ends[0] + ends[1]) + 0.5 * (ends[1] - ends[0]) * share


def write_recording(folder: Path, frames: int, points: int, seed: int) -> None:
    """A session of so many frames of so many points, with rig.json next to session.yaml."""
    one, rng = _period(points), np.random.default_rng(seed)
    sigma, noise_Nm = np.full(points, SIGMA_PX), one.rig.moment_sensor.std_Nm

    def noisy(index: int) -> Measured:
        pixels = one.points_px[index % _PERIOD] + SIGMA_PX * rng.normal(size=(points, 2))
        moment = float(one.moment_Nm[index % _PERIOD] + noise_Nm * rng.normal())
        return Measured(pixels, sigma, moment, 0.0, 0.0, time_s=index / _RATE_HZ)

    write_session(folder, map(noisy, range(frames)))
    (folder / "rig.json").write_text(json.dumps(one.rig.to_dict()))
