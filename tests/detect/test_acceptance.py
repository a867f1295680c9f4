"""What a line must be like to be the antenna, in drawn, painted and path-traced pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from vbaa_calib.antenna.shape import bend
from vbaa_calib.calibrate.antenna.learnt_paint import learn
from vbaa_calib.camera import Camera
from vbaa_calib.core.polyline import normals, resample
from vbaa_calib.detect.whisker.centreline import Centreline, Visibility
from vbaa_calib.detect.whisker.corridor import Corridor, corridor, free_curve, pixels
from vbaa_calib.detect.whisker.finder import AntennaFinder
from vbaa_calib.detect.whisker.finder import finder as detector
from vbaa_calib.detect.whisker.paint import Paint, look_of, usual_looks, without_other_things
from vbaa_calib.detect.whisker.profile import measure, measure_ribbon
from vbaa_calib.detect.whisker.settings import SearchSettings
from vbaa_calib.geometry import Pose

from ..rod_scenes import BROWN, LENGTH_M, MATRIX, World, camera_pose
from ..traced_pictures import TracedPicture, traced_pictures
from .drawn_lines import SIZE, aside, background, bent, exposed, straight, tube

WIDTH_PX = 4.0
CLAMP, LENGTH = (40.0, 120.4), 220.0
GRAVITY = np.array([0.0, 0.0, -9.81])


@pytest.fixture(scope="module")
def finder() -> AntennaFinder:
    along = np.linspace(0.0, LENGTH, 60)
    axis = np.array(CLAMP) + along[:, None] * [1.0, 0.0]
    where = Corridor(axis, 8.0 + 0.9 * along, WIDTH_PX, clamp_px=4.0, clamp_rad=0.06)
    return AntennaFinder.prepare(where, (SIZE[1], SIZE[0]))


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


WIDTH_PX_PAINT = 3.0


@pytest.fixture(scope="module")
def finder_paint() -> AntennaFinder:
    along = np.linspace(0.0, 225.0, 60)
    axis = np.array([40.0, 120.0]) + along[:, None] * np.array([1.0, 0.0])
    return AntennaFinder.prepare(Corridor(axis, 8.0 + 0.9 * along, WIDTH_PX_PAINT), (SIZE[1], SIZE[0]))


def picture(rng: np.random.Generator, turn_deg: float, height: float = 90.0) -> tuple[np.ndarray, np.ndarray]:
    """(H, W) float grey levels and the drawn path."""
    path = bent((40.0, 120.4), 0.0, turn_deg)
    return background(rng, 2.0) + tube(path, WIDTH_PX_PAINT, height), path


def test_a_colour_is_found_where_the_grey_level_shows_nothing(finder_paint: AntennaFinder) -> None:
    """The antenna is redder and less green than the ground, and exactly as grey."""
    rng = np.random.default_rng(1)
    path = bent((40.0, 120.4), 0.0, 20.0)
    line, ground = tube(path, WIDTH_PX_PAINT, 60.0), background(rng, 2.0)
    planes = [exposed(ground + share * line, rng) for share in (0.0, -0.299 / 0.587, 1.0)]
    colour = np.stack(planes, axis=-1).astype(np.uint8)
    assert not Paint().find(finder_paint, colour).found
    paint = learn([finder_paint], [colour])
    assert paint is not None
    found = paint.find(finder_paint, colour)
    assert found.found
    error = aside(path, found.points_px)
    assert abs(error.mean()) < 0.02
    # measured by both edges: what these share is in the deviations
    assert 0.5 < error.std() / np.sqrt((found.sigma_px**2).mean()) < 1.2


def test_what_is_hidden_and_where_the_visible_end_is(finder_paint: AntennaFinder) -> None:
    rng = np.random.default_rng(4)
    light, path = picture(rng, 25.0)
    light[:, 120:150] = 30.0
    light[:, 215:] = 30.0
    line = finder_paint.find(exposed(light, rng))
    assert line.found
    assert line.end == "hidden"
    assert 208.0 < line.end_px[0] <= 216.0
    gap = np.concatenate(line.stretches(Visibility.HIDDEN))
    assert 110.0 < gap[:, 0].min() < 122.0
    assert 148.0 < gap[:, 0].max() < 160.0
    assert np.abs(aside(path, gap)).max() < 1.5, "the bridge over what is hidden"
    assert np.concatenate(line.stretches(Visibility.BEYOND))[:, 0].min() > 205.0
    whole = finder_paint.find(exposed(picture(rng, 25.0)[0], rng))
    assert whole.end == "tip"


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("seed", range(20))
def test_any_corridor_in_any_picture(seed: int) -> None:
    """Short, outside, ragged, end on, in tiny pictures: an answer with a reason, nothing that is not a number."""
    rng = np.random.default_rng([99, seed])
    height, width = rng.integers(4, 200, 2)
    noise = rng.integers(0, 256, (height, width)).astype(np.uint8)
    image = [noise, np.full_like(noise, 77), rng.normal(size=noise.shape), noise.astype(np.uint16) * 257][seed % 4]
    ends = rng.uniform(-1, 2, (2, 2)) * [width, height]
    ends[1] = ends[0] + rng.normal(0, 3, 2) if seed % 5 == 0 else ends[1]
    count = int(rng.integers(0, 40))
    axis = ends[0] + np.linspace(0, 1, count)[:, None] * (ends[1] - ends[0])
    axis += rng.normal(0, 1, axis.shape) * (seed % 3 == 0)
    along = np.linspace(0.0, float(np.linalg.norm(ends[1] - ends[0])), count)
    where = Corridor(axis, 8.0 + 0.9 * along, float(rng.uniform(0.3, 40.0)))
    for bright in (True, False):
        one = detector(where, Camera("opencv", (int(width), int(height)), np.diag([100.0, 100.0, 1.0]), np.zeros(0)))
        for line in [measure(image, axis, where.width_px, bright), *([one.find(image, bright)] if one else [])]:
            assert np.isfinite(line.points_px).all()
            assert np.isfinite(line.sigma_px).all()
            assert not line.found
            assert line.reason
            assert len(line.visibility) == len(line.guide_px)


def test_polarity_that_changes_along_the_antenna_is_learnt_and_found(finder_paint: AntennaFinder) -> None:
    """Glaring at the clamp, darker than its background at the tip; a thick bright cable runs beside it."""
    rng = np.random.default_rng(6)
    ground, path = background(rng, 2.0), bent((40.0, 120.4), 0.0, 10.0)
    reflectance = np.interp(np.arange(ground.shape[1]), [40, 120, 170, 265], [1.0, 0.6, -0.6, -1.0])
    cable = tube(straight(8.0, 260.0, (150.0, 165.0)), 3.0 * WIDTH_PX_PAINT, 90.0)
    image = exposed(60.0 + ground + cable + 70.0 * reflectance * tube(path, WIDTH_PX_PAINT, 1.0), rng)
    paint = learn([finder_paint], [image])
    assert paint.bright is None
    line = paint.find(finder_paint, image)
    assert line.found
    assert line.seen > 0.8
    assert np.abs(aside(path, line.points_px)).max() < 1.0
    assert max(Paint(bright).find(finder_paint, image).seen for bright in (True, False)) < 0.7


def test_a_line_keeps_to_the_middle_of_an_antenna_with_a_bright_and_a_dark_side(finder_paint: AntennaFinder) -> None:
    """As of bare steel between a lamp and the dark: either side alone would draw it by half a width."""
    rng = np.random.default_rng(7)
    path = bent((40.0, 120.4), 0.0, 10.0)
    down = np.array([0.0, 0.25 * WIDTH_PX_PAINT])
    sides = [tube(path + side * down, 0.5 * WIDTH_PX_PAINT, 60.0) for side in (-1.0, 1.0)]
    image = exposed(background(rng, 2.0) + 80.0 + sides[0] - sides[1], rng)
    line = finder_paint.find(image, None)
    assert line.found
    assert np.abs(aside(path, line.points_px)).max() < 0.25 * WIDTH_PX_PAINT


def taken(drawn: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(H, W, 3) uint8 of drawn colours, with noise."""
    return np.clip(drawn + rng.normal(0.0, 2.0, drawn.shape), 0, 255).astype(np.uint8)


