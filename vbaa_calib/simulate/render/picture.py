"""From brightness to grey levels: the background, its illumination, blur, noise, quantisation.

Brightness is linear: 0 is black, 1 saturates the sensor.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from vbaa_calib.native import core
from vbaa_calib.simulate.scene.lens import Lens, RayMap, ray_map
from vbaa_calib.simulate.scene.scene import PictureSpec

from .settings import PAINT

LAMP_WORLD = np.array([-0.32, 0.38, 0.87]) / np.linalg.norm([-0.32, 0.38, 0.87])
"""Direction toward the lamp, world frame: it shades board, antenna and object."""


@dataclass(frozen=True, eq=False)
class Studio:
    """What all pictures of a scene share: rays, illumination, background.

    Attributes
    ----------
    rays : the lens, with the ray of every pixel.
    light : (height, width) float32, how much of the light reaches each pixel.
    bench : (n, n) float32 brightness of the surroundings over directions in the world.
    """

    spec: PictureSpec
    rays: RayMap
    light: np.ndarray
    bench: np.ndarray

    @property
    def room_px(self) -> int:
        """Pixels around what is drawn that its blur may reach."""
        return 3 + int(np.ceil(4 * self.spec.blur_px))


@dataclass(frozen=True, eq=False)
class ImagePatch:
    """A part of the picture in front of what was drawn before, in sub-pixels where its edges matter: blur comes
    before sampling.

    Attributes
    ----------
    left, top : its first pixel in the picture.
    factor : sub-pixels per pixel.
    brightness, alpha : (rows·factor, factor·columns) float32, brightness already weighted with the covered part, and
        the covered part. A row has the first sub-pixel of all its pixels, then their second, and so on.
    """

    left: int
    top: int
    factor: int
    brightness: np.ndarray
    alpha: np.ndarray

    @property
    def where(self) -> tuple[slice, slice]:
        """Slices of the picture that the patch covers."""
        rows, columns = (length // self.factor for length in self.alpha.shape)
        return slice(self.top, self.top + rows), slice(self.left, self.left + columns)

    def laid_out(self, values: np.ndarray) -> np.ndarray:
        """(rows·factor, columns·factor) values of the sub-pixels side by side."""
        return values.reshape(len(values), self.factor, -1).swapaxes(1, 2).reshape(values.shape)

    def packed(self, values: np.ndarray) -> np.ndarray:
        """Values of sub-pixels side by side in the patch's own order."""
        return values.reshape(len(values), -1, self.factor).swapaxes(1, 2).reshape(values.shape)

    def behind(self, canvas: np.ndarray) -> np.ndarray:
        """The part of the canvas behind the patch, its sub-pixels side by side."""
        return cv2.resize(canvas[self.where], self.alpha.shape[::-1], interpolation=cv2.INTER_LINEAR)

    def over(self, canvas: np.ndarray) -> np.ndarray:
        """A copy of the canvas (H, W) with this patch of whole pixels in front."""
        result = canvas.copy()
        result[self.where] = result[self.where] * (1.0 - self.alpha) + self.brightness
        return result


def studio(lens: Lens, spec: PictureSpec, rng: np.random.Generator) -> Studio:
    """Compute what all pictures share. Raises InputError when the lens folds inside the picture."""
    return Studio(spec, ray_map(lens), _light(lens, spec), _bench(spec, rng))


def _light(lens: Lens, spec: PictureSpec) -> np.ndarray:
    width, height = lens.image_size
    u, v = np.linspace(-1.0, 1.0, width), np.linspace(-1.0, 1.0, height)[:, None]
    corners = 1.0 - spec.vignette * (u**2 + v**2) / 2
    one_side = 1.0 - spec.gradient * (0.5 + 0.3 * u - 0.2 * v)
    return (corners * one_side).astype(np.float32)


