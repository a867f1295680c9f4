"""`vbaa simulate`: a scene file to a session in the agreed layout, the same bytes for the same seed."""

from __future__ import annotations

import argparse
import functools
import hashlib
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from vbaa_calib import session as session_files
from vbaa_calib.cli import simulate as simulate_cli
from vbaa_calib.simulate.plan import AntennaShot, Plan, plan
from vbaa_calib.simulate.scene.lens import project
from vbaa_calib.simulate.scene.scene import SceneSpec, _bundled_names, bundled_scene, true_rod
from vbaa_calib.simulate.scene.scene_file import load_scene

from ..csv_files import read_rows


@functools.cache
def _bundled(name: str) -> tuple[SceneSpec, Plan]:
    scene = load_scene(bundled_scene(name))
    return scene, plan(scene)


SESSIONS = ["cone", "demo", "steep_sphere", "two_cameras", "upright_knife"]
"""Bundled scenes of sessions; whiskers have none."""


def _small(**changes: Any) -> dict[str, Any]:
    """The demo scene with few and small pictures."""
    data = yaml.safe_load(bundled_scene("demo").read_text())
    data["antenna"]["youngs_modulus_Pa"] = 193e9
    camera = data["camera"]
    camera["image_size"] = [320, 240]
    camera["matrix"] = [[334.7, 0.0, 158.5], [0.0, 333.7, 120.7], [0.0, 0.0, 1.0]]
    data["intrinsics"]["pictures"] = 2
    data["jig"]["pictures"] = 2
    data["noload"] = data["noload"][:2]
    data["loads"] = data["loads"][:3]
    data["recording"]["sweeps"] = [data["recording"]["sweeps"][0] | {"frames": 4, "free_frames": 1}]
    return data | changes


def _scene_file(folder: Path, **changes: Any) -> Path:
    path = folder / "scene.yaml"
    path.write_text(yaml.safe_dump(_small(**changes)))
    return path


def _simulate(scene: Path | str, out: Path, *options: str, force: bool = False) -> dict[str, Any]:
    parser = argparse.ArgumentParser()
    simulate_cli.configure(parser)
    args = parser.parse_args([str(scene), "-o", str(out), *options])
    args.force = force
    return simulate_cli._run(args)


def _digests(folder: Path) -> dict[str, str]:
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("simulate")
    _simulate(_scene_file(folder), folder / "session")
    return folder / "session"


def test_the_session_reader_takes_what_was_written(written: Path) -> None:
    session = session_files.load_session(written)
    assert session.moment_std_Nm == 2e-5
    assert session.T_antenna_board is not None
    assert len(session_files.read_noload(session)) == 2
    assert len(session_files.read_loads(session)) == 3
    assert [frame.frame for frame in session_files.read_recording(session)] == list(range(6))
    names = {str(path.relative_to(written)) for path in written.rglob("*.png")}
    assert sum(name.startswith("intrinsics/") for name in names) == 2
    assert sum(name.startswith("plane/") for name in names) == 2
    for name in names:
        picture = cv2.imread(str(written / name), cv2.IMREAD_UNCHANGED)
        assert picture.shape == (240, 320)
        assert picture.dtype == np.uint8


def test_the_same_seed_gives_the_same_bytes_and_another_does_not(written: Path, tmp_path: Path) -> None:
    scene = _scene_file(tmp_path)
    _simulate(scene, tmp_path / "again")
    assert _digests(tmp_path / "again") == _digests(written)
    _simulate(scene, tmp_path / "other", "--seed", "7")
    mine, other = _digests(written), _digests(tmp_path / "other")
    assert mine.keys() == other.keys()
    assert all(mine[name] != other[name] for name in mine if name.endswith((".png", ".csv")))
    assert mine["session.yaml"] == other["session.yaml"]


