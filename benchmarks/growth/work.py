"""What is timed: each function makes everything ready for one size and gives back the work alone."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np

from benchmarks import boards
from benchmarks.chain.scenes import JOINTS_RAD, cell
from benchmarks.coverage.rigs import MOMENT_NM, NOMINAL, coverage_rigs, draw
from benchmarks.coverage.solve import observations, prior_of
from benchmarks.estimator.scenes import push_for_deflection, rolled, scenes
from benchmarks.estimator.setup import LENGTH_M, SIGMA_PX, STIFFNESS_NM2, Setup
from benchmarks.object.scenes import CASES, SETUP, contacts, record
from estimator import ContactEstimator
from estimator.contact.recording import estimate_picture
from estimator.contact.source import estimate_source, open_source
from estimator.object.estimate import estimate_object
from estimator.object.surface import reconstruct, touches_of
from estimator.table.contacts import ContactRow, ContactTable
from estimator.table.files import write_contacts
from vbaa_calib.calibrate.antenna.bundle_adjustment import adjust_bundle
from vbaa_calib.calibrate.lens.intrinsics import solve_intrinsics
from vbaa_calib.rig import Rig
from vbaa_calib.session import Frame

RATE_HZ, _PERIOD = 30.0, 240
"""Frames a second, and frames after which the motion begins anew: 8 s."""
_NOISES = 4
"""Periods with noise of their own; then the pixels come again. The moments' noise is always fresh."""
REACH, DEFLECTION_M, ROLL_RAD = (0.35, 0.75), (0.005, 0.008), 0.4
SESSION = """schema: vbaa.session/1
board: {squares_x: 9, squares_y: 6, square_m: 0.012, marker_m: 0.009}
antenna: {length_m: 0.24, diameter_m: 0.0008, youngs_modulus_Pa: 193.0e9, density_kg_m3: 7900.0}
gravity_world: null
moment_sensor: {std_Nm: 2.0e-5}
"""


@dataclass(frozen=True, eq=False)
class _Period:
    """One period of the motion. `points_px` (_PERIOD, N, 2) and `moment_Nm` (_PERIOD,) are without noise."""

    rig: Rig
    points_px: np.ndarray
    moment_Nm: np.ndarray


def period(points: int) -> _Period:
    """So many points of every frame, evenly along the antenna, under an upright camera."""
    rig = Setup().rig()
    turn = 2.0 * np.pi * np.arange(_PERIOD) / _PERIOD
    distance = LENGTH_M * _between(REACH, np.sin(turn))
    size = push_for_deflection(_between(DEFLECTION_M, np.cos(turn)), distance, STIFFNESS_NM2)
    seen = scenes(rig, distance, rolled(size, ROLL_RAD * np.sin(2.0 * turn)), points=points)
    return _Period(rig, seen.points_px, seen.moment_Nm)


def _between(ends: tuple[float, float], share: np.ndarray) -> np.ndarray:
    """From −1 to 1 as from one end to the other."""
    return 0.5 * (ends[0] + ends[1]) + 0.5 * (ends[1] - ends[0]) * share


