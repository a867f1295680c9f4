"""The report's pictures: the scene in three dimensions, and one picture of the recording with what was seen in it."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from estimator.table.contacts import ContactTable
from vbaa_calib.core.errors import InputError, VbaaError

if TYPE_CHECKING:
    from estimator.object.estimate import ObjectEstimate
    from vbaa_calib.rig import Rig
    from vbaa_calib.session import Frame
    from viz.scene.scene import Scene

WIDEST_PX = 1600
QUALITY = 88
SCENE_CAPTION = (
    "The scene, what was touched close up. Arrows are the object's forces on the antenna; `vbaa view` shows the scene "
    "to turn, zoom and follow in time."
)


@dataclass(frozen=True)
class Picture:
    """One picture of the report. `jpeg` is empty where there is none, and `words` say why."""

    jpeg: bytes
    words: str


def from_file(path: Path, words: str) -> Picture:
    """A picture from a file. Raises InputError when it cannot be read or is none."""
    try:
        data = np.frombuffer(Path(path).read_bytes(), np.uint8)
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", where=path, remedy="write the picture first") from None
    image = cv2.imdecode(data, cv2.IMREAD_COLOR) if len(data) else None
    if image is None:
        raise InputError("is not a picture", where=path, remedy="give the PNG that vbaa view --screenshot wrote")
    return Picture(_packed(image), words)


def _packed(image: np.ndarray) -> bytes:
    """(H, W, 3) uint8, blue, green, red, as a JPEG that is not wider than a page needs."""
    scale = min(1.0, WIDEST_PX / image.shape[1])
    if scale < 1.0:
        size = (WIDEST_PX, max(1, round(image.shape[0] * scale)))
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()


def scene_picture(
    table: ContactTable,
    rig: Rig | None,
    estimate: ObjectEstimate | None,
    truth: Mapping[str, Any] | None,
    session: Path | None,
) -> Picture:
    """The scene as `vbaa view --screenshot` draws it, or why there is none. `truth` is truth.json's contents."""
    from viz.render.render import can_render, screenshot

    if not table.located.any():
        return Picture(b"", "No picture of the scene: no frame has a located contact.")
    if not can_render():
        return Picture(b"", "No picture of the scene: OpenGL does not work here (libegl1 and libgl1-mesa-dri give it).")
    try:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "scene.png"
            screenshot(_scene(table, rig, estimate, truth, session), path)
            return from_file(path, SCENE_CAPTION)
    except VbaaError as error:
        return Picture(b"", f"No picture of the scene: {error}")


def _scene(
    table: ContactTable,
    rig: Rig | None,
    estimate: ObjectEstimate | None,
    truth: Mapping[str, Any] | None,
    session: Path | None,
) -> Scene:
    from viz.scene.facts import drawn_estimate
    from viz.scene.moments import moments_of
    from viz.scene.rig_items import rig_items, session_pictures
    from viz.scene.scene import Contacts, ObjectMesh, Scene
    from viz.scene.truth import true_object

    moments = moments_of(table, None if estimate is None else estimate.track.phase)
    pictures: tuple[np.ndarray | None, ...] = ()
    if rig is not None and session is not None:
        main = moments.main
        seen = session_pictures(session, moments.frame[main : main + 1], rig.camera.image_size)
        pictures = tuple(seen[0] if index == main else None for index in range(len(moments)))
    return Scene(
        Contacts.of(table),
        moments,
        rig=None if rig is None else rig_items(rig, table, moments),
        object=None if estimate is None else ObjectMesh.of(estimate.surface),
        truth=None if truth is None else true_object(truth),
        estimate=None if estimate is None else drawn_estimate(estimate),
        pictures=pictures,
    )


def seen_picture(table: ContactTable, rig: Rig, session: Path, background: Path | None = None) -> Picture:
    """The recording's picture of the greatest force with what was seen and estimated, or why there is none."""
    from estimator.contact.estimate import ContactEstimator
    from estimator.contact.overlay import frame_picture
    from estimator.contact.recording import estimate_picture, read_ground
    from vbaa_calib.session import load_session, read_recording

    try:
        frame, row = _strongest(table, read_recording(load_session(session)))
        if frame is None or frame.image is None:
            return Picture(b"", "No picture of the recording: it has none, or none with a located contact.")
        # estimated anew, as the table's row was
        estimator = ContactEstimator(rig, str(table.model[row]), friction=table.assumed_friction_rad)
        if not np.isfinite(table.moment_residual_Nm[row]):
            frame = replace(frame, moment_Nm=np.nan, moment_z_Nm=np.nan)
        ground = None if background is None else read_ground(rig, background)
        image = frame_picture(estimator, estimate_picture(estimator, frame, ground))
    except VbaaError as error:
        return Picture(b"", f"No picture of the recording: {error}")
    return Picture(
        _packed(image),
        f"Frame {frame.frame}, the one of the greatest force, with what was seen of the antenna, the fitted shape, the "
        "contact and the force; `vbaa estimate --overlay` draws every frame so.",
    )


def _strongest(table: ContactTable, frames: list[Frame]) -> tuple[Frame | None, int]:
    """The frame with the greatest force among those that were located, and its row in the table."""
    located = np.flatnonzero(table.located)
    if not len(located):
        return None, 0
    across = np.hypot(table.force_y_N[located], table.force_z_N[located])
    whole = np.linalg.norm(table.force_world_N[located], axis=1)
    row = int(located[int(np.argmax(np.where(np.isfinite(whole), whole, across)))])
    return next((frame for frame in frames if frame.frame == int(table.frame[row])), None), row
