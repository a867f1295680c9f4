"""A session's recording as a bag of ROS messages."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import refuse_overwrite, replacing
from vbaa_calib.core.folders import replacing_folder
from vbaa_calib.session import READINGS, Frame, load_session, read_recording
from vbaa_calib.simulate.scene.lens import Lens

from .bags import BagWriter, Logged


def refuse_bag(path: Path, force: bool) -> None:
    """Raises InputError unless a bag may be written to `path`: a file, or the folder of a ROS 2 bag."""
    if path.suffix in (".mcap", ".bag"):
        refuse_overwrite(path, force)
        return
    if path.suffix:
        remedy = "name it .mcap, .bag, or without a suffix for the folder of a ROS 2 bag"
        raise InputError(f"{path.suffix} is no bag", where=path, remedy=remedy)
    if os.path.lexists(path) and not (force and (path / "metadata.yaml").is_file() and not path.is_symlink()):
        remedy = "take another name" if force else "give --force to replace it, or another name"
        raise InputError("exists already", where=path, remedy=remedy)


def write_recording(path: Path, session: Path, lenses: Mapping[str, Lens]) -> None:
    """Write a session's recording at its own times: the pictures as CompressedImage, the moment as WrenchStamped,
    the joints as JointState, and CameraInfo. lenses : by the cameras' names, the first camera first."""
    frames = read_recording(load_session(session))
    if path.suffix:
        with replacing(path) as temporary:
            temporary.unlink()  # the ROS 1 writer does not overwrite
            _write(temporary, frames, lenses)
        return
    with replacing_folder(path) as folder:
        made = folder / path.name  # nor does that of ROS 2
        _write(made, frames, lenses)
        for part in list(made.iterdir()):
            part.rename(folder / part.name)
        made.rmdir()


def _write(path: Path, frames: Iterable[Frame], lenses: Mapping[str, Lens]) -> None:
    writer = BagWriter(path)
    try:
        for frame in frames:
            for logged in _logged(frame, lenses):
                writer.write(logged)
    finally:
        writer.close()


def _logged(frame: Frame, lenses: Mapping[str, Lens]) -> Iterator[Logged]:
    """The messages of one frame: the readings first, because they arrive while the picture is read out."""
    # a bag begins a second after the clock's zero: a stamp of zero means none
    time_ns = 1_000_000_000 + round(1e9 * frame.time_s)
    wrench: dict[str, dict[str, float]] = {"torque": {}, "force": {}}
    for name, value in zip(READINGS, frame.readings, strict=True):
        if np.isfinite(value):
            wrench["torque" if name[0] == "m" else "force"][name[1]] = value
    if any(wrench.values()):
        yield Logged("/antenna/moment", "geometry_msgs/msg/WrenchStamped", {"wrench": wrench}, time_ns)
    joints = {"name": ["pan", "tilt"], "position": [frame.pan_rad, frame.tilt_rad]}
    yield Logged("/joint_states", "sensor_msgs/msg/JointState", joints, time_ns)
    for index, (camera, lens) in enumerate(lenses.items()):
        image = frame.others.get(camera) if index else frame.image
        if image is None:
            continue
        yield Logged(f"/{camera}/camera_info", "sensor_msgs/msg/CameraInfo", _camera_info(lens), time_ns)
        content = {"format": image.suffix.lower().lstrip("."), "data": np.frombuffer(image.read_bytes(), np.uint8)}
        yield Logged(f"/{camera}/image/compressed", "sensor_msgs/msg/CompressedImage", content, time_ns)


def _camera_info(lens: Lens) -> dict[str, Any]:
    width, height = lens.image_size
    names = {0: "plumb_bob", 4: "plumb_bob", 5: "plumb_bob", 8: "rational_polynomial"}
    model = "equidistant" if lens.model == "fisheye" else names.get(len(lens.distortion), "")
    return {"width": width, "height": height, "distortion_model": model, "d": lens.distortion, "k": lens.matrix.ravel()}
