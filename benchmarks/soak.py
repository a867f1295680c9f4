"""`python -m benchmarks.soak` (`make soak`): long runs, in which memory and open files must not grow.

A line for each: how many items, the processor's seconds, and by how much the resident memory and the open descriptors
rose in the second half; what is loaded comes before that. `--part 0.1` does a tenth of each. The exit code is 1 where
a run grew. Linux alone: it is read from /proc.
"""

from __future__ import annotations

import argparse
import contextlib
import http.client
import io
import os
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from urllib.parse import urlsplit

import cv2
import numpy as np
import yaml

from benchmarks.estimator.setup import SIGMA_PX
from benchmarks.waiting.recordings import period
from estimator import ContactEstimator
from estimator.live import LiveEstimator
from estimator.table.contacts import Measured
from vbaa_calib.camera import Camera
from vbaa_calib.cli.main import main as vbaa
from vbaa_calib.core.files import read_yaml
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.rig import RIG_PARAMETERS, Antenna, AntennaImage, MomentSensor, Rig
from vbaa_calib.simulate.scene.scene import bundled_scene
from vbaa_calib.streams import Reading, Synchronizer, Taken, Timing
from vbaa_calib.wizard.server import PageServer

MOST_MB, MOST_OPEN = 10.0, 2
"""That may come on top in the second half."""
_SAMPLES = 200
_POINTS, _RATE_HZ, _SHOWN = 40, 30.0, 16


def offline(count: int) -> Iterator[object]:
    """Frames of centrelines through the estimator, as it takes a recording; noise is new in every frame."""
    one, rng = period(_POINTS), np.random.default_rng(0)
    sigma = np.full(_POINTS, SIGMA_PX)

    def measured() -> Iterator[Measured]:
        for index in range(count):
            at = index % len(one.points_px)
            points = one.points_px[at] + SIGMA_PX * rng.normal(size=(_POINTS, 2))
            moment = one.moment_Nm[at] + one.rig.moment_sensor.std_Nm * rng.normal()
            yield Measured(points, sigma, float(moment), 0.0, 0.0, time_s=index / _RATE_HZ)

    return ContactEstimator(one.rig, jobs=1).run(measured())


def _plain_rig() -> Rig:
    """A straight, weightless antenna seen from above by a camera of 480 x 360 px."""
    parameters = np.zeros(9)
    parameters[6:8] = np.log([4e-3, 4e-3])
    matrix = np.array([[500.0, 0.0, 240.0], [0.0, 500.0, 180.0], [0.0, 0.0, 1.0]])
    return Rig(
        camera=Camera("opencv", (480, 360), matrix, np.zeros(5)),
        T_antenna_camera=Pose(np.diag([1.0, -1.0, -1.0]), np.array([0.12, 0.0, 0.32])),
        antenna=Antenna(0.24, 8e-4, parameters),
        moment_sensor=MomentSensor(1.0, 0.0, 2e-5),
        kinematics=Kinematics(),
        gravity_world_m_s2=np.zeros(3),
        image=AntennaImage(0.1, 1.0, True),
        covariance=np.diag(np.full(len(RIG_PARAMETERS), 1e-10)),
    )


def live(count: int) -> Iterator[object]:
    """Pictures and readings as they come, each answered at once and once more; free and bent in turn."""
    rig, rng = _plain_rig(), np.random.default_rng(0)
    stream = LiveEstimator(ContactEstimator(rig, jobs=1), Synchronizer(Timing(), ["moment_Nm"]))
    pictures = []
    for bent in np.linspace(0.0, 24.0, _SHOWN):
        picture = rng.normal(70.0, 2.0, rig.camera.image_size[::-1]).astype(np.uint8)
        axis = np.stack([np.linspace(52.5, 427.5, 300), 180.0 + bent * np.linspace(0.0, 1.0, 300) ** 2], axis=-1)
        pictures.append(cv2.polylines(picture, [axis.round().astype(int)], False, 150, 2, cv2.LINE_AA))
    for index in range(count):
        time_s, at = index / _RATE_HZ, index % _SHOWN
        for _ in stream.push(Reading(time_s, "moment_Nm", 2.5e-4 * at, time_s)):
            pass
        for _ in stream.push(Taken(time_s, pictures[at].copy(), time_s, time.perf_counter())):
            pass
        yield None
    yield from stream.finish()


