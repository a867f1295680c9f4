"""What the camera saw at each moment, small enough for a page."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from vbaa_calib.errors import InputError
from vbaa_calib.images import read_picture
from vbaa_calib.session import load_session, read_recording

WIDEST_PX = 360


def one_picture(path: Path, image_size: tuple[int, int], count: int) -> tuple[np.ndarray, ...]:
    """The same picture (H, W, 3) RGB for `count` moments.

    Raises InputError when it cannot be read or is not of the camera's `image_size` (width, height).
    """
    return (_small(path, image_size),) * count


def session_pictures(folder: Path, frames: np.ndarray, image_size: tuple[int, int]) -> tuple[np.ndarray | None, ...]:
    """The recording's picture (H, W, 3) RGB of each frame (M,), None for a frame that has none.

    Raises InputError when the session is damaged, holds no picture of these frames, or one of another size.
    """
    paths = {frame.frame: frame.image for frame in read_recording(load_session(folder))}
    wanted = [paths.get(int(frame)) for frame in frames]
    if not any(wanted):
        raise InputError("holds no picture of these frames", where=folder, remedy="give the session of this recording")
    return tuple(None if path is None else _small(path, image_size) for path in wanted)


def _small(path: Path, image_size: tuple[int, int]) -> np.ndarray:
    pixels = read_picture(path)
    height, width = pixels.shape[:2]
    if (width, height) != tuple(image_size):
        what = f"is {width} x {height} pixels, the rig's camera {image_size[0]} x {image_size[1]}"
        raise InputError(what, where=path, remedy="give a picture of this rig's camera")
    factor = min(WIDEST_PX / width, 1.0)
    size = (max(round(factor * width), 1), max(round(factor * height), 1))
    small = cv2.resize(np.clip(pixels, 0, 255).astype(np.uint8), size, interpolation=cv2.INTER_AREA)
    return cv2.cvtColor(small, cv2.COLOR_GRAY2RGB if small.ndim == 2 else cv2.COLOR_BGR2RGB)
