"""Pictures of an antenna that touches something, with everything that is true of them: the chain from end to end.

Shapes are the static rod's (weight, bow, a crooked clamp), pictures the simulator's, through OpenCV's lens. Neither
shares code with what is judged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.estimator.bound import Bound, bound
from benchmarks.estimator.scenes import Scenes, Touches, push_for_deflection, rod_shapes, rolled, scenes, seen
from benchmarks.estimator.setup import TOWARDS_CLAMP, Setup, drawn_truth
from benchmarks.harness import concatenated
from benchmarks.vision.judge import information
from benchmarks.vision.scenes import PLAIN, bare_studio, variance
from vbaa_calib.rig import Rig
from vbaa_calib.simulate.render.antenna import Tube, tube, tube_patch
from vbaa_calib.simulate.render.picture import LAMP_WORLD, Studio, digitise, expose
from vbaa_calib.simulate.scene.lens import Lens

SIZES = ((512, 512), (1280, 720))
RIGS = {"exact": True, "calibrated": False}
"""What is known of the rig → whether that is everything."""
CAMERA_TILT_RAD = np.radians(30.0)
REACH, DEFLECTION_M, ROLL_RAD = (0.3, 0.8), (0.004, 0.010), np.radians(60.0)
"""Contact distances over length, deflections there, and the largest roll of the deformation plane."""
FRICTION_STD_RAD = 0.2
"""Of the friction angle; the estimator's own default."""
JOINTS_RAD = (0.3, -0.25)
"""Pan and tilt of all pictures: weight bends the antenna along y and z."""
LIGHT = replace(PLAIN, vignette=0.3, gradient=0.3)
"""In focus, a sensor's shot and read noise, light from one side and dark corners, nothing behind."""
_DRAWN_AT = 161
"""Places along the antenna from which its picture is drawn."""


@dataclass(frozen=True, eq=False)
class Drawing:
    """One picture to be drawn.

    tube : the antenna as the camera sees it.
    """

    studio: Studio
    tube: Tube

    def light(self, aside_px: float = 0.0, antenna: bool = True) -> np.ndarray:
        """(H, W) grey levels without noise, the antenna moved so far along its normals, or left out."""
        height, width = self.studio.light.shape
        canvas = np.full((height, width), self.studio.spec.background, np.float32)
        moved = replace(self.tube, pixels=self.tube.pixels + aside_px * self.tube.normals)
        patch = tube_patch(self.studio, moved, self.studio.spec.antenna) if antenna else None
        return expose(self.studio, canvas, [] if patch is None else [patch])

    def variance(self, grey: np.ndarray) -> np.ndarray:
        """(H, W) of every pixel: shot noise, read noise and rounding."""
        return variance(self.studio.spec, grey)


@dataclass(frozen=True, eq=False)
class Photograph:
    """One picture with its truth.

    image : (H, W) uint8. moment_Nm : the sensor's reading, with noise.
    truth : the same as one frame, its rig the true one; of its points any number, without noise.
    """

    image: np.ndarray
    moment_Nm: float
    drawing: Drawing
    truth: Scenes

    @property
    def distance_m(self) -> float:
        """Of the contact, true."""
        return float(self.truth.distance_m[0])

    @property
    def force_N(self) -> np.ndarray:
        """(3,) antenna frame, true."""
        return np.asarray(self.truth.force_N[0])


@dataclass(frozen=True, eq=False)
class Cell:
    """Pictures of one size and rig.

    rig : as the estimator is to know it. known : one of `RIGS`.
    """

    size: tuple[int, int]
    known: str
    rig: Rig
    photographs: list[Photograph]

    def __len__(self) -> int:
        return len(self.photographs)

    @property
    def name(self) -> str:
        """Of the size."""
        return f"{self.size[0]}x{self.size[1]}"


def cell(size: tuple[int, int], known: str, count: int, seed: int) -> Cell:
    """So many pictures at random. With a calibrated rig every picture has a true rig of its own."""
    rng = np.random.default_rng([seed, *size, RIGS[known]])
    given = Setup(tilt_rad=CAMERA_TILT_RAD, azimuth_rad=TOWARDS_CLAMP, image_size=size, real=True, exact=RIGS[known])
    rig = given.rig()
    return Cell(size, known, rig, [_photograph(drawn_truth(rig, rng), rng) for _ in range(count)])


def _photograph(rig: Rig, rng: np.random.Generator) -> Photograph:
    """One picture of a true rig, contact and noise at random."""
    length = rig.antenna.length_m
    distance = rng.uniform(*REACH, 1) * length
    size = push_for_deflection(rng.uniform(*DEFLECTION_M, 1), distance, rig.antenna.stiffness_Nm2)
    push = rolled(size * rng.choice([-1.0, 1.0]), rng.uniform(-ROLL_RAD, ROLL_RAD))
    friction = np.clip(FRICTION_STD_RAD * rng.normal(size=1), -1.0, 1.0)
    pan, tilt = JOINTS_RAD
    truth = scenes(rig, distance, push, friction, made_by=rod_shapes, pan_rad=pan, tilt_rad=tilt)
    drawing = drawn(rig, truth.touches)
    image = digitise(drawing.studio.spec, drawing.light(), rng)
    moment = float(truth.moment_Nm[0]) + rig.moment_sensor.std_Nm * rng.normal()
    return Photograph(image, moment, drawing, truth)