def write_recording(folder: Path, frames: int, points: int, seed: int) -> None:
    """A session of centrelines in a folder that exists, with rig.json beside session.yaml; `points` 2 or less: too few
    to estimate anything, so that all but the solver works."""
    one, rng = period(max(points, 2)), np.random.default_rng(seed)
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
            rows.write(f"{name},{index / RATE_HZ:.6f},0,0,{moment:.9g}\n")
            lines.write(name.join(noisy[index // _PERIOD % len(noisy)][at][: points + 1]))


_FRAME_POINTS, _BATCH = 40, 64
_ASPECT = 1.5
"""Width over height of the pictures."""
STIFFNESS_N_M, FRICTION = 1000.0, 0.1
_STROKES = 4
_BESIDE_M = 2e-5
"""How far strokes that are repeated lie from each other."""

Work = Callable[[], object]


def recording_of_frames(size: int, seed: int) -> Work:
    """A recording of so many frames, from its files to contacts.csv as `vbaa estimate` does it."""
    folder = TemporaryDirectory()
    root = Path(folder.name)
    write_recording(root, size, _FRAME_POINTS, seed)

    def work() -> None:
        rig = Rig.load(root / "rig.json")
        found = estimate_source(ContactEstimator(rig), open_source(root, rig))
        write_contacts(root / "contacts.csv", (ContactRow.of(item.frame, item.contact) for item in found), force=True)
        assert folder  # lives as long as the work

    return work


def batch_of_points(size: int, seed: int) -> Work:
    """A batch of frames with so many points each."""
    one, rng = period(size), np.random.default_rng(seed)
    pick = np.linspace(0, _PERIOD - 1, _BATCH).astype(int)
    points = one.points_px[pick] + 0.1 * rng.normal(size=(_BATCH, size, 2))
    nothing, estimator = np.zeros(_BATCH), ContactEstimator(one.rig)
    return lambda: estimator.estimate_batch(points, one.moment_Nm[pick], nothing, nothing)


def one_picture(size: int, seed: int) -> Work:
    """One picture of so many thousand pixels, from its PNG to the contact."""
    height = round((1e3 * size / _ASPECT) ** 0.5)
    shown = cell((round(_ASPECT * height), height), "exact", 1, seed)
    folder = TemporaryDirectory()
    path = Path(folder.name) / "picture.png"
    cv2.imwrite(str(path), shown.photographs[0].image)
    pan, tilt = JOINTS_RAD
    frame = Frame(path, pan, tilt, shown.photographs[0].moment_Nm, frame=0, time_s=0.0)
    estimator = ContactEstimator(shown.rig)
    estimate_picture(estimator, frame)  # templates are made once for a recording
    return lambda: (folder, estimate_picture(estimator, frame))


def lens_solve(size: int, seed: int) -> Work:
    """The lens from so many views."""
    drawn = boards.draw(replace(boards.rigs()[0], views=size), seed)
    return lambda: solve_intrinsics(drawn.views, boards.BOARD, model="opencv5")


def joint_solve(size: int, seed: int) -> Work:
    """Everything together from so many stills: those of one calibration, over and over."""
    given = draw(coverage_rigs()[0], (seed,))
    before, once = prior_of(given), observations(given)
    stills = [once[index % len(once)] for index in range(size)]
    return lambda: adjust_bundle(stills, before, NOMINAL.length_m, MOMENT_NM)


def surface_of_contacts(size: int, seed: int) -> Work:
    """The surface through so many contacts."""
    touches = touches_of(repeated(_stroked(seed), size))
    return lambda: reconstruct(touches, SETUP.rig().antenna.diameter_m / 2)


def object_of_contacts(size: int, seed: int) -> Work:
    """Everything that so many contacts say."""
    table, rig = repeated(_stroked(seed), size), SETUP.rig()
    return lambda: estimate_object(table, rig)


@cache
def _stroked(seed: int) -> ContactTable:
    """A soft cylinder stroked to and fro, some hundred contacts."""
    case, rng = CASES[0], np.random.default_rng(seed)
    played = record(SETUP.rig(), case.make(STIFFNESS_N_M, FRICTION), case.strokes[:_STROKES], rng)
    return contacts(played)


def repeated(table: ContactTable, located: int) -> ContactTable:
    """The same strokes again and again, each contact a little elsewhere, until so many are located."""
    rng, span = np.random.default_rng(0), float(table.time_s[-1] - table.time_s[0]) + 1.0
    times = -(-located // int(table.located.sum()))
    parts = []
    for turn in range(times):
        moved = table.point_world_m + _BESIDE_M * rng.normal(size=table.point_world_m.shape)
        frame, time_s = table.frame + turn * len(table), table.time_s + turn * span
        parts.append(replace(table, frame=frame, time_s=time_s, point_world_m=moved))
    whole = ContactTable.joined(parts)
    end = int(np.flatnonzero(np.cumsum(whole.located) >= located)[0]) + 1
    return whole.picked(slice(end))
