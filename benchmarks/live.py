"""`python -m benchmarks.live [--size 640x480] [--pictures 4000]`: processor time of a picture to both of its contacts.

The demo's scene at that size, calibrated as a user does it, its recording forth and back at 60 pictures a second; on
one thread, from memory. The first lap, in which what depends on the joint angles is prepared, counts, too.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from estimator import ContactEstimator
from estimator.live import LiveEstimator
from vbaa_calib.cli.main import run_verb
from vbaa_calib.core.files import read_yaml
from vbaa_calib.rig import Rig
from vbaa_calib.session import load_session, read_recording
from vbaa_calib.simulate.scene.scene import bundled_scene
from vbaa_calib.streams import Reading, Synchronizer, Taken, Timing

_RATE_HZ = 60.0
_CHANNELS = ("moment_Nm", "pan_rad", "tilt_rad")


def demo_at(size: tuple[int, int]) -> dict[str, Any]:
    """The demo's scene, its camera of another size (width, height) with the same view or more of it."""
    scene: dict[str, Any] = read_yaml(bundled_scene("demo"))
    camera = scene["camera"]
    was, now = np.array(camera["image_size"]), np.array(size)
    scale = (now / was).max()
    matrix = np.diag([scale, scale, 1.0]) @ np.array(camera["matrix"])
    matrix[:2, 2] += 0.5 * (now - scale * was)
    camera.update(image_size=list(size), matrix=matrix.tolist())
    return scene


def seconds(folder: Path, count: int) -> np.ndarray:
    """(count,) processor time of each picture of a session in a folder beside its rig.json."""
    rig, frames = Rig.load(folder / "rig.json"), read_recording(load_session(folder / "session"))
    images = [cv2.imread(str(frame.image), cv2.IMREAD_UNCHANGED) for frame in frames]
    lap = [*range(len(frames)), *range(len(frames) - 2, 0, -1)]
    live = LiveEstimator(ContactEstimator(rig, jobs=1), Synchronizer(Timing(), _CHANNELS, rig.camera.image_size))
    live.warm()
    spent = np.empty(count)
    for index in range(count):
        at, time_s = lap[index % len(lap)], index / _RATE_HZ
        begun = time.process_time()
        for channel in _CHANNELS:
            for _ in live.push(Reading(time_s, channel, getattr(frames[at], channel), time_s)):
                pass
        for _ in live.push(Taken(time_s, images[at], time_s, time.perf_counter())):
            pass
        spent[index] = time.process_time() - begun
    return spent


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", default="640x480", help="of the pictures, px (default: 640x480)")
    parser.add_argument("--pictures", type=int, default=4000, help="how many (default: 4000)")
    args = parser.parse_args()
    width, height = map(int, args.size.split("x"))
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "scene.yaml").write_text(yaml.safe_dump(demo_at((width, height))))
        for words in (f"simulate {name}/scene.yaml -o {name}/session", f"calibrate {name}/session -o {name}/rig.json"):
            run_verb(words.split())
        spent_ms = 1e3 * seconds(folder, args.pictures)
    median, most, late = np.quantile(spent_ms, [0.5, 0.9, 0.99])
    print(
        f"{args.size}, {args.pictures} pictures: {spent_ms.mean():.1f} ms, median {median:.1f}, 90 % {most:.1f}, "
        f"99 % {late:.1f}, most {spent_ms.max():.0f}; longer than two frame times: {(spent_ms > 2e3 / _RATE_HZ).sum()}"
    )


if __name__ == "__main__":
    main()