def test_the_truth_is_consistent(written: Path) -> None:
    truth, scene = json.loads((written / "truth.json").read_text()), load_scene(_scene_file(written.parent))
    frames, rows = truth["frames"], read_rows(written / "recording/recording.csv")
    assert truth["schema"] == "vbaa.truth/1"
    assert [frame["in_contact"] for frame in frames] == [False, True, True, True, True, False]
    assert truth["stiffness_Nm2"] == pytest.approx(scene.antenna.stiffness_Nm2 * 1.03)
    for frame, row in zip(frames, rows, strict=True):
        reading = float(row["moment_Nm"])
        expected = scene.moment.gain * frame["moment_true_Nm"] + scene.moment.offset_Nm
        assert reading == pytest.approx(expected, abs=5 * scene.moment.std_Nm)
        if not frame["in_contact"]:
            assert frame["force_N"] == [0.0, 0.0, 0.0]
            assert frame["contact_world_m"] is None
            continue
        pose = scene.kinematics.T_world_antenna(float(row["pan_rad"]), float(row["tilt_rad"]))
        np.testing.assert_allclose(pose @ np.array(frame["contact_antenna_m"]), frame["contact_world_m"], atol=1e-9)
        distance, normal = scene.object.signed_distance(np.array(frame["contact_world_m"]))
        push = pose.rotation @ np.array(frame["force_N"])
        pressed = push @ normal
        assert scene.radius_m - distance == pytest.approx(pressed / scene.object.stiffness_N_m, abs=2e-6)
        assert np.arccos(pressed / np.linalg.norm(push)) < np.arctan(scene.object.friction) + 0.01
        assert 0.13 < frame["distance_m"] < 0.17


def test_the_moment_is_force_plus_weight(tmp_path: Path) -> None:
    scene = load_scene(_scene_file(tmp_path))
    planned, rod = plan(scene), true_rod(scene)
    frame, shot = planned.truth["frames"][2], [s for s in planned.shots if "recording" in s.path][2]
    gravity = scene.T_world_antenna(shot.joints).rotation.T @ scene.gravity_world_m_s2
    x, _, z = frame["contact_antenna_m"]
    of_force = x * frame["force_N"][2] - z * frame["force_N"][0]
    weight = rod.mass_per_length_kg_m * gravity
    middle = np.trapezoid(shot.points_m, shot.arclength_m, axis=0)
    of_weight = middle[0] * weight[2] - middle[2] * weight[0]
    assert frame["moment_true_Nm"] == pytest.approx(of_force + of_weight, rel=1e-3)


def test_centrelines_stand_in_for_the_recordings_pictures(written: Path, tmp_path: Path) -> None:
    _simulate(_scene_file(tmp_path), tmp_path / "session", "--pictures", "none")
    root = tmp_path / "session"
    session = session_files.load_session(root)
    frames = session_files.read_recording(session)
    lines = session_files.read_centrelines(session)
    assert not list((root / "recording").glob("*.png"))
    assert {frame.frame for frame in frames} == set(lines)
    assert min(map(len, lines.values())) > 100
    # what both ways write is the same: the free antenna's last pixels lie on its picture
    bright = cv2.imread(str(written / "recording/frame_0000.png"), cv2.IMREAD_GRAYSCALE)
    on_line = bright[tuple(np.round(lines[0][10:-10, 1::-1]).astype(int).T)]
    assert np.median(on_line) > 1.5 * np.median(bright)
    shared = _digests(root / "intrinsics").items() <= _digests(written / "intrinsics").items()
    assert shared


def test_every_bundled_scene_can_be_carried_out() -> None:
    assert _bundled_names() == [*SESSIONS, "whiskers"]
    for name in SESSIONS:
        scene, planned = _bundled(name)
        frames = planned.truth["frames"]
        touching = [frame for frame in frames if frame["in_contact"]]
        deflections = [np.hypot(*frame["contact_antenna_m"][1:]) for frame in touching]
        assert scene.name == name
        assert len(touching) >= (60 if name == "demo" else 20)
        assert len(frames) > len(touching)
        assert np.quantile(deflections, 0.25) > 0.005


def test_the_whole_antenna_is_in_every_picture_of_the_bundled_scenes() -> None:
    for name in SESSIONS:
        scene, planned = _bundled(name)
        for shot in planned.shots:
            if isinstance(shot, AntennaShot):
                one = scene.of_camera(shot.camera) if shot.camera else scene
                pixels = project(one.lens, one.T_antenna_camera.inverse() @ shot.points_m)
                assert (pixels > 10).all()
                assert (pixels < np.array(one.lens.image_size) - 10).all()
