"""The static background behind the antenna, learnt from a recording's own pictures and those of the free antenna.

Camera and antenna move together, so that the background is static in the picture only where the joints are at rest, or
where it moves with them. The pictures themselves decide.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.images import SUFFIXES
from vbaa_calib.detect.whisker.background import Background, covered, learn
from vbaa_calib.detect.whisker.centreline import Centreline
from vbaa_calib.detect.whisker.finder import AntennaFinder
from vbaa_calib.detect.whisker.settings import BackgroundSettings
from vbaa_calib.rig import Rig
from vbaa_calib.session import Frame, Still, check_pictures

from .recording import Ground, prepared, read_own
from .settings import ContactSettings

AUTO = Path("auto")
"""In place of a picture: learn the background."""


def surroundings(rig: Rig, picture: Path | None, frames: Callable[[], Sequence[Still]]) -> tuple[Ground | None, str]:
    """The background, as `--background` asks for it, and a sentence on it.

    picture : a picture of the first camera's view without the antenna, or `AUTO`: each camera's is learnt from the
        frames.
    Raises InputError when a picture cannot be read or has another size than the rig's.
    """
    if picture is None:
        return None, ""
    if picture != AUTO:
        empty = Background(_plane(rig, picture).astype(np.float32))
        words = f"{picture.name} is taken off where it lies behind the antenna"
        return lambda _, camera: empty if camera == rig.camera_name else None, words
    several, found, notes = frames(), dict[str, Callable[[Still], Background | None]](), list[str]()
    for name, one in rig.cameras.items():
        own = several
        if name in rig.others:
            own = [replace(each, image=each.others.get(name)) for each in several if isinstance(each, Frame)]
        ground, words = _learn_surroundings(one, own)
        found |= {} if ground is None else {name: ground}
        notes.append(f"{name}: {words}" if rig.others else words)

    def behind(still: Still, camera: str) -> Background | None:
        return found[camera](still) if camera in found else None

    return behind if found else None, "; ".join(notes)


def _learn_surroundings(rig: Rig, frames: Sequence[Still]) -> tuple[Callable[[Still], Background | None] | None, str]:
    """Backgrounds from pictures with the antenna in them, and a sentence on them; None where none is useful."""
    pictured = [still for still in frames if still.image is not None]
    why = f"fewer than {BackgroundSettings.least_pictures} pictures"
    for step in (np.inf, ContactSettings.alike_px / float(rig.camera.matrix[0, 0])):
        cells = defaultdict(list)
        for still in pictured:
            cells[_cell(still, step)].append(still)
        several = sorted(cells.items(), key=lambda cell: -len(cell[1]))[: ContactSettings.most_positions]
        grounds: dict[tuple[int, int], Background] = {}
        for cell, own in several:
            if len(own) >= BackgroundSettings.least_pictures:
                ground, why = _learnt(rig, own)
                grounds |= {} if ground is None else {cell: ground}
        if grounds:
            where = "" if len(cells) == 1 else f" at {len(grounds)} of {len(cells)} positions of the joints"
            return partial(_ground_of, grounds, step), f"what stands still behind the antenna is taken off{where}"
        if len(cells) > 1 and np.isfinite(step):
            why = f"{why}, at none of {len(cells)} positions of the joints"
    return None, f"nothing is taken off: {why}"


def _ground_of(grounds: dict[tuple[int, int], Background], step_rad: float, still: Still) -> Background | None:
    """The background for the cell of joint angles, `step_rad` wide (infinite for a single background), of a picture."""
    return grounds.get(_cell(still, step_rad))


def neighbours(rig: Rig, still: Still) -> list[Still]:
    """The pictures in a picture's folder that this camera may have taken, about a dozen of them, including itself."""
    assert still.image is not None
    paths = sorted(path for path in still.image.parent.iterdir() if path.suffix.lower() in SUFFIXES)
    several = []
    for path in paths[:: 1 + len(paths) // (2 * ContactSettings.most_pictures)]:
        with suppress(InputError):
            check_pictures([path], rig.camera.image_size, "the rig was calibrated at")
            several.append(replace(still, image=path))
    return several


def _cell(still: Still, step_rad: float) -> tuple[int, int]:
    return round(still.pan_rad / step_rad), round(still.tilt_rad / step_rad)


def _learnt(rig: Rig, frames: Sequence[Still]) -> tuple[Background | None, str]:
    """The background from pictures at one position of the joints, or the reason why there is none."""
    looking = prepared(rig, frames[0])
    if looking is None:
        return None, "the camera does not see the antenna"
    width, height = rig.camera.image_size
    count = int(
        np.clip(
            ContactSettings.most_px // (width * height),
            BackgroundSettings.least_pictures,
            ContactSettings.most_pictures,
        )
    )
    sample = [frames[i] for i in np.unique(np.linspace(0, len(frames) - 1, count).round().astype(int))]
    return _background_of([_plane(rig, still.image) for still in sample if still.image], looking, rig.image.bright)


def _background_of(
    images: Sequence[np.ndarray], looking: AntennaFinder, bright: bool | None
) -> tuple[Background | None, str]:
    """The static background of pictures (H, W) of the antenna, or the reason why it would not help."""
    from vbaa_calib.detect.drawing.overlay import corridor_mask

    width = looking.corridor.width_px
    lines = [looking.find(image, bright) for image in images]
    ground = _without(lines, images, width)
    if ground is None:
        return None, "what lies behind the antenna does not stand still, or shows no detail"
    # what clutter hid, the difference may show; what still looks like an antenna in the background may be one at rest
    for index, image in enumerate(images):
        behind = None if lines[index].found else ground.behind(image)
        if behind is not None:
            lines[index] = looking.find(image - behind, None)  # also where it is too little: it hides all the same
    at_rest = looking.find(ground.grey, bright)
    ground = _without(lines, images, width, at_rest if at_rest.found else None)
    if ground is None or ground.scatter is None:
        return None, "what lies behind the antenna does not stand still"
    unknown = np.isnan(ground.scatter)
    always = [unknown[covered(line, unknown.shape, 1.0) > 0].mean() for line in lines if line.found]
    if always and np.mean(always) > ContactSettings.hardly_moves:
        return None, "the antenna hardly moves in the picture, and hides what lies behind it"
    if ground.detail_over_scatter(corridor_mask(looking.corridor, looking.image_size) > 0) < BackgroundSettings.still:
        return None, "what lies behind the antenna is plain, or does not stand still"
    return ground, ""


def _without(
    lines: Sequence[Centreline], images: Sequence[np.ndarray], width_px: float, at_rest: Centreline | None = None
) -> Background | None:
    masks = [covered(line, image.shape, width_px) for line, image in zip(lines, images, strict=True)]
    if at_rest is not None:
        masks = [np.maximum(mask, covered(at_rest, mask.shape, width_px)) for mask in masks]
    return learn(images, masks)


def _plane(rig: Rig, path: Path) -> np.ndarray:
    """A picture (H, W) on the rig's plane of paint. Raises as `read_own` does."""
    return rig.image.paint.plane(read_own(rig, path))