def own(finder_paint: AntennaFinder, paint: Paint, image: np.ndarray, calibrated: Sequence[np.ndarray]) -> Centreline:
    """What is the antenna's own in a picture, by its looks in others."""
    looks = usual_looks([look_of(one, paint.find(finder_paint, one)) for one in calibrated])
    return without_other_things(image, paint.find(finder_paint, image), looks, finder_paint.corridor.width_px, paint)


@pytest.mark.parametrize("light", [0.75, 1.0, 1.3])
def test_a_line_that_goes_on_along_another_thing_ends_where_that_begins(
    finder_paint: AntennaFinder, light: float
) -> None:
    """Beyond its middle the antenna is hidden behind an edge of another colour, as wide and as straight."""
    rng = np.random.default_rng(5)
    path = bent((40.0, 120.4), 0.0, 3.0)
    drawn, hidden = (np.full((*SIZE, 3), 40.0) for _ in range(2))
    line = tube(path, WIDTH_PX_PAINT, 1.0)[..., None]
    drawn += line * (np.array([140.0, 140.0, 140.0]))
    middle = int(path[len(path) // 2, 0])
    hidden[:] = drawn
    hidden[:, middle:] = (40.0 + line * np.array([20.0, 160.0, 90.0]))[:, middle:]
    shown = [taken(light * one, rng) for one in (drawn, hidden)]
    calibrated = [taken(drawn, rng) for _ in range(3)]
    whole, cut = (own(finder_paint, Paint(True), one, calibrated) for one in shown)
    assert whole.found
    assert whole.points_px[-1, 0] > path[-1, 0] - 5.0
    assert cut.points_px[-1, 0] < middle + 2.0
    assert len(cut.points_px) > 0.4 * len(whole.points_px)
    assert cut.end != "tip"


@pytest.mark.parametrize(("both_edges", "left_out"), [(False, True), (True, False)])
def test_in_a_shadow_both_edges_show_the_antenna_as_well(
    finder_paint: AntennaFinder, both_edges: bool, left_out: bool
) -> None:
    """A third of it has two fifths of its light, and its hue; what lies behind it is lit as elsewhere."""
    rng = np.random.default_rng(6)
    path = bent((40.0, 120.4), 0.0, 3.0)
    begin, end = int(path[len(path) // 2, 0]), int(path[5 * len(path) // 6, 0])
    lit = 40.0 + tube(path, WIDTH_PX_PAINT, 1.0)[..., None] * np.array([120.0, 150.0, 160.0])
    shaded = lit.copy()
    shaded[:, begin:end] = 40.0 + 0.2 * (lit - 40.0)[:, begin:end]
    calibrated = [taken(lit, rng) for _ in range(3)]
    line = own(finder_paint, Paint(True, both_edges=both_edges), taken(shaded, rng), calibrated)
    assert line.found
    inside = (line.points_px[:, 0] > begin + 15.0) & (line.points_px[:, 0] < end - 15.0)
    assert (inside.sum() == 0) == left_out
    assert line.points_px[-1, 0] > path[-1, 0] - 5.0
    if inside.any():
        assert np.sqrt(np.mean((aside(path, line.points_px) / line.sigma_px)[inside] ** 2)) < 2.0
        assert line.sigma_px[inside].min() > 1.2 * np.median(line.sigma_px[~inside])
        assert np.abs(aside(path, line.points_px[inside])).max() < 1.0


PICTURES = traced_pictures()


@pytest.mark.parametrize("picture", PICTURES, ids=lambda picture: picture.name)
def test_no_other_line_is_taken_for_the_antenna(picture: TracedPicture) -> None:
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(picture.free_px, axis=0), axis=1))])
    # the rig is known to a pixel, not better
    guess, reach = picture.free_px + np.array([0.5, 1.0]), SearchSettings.clamp_px + SearchSettings.reach * along
    color, where = picture.color(), Corridor(guess, reach, picture.width_px)
    finder = AntennaFinder.prepare(where, (color.shape[1], color.shape[0]))
    found = Paint(None).find(finder, color)
    if found.verdict != "ok":
        return
    assert len(picture.line_px), "there is no antenna"
    assert (_off(picture, found.points_px) < picture.width_px).mean() > 0.95


