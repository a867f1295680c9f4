"""Recordings of centrelines whose motion repeats: as many frames as are asked for, written as a session."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from benchmarks.estimator.scenes import Scenes, push_for_deflection, rolled, scenes
from benchmarks.estimator.setup import LENGTH_M, SIGMA_PX, STIFFNESS_NM2, Setup

_RATE_HZ, _PERIOD = 30.0, 240
"""Frames a second, and frames after which the motion begins anew: 8 s."""
_NOISES = 4
"""Periods with noise of their own; then the pixels come again. The moments' noise is always fresh."""
_REACH, _DEFLECTION_M, _ROLL_RAD = (0.35, 0.75), (0.005, 0.008), 0.4
SESSION = """schema: vbaa.session/1
board: {squares_x: 9, squares_y: 6, square_m: 0.012, marker_m: 0.009}
antenna: {length_m: 0.24, diameter_m: 0.0008, youngs_modulus_Pa: 193.0e9, density_kg_m3: 7900.0}
gravity_world: null
moment_sensor: {std_Nm: 2.0e-5}
"""


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
    """A session of centrelines in a folder that exists, with rig.json beside session.yaml; `points` 2 or less: too few
    to estimate anything, so that all but the solver works."""
    one, rng = _period(max(points, 2)), np.random.default_rng(seed)
    (folder / "session.yaml").write_text(SESSION)
    (folder / "rig.json").write_text(json.dumps(one.rig.to_dict()))
    (folder / "recording").mkdir()
    table = folder / "recording" / "recording.csv"
    with table.open("w") as rows, table.with_name("centrelines.csv").open("w") as lines:
        rows.write("frame,time_s,pan_rad,tilt_rad,moment_Nm\n")
        lines.write("frame,u_px,v_px,sigma_px\n")
        noisy = []
        for _ in range(min(_NOISES, -(-frames // _PERIOD))):
            pixels = one.points_px + SIGMA_PX * rng.normal(size=one.points_px.shape)
            # of each frame the ends of its rows, to be joined by its number
            noisy.append([["", *(f",{u:.4f},{v:.4f},{SIGMA_PX}\n" for u, v in line)] for line in pixels.tolist()])
        noise_Nm = one.rig.moment_sensor.std_Nm
        for index in range(frames):
            at, name = index % _PERIOD, str(index)
            moment = one.moment_Nm[at] + noise_Nm * rng.normal()
            rows.write(f"{name},{index / _RATE_HZ:.6f},0,0,{moment:.9g}\n")
            lines.write(name.join(noisy[index // _PERIOD % len(noisy)][at][: points + 1]))
