"""Path-traced pictures of antennas with their truth, for tests: JPEGs and truth.json in tests/traced/.

Made from sessions that `vbaa simulate SCENE --render mitsuba --labels` wrote, two or three pictures of each:
`python -m tests.traced_pictures SESSION…`. Add sessions without an antenna (`material: none`) for false alarms.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from vbaa_calib.core.files import read_json

from .csv_files import read_rows

FOLDER = Path(__file__).parent / "traced"
_QUALITY = 92
_STEP = 4
"""Rows of labels/centrelines.csv, about one a pixel, per point that is kept."""


@dataclass(frozen=True, eq=False)
class TracedPicture:
    """One picture.

    Attributes
    ----------
    material, bench : "steel", "paint", "nitinol", "nylon" or "none"; "plain", "cluttered", "patchwork".
    line_px : (N, 2) the true centreline, about every 4 px from the clamp to the tip; empty without an antenna.
    visible : (N,) whether it is in the picture and not behind the object.
    free_px : (M, 2) the free antenna of the same rig: the axis of the corridor in which it is looked for.
    width_px : of the silhouette, in its middle.
    in_contact : whether an object touches it.
    """

    name: str
    material: str
    bench: str
    line_px: np.ndarray
    visible: np.ndarray
    free_px: np.ndarray
    width_px: float
    in_contact: bool

    def color(self) -> np.ndarray:
        """(H, W, 3) uint8, blue, green, red."""
        picture = cv2.imread(str(FOLDER / f"{self.name}.jpg"))
        assert picture is not None
        return picture

    def gray(self) -> np.ndarray:
        """(H, W) uint8."""
        return cv2.cvtColor(self.color(), cv2.COLOR_BGR2GRAY)


def traced_pictures() -> list[TracedPicture]:
    """All of them."""
    return [
        TracedPicture(
            name=name,
            material=one["material"],
            bench=one["bench"],
            line_px=np.array(one["line_px"], float).reshape(-1, 2),
            visible=np.array(one["visible"], bool),
            free_px=np.array(one["free_px"], float),
            width_px=one["width_px"],
            in_contact=one["in_contact"],
        )
        for name, one in read_json(FOLDER / "truth.json").items()
    ]


def _add(session: Path, images: tuple[str, ...]) -> dict[str, dict]:
    """Write the JPEGs of some of a session's pictures. Returns their truth by name."""
    traced = read_json(session / "truth.json")["traced"]
    lines: dict[str, list[list[float]]] = {}
    for row in read_rows(session / "labels/centrelines.csv"):
        values = [float(row[name]) for name in ("u_px", "v_px", "width_px", "visible")]
        lines.setdefault(row["image"], []).append(values)
    touched = {row["image"]: row["in_contact"] == "1" for row in read_rows(session / "labels/contacts.csv")}
    free = np.array(lines["noload/noload_000.png"])[::_STEP]
    truth = {}
    for image in images:
        name = f"{session.name}_{Path(image).stem}"
        picture = cv2.imread(str(session / image))
        assert picture is not None
        (FOLDER / f"{name}.jpg").write_bytes(
            cv2.imencode(".jpg", picture, (cv2.IMWRITE_JPEG_QUALITY, _QUALITY))[1].tobytes()
        )
        line = np.array(lines[image])[::_STEP] if traced["material"] != "none" else np.zeros((0, 4))
        truth[name] = {
            "material": traced["material"],
            "bench": traced["bench"],
            "in_contact": touched[image],
            "width_px": round(float(np.median(free[:, 2])), 2),
            "free_px": np.round(free[:, :2], 2).tolist(),
            "line_px": np.round(line[:, :2], 2).tolist(),
            "visible": line[:, 3].astype(int).tolist(),
        }
    return truth


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    known = read_json(FOLDER / "truth.json") if (FOLDER / "truth.json").is_file() else {}
    for given in map(Path, sys.argv[1:]):
        empty = read_json(given / "truth.json")["traced"]["material"] == "none"
        chosen = ("noload/noload_001.png",) if empty else ("noload/noload_001.png", "recording/frame_0005.png")
        known |= _add(given, chosen)
    text = ",\n".join(f"{json.dumps(name)}: {json.dumps(one)}" for name, one in sorted(known.items()))
    (FOLDER / "truth.json").write_text("{\n" + text + "\n}\n")
