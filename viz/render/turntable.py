"""An animation of the contacts, turned once around: .gif or .mp4."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import replacing
from viz.parts.assemble import all_parts
from viz.scene.scene import Scene

from .probe import require_opengl
from .stage import Stage, quiet


@dataclass(frozen=True)
class _TurntableSettings:
    """Size and speed of a turntable."""

    frames: int = 48  # of a full turn
    per_second: int = 12  # frames per second
    size: tuple[int, int] = (640, 480)  # width and height, px


_FILM = _TurntableSettings()


@quiet()
def turntable(scene: Scene, path: Path, *, mode: str = "force", force: bool = False) -> None:
    """Write a close-up of the contacts from all sides at one height, as a repeating .gif or an .mp4.

    Raises InputError when the file exists and `force` is off, or this OpenCV writes no .mp4; VbaaError where pictures
    cannot be drawn.
    """
    with replacing(path, force) as temporary:
        require_opengl()
        parts = [part for part in all_parts(scene) if part.name not in ("grid", "plane", "camera", "now")]
        stage = Stage(scene, parts, mode, _FILM.size)
        stage.look_at_contacts(parallel=False)
        try:
            if path.suffix.lower() == ".gif":
                first, *others = (Image.fromarray(picture).quantize(128) for picture in _turned(stage))
                look = {"duration": 1000 // _FILM.per_second, "loop": 0}
                first.save(temporary, format="GIF", save_all=True, append_images=others, **look)
            else:
                _write_film(temporary, path, stage)
        finally:
            stage.plotter.close()


def _turned(stage: Stage) -> Iterator[np.ndarray]:
    """Yields (H, W, 3) uint8 pictures, one for each angle."""
    stage.plotter.enable_anti_aliasing("ssaa")
    stage.plotter.enable_depth_peeling(8)
    for _ in range(_FILM.frames):
        yield np.asarray(stage.plotter.screenshot(return_img=True))[..., :3]
        stage.plotter.camera.Azimuth(360 / _FILM.frames)
        stage.plotter.reset_camera_clipping_range()
        stage.plotter.render_window.Render()


def _write_film(temporary: Path, path: Path, stage: Stage) -> None:
    film = cv2.VideoWriter(
        str(temporary), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"mp4v"), _FILM.per_second, _FILM.size
    )
    if not film.isOpened():
        raise InputError("this OpenCV writes no .mp4", where=path, remedy="name it .gif")
    for picture in _turned(stage):
        film.write(np.ascontiguousarray(picture[..., ::-1]))
    film.release()
