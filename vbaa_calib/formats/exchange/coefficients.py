"""Which of a format's lens models holds a camera's coefficients, and what it would cost to leave some out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...camera import Camera
from ...errors import InputError

_COLUMNS, _ROWS = 41, 31


def held_in(camera: Camera, counts: Sequence[int], whose: str) -> list[float]:
    """The camera's coefficients at the shortest of the lengths `counts` that holds all that are not zero.

    Shorter vectors are filled with zeros, which change nothing. Raises InputError, with what leaving them out would
    cost, where none is long enough.
    """
    values = camera.distortion.tolist()
    needed = max((index + 1 for index, value in enumerate(values) if value != 0.0), default=0)
    fitting = [count for count in sorted(counts) if count >= needed]
    if fitting:
        # keep the length that the camera has, where the format has it too: read again, it is the same camera
        count = len(values) if len(values) in fitting else fitting[0]
        return values[:count] + [0.0] * (count - len(values))
    longest = max(counts)
    beyond = [f"{name} = {value:g}" for name, value in _named(camera)[longest:] if value != 0.0]
    cost = left_out_px(camera, longest)
    words = f"it would be off by up to {cost:.2g} px without them" if np.isfinite(cost) else "they matter"
    raise InputError(
        f"{whose} holds {longest} coefficients at most, this lens has {', '.join(beyond)} too: {words}",
        remedy="choose another format, or calibrate with a simpler lens (`--model`)",
    )


def left_out_px(camera: Camera, count: int) -> float:
    """How far points of the picture move, at most, when only the first `count` coefficients are kept; NaN: unknown.

    The lens is not fitted anew: that might make up for some of it.
    """
    width, height = camera.image_size
    u, v = np.meshgrid(np.linspace(0, width - 1, _COLUMNS), np.linspace(0, height - 1, _ROWS))
    pixels = np.stack([u, v], axis=-1).reshape(-1, 2)
    rays, seen = camera.unproject(pixels)
    short = Camera(camera.model, camera.image_size, camera.matrix, camera.distortion[:count])
    moved, there = short.project(np.where(seen[:, None], rays, [0.0, 0.0, 1.0]))
    off = np.linalg.norm(moved - pixels, axis=1)[seen & there]
    return float(off.max()) if len(off) else float("nan")


def refuse_fisheye(camera: Camera, whose: str) -> None:
    """Raises InputError for a fisheye lens, where a format has no model for it."""
    if camera.model == "fisheye":
        raise InputError(
            f"{whose} has no equidistant fisheye lens (k1 to k4 over the angle)",
            remedy="choose another format, or calibrate with another lens model (`--model`)",
        )


def _named(camera: Camera) -> list[tuple[str, float]]:
    return list(zip(camera.parameter_names[4:], camera.distortion.tolist(), strict=True))
