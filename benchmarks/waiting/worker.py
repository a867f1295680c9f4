"""What `vbaa bench waiting` runs in two trees, this one and an older one's: calls that both have, and a clock.

    python -P worker.py

Reads one line of JSON after the other and answers each with one. It may import nothing of benchmarks/: the older tree
has other ones.
"""

from __future__ import annotations

import itertools
import json
import os
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from estimator import ContactEstimator
from estimator.live import LiveEstimator
from vbaa_calib.rig import Rig
from vbaa_calib.session import Frame
from vbaa_calib.streams import Reading, Synchronizer, Taken, Timing

try:
    from estimator.contact import recording
except ImportError:  # where it was before
    from estimator import recording  # type: ignore[no-redef]

RATE_HZ = 60.0
LEAST_S = 0.1
"""Of one timing: quick work is repeated within it."""
LONG_S = 5.0
"""What takes longer the first time is not repeated within a timing."""
Work = Callable[[], Sequence[Any]]


def prepared(job: dict[str, Any], counted: list[np.ndarray]) -> tuple[Work, int]:
    """What is to be timed, and how many frames or pictures it goes through.

    `counted` takes how often each fit evaluates the model.
    """
    rig, given = Rig.load(Path(job["rig"])), dict(np.load(job["frames"]))
    estimator = ContactEstimator(rig, jobs=1)
    solved = estimator._solved

    def counting(*words: Any, **more: Any) -> Any:
        numbers = solved(*words, **more)
        counted.append(numbers.evaluations)
        return numbers

    setattr(estimator, "_solved", counting)  # noqa: B010
    return {"batch": _batch, "single": _single, "alone": _alone, "recording": _recording, "live": _live}[job["way"]](
        estimator, given
    )


def _batch(estimator: ContactEstimator, given: dict[str, np.ndarray]) -> tuple[Work, int]:
    """All frames in one call."""
    every = [given[name] for name in ("points_px", "moment_Nm", "pan_rad", "tilt_rad")]
    return lambda: estimator.estimate_batch(*every), len(every[0])


def _single(estimator: ContactEstimator, given: dict[str, np.ndarray]) -> tuple[Work, int]:
    """Frame by frame, as a user of one camera calls it."""
    frames = list(zip(given["points_px"], given["moment_Nm"], given["pan_rad"], given["tilt_rad"], strict=True))
    return lambda: [
        estimator.estimate(points, moment=float(moment), pan=float(pan), tilt=float(tilt))
        for points, moment, pan, tilt in frames
    ], len(frames)


def _pictures(given: dict[str, np.ndarray]) -> list[Frame]:
    """Pictures in memory as a recording's frames: in place of reading a file, the array of its number is taken."""
    images = given["images"]
    setattr(recording, "read_picture", lambda path: images[int(path.name)])  # noqa: B010
    joints = zip(given["pan_rad"].tolist(), given["tilt_rad"].tolist(), given["moment_Nm"].tolist(), strict=True)
    return [Frame(Path(str(index)), *own, frame=index, time_s=float("nan")) for index, own in enumerate(joints)]


def _alone(estimator: ContactEstimator, given: dict[str, np.ndarray]) -> tuple[Work, int]:
    frames = _pictures(given)
    return lambda: [recording.estimate_picture(estimator, frame).contact for frame in frames], len(frames)


def _recording(estimator: ContactEstimator, given: dict[str, np.ndarray]) -> tuple[Work, int]:
    frames = _pictures(given)
    return lambda: [each.contact for each in recording.estimate_pictures(estimator, frames)], len(frames)


def _live(estimator: ContactEstimator, given: dict[str, np.ndarray]) -> tuple[Work, int]:
    """Pictures and their readings as they come, `RATE_HZ` of them, to both contacts of each."""
    names, images = ("moment_Nm", "pan_rad", "tilt_rad"), given["images"]
    live = LiveEstimator(estimator, Synchronizer(Timing(), names, estimator.rig.camera.image_size))
    live.warm()
    counted = itertools.count()

    def work() -> Sequence[Any]:
        found: list[Any] = []
        for index, image in enumerate(images):
            time_s = next(counted) / RATE_HZ
            for name in names:
                found += live.push(Reading(time_s, name, float(given[name][index]), time_s))
            found += live.push(Taken(time_s, image, time_s, time.perf_counter()))
        return [contact.row for contact in found]

    return work, len(images)


def timed(work: Work, count: int, calls: int) -> dict[str, float]:
    """Processor time of all threads, and time on the wall, both in s for a frame."""
    wall, cpu = time.perf_counter(), time.process_time()
    for _ in range(calls):
        work()
    each = 1.0 / (calls * count)
    return {"cpu_s": (time.process_time() - cpu) * each, "wall_s": (time.perf_counter() - wall) * each}


def main() -> None:
    """Prepare, warm up and count; then time as often as is asked for."""
    replies = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # whatever is printed must not come between
    cv2.setNumThreads(1)
    work: Work = list
    count = calls = 1
    for line in sys.stdin:
        job = json.loads(line)
        reply: dict[str, Any] = {}
        if "way" in job:
            counted: list[np.ndarray] = []
            work, count = prepared(job, counted)
            begun = time.perf_counter()
            found = work()
            reply["located"] = float(np.mean(np.isfinite([contact.distance_m for contact in found])))
            if not counted and job["way"] == "single":  # which is one call of the core
                prepared(job | {"way": "batch"}, counted)[0]()
            reply["evaluations"] = float(np.concatenate(counted).sum()) / count if counted else None
            # what was compiled on the way does not count
            spent = time.perf_counter() - begun
            calls = max(1, int(LEAST_S / max(timed(work, 1, 1)["wall_s"], 1e-6))) if spent < LONG_S else 1
        else:
            reply = timed(work, count, calls)
        print(json.dumps(reply), file=replies, flush=True)


if __name__ == "__main__":
    main()
