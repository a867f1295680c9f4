"""What a line of either polarity must be like to be the antenna: geometry and opacity tell, contrast does not."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from vbaa_calib.antenna.shape import bend
from vbaa_calib.camera import Camera
from vbaa_calib.core.polyline import normals, resample
from vbaa_calib.detect.whisker.acceptance import best_of, decided
from vbaa_calib.detect.whisker.antenna import corridor, free_curve, pixels
from vbaa_calib.detect.whisker.centreline import Centreline
from vbaa_calib.detect.whisker.corridor import Corridor, less_sure, of_antennas_shape
from vbaa_calib.detect.whisker.finder import AntennaFinder
from vbaa_calib.detect.whisker.paint import Paint

from ..rod_scenes import BROWN, LENGTH_M, MATRIX, World, camera_pose
from .drawn_lines import SIZE, aside, background, bent, exposed, tube

WIDTH_PX = 4.0
CLAMP, LENGTH = (40.0, 120.4), 220.0
GRAVITY = np.array([0.0, 0.0, -9.81])


@pytest.fixture(scope="module")
def finder() -> AntennaFinder:
    along = np.linspace(0.0, LENGTH, 60)
    axis = np.array(CLAMP) + along[:, None] * [1.0, 0.0]
    where = Corridor(axis, 8.0 + 0.9 * along, WIDTH_PX, clamp_px=4.0, clamp_rad=0.06)
    return AntennaFinder.prepare(where, (SIZE[1], SIZE[0]))


def _patchwork(rng: np.random.Generator, cell_px: int = 14) -> np.ndarray:
    cells = rng.uniform(30.0, 220.0, (SIZE[0] // cell_px + 1, SIZE[1] // cell_px + 1))
    return cv2.resize(cells, None, fx=cell_px, fy=cell_px, interpolation=cv2.INTER_NEAREST)[: SIZE[0], : SIZE[1]]


@pytest.mark.parametrize("bright", [None, True])
def test_a_cable_that_passes_the_clamp_is_not_the_antenna(finder: AntennaFinder, bright: bool | None) -> None:
    """Straight at an angle from the clamp on; a cantilever as far aside at its tip leaves its clamp along its axis."""
    rng = np.random.default_rng(3)
    for angle in (-14.0, 9.0, 20.0):
        cable = exposed(70.0 + background(rng, 2.0) + 60.0 * tube(bent(CLAMP, angle, 0.0), WIDTH_PX, 1.0), rng)
        assert not finder.find(cable, bright).found
        antenna = 70.0 + background(rng, 2.0) + 60.0 * tube(bent(CLAMP, 0.0, 2.0 * angle), WIDTH_PX, 1.0)
        assert finder.find(exposed(antenna, rng), bright).found
        if bright:
            beside = 70.0 + background(rng, 2.0) + 60.0 * tube(bent((40.0, 130.4), 0.0, 0.0), WIDTH_PX, 1.0)
            assert not finder.find(exposed(beside, rng), bright).found


def test_a_patchwork_alone_shows_no_antenna_and_one_before_it_is_seen(finder: AntennaFinder) -> None:
    """The model follows any texture; but an opaque antenna does not follow its background's brightness."""
    found = 0
    for seed in range(24):
        rng = np.random.default_rng([5, seed])
        ground = cv2.GaussianBlur(_patchwork(rng), (0, 0), 0.8)
        found += finder.find(exposed(ground, rng), None).found
    assert found == 0
    seen = []
    for seed in range(6):
        rng = np.random.default_rng([6, seed])
        cover = np.clip(tube(bent(CLAMP, 0.0, 12.0), WIDTH_PX, 1.6), 0.0, 1.0)
        ground = cv2.GaussianBlur(_patchwork(rng), (0, 0), 0.8)
        seen.append(finder.find(exposed(ground * (1.0 - cover) + 240.0 * cover, rng), None))
    assert np.mean([line.found and line.seen > 0.75 for line in seen]) >= 5 / 6


def test_of_two_lines_the_one_that_was_expected_is_taken() -> None:
    one, other = bent(CLAMP, 0.0, 5.0), bent(CLAMP, 0.0, 40.0)
    line = Centreline(one, np.full(len(one), 0.1), 0.9, 30.0, 1.0, guide_px=one).with_verdict("ambiguous", "two", other)
    assert decided(line, one + np.array([0.0, 2.0])).found
    assert decided(line, other).verdict == "ambiguous"
    assert decided(line, np.empty((0, 2))).verdict == "ambiguous"


