"""What is timed: each function makes everything ready for one size and gives back the work alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np

from estimator import ContactEstimator
from estimator.contact_row import ContactRow, ContactTable
from estimator.felt import feel
from estimator.recording import estimate_picture, estimate_recording
from estimator.surface import reconstruct, touches_of
from estimator.table import write_contacts

from ..calibrate.intrinsics import solve_intrinsics
from ..calibrate.jig import jig_estimate
from ..calibrate.joint import solve_joint
from ..calibrate.plane import solve_board_pose
from ..calibrate.session_rig import prior
from ..rig import Rig
from ..session import Frame, load_session, read_recording
from . import calibration_rigs
from .chain_scenes import JOINTS_RAD, cell
from .coverage_draw import MOMENT_NM, draw
from .coverage_rigs import BOARD, NOMINAL, T_ANTENNA_JIG, coverage_rigs
from .coverage_solve import observations
from .growth_recording import PERIOD, period, write_recording
from .object_cases import CASES, SETUP
from .object_scenes import contacts, record

FRAME_POINTS, BATCH = 40, 64
ASPECT = 1.5
"""Width over height of the pictures."""
STIFFNESS_N_M, FRICTION = 1000.0, 0.1
STROKES = 4
BESIDE_M = 2e-5
"""How far strokes that are repeated lie from each other."""

Work = Callable[[], object]


def recording_of_frames(size: int, seed: int) -> Work:
    """A recording of so many frames, from its files to contacts.csv as `vbaa estimate` does it."""
    folder = TemporaryDirectory()
    root = Path(folder.name)
    write_recording(root, size, FRAME_POINTS, seed)

    def work() -> None:
        session, rig = load_session(root), Rig.load(root / "rig.json")
        found = estimate_recording(ContactEstimator(rig), session, read_recording(session))
        write_contacts(root / "contacts.csv", (ContactRow.of(item.frame, item.contact) for item in found), force=True)
        assert folder  # lives as long as the work

    return work


def batch_of_points(size: int, seed: int) -> Work:
    """A batch of frames with so many points each."""
    one, rng = period(size), np.random.default_rng(seed)
    pick = np.linspace(0, PERIOD - 1, BATCH).astype(int)
    points = one.points_px[pick] + 0.1 * rng.normal(size=(BATCH, size, 2))
    nothing, estimator = np.zeros(BATCH), ContactEstimator(one.rig)
    return lambda: estimator.estimate_batch(points, one.moment_Nm[pick], nothing, nothing)


def one_picture(size: int, seed: int) -> Work:
    """One picture of so many thousand pixels, from its PNG to the contact."""
    height = round((1e3 * size / ASPECT) ** 0.5)
    shown = cell((round(ASPECT * height), height), "exact", 1, seed)
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
    drawn = calibration_rigs.draw(replace(calibration_rigs.rigs()[0], views=size), seed)
    return lambda: solve_intrinsics(drawn.views, calibration_rigs.BOARD, model="opencv5")


def joint_solve(size: int, seed: int) -> Work:
    """Everything together from so many stills: those of one calibration, over and over."""
    given = draw(coverage_rigs()[0], (seed,))
    lens = solve_intrinsics(given.views, BOARD, model=given.rig.lens_model)
    board_pose = solve_board_pose(given.jig_views, BOARD, lens.camera, lens.board_flex.bend)
    before = prior(NOMINAL, lens.camera, [jig_estimate(board_pose, T_ANTENNA_JIG)])
    once = observations(given)
    stills = [once[index % len(once)] for index in range(size)]
    return lambda: solve_joint(stills, before, NOMINAL.length_m, MOMENT_NM)


def surface_of_contacts(size: int, seed: int) -> Work:
    """The surface through so many contacts."""
    touches = touches_of(repeated(_stroked(seed), size))
    return lambda: reconstruct(touches, SETUP.rig().antenna.diameter_m / 2)


def felt_object(size: int, seed: int) -> Work:
    """Everything that so many contacts say."""
    table, rig = repeated(_stroked(seed), size), SETUP.rig()
    return lambda: feel(table, rig)


@cache
def _stroked(seed: int) -> ContactTable:
    """A soft cylinder stroked to and fro, some hundred contacts."""
    case, rng = CASES[0], np.random.default_rng(seed)
    played = record(SETUP.rig(), case.make(STIFFNESS_N_M, FRICTION), case.strokes[:STROKES], rng)
    return contacts(played)


def repeated(table: ContactTable, located: int) -> ContactTable:
    """The same strokes again and again, each contact a little elsewhere, until so many are located."""
    rng, span = np.random.default_rng(0), float(table.time_s[-1] - table.time_s[0]) + 1.0
    times = -(-located // int(table.located.sum()))
    parts = []
    for turn in range(times):
        moved = table.point_world_m + BESIDE_M * rng.normal(size=table.point_world_m.shape)
        parts.append(
            replace(
                table, frame=table.frame + turn * len(table), time_s=table.time_s + turn * span, point_world_m=moved
            )
        )
    whole = ContactTable.joined(parts)
    end = int(np.flatnonzero(np.cumsum(whole.located) >= located)[0]) + 1
    return ContactTable(**{field.name: getattr(whole, field.name)[:end] for field in fields(ContactTable)})
