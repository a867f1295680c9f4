"""The worlds benchmark's own truth: its mechanics, its pictures, and one small world on the whole way."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from benchmarks.worlds.judge import outcome, true_rig
from benchmarks.worlds.mechanics import Wire, hang, press
from benchmarks.worlds.optics import FAMILIES, Optics
from benchmarks.worlds.pictures import Sensor, Tube, photograph
from benchmarks.worlds.rigs import draw_optics, draw_world
from benchmarks.worlds.session import Photographer, write_session
from vbaa_calib.cli.main import main
from vbaa_calib.detect.whisker.profile import measure, measure_in_colour

PLAIN = Wire(0.2, 8e-4, 4e-3, 0.0, np.zeros(2), np.zeros(2), np.zeros(2), 0.0)
FAR = np.zeros((1, 3))
SHARP = Sensor("well sampled", 0.7, 0.0, 1e9, 95, 4)


def test_the_wire_is_the_elastica_of_elliptic_integrals() -> None:
    """A dead force P at the tip, a = P·L²/EI: deflection and shortening over the length."""
    for a, across, along in ((1.0, 0.301720774, 0.056433236), (5.0, 0.713791524, 0.387628361)):
        (bent,) = hang(PLAIN, FAR, np.array([0.2 - 1e-9]), np.array([[0.0, a * 4e-3 / 0.04, 0.0]]))
        np.testing.assert_allclose(bent.points_m[-1] / 0.2, [1.0 - along, across, 0.0], atol=1e-6)


def test_an_object_pushes_across_the_wire() -> None:
    (bent,) = press(PLAIN, FAR, np.array([0.15]), np.array([[0.0, 0.2, 0.1]]), np.array([0.1]))
    angle = np.arccos(bent.along(0.15) @ bent.force_N / np.linalg.norm(bent.force_N))
    assert np.degrees(np.arccos(bent.along(0.2)[0])) > 10.0
    np.testing.assert_allclose(angle, np.pi / 2 + 0.1, atol=1e-6)


@pytest.mark.parametrize("family", FAMILIES)
def test_rays_lead_back_to_their_pixels(family: str) -> None:
    optics = draw_optics(np.random.default_rng(5), [family])
    pixel = np.array(optics.size) * [0.05, 0.9]
    ray = np.append(optics.ray(pixel), 1.0)
    np.testing.assert_allclose(optics.pixels(ray), pixel, atol=1e-5)
    world = replace(draw_world(0, 6), optics=optics)
    np.testing.assert_allclose(true_rig(world, None).camera.project(ray)[0], pixel, atol=1e-5)


def test_a_line_lies_where_it_is_projected_to() -> None:
    """The centroid across a thin wire of several slopes, straight off the picture."""
    optics = Optics("radial", (320, 240), np.array([400.0, 400.0]), np.array([150.0, 118.0]), np.array([-0.1, 0.0]))
    for slope in (0.0, 0.02, 0.3):
        x = np.linspace(-0.05, 0.05, 300)
        axis = np.stack([x, slope * x + 1.3e-3, np.full(300, 0.2)], axis=1)
        wire = Tube.of(optics, axis, 5e-4, (0.9, 0.7))
        picture = photograph(optics, SHARP, np.full((240, 320), 0.2), [wire], np.random.default_rng(0)).astype(float)
        off = []
        for column in range(80, 230, 7):
            height = np.interp(column, wire.axis_px[:, 0], wire.axis_px[:, 1])
            rows = np.arange(round(height) - 8, round(height) + 9)
            light = picture[rows, column] - picture[rows[[0, -1]], column].mean()
            off.append((rows * light).sum() / light.sum() - height)
        assert np.abs(off).max() < 0.02


@pytest.mark.parametrize("channels", [1, 3])
def test_a_rod_that_comes_nearer_is_measured_midway_between_its_edges(channels: int) -> None:
    """Columns cross it at a slant, and one edge where it is broader."""
    optics = Optics("radial", (480, 360), np.array([500.0, 500.0]), np.array([240.0, 180.0]), np.zeros(2))
    x = np.linspace(-0.04, 0.03, 300)
    rod = Tube.of(optics, np.stack([x, 0.6 * x, 0.15 - 0.9 * (x + 0.04)], axis=1), 1.5e-3, (0.9, 0.88))
    light = photograph(optics, SHARP, np.full((360, 480), 0.2), [rod], np.random.default_rng(0))
    width, (low, high) = np.median(np.diff(rod.edges_px, axis=0)), rod.edges_px
    path = np.ascontiguousarray(rod.axis_px[::8])
    line = (
        measure(light, path, width)
        if channels == 1
        else measure_in_colour(np.dstack([light, light, light]), path, width)
    )
    assert line.found
    nearest = cKDTree(rod.axis_px).query(line.points_px)[1]
    along = np.gradient(rod.axis_px, axis=0)[nearest]
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1)[:, None]
    off = ((line.points_px - rod.axis_px[nearest]) * normal).sum(axis=1) - 0.5 * (low + high)[nearest]
    assert (high - low)[-1] > 1.5 * (high - low)[0]
    assert np.abs(off).mean() < 0.01


@pytest.mark.parametrize("slope_deg", [0.0, 20.0, 32.0, 40.0])
def test_a_broad_rod_is_as_high_and_broad_at_any_slant(slope_deg: float) -> None:
    """Where columns cross it at a slant they show less of what is next to it."""
    optics = Optics("radial", (480, 360), np.array([500.0, 500.0]), np.array([240.0, 180.0]), np.zeros(2))
    x = np.linspace(-0.045, 0.045, 300)
    axis = np.stack([x * np.cos(np.radians(slope_deg)), x * np.sin(np.radians(slope_deg)), np.full(300, 0.15)], axis=1)
    rod = Tube.of(optics, axis, 3.6e-3, (0.1, 0.1))
    bench = np.full((360, 480), 0.6) * (1.0 + np.linspace(-0.1, 0.1, 360)[:, None])
    light = photograph(optics, SHARP, bench, [rod], np.random.default_rng(0))
    line = measure(light, np.ascontiguousarray(rod.axis_px[::8]), 24.0, False)
    assert line.found
    assert abs(line.breadth - 1.0) < 0.1
    assert abs(line.amplitude / (255.0 * 0.5) - 1.0) < 0.1


def test_corners_lie_where_they_are_projected_to() -> None:
    world = replace(draw_world(0, 6), sensor=SHARP)
    view = world.camera.inverse() @ world.jig
    data = Photographer(world).board(view, np.random.default_rng(0))
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    true = world.optics.pixels(view.of(world.board.corners_m))
    end = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 100, 1e-4)
    found = cv2.cornerSubPix(picture, true.astype(np.float32)[:, None] + 0.3, (3, 3), (-1, -1), end)[:, 0]
    assert np.abs(np.mean(found - true, axis=0)).max() < 0.01
    # OpenCV takes the edges of markers nearby for the corner's
    assert np.median(np.abs(found - true)) < 0.03


def test_a_small_world_on_the_whole_way(tmp_path: Path) -> None:
    """It calibrates, and contacts are where they are, as far as is stated."""
    world = draw_world(0, 1)
    world = replace(
        world, boards=world.boards[:8], free=world.free[:3], loads=world.loads[:4], contacts=world.contacts[2:8]
    )
    found = outcome(world, write_session(world, tmp_path / "session"), tmp_path / "session")
    assert found.calibrated < 2, found.words
    assert found.ours is not None
    assert found.true is not None
    assert len(found.ours.error_m) >= 3
    assert found.ours.silent == found.true.silent == 0


def test_the_jig_is_typed_nearly_as_it_is() -> None:
    world = draw_world(0, 6)
    assert world.jig is not None
    assert world.jig_typed is not None
    turn = world.jig_typed.turn.as_matrix() @ world.jig.turn.as_matrix().T
    assert np.linalg.norm(Rotation.from_matrix(turn).as_rotvec()) < 5e-3


@pytest.mark.slow
def test_the_subject_tells_of_every_world(tmp_path: Path) -> None:
    assert main(["bench", "worlds", "--draws", "1", "--out", str(tmp_path)]) == 0