def drawn(rig: Rig, touches: Touches) -> Drawing:
    """The picture of one touch."""
    arclength = np.linspace(0.0, rig.antenna.length_m, _DRAWN_AT)
    points = rod_shapes(rig, touches, arclength).points_m[0]
    lens = Lens(rig.camera.model, rig.camera.image_size, rig.camera.matrix, rig.camera.distortion)
    to_camera = rig.T_antenna_camera.inverse()
    lamp = to_camera.rotation @ rig.kinematics.T_world_antenna(*JOINTS_RAD).rotation.T @ LAMP_WORLD
    return Drawing(
        bare_studio(lens, LIGHT), tube(lens, arclength, to_camera @ points, rig.antenna.diameter_m / 2, lamp)
    )


POINTS = 200
STEP_PX = 0.05


@dataclass(frozen=True, eq=False)
class Information:
    """What every column of one picture says.

    column : (C,) int. share : (C,) where along the antenna it is crossed, 0 at the clamp to 1 at the tip.
    per_px2 : (C,) inverse variance of the place across the antenna, px⁻².
    """

    column: np.ndarray
    share: np.ndarray
    per_px2: np.ndarray

    @property
    def sigma_px(self) -> np.ndarray:
        """(C,) least standard deviation of the place across the antenna."""
        return 1.0 / np.sqrt(self.per_px2)


def information_of(photograph: Photograph) -> Information:
    """Of a picture whose antenna runs along u."""
    truth, drawing = photograph.truth, photograph.drawing
    arclength = np.linspace(0.0, truth.rig.antenna.length_m, 4 * POINTS)
    points = rod_shapes(truth.rig, truth.touches, arclength).points_m[0]
    pixels = seen(truth.rig.camera, truth.rig.T_antenna_camera, points, True)
    whole = drawing.light()
    slope = (drawing.light(STEP_PX) - drawing.light(-STEP_PX)) / (2.0 * STEP_PX)
    height, width = whole.shape
    column = np.arange(max(int(np.ceil(pixels[0, 0])), 0), min(int(pixels[-1, 0]), width - 1) + 1)
    row = np.interp(column, pixels[:, 0], pixels[:, 1])
    column, row = (values[(row >= 0) & (row <= height - 1)] for values in (column, row))
    # so far that a longer profile would tell the background's slope, and with it the place, no better
    reach = 3 * int(np.ceil(drawing.tube.half_width_px.max() + 4.0 * drawing.studio.spec.blur_px + 2.0))
    line = whole - drawing.light(antenna=False)
    per_px2 = information((slope, line, drawing.variance(whole)), column, row, reach)
    share = np.interp(column, pixels[:, 0], arclength) / arclength[-1]
    return Information(column, share, per_px2)


def equal_information(known: Sequence[Information], points: int = POINTS) -> tuple[np.ndarray, float]:
    """Places (N,) along the antenna between which there is equally much information, on average over pictures, and
    the standard deviation in px of a point at each that carries the information around it."""
    grid = np.linspace(0.0, 1.0, 2001)
    every = []
    for one in known:
        edges = np.concatenate([one.share[:1], (one.share[1:] + one.share[:-1]) / 2, one.share[-1:]])
        every.append(np.interp(grid, edges, np.concatenate([[0.0], np.cumsum(one.per_px2)])))
    summed = np.mean(every, axis=0)
    places = np.interp((np.arange(points) + 0.5) / points * summed[-1], summed, grid)
    return places, float(np.sqrt(points / summed[-1]))


def frames_at_information(truths: Sequence[Scenes], known: Sequence[Information]) -> Scenes:
    """Frames of one rig, their points where `equal_information` puts them, without noise, with that deviation.

    Every picture is taken to tell as much as the mean of them, which they do to a few percent.
    """
    places, sigma_px = equal_information(known)
    touches = concatenated([one.touches for one in truths])
    return at_places(replace(truths[0], touches=touches, sigma_px=sigma_px), places)


def at_places(scenes: Scenes, places: np.ndarray) -> Scenes:
    """Frames of the touches that these have, without noise, seen at places (N,) along the antenna."""
    rig, touches = scenes.rig, scenes.touches
    arclength = places * rig.antenna.length_m
    shapes = rod_shapes(rig, touches, arclength)
    return replace(
        scenes,
        points_px=seen(rig.camera, rig.T_antenna_camera, shapes.points_m),
        moment_Nm=rig.moment_sensor.gain * shapes.moment_Nm + rig.moment_sensor.offset_Nm,
        pan_rad=np.full(len(touches), scenes.pan_rad[0]),
        tilt_rad=np.full(len(touches), scenes.tilt_rad[0]),
        shapes=shapes,
        arclength_m=arclength,
    )


def contact_bound(scenes: Scenes) -> Bound:
    """Of frames of `frames_at_information`."""
    return bound(scenes, FRICTION_STD_RAD)
