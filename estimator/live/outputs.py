"""Where live contacts go: a table that grows, JSON lines, an MCAP file."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Any, TextIO

from estimator.table.contacts import LOCATED
from estimator.table.files import cells_of, write_header, write_row
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import disk_errors_named, refuse_overwrite
from vbaa_calib.streams.bags import BagWriter, Logged

from .estimator import LiveContact


class GrowingTable:
    """contacts.csv that can be read while it grows: a line for each frame as it comes, at once in the file.

    The final rows are kept beside it, and take its place when it is closed.
    """

    def __init__(self, path: Path, force: bool = False) -> None:
        """Raises InputError for a file in the way, or what is not a .csv."""
        if path.suffix != ".csv":
            raise InputError(
                "is not a .csv", where=path, remedy="others cannot be read while they grow; convert it later"
            )
        refuse_overwrite(path, force)
        self._path, self._later = path, path.with_name(f".{path.name}.final")
        self._now_stream, self._later_stream = _opened(path), _opened(self._later)
        self._rows = [0, 0]

    def write(self, contact: LiveContact) -> None:
        stream = self._later_stream if contact.final else self._now_stream
        with disk_errors_named(self._path):
            write_row(stream, cells_of(contact.row))
            stream.flush()
        self._rows[contact.final] += 1

    def close(self) -> None:
        """Puts the final rows in place, if there is one of every frame."""
        try:
            with disk_errors_named(self._path):
                self._now_stream.close()
                self._later_stream.close()
                if self._rows[True] == self._rows[False]:
                    os.replace(self._later, self._path)
        finally:
            self._later.unlink(missing_ok=True)


def _opened(path: Path) -> TextIO:
    try:
        stream = path.open("w", encoding="utf-8", newline="")
    except OSError as error:
        raise InputError(f"cannot be written ({error.strerror})", where=path, remedy="write somewhere else") from None
    try:
        with disk_errors_named(path):
            write_header(stream)
            stream.flush()
    except BaseException:
        path.unlink(missing_ok=True)
        raise
    return stream


def json_line(contact: LiveContact) -> str:
    """One line: the columns of contacts.csv, null where there is no number, and final, latency_s, age_s."""
    cells: dict[str, Any] = {**cells_of(contact.row), "latency_s": contact.latency_s, "age_s": contact.age_s}
    plain = {
        name: None if isinstance(value, float) and not math.isfinite(value) else value for name, value in cells.items()
    }
    return json.dumps({"final": contact.final, **plain}, allow_nan=False)


class ContactBag:
    """Contacts as ROS messages: PointStamped and WrenchStamped of what is located, the pose with its covariance, and
    every frame as JSON text (std_msgs/String), in an MCAP file or a ROS bag by the suffix."""

    def __init__(self, path: Path, force: bool = False) -> None:
        """Raises InputError for a file in the way."""
        refuse_overwrite(path, force)
        self._path = path
        with disk_errors_named(path):
            self._writer = BagWriter(path)

    def write(self, contact: LiveContact) -> None:
        with disk_errors_named(self._path):
            for logged in contact_messages(contact):
                self._writer.write(logged)

    def close(self) -> None:
        with disk_errors_named(self._path):
            self._writer.close()


def contact_messages(contact: LiveContact) -> list[Logged]:
    """A contact as ROS messages, at the picture's time; world frame."""
    row = contact.row
    prefix, time_ns = "/contact/final" if contact.final else "/contact", max(round(1e9 * row.time_s), 0)
    said = [Logged(f"{prefix}/row", "std_msgs/msg/String", {"data": json_line(contact)}, time_ns)]
    if row.status not in LOCATED:
        return said
    point = dict(zip("xyz", row.point_world_m.tolist(), strict=True))
    covariance = [0.0] * 36
    for i in range(3):
        for j in range(3):
            covariance[6 * i + j] = float(row.covariance_world_m2[i, j])
    pose = {"pose": {"position": point, "orientation": {"w": 1.0}}, "covariance": covariance}
    force = {"force": dict(zip("xyz", row.force_world_N.tolist(), strict=True))}
    return [
        *said,
        Logged(f"{prefix}/point", "geometry_msgs/msg/PointStamped", {"point": point}, time_ns),
        Logged(f"{prefix}/force", "geometry_msgs/msg/WrenchStamped", {"wrench": force}, time_ns),
        Logged(f"{prefix}/pose", "geometry_msgs/msg/PoseWithCovarianceStamped", {"pose": pose}, time_ns),
    ]
