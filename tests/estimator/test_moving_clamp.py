"""Antennas on clamps that move: intervals sampled from the priors, lost clamps, exchanged antennas."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from estimator.contact.moving_clamp import _ClampTrack, clamp_tracks, estimate_antennas
from estimator.contact.recording import FrameContact
from estimator.table.contacts import LOCATED
from estimator.table.files import read_contacts
from vbaa_calib.antenna.rod import Rod, sample_shape, solve_rod
from vbaa_calib.cli.main import main
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_json, write_text
from vbaa_calib.geometry import Pose
from vbaa_calib.rig import Rig
from vbaa_calib.session import Frame, antennas_of, recording_of
from vbaa_calib.simulate.scene.scene import bundled_scene

from ..rod_scenes import along, press

LENGTH_M, BOW_PER_M, STEP_M = 0.036, 8.0, 6.25e-5
RATE_HZ = 500.0


@pytest.fixture(scope="module")
def whiskers(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bundled recording's first whisk."""
    folder = tmp_path_factory.mktemp("whiskers")
    text = bundled_scene("whiskers").read_text(encoding="utf-8").replace("frames: 250", "frames: 62")
    write_text(folder / "short.yaml", text)
    assert main(["simulate", str(folder / "short.yaml"), "-o", str(folder / "short")]) == 0
    return folder / "short"


def pressed(rig: Rig, count: int, sigma_px: float) -> tuple[list[Frame], dict[int, np.ndarray], np.ndarray]:
    """Frames, lines and true distances (F,), NaN where free, of a whisker that is pressed anywhere from any side, with
    turns, depths and friction as their priors say."""
    rng, clamp = np.random.default_rng(round(1e3 * sigma_px)), rig.clamp
    assert clamp is not None
    time_s = np.arange(count) / RATE_HZ
    phase = 2.0 * np.pi * time_s[:, None] * [8.0, 8.0, 8.0, 5.3, 9.1, 3.7] + rng.uniform(0.0, 6.0, 6)
    std = np.sqrt(2.0) * np.array([0.3, 5e-4, 5e-4, clamp.depth_std_m, clamp.elevation_std_rad, clamp.roll_std_rad])
    angle, x, y, depth, up, roll = (std * np.sin(phase)).T
    turns = Rotation.from_euler("ZYX", np.column_stack([angle, -up, roll])).as_matrix()
    antenna = rig.of_antenna("C1").antenna
    rod = Rod(
        LENGTH_M,
        antenna.stiffness_Nm2,
        antenna.stiffness_Nm2 / 1.3,
        antenna.mass_per_length_kg_m,
        natural_curvature_per_m=np.array([0.0, BOW_PER_M]),
    )
    distance = LENGTH_M * rng.uniform(0.4, 0.9, count)
    size = 3.0 * rod.bending_stiffness_Nm2 / distance**2 * rng.uniform(0.02, 0.12, count)
    free = np.arange(count) % 4 == 0
    side = rng.uniform(-np.pi, np.pi, count)
    push = np.where(free, 0.0, size)[:, None] * np.column_stack([np.cos(side), np.sin(side)])
    gravity = rig.gravity_world_m_s2 @ turns
    shape, force = press(rod, gravity, distance, push)
    friction = 0.2 * rng.standard_normal((count, 1))
    for _ in range(3):
        tangent = sample_shape(shape, distance[:, None])[1][:, 0]
        normal = force - (force * tangent).sum(axis=1, keepdims=True) * tangent
        normal *= np.where(free, 0.0, size)[:, None] / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
        force = normal - np.tan(friction) * np.linalg.norm(normal, axis=1, keepdims=True) * tangent
        shape = solve_rod(rod, gravity, distance, force)
    view, focal = rig.T_antenna_camera.inverse(), rig.camera.matrix[0, 0]
    lines = {}
    for row in range(count):
        s = np.arange(STEP_M * rng.uniform(), 0.97 * LENGTH_M, STEP_M)
        seen = view @ (Pose(turns[row], np.array([x[row] - 0.02, y[row], depth[row]])) @ along(shape, s, row))
        pixels = focal * seen[:, :2] / seen[:, 2:] + rig.camera.matrix[:2, 2]
        noisy = pixels + sigma_px * rng.standard_normal(pixels.shape)
        lines[row] = np.column_stack([noisy, np.full(len(s), np.nan)])
    frames = [Frame(None, 0.0, 0.0, np.nan, frame=row, time_s=float(row)) for row in range(count)]
    return frames, lines, np.where(free, np.nan, distance)