class _Rig:
    """A calibrated rig's corridor, and its antenna bent by a force."""

    def __init__(self, inclined_deg: float) -> None:
        camera = Camera("opencv", (960, 720), MATRIX, BROWN)
        self.world = World(camera_pose(np.radians(inclined_deg), 0.5 * np.pi))
        self.seen_from = (camera, self.world.T_antenna_camera.inverse())
        free = free_curve(self.world.parameters, LENGTH_M, GRAVITY)
        self.where = replace(corridor(*self.seen_from, free, 0.8e-3), clamp_px=1.5, clamp_rad=0.015, shape_px=0.5)

    def pressed(self, contact: float, bend_rad: float, side_rad: float) -> np.ndarray:
        """(N, 2) by a force there, in lengths, that turns it by so much."""
        parameters = self.world.parameters
        size = 2.0 * bend_rad * np.exp(parameters[6]) / (contact * LENGTH_M) ** 2
        force = size * np.array([[np.cos(side_rad), np.sin(side_rad)]])
        shape = bend(parameters[None], LENGTH_M, GRAVITY[None], np.array([contact * LENGTH_M]), force)
        return resample(pixels(*self.seen_from, shape.points_m[0]), 1.0)[0]


@pytest.mark.parametrize("inclined_deg", [0.0, 45.0])
def test_a_calibrated_rigs_antenna_is_its_free_shape_bent_by_a_force(inclined_deg: float) -> None:
    """Of forces from all sides and any noise that is stated, bent by up to 0.8 rad; a kink, or a line beside the clamp,
    is none."""
    rng, rig = np.random.default_rng(4), _Rig(inclined_deg)

    def misfit(path: np.ndarray, noise_px: float) -> float:
        noisy = path + noise_px * rng.standard_normal(len(path))[:, None] * normals(path)
        return rig.where.misfit(noisy, np.full(len(path), max(noise_px, 0.05)))

    for contact in (0.33, 0.57, 0.8, 0.95):
        for bend_rad in (-0.8, -0.3, 0.05, 0.5):
            for side_rad in (0.0, 1.2):
                for noise_px in (0.05, 1.0):
                    assert misfit(rig.pressed(contact, bend_rad, side_rad), noise_px) < 1.0
    path = rig.pressed(0.6, 0.4, 0.3)
    later = np.maximum(np.arange(len(path)) - 0.75 * len(path), 0.0)[:, None]
    assert misfit(path + np.array([0.0, 5.0]), 0.1) > 1.0
    assert misfit(path + later * np.array([0.0, 0.2]), 0.1) > 1.0
    assert misfit(path + np.where(later > 0.0, [0.0, 3.0], 0.0), 0.1) > 1.0


@pytest.mark.parametrize("off_px", [8.0, 30.0])
def test_the_nearest_shape_is_found_where_another_thing_draws_points_aside(off_px: float) -> None:
    """A cable across the clamp, an object's edge at the end."""
    rng, rig = np.random.default_rng(6), _Rig(30.0)
    for contact, bend_rad in ((0.7, 0.4), (0.4, -0.3), (0.95, 0.15)):
        path = rig.pressed(contact, bend_rad, 0.1)
        share, normal = np.linspace(0.0, 1.0, len(path)), normals(path)
        for first, last in ((0.0, 0.1), (0.4, 0.5), (0.9, 1.0)):
            off = off_px * ((share >= first) & (share <= last)) + 0.3 * rng.standard_normal(len(path))
            nearest = resample(rig.where.nearest(path + off[:, None] * normal, np.full(len(path), 0.3)), 1.0)[0]
            # an end a little aside may be the antenna's own, bent more
            assert np.abs(aside(path, nearest)).max() < (0.5 if last < 1.0 or off_px > 20.0 else off_px)
            assert abs(len(nearest) - len(path)) < 0.08 * len(path)
    assert len(rig.where.nearest(path[:4], np.ones(4))) == 0