def wizard(count: int) -> Iterator[object]:
    """A wizard that looks at pictures of a folder; none shows the board, so it goes on and on."""
    with tempfile.TemporaryDirectory() as name:
        root, source = Path(name), Path(name, "pictures", "intrinsics")
        source.mkdir(parents=True)
        rng, board = np.random.default_rng(0), read_yaml(bundled_scene("demo"))["board"]
        (root / "board.yaml").write_text(yaml.safe_dump(board))
        for index in range(count):
            # little to see: the search for a board is not what is held here
            cv2.imwrite(str(source / f"{index:06d}.png"), rng.normal(128.0, 1.0, (60, 80)).astype(np.uint8))
            os.utime(source / f"{index:06d}.png", (1e9, 1e9))
        answers: dict[str, object] = {"board": str(root / "board.yaml"), "source": str(source.parent)}
        answers |= {"antenna_length_mm": 240, "camera_distance_mm": 370, "camera_inclination_deg": 30}
        answers |= {f"board_along_{x}_mm": 1e3 * board["square_m"] * board[f"squares_{x}"] for x in "xy"}
        (root / "answers.yaml").write_text(yaml.safe_dump(answers))
        said, words = list[int](), io.StringIO()

        def work() -> None:
            with contextlib.redirect_stderr(words):
                said.append(vbaa(["wizard", str(root / "rig"), "--answers", str(root / "answers.yaml"), "--batch"]))

        worker = threading.Thread(target=work)
        worker.start()
        while worker.is_alive():
            worker.join(0.2)
            yield None
        if said != [2] or f"{count - 1:06d}.png" not in words.getvalue():
            raise SystemExit(f"the wizard ended with {said}: {words.getvalue()[-1000:]}")


def page(count: int) -> Iterator[object]:
    """Browsers that come, ask for the page, the state and the picture, and go; some without a word."""
    server = PageServer()
    cookie = {"Cookie": f"vbaa_wizard_{server.port}={urlsplit(server.url).query.removeprefix('token=')}"}
    shown = cv2.imencode(".jpg", np.zeros((480, 640), np.uint8))[1].tobytes()
    for index in range(count):
        server.show({"log": [f"picture {index}"], "finished": False}, shown)
        for path in ("/", "/page.js", "/state?after=0", "/picture"):
            connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)
            connection.request("GET", path, headers=cookie)
            if index % 10 or path == "/":
                answer = connection.getresponse()
                if answer.status != 200:
                    raise SystemExit(f"{path}: {answer.status}")
                answer.read()
            connection.close()
        yield None
    server.close()


RUNS: dict[str, tuple[Callable[[int], Iterator[object]], int]] = {
    "offline": (offline, 1_000_000),
    "live": (live, 100_000),
    "wizard": (wizard, 5_000),
    "page": (page, 1_000),
}
"""Name → what is done, and how often."""


def _resident_MB() -> float:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def rise(values: Sequence[float]) -> float:
    """By how much values rose over their second half: twice the difference of its halves' medians."""
    quarter = max(1, len(values) // 4)
    return float(2.0 * (np.median(values[-quarter:]) - np.median(values[-2 * quarter : -quarter])))


def soaked(name: str, count: int) -> tuple[str, bool]:
    """A line about a run, and whether it stayed flat."""
    make, _ = RUNS[name]
    begun, samples, every = time.process_time(), list[tuple[float, int]](), max(1, count // _SAMPLES)
    for index, _ in enumerate(make(count)):
        if index % every == 0 or name == "wizard":
            samples.append((_resident_MB(), len(os.listdir("/proc/self/fd"))))
    grown = [rise(column) for column in zip(*samples, strict=True)]
    flat = grown[0] <= MOST_MB and grown[1] <= MOST_OPEN
    memory, descriptors = samples[len(samples) // 2]
    spent = f"{time.process_time() - begun:.0f} CPU s"
    line = f"{name}: {count} items, {spent}; from the middle on {memory:.0f} MB, {grown[0]:+.1f} MB"
    return f"{line}; {descriptors} descriptors, {grown[1]:+.0f}", flat


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", nargs="*", choices=[*RUNS, []], help="which (default: all)")
    parser.add_argument("--part", type=float, default=1.0, help="of each run's length (default: 1)")
    args = parser.parse_args()
    grown = False
    for name in args.runs or RUNS:
        line, flat = soaked(name, max(50, round(args.part * RUNS[name][1])))
        grown |= not flat
        print(line if flat else f"{line}: GROWS", flush=True)
    sys.exit(1 if grown else 0)


if __name__ == "__main__":
    main()