def _bench(spec: PictureSpec, rng: np.random.Generator) -> np.ndarray:
    size = (PAINT.bench_texels, PAINT.bench_texels)
    cloud = np.zeros(size, np.float32)
    for cells, weight in ((6, 0.5), (17, 0.25), (70, 0.12)):
        coarse = rng.standard_normal((cells, cells)).astype(np.float32)
        cloud += weight * cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC)
    cloud += 0.3 * cv2.GaussianBlur(rng.standard_normal(size).astype(np.float32), (0, 0), 1.0)
    for softness in (0.8, 2.0, 6.0):
        cloud += _soft_shapes(rng, softness)
    cloud *= spec.background * spec.clutter
    cloud += spec.background
    return np.clip(cloud, 0.02 * spec.background, 1.0, out=cloud)


def _soft_shapes(rng: np.random.Generator, softness: float) -> np.ndarray:
    """Random boards, discs and edges on the bench, out of focus."""
    canvas, one = np.zeros((2, PAINT.bench_texels, PAINT.bench_texels), np.float32)
    for _ in range(PAINT.bench_things):
        centre, size = rng.uniform(0, PAINT.bench_texels, 2), rng.uniform(25, 260, 2)
        if rng.uniform() < 0.3:
            cv2.circle(one, centre.astype(int).tolist(), int(size[0] / 2), 1.0, -1)
        else:
            corners = cv2.boxPoints((centre.tolist(), size.tolist(), float(rng.uniform(0, 180))))
            cv2.fillConvexPoly(one, np.round(corners).astype(np.int32), 1.0)
        first = np.maximum(centre - 0.5 * np.hypot(*size) - 2.0, 0.0).astype(int)
        last = (centre + 0.5 * np.hypot(*size) + 3.0).astype(int)
        around = slice(first[1], last[1]), slice(first[0], last[0])
        canvas[around] += np.float32(rng.uniform(-0.7, 0.7)) * one[around]
        one[around] = 0.0
    return cv2.GaussianBlur(canvas, (0, 0), softness)


def surroundings(place: Studio, R_world_camera: np.ndarray) -> np.ndarray:
    """(height, width) float32 brightness of the background, seen by a camera in this orientation.

    The bench is far away: it turns with the camera and does not shift. Directions are laid out stereographically,
    straight down in the middle, so that it goes on past the horizon.
    """
    padded = place.rays.padded
    found: np.ndarray = core.simulate.surroundings(padded, R_world_camera, place.bench, PAINT.bench_reach)
    return found


def frame_around(place: Studio, pixels: np.ndarray) -> tuple[int, int, int, int]:
    """(left, top, right, bottom) bounds of the pixels around points (n, 2), with a margin for the blur.

    The whole picture when a point has no pixel.
    """
    size = np.array(place.rays.lens.image_size)
    if not np.isfinite(pixels).all():
        return 0, 0, int(size[0]), int(size[1])
    room = place.room_px
    left, top = np.clip(np.floor(pixels.min(axis=0)) - room, 0, size).astype(int)
    right, bottom = np.clip(np.ceil(pixels.max(axis=0)) + room + 1, 0, size).astype(int)
    return int(left), int(top), int(right), int(bottom)


def expose(place: Studio, canvas: np.ndarray, patches: Iterable[ImagePatch] = ()) -> np.ndarray:
    """(height, width) float grey levels before noise and quantisation: the canvas with the patches in front, blurred
    and illuminated.

    The patches must not overlap one another.
    """
    picture = blurred(canvas, place.spec.blur_px)
    for patch in patches:
        # blur is linear: what the patch adds to what it hides can be blurred by itself, as finely as it was drawn
        where = patch.left, patch.top, patch.factor
        picture[patch.where] += core.simulate.blurred_change(
            canvas, patch.brightness, patch.alpha, where, place.spec.blur_px
        )
    picture *= 255.0
    picture *= place.light
    return picture


def blurred(brightness: np.ndarray, sigma_px: float) -> np.ndarray:
    """A copy of a picture's brightness blurred by a Gaussian of standard deviation `sigma_px`."""
    return cv2.GaussianBlur(brightness, (0, 0), sigma_px) if sigma_px > 0 else brightness.copy()


def digitise(spec: PictureSpec, grey: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(height, width) uint8 with shot noise and read noise."""
    seed = int(rng.integers(2**32))
    noisy: np.ndarray = core.simulate.digitised(
        np.ascontiguousarray(grey, np.float32), spec.electrons_per_grey, spec.read_noise, seed
    )
    return noisy