def _off(picture: TracedPicture, points_px: np.ndarray) -> np.ndarray:
    """(N,) distances of points from the true line."""
    share, fine = np.linspace(0.0, 1.0, len(picture.line_px)), np.linspace(0.0, 1.0, 4000)
    line = np.stack([np.interp(fine, share, axis) for axis in picture.line_px.T], axis=1)
    return cKDTree(line).query(points_px)[0]


def test_before_other_colours_the_line_is_where_the_antenna_is() -> None:
    patchworks = [one for one in PICTURES if "_patchwork_" in one.name and len(one.line_px)]
    for one in patchworks:
        line = measure_ribbon(one.color(), one.line_px, one.width_px)
        assert line.found
        assert np.median(_off(one, line.points_px)) < 0.06 * one.width_px
    assert len(patchworks) >= 8


@pytest.mark.parametrize("name", ["paint_patchwork_noload_001", "nitinol_patchwork_noload_001"])
def test_light_from_one_side_does_not_pull_the_line(name: str) -> None:
    picture = next(one for one in PICTURES if one.name == name)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(picture.free_px, axis=0), axis=1))])
    where = Corridor(picture.free_px, SearchSettings.clamp_px + SearchSettings.reach * along, picture.width_px)
    color = picture.color()
    finder = AntennaFinder.prepare(where, (color.shape[1], color.shape[0]))
    assert learn([finder], [color]) == Paint(None)
    line = Paint(None).find(finder, color)
    assert line.found
    off = _off(picture, line.points_px)
    assert np.sqrt(np.mean(off**2)) < 0.04 * picture.width_px
    assert np.sqrt(np.mean((off / line.sigma_px) ** 2)) < 2.0


