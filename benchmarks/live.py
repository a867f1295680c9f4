"""`python -m benchmarks.live [--size 640x480] [--pictures 4000]`: processor time of a picture to both of its contacts.

The demo's scene at that size, calibrated as a user does it, its recording forth and back at 60 pictures a second; on
one thread, from memory. The first lap, in which what depends on the joint angles is prepared, counts, too. By a clock
that goes on by these times follows what a core with nothing else to do drops, and how late its contacts are.
With `--paced` the pictures come when they are due, from a camera that waits for nobody: what is dropped, and how late
the contacts are. That wants such a core.
"""

from __future__ import annotations

import argparse
import gc
import tempfile
import time
from collections import deque
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
import yaml

from estimator import ContactEstimator
from estimator.live import LiveEstimator
from vbaa_calib.cli.main import run_verb
from vbaa_calib.core.files import read_yaml
from vbaa_calib.core.images import read_picture
from vbaa_calib.rig import Rig
from vbaa_calib.session import Frame, load_session, read_recording
from vbaa_calib.simulate.scene.scene import bundled_scene
from vbaa_calib.sources.live import _CAMERA_FAULTS, LiveSource, StreamSettings
from vbaa_calib.streams import Reading, Synchronizer, Taken, Timing
from vbaa_calib.streams.devices import DEVICES, open_device
from vbaa_calib.streams.messages import MESSAGES

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


def _recorded(folder: Path) -> tuple[LiveEstimator, list[Frame], list[np.ndarray]]:
    """What is ready for the pictures of a rig, and its recording forth and back, with the pictures."""
    frames = read_recording(load_session(folder / "session"))
    lap = [*frames, *frames[-2:0:-1]]
    # each a picture of its own, so that it is known which one comes
    images, rig = [read_picture(each.image) for each in lap if each.image], Rig.load(folder / "rig.json")
    live = LiveEstimator(ContactEstimator(rig, jobs=1), Synchronizer(Timing(), _CHANNELS, rig.camera.image_size))
    live.warm()
    gc.collect()
    gc.freeze()
    return live, lap, images


def alone(folder: Path, count: int) -> tuple[np.ndarray, np.ndarray, int]:
    """Of so many pictures of a session in a folder beside its rig.json, as a core with nothing else to do would take
    them: (N, 2) processor time, s, to the contact at once, and to all that comes with it; (N,) latency of the contact
    at once, s; and how many more were dropped."""
    live, lap, images = _recorded(folder)
    waiting, coming, now_s = deque[int](), 0, 0.0
    spent, late_s = list[tuple[float, float]](), list[float]()
    while waiting or coming < count:
        while coming < count and coming / _RATE_HZ <= now_s:
            if len(waiting) >= DEVICES.queued:
                waiting.popleft()
            waiting.append(coming)
            coming += 1
        begun = time.process_time()
        if not waiting:
            if coming / _RATE_HZ < now_s + MESSAGES.tick_s / 10:
                now_s = coming / _RATE_HZ
                continue
            for _ in live.push(None):
                pass
            now_s += MESSAGES.tick_s / 10 + time.process_time() - begun
            continue
        index, at_once_s = waiting.popleft(), 0.0
        at, time_s = index % len(lap), index / _RATE_HZ
        for channel in _CHANNELS:
            for _ in live.push(Reading(time_s, channel, getattr(lap[at], channel), time_s)):
                pass
        for contact in live.push(Taken(time_s, images[at], time_s, time.perf_counter(), waiting=len(waiting))):
            if not contact.final:
                at_once_s = time.process_time() - begun
        spent.append((at_once_s, time.process_time() - begun))
        late_s.append(now_s + at_once_s - time_s)
        now_s += spent[-1][1]
    return np.array(spent), np.array(late_s), count - len(spent)


class _Camera:
    """Gives pictures when they are due, as `cv2.VideoCapture` does, as often as `count`."""

    def __init__(self, images: list[np.ndarray], count: int) -> None:
        self._images, self._left = images, count
        self._begun_s, self._count = time.monotonic(), count

    def isOpened(self) -> bool:
        return True

    def grab(self) -> bool:
        self._left -= 1
        due_s = self._begun_s + (self._count - self._left) / _RATE_HZ
        time.sleep(max(0.0, due_s - time.monotonic()))
        return self._left >= 0

    def retrieve(self) -> tuple[bool, np.ndarray]:
        return True, self._images[(self._count - self._left) % len(self._images)]

    def release(self) -> None:
        pass


def paced(folder: Path, count: int) -> tuple[int, np.ndarray]:
    """How many of so many pictures were dropped, and the latencies (N,) of the contacts at once, s."""
    live, lap, images = _recorded(folder)
    shown = {id(image): frame for image, frame in zip(images, lap, strict=True)}
    opened = cast(cv2.VideoCapture, _Camera(images, count))
    camera = LiveSource("camera", lambda: opened, StreamSettings(failures=1), _CAMERA_FAULTS)
    source, late_s = open_device(camera), []
    camera.retries_s = ()
    for message in source.messages():
        if isinstance(message, Taken):
            for channel in _CHANNELS:
                value = getattr(shown[id(message.image)], channel)
                for _ in live.push(Reading(message.time_s, channel, value, message.time_s)):
                    pass
        late_s += [contact.latency_s for contact in live.push(message) if not contact.final]
    return source.dropped(), np.array(late_s)


def _told(size: str, dropped: int, late_s: np.ndarray) -> str:
    median, late, most = 1e3 * np.quantile(late_s, [0.5, 0.99, 1.0])
    return (
        f"{size}, {dropped + len(late_s)} pictures at {_RATE_HZ:g}/s: {dropped} dropped; latency "
        f"{median:.1f} ms (median), {late:.1f} (99 %), {most:.0f} (most)"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", default="640x480", help="of the pictures, px (default: 640x480)")
    parser.add_argument("--pictures", type=int, default=4000, help="how many (default: 4000)")
    parser.add_argument("--paced", action="store_true", help="in real time, from a camera that waits for nobody")
    args = parser.parse_args()
    width, height = map(int, args.size.split("x"))
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "scene.yaml").write_text(yaml.safe_dump(demo_at((width, height))))
        for words in (f"simulate {name}/scene.yaml -o {name}/session", f"calibrate {name}/session -o {name}/rig.json"):
            run_verb(words.split())
        if args.paced:
            print(_told(args.size, *paced(folder, args.pictures)))
            return
        spent_s, late_s, dropped = alone(folder, args.pictures)
    spent_ms = 1e3 * spent_s[:, 1]
    median, most, late = np.quantile(spent_ms, [0.5, 0.9, 0.99])
    print(
        f"{args.size}, {len(spent_ms)} pictures: {spent_ms.mean():.1f} ms, median {median:.1f}, 90 % {most:.1f}, "
        f"99 % {late:.1f}, most {spent_ms.max():.0f}; longer than two frame times: {(spent_ms > 2e3 / _RATE_HZ).sum()}"
    )
    print("a core alone:", _told(args.size, dropped, late_s))


if __name__ == "__main__":
    main()
