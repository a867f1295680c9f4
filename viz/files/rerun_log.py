"""Contacts in Rerun's viewer: picture, scene, and numbers over time."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from vbaa_calib.core.errors import InputError, require_extra
from vbaa_calib.core.files import refuse_overwrite
from vbaa_calib.core.folders import make_folder

if TYPE_CHECKING:
    from estimator.live import LiveContact
    from estimator.table.contacts import ContactRow


def refuse_log(target: str, force: bool) -> None:
    """Raises InputError for what is neither a viewer nor an .rrd file that may be written."""
    if target == "spawn" or "://" in target:
        return
    if Path(target).suffix != ".rrd":
        raise InputError("is no .rrd", where=target, remedy="name a file.rrd, a viewer's URL, or give --rerun alone")
    refuse_overwrite(Path(target), force)


def _open_viewer() -> str:
    """The URL of a viewer on this machine: one that listens at Rerun's port, else a new one.

    Raises OSError if none can be opened.
    """
    host, port = "127.0.0.1", 9876
    url = f"rerun+http://{host}:{port}/proxy"
    with suppress(OSError), socket.create_connection((host, port), 1.0):
        return url
    # what the library itself opens listens at all addresses of the machine, and shows the pictures to all who ask
    command = [sys.executable, "-m", "rerun_cli", "--bind", host, "--port", str(port), "--expect-data-soon"]
    viewer = subprocess.Popen(command, start_new_session=True, env={**os.environ, "RERUN_APP_ONLY": "true"})
    most_s = time.monotonic() + 30.0
    while viewer.poll() is None and time.monotonic() < most_s:
        with suppress(OSError), socket.create_connection((host, port), 1.0):
            return url
        time.sleep(0.05)
    raise OSError("the viewer does not open")


class RerunLog:
    """A log of contacts in Rerun.

    target : "spawn" opens a viewer; a URL is that of one that runs; else an .rrd file to write.
    """

    def __init__(self, target: str, force: bool = False) -> None:
        """Raises InputError as `refuse_log` does, where the extra `live` is not installed, and for a viewer that cannot
        be reached."""
        refuse_log(target, force)
        self._rerun = require_extra("rerun", "live")
        self._stream = self._rerun.RecordingStream("vbaa")
        try:
            if target == "spawn":
                self._stream.connect_grpc(_open_viewer())
            elif "://" in target:
                self._stream.connect_grpc(target)
            else:
                make_folder(Path(target).parent)
                self._stream.save(target)
        except Exception as error:
            raise InputError(f"cannot be shown there ({error})", where=target, remedy="write a file.rrd") from None
        self._start_s = np.nan

    def write(self, contact: LiveContact) -> None:
        """Log a contact as it comes, with its picture and the detected line; a final one with its numbers."""
        self.row(contact.row, "final" if contact.final else "contact")
        if contact.final or contact.image is None:
            return
        measured, quality = contact.item.measured, [cv2.IMWRITE_JPEG_QUALITY, 85]
        for camera, image in contact.images.items() or [("", contact.image)]:
            path = f"picture/{camera}" if camera else "picture"
            data = cv2.imencode(".jpg", np.clip(image, 0, 255).astype(np.uint8), quality)[1].tobytes()
            self._log(path, self._rerun.EncodedImage(contents=data, media_type="image/jpeg"))
            points = measured.others.get(camera, measured).points_px
            self._log(f"{path}/antenna", self._rerun.Points2D(points, radii=1.0, colors=(0, 220, 120)))

    def row(self, row: ContactRow, name: str = "contact") -> None:
        """Log a row's point, force and numbers, at its time since the first one."""
        if np.isnan(self._start_s):
            self._start_s = row.time_s
        self._stream.set_time("stream", duration=row.time_s - self._start_s)
        self._stream.set_time("frame", sequence=row.frame)
        self._log(f"{name}/status", self._rerun.TextLog(f"{row.status}: {row.reason}"))
        force = float(np.hypot(row.force_y_N, row.force_z_N))
        for path, value, std in (
            ("distance_mm", 1e3 * row.distance_m, 1e3 * row.distance_std_m),
            ("force_y_mN", 1e3 * row.force_y_N, 1e3 * row.force_y_std_N),
            ("force_z_mN", 1e3 * row.force_z_N, 1e3 * row.force_z_std_N),
            ("force_mN", 1e3 * force, np.nan),
            ("moment_residual_uNm", 1e6 * row.moment_residual_Nm, np.nan),
        ):
            # band of two standard deviations
            values = [value, value - 2.0 * std, value + 2.0 * std] if np.isfinite(std) else [value]
            if np.isfinite(value):
                self._log(f"{name}/{path}", self._rerun.Scalars(values))
        if not np.isfinite(row.point_world_m).all():
            self._log(f"world/{name}", self._rerun.Clear(recursive=True))
            return
        point = row.point_world_m[None]
        self._log(f"world/{name}/point", self._rerun.Points3D(point, radii=5e-4))
        # m of arrow per N
        arrow = 0.2 * np.nan_to_num(row.force_world_N[None])
        self._log(f"world/{name}/force", self._rerun.Arrows3D(vectors=arrow, origins=point))
        sizes, axes = np.linalg.eigh(row.covariance_world_m2)
        # the ellipsoid of this size, in standard deviations, contains 95 % of a normal distribution in space
        half = 2.796 * np.sqrt(np.clip(sizes, 0.0, None))
        turned = axes * np.sign(np.linalg.det(axes))
        self._log(f"world/{name}/region_95", self._rerun.Ellipsoids3D(half_sizes=half[None]))
        self._log(f"world/{name}/region_95", self._rerun.Transform3D(translation=row.point_world_m, mat3x3=turned))

    def close(self) -> None:
        self._stream.flush()
        self._stream.disconnect()

    def _log(self, path: str, what: Any) -> None:
        self._stream.log(path, what)
