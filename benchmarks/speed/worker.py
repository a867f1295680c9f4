"""What `vbaa bench speed` runs in two trees, this one and an older one's: calls that both have, and a clock.

    python -P worker.py

Reads one line of JSON after the other and answers each with one. It may import nothing of benchmarks/: the older tree
has other ones.
"""

from __future__ import annotations

import inspect
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
from vbaa_calib.rig import Rig
from vbaa_calib.session import Frame

try:
    from estimator.contact import recording
except ImportError:  # where it was before
    from estimator import recording  # type: ignore[no-redef]

LEAST_S = 0.1
"""Of one timing: quick work is repeated within it."""
LONG_S = 5.0
"""What takes longer the first time is not repeated within a timing."""
Work = Callable[[], Sequence[Any]]


def prepared(job: dict[str, Any]) -> tuple[Work, int]:
    """What is to be timed, and how many frames or pictures it goes through."""
    rig, given = Rig.load(Path(job["rig"])), dict(np.load(job["frames"]))
    # a tree that knows no threads of its own stays with one
    threads = {"jobs": job["threads"]} if "jobs" in inspect.signature(ContactEstimator).parameters else {}
    estimator = ContactEstimator(rig, job["model"], friction=job["friction"], **threads)
    return {"batch": _batch, "single": _single, "alone": _alone, "recording": _recording}[job["way"]](estimator, given)


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


def timed(work: Work, count: int, calls: int) -> dict[str, float]:
    """Processor time of all threads, and time on the wall, both in s for a frame."""
    wall, cpu = time.perf_counter(), time.process_time()
    for _ in range(calls):
        work()
    each = 1.0 / (calls * count)
    return {"cpu_s": (time.process_time() - cpu) * each, "wall_s": (time.perf_counter() - wall) * each}


def answers(found: Sequence[Any]) -> dict[str, np.ndarray]:
    """Of contacts: status, model, distance and force with their deviations."""
    names = ("status", "model", "distance_m", "distance_std_m", "force_N", "force_std_N")
    return {name: np.array([getattr(contact, name) for contact in found]) for name in names}


def main() -> None:
    """Prepare, warm up and leave the frames' contacts in a file; then time as often as is asked for."""
    replies = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # whatever is printed must not come between
    cv2.setNumThreads(1)
    work: Work = list
    count = calls = 1
    for line in sys.stdin:
        job = json.loads(line)
        reply: dict[str, Any] = {}
        if "way" in job:
            work, count = prepared(job)
            begun = time.perf_counter()
            np.savez(job["answers"], allow_pickle=False, **answers(work()))
            # what was compiled on the way does not count
            spent = time.perf_counter() - begun
            calls = max(1, int(LEAST_S / max(timed(work, 1, 1)["wall_s"], 1e-6))) if spent < LONG_S else 1
        else:
            reply = timed(work, count, calls)
        print(json.dumps(reply), file=replies, flush=True)


if __name__ == "__main__":
    main()