@pytest.mark.parametrize("sigma_px", [0.05, pytest.param(0.3, marks=pytest.mark.slow)])
def test_intervals_hold_with_a_clamp_of_every_frame(whiskers: Path, sigma_px: float) -> None:
    rig = Rig.load(whiskers / "whiskers.yaml")
    frames, lines, true_m = pressed(rig, 160, sigma_px)
    tracks = clamp_tracks(rig, frames, {"C1": lines})
    assert tracks["C1"].free_frames >= 27
    assert tracks["C1"].rig.antenna.parameters[5] == pytest.approx(BOW_PER_M, abs=0.1)
    found = [each.contact for each in estimate_antennas(tracks, frames, {"C1": lines})]
    located = np.array([each.status in LOCATED for each in found])
    assert not located[np.isnan(true_m)].any()
    off = np.array([(each.distance_m - true) / each.distance_std_m for each, true in zip(found, true_m, strict=True)])
    assert located.sum() > 40
    assert (np.abs(off[located]) < 1.96).mean() > 0.92
    assert np.abs(off[located]).max() < 5.0


def estimated(
    whiskers: Path, changed: Mapping[str, Mapping[int, np.ndarray]] | None = None
) -> tuple[dict[str, _ClampTrack], dict[tuple[str, int], FrameContact]]:
    """The recording's antennas by name and frame; `changed` lines in the place of its own."""
    rig, frames = Rig.load(whiskers / "whiskers.yaml"), recording_of(whiskers / "readings.csv", with_images=False)
    lines = dict(antennas_of(whiskers / "centrelines.csv") if changed is None else changed)
    tracks = clamp_tracks(rig, frames, lines)
    return tracks, {(each.antenna, each.frame.frame): each for each in estimate_antennas(tracks, frames, lines)}


def truth_of(whiskers: Path) -> dict[tuple[str, int], dict[str, float]]:
    return {(row["antenna"], row["frame"]): row for row in read_json(whiskers / "truth.json")["frames"]}


def test_lost_and_exchanged_clamps_are_named(whiskers: Path) -> None:
    """Neither of them gives a contact, and the frames around them are as without them."""
    lines = {name: dict(each) for name, each in antennas_of(whiskers / "centrelines.csv").items()}
    lost, exchanged = range(12, 24), range(40, 52)
    for frame in lost:
        lines["C2"][frame] = lines["C2"][frame][25:]
    for frame in exchanged:
        lines["C1"][frame], lines["C2"][frame] = lines["C2"][frame], lines["C1"][frame]
    lines["C3"][60] = lines["C3"][60][:4]
    _, found = estimated(whiskers, lines)
    for name, several, cause in (
        ("C2", lost, "first points are missing"),
        ("C1", exchanged, "that of C2 does"),
        ("C2", exchanged, "that of C1 does"),
    ):
        assert {found[name, frame].contact.status for frame in several} == {"failed"}
        assert all(cause in found[name, frame].contact.reason for frame in several)
    assert found["C3", 60].contact.status == "no_antenna"
    truth = truth_of(whiskers)
    for key, each in found.items():
        if each.contact.status in LOCATED:
            assert key[0] == "C2"
            assert abs(each.contact.distance_m - truth[key]["distance_m"]) < 4.0 * each.contact.distance_std_m


def test_a_recording_of_whiskers_from_file_to_table(whiskers: Path, tmp_path: Path) -> None:
    """Contacts of the one that touches, where it touches; the page's numbers come of the whole of it."""
    files = {"centrelines": "centrelines.csv", "readings": "readings.csv", "rig": "whiskers.yaml"}
    flags = [word for flag, name in files.items() for word in (f"--{flag}", str(whiskers / name))]
    output = tmp_path / "contacts.csv"
    assert main(["estimate", *flags, "-o", str(output), "--no-report"]) == 0
    with pytest.raises(InputError, match="C1, C2, C3: only one is supported here"):
        read_contacts(output)
    with pytest.raises(InputError, match="has no antenna D1"):
        read_contacts(output, antenna="D1")
    truth, table = truth_of(whiskers), read_contacts(output, antenna="C2")
    assert table.located.sum() >= 10
    assert not read_contacts(output, antenna="C1").located.any()
    for row in table.rows():
        true = truth["C2", row.frame]
        assert np.linalg.norm(row.clamp_world_m[:2] - true["clamp_world_m"][:2]) < 2e-4
        assert row.clamp_angle_rad == pytest.approx(true["clamp_angle_rad"], abs=0.01)
        if row.status in LOCATED:
            off = (row.point_world_m - true["contact_world_m"])[:2]
            assert off @ np.linalg.solve(row.covariance_world_m2[:2, :2], off) < 16.0
            assert row.force_y_N == pytest.approx(true["force_N"][1], rel=0.6)
    for verb in (["next", str(output), "--rig"], ["track", str(output), "-o", str(tmp_path / "t.csv"), "--rig"]):
        assert main([*verb, str(whiskers / "whiskers.yaml"), "--antenna", "C2"]) == 2
