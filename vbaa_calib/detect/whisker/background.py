"""Background subtraction: the scene without the antenna, learned from no-load pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from .centreline import Centreline


@dataclass(frozen=True, eq=False)
class Background:
    """The empty scene: `grey` (H, W) float32. Only for a camera and a background that stand still."""

    grey: np.ndarray

    @staticmethod
    def learn(images: Sequence[np.ndarray], lines: Sequence[Centreline], width_px: float) -> Background:
        """The median of pictures (H, W) of the free antenna, with the antenna painted over from its two sides."""
        empty = [_painted_over(image, line, width_px) for image, line in zip(images, lines, strict=True)]
        return Background(np.median(empty, axis=0).astype(np.float32))

    def subtracted_from(self, image: np.ndarray) -> np.ndarray:
        """(H, W) float32 picture less the background, scaled to the picture's brightness."""
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