@pytest.mark.parametrize("changing", [False, True])
def test_a_line_that_has_less_of_the_antennas_shape_is_less_sure(changing: bool) -> None:
    """And none with a kink; of either polarity none either that is short and fits badly."""
    rig = _Rig(30.0)
    path = rig.pressed(0.7, 0.4, 0.3)
    share, normal = np.linspace(0.0, 1.0, len(path)), normals(path)

    def judged(off_px: np.ndarray, seen: float = 1.0) -> Centreline:
        points, numbers = path + off_px[:, None] * normal, np.full(len(path), 0.1)
        line = Centreline(points, numbers, seen, 30.0, 1.0, "ok", "", points, effective_px=numbers)
        return less_sure(of_antennas_shape(line, rig.where, changing), rig.where)

    wavy = 0.8 * np.sin(4.0 * np.pi * share) * share
    assert (judged(np.zeros(len(path))).sigma_px == 0.1).all()
    assert (judged(wavy).sigma_px > 0.4).all()
    assert (judged(wavy).effective_px > judged(wavy).sigma_px).all()
    assert judged(wavy, 0.6).found is not changing
    assert not judged(40.0 * np.abs(share - 0.5)).found


def test_on_a_calibrated_rig_a_line_is_measured_along_the_antennas_shapes() -> None:
    """A bright cable crosses it at a narrow angle near the clamp: by contrast alone the line begins on that. What is
    no guide shows nothing."""
    rig, rng = _Rig(0.0), np.random.default_rng(10)
    width, height = 960, 720
    path = rig.pressed(0.7, 0.3, 0.0)
    span = path[60] - path[0]
    across = span[::-1] * [-1.0, 1.0] / np.hypot(*span)
    cable = path[0] + np.linspace(-0.2, 3.0, 200)[:, None] * span + across * np.linspace(9.0, -9.0, 200)[:, None]

    def drawn(line: np.ndarray, width_px: int, level: float, picture: np.ndarray) -> None:
        points = np.rint(16.0 * line).astype(np.int32)
        cv2.polylines(picture, [points], False, level, width_px, cv2.LINE_AA, 4)

    picture = np.full((height, width), 60, np.uint8)
    drawn(cable, 2, 230.0, picture)
    drawn(path, 4, 130.0, picture)
    picture = exposed(cv2.GaussianBlur(picture, (0, 0), 0.7).astype(float), rng)
    where = replace(rig.where, width_px=4.0)
    finder = AntennaFinder.prepare(where, (width, height))
    line = finder.find(picture, None)
    assert line.found
    assert np.sqrt(np.mean(aside(path, line.points_px) ** 2)) < 0.5
    again = finder.along(picture, path + np.array([0.0, 1.0]), 4.0, None)
    assert np.sqrt(np.mean(aside(path, again.points_px) ** 2)) < 0.5
    for guide in (path[:0], path[:1], path[:2]):
        assert not finder.along(picture, guide, 4.0, None).found


def test_where_it_is_as_bright_as_what_lies_behind_it_an_antenna_is_seen_by_its_colour() -> None:
    rig, rng, (width, height) = _Rig(0.0), np.random.default_rng(11), (960, 720)
    path = rig.pressed(0.7, 0.3, 0.0)
    cover = np.zeros((height, width), np.uint8)
    cv2.polylines(cover, [np.rint(16.0 * path).astype(np.int32)], False, 255, 4, cv2.LINE_AA, 4)
    cover = cv2.GaussianBlur(cover, (0, 0), 0.7)[..., None] / 255.0
    ground = np.full((height, width, 3), 60.0)
    first, last = path[len(path) // 3, 0], path[3 * len(path) // 4, 0]
    ground[:, int(first) : int(last)] = 240.0, 110.0, 128.0  # grey level 130
    taken = exposed(ground * (1.0 - cover) + 130.0 * cover, rng).astype(np.uint8)
    where, paint = replace(rig.where, width_px=4.0), Paint(None)
    finder, grey = AntennaFinder.prepare(where, (width, height)), paint.plane(taken)
    line, seen = (finder.along(grey, path, 4.0, None, picture) for picture in (None, taken))
    assert line.seen < 0.8
    assert seen.found
    assert seen.seen > 0.95
    off = aside(path, seen.points_px)
    assert np.sqrt(np.mean(off**2)) < 0.2
    assert np.sqrt(np.mean((off / seen.sigma_px) ** 2)) < 2.0
    for colourless in (grey, np.repeat(grey[..., None], 3, axis=2)):
        assert finder.along(grey, path, 4.0, None, colourless).seen == line.seen


def test_of_two_lines_the_one_that_an_edge_explains_is_less_likely() -> None:
    line = Centreline(np.zeros((2, 2)), np.ones(2), 0.9, 30.0, 1.0, verdict="ok")
    assert best_of([replace(line, sure=0.5), replace(line, seen=0.7)], 4.0).seen == 0.7
