"""The surroundings without the antenna, from no-load pictures: taken off a picture, only what is new stays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from .centreline import Centreline


@dataclass(frozen=True, eq=False)
class Ground:
    """The empty scene: `grey` (H, W) float32. Only for a camera and a background that stand still."""

    grey: np.ndarray

    @staticmethod
    def learn(images: Sequence[np.ndarray], lines: Sequence[Centreline], width_px: float) -> Ground:
        """The median of pictures (H, W) of the free antenna, with the antenna painted over from its two sides."""
        empty = [_painted_over(image, line, width_px) for image, line in zip(images, lines, strict=True)]
        return Ground(np.median(empty, axis=0).astype(np.float32))

    def taken_off(self, image: np.ndarray) -> np.ndarray:
        """(H, W) float32 picture less the ground, in the picture's own light: the ground is brightened to fit it."""
        picture = image.astype(np.float32)
        few = (slice(None, None, 7), slice(None, None, 7))
        return picture - self.grey * (float(np.median(picture[few])) / max(float(np.median(self.grey[few])), 1e-6))


def _painted_over(image: np.ndarray, line: Centreline, width_px: float) -> np.ndarray:
    if len(line.guide_px) < 2:
        return image.astype(np.float32)
    mask = np.zeros(image.shape, np.uint8)
    thickness = int(np.ceil(line.breadth * width_px)) + 6
    path = np.round(line.guide_px).astype(np.int32).reshape(-1, 1, 2)
    cv2.polylines(mask, [path], False, 255, thickness)
    # only what is beside the line may fill it in: a mean of the unmasked pixels around
    reach = 2 * thickness + 1
    around = cv2.blur(np.where(mask > 0, 0.0, image).astype(np.float32), (reach, reach))
    share = cv2.blur((mask == 0).astype(np.float32), (reach, reach))
    return np.where(mask > 0, around / np.maximum(share, 1e-3), image).astype(np.float32)