@pytest.mark.parametrize("bright", [True, None])
def test_an_antenna_that_nearness_makes_four_times_thicker_at_its_clamp_is_seen_from_end_to_end(
    bright: bool | None,
) -> None:
    """Measured with one width all along, its clamp would lie outside the profiles, and be no part of it."""
    matrix = np.array([[500.0, 0.0, 159.5], [0.0, 500.0, 119.5], [0.0, 0.0, 1.0]])
    camera = Camera("opencv", SIZE[::-1], matrix, np.zeros(5))
    clamp, tip = np.array([-0.015, 0.002, 0.08]), np.array([0.06, 0.01, 0.32])
    along = (tip - clamp) / np.linalg.norm(tip - clamp)
    turn = Rotation.align_vectors([along], [[1.0, 0.0, 0.0]])[0]
    free = free_curve(np.array([0.0] * 6 + [-8.0, -8.0, 0.0]), float(np.linalg.norm(tip - clamp)), np.zeros(3))
    where = corridor(camera, Pose.from_rotvec(turn.as_rotvec(), clamp), free, 1.6e-3)
    path, fine = pixels(camera, Pose.from_rotvec(turn.as_rotvec(), clamp), free.points_m[0]), 8
    across = normals(path[[0, -1]])[0] * 0.5 * 500.0 * 1.6e-3
    outline = [path[0] + across / 0.08, path[0] - across / 0.08, path[-1] - across / 0.32, path[-1] + across / 0.32]
    large = np.zeros((SIZE[0] * fine, SIZE[1] * fine), np.uint8)
    cv2.fillPoly(large, [np.rint((np.array(outline) + 0.5) * fine - 0.5).astype(np.int32)], 1)
    light = cv2.GaussianBlur(cv2.resize(large.astype(float), SIZE[::-1], interpolation=cv2.INTER_AREA), (0, 0), 0.7)
    rng = np.random.default_rng(4)
    line = AntennaFinder.prepare(where, SIZE[::-1]).find(exposed(60.0 + 110.0 * light, rng), bright)
    assert line.found
    assert line.seen > 0.9
    off = aside(path, line.points_px)
    assert np.abs(np.array([part.mean() for part in np.array_split(off, 4)])).max() < 0.1
