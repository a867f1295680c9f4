"""What is tried in a process of its own, since it may end the one that tries it: drawing, cameras, torch."""

from __future__ import annotations

import glob
import json
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from vbaa_calib.core.errors import Diagnosis

from .finding import Finding, by_system, pip

DRAWING_SECONDS, CAMERA_SECONDS, TORCH_SECONDS = 90.0, 30.0, 120.0
_SLOW_TORCH_SECONDS = 20.0
_OPEN = (
    "import json, sys, cv2\n"
    "for index in map(int, sys.argv[1:]):\n"
    "    camera = cv2.VideoCapture(index)\n"
    "    taken, image = camera.read() if camera.isOpened() else (False, None)\n"
    "    print(json.dumps([index, list(image.shape[1::-1]) if taken else None]), flush=True)\n"
    "    camera.release()\n"
)
_TORCH = (
    "import time; begun = time.perf_counter(); import torch; "
    "print(time.perf_counter() - begun, torch.__version__, torch.get_num_threads(), torch.cuda.is_available())"
)


@dataclass(frozen=True)
class Tried:
    """How a process ended: its exit code, None when it took too long; negative when a signal ended it."""

    code: int | None
    out: str = ""
    err: str = ""

    @property
    def last_line(self) -> str:
        """The last thing that it complained of."""
        lines = self.err.strip().splitlines()
        return lines[-1].strip() if lines else "it said nothing"


_Try = Callable[[Sequence[str], float], Tried]


def try_python(arguments: Sequence[str], seconds: float) -> Tried:
    """Run this Python with these arguments; -P keeps the current folder's own modules out of it."""
    try:
        done = subprocess.run(
            [sys.executable, "-P", *arguments],
            capture_output=True,
            timeout=seconds,
            check=False,
            stdin=subprocess.DEVNULL,
            text=True,
            errors="replace",
        )
    except subprocess.TimeoutExpired as late:
        out = late.stdout or b""
        return Tried(None, out if isinstance(out, str) else out.decode(errors="replace"))
    except OSError as error:
        return Tried(127, err=str(error))
    return Tried(done.returncode, done.stdout, done.stderr)


def drawing(attempt: _Try = try_python) -> Finding:
    """Whether 3-D pictures can be drawn. Pages and glTF need no OpenGL, so this alone stops nothing."""
    tried = attempt(["-m", "viz.render.probe"], DRAWING_SECONDS)
    if tried.code == 0:
        return Finding("drawing", "3-D pictures can be drawn")
    if tried.code is None:
        how = f"took longer than {DRAWING_SECONDS:.0f} s"
    elif tried.code < 0:
        how = f"was ended by signal {-tried.code}"
    else:
        how = f"failed ({tried.last_line})" if tried.err.strip() else "found no OpenGL that works"
    remedy = by_system(
        "apt-get install libegl1 libgl1-mesa-dri",
        "log in at the screen: macOS draws for a logged-in user only",
        "update the graphics driver, or put Mesa's opengl32.dll beside python.exe",
    )
    problem = Diagnosis("no_drawing", f"drawing a 3-D picture {how}", f"{remedy}; pages and glTF work without")
    return Finding("drawing", "3-D pictures cannot be drawn", (problem,), {"exit_code": tried.code})


def _video_devices() -> list[str]:
    """Linux' camera devices, in order."""
    return sorted(glob.glob("/dev/video*"), key=lambda path: (len(path), path))


def _readable(path: str) -> bool:
    return os.access(path, os.R_OK | os.W_OK)


def cameras(
    devices: Sequence[str] | None = None,
    readable: Callable[[str], bool] = _readable,
    attempt: _Try = try_python,
    system: str = sys.platform,
) -> Finding:
    """Cameras, and whether they give a picture. None is no fault: pictures come from files and streams too."""
    problems: list[Diagnosis] = []
    if system == "linux":
        devices = _video_devices() if devices is None else devices
        shut = [path for path in devices if not readable(path)]
        if shut:
            words = f"{', '.join(shut)} may not be opened by you"
            remedy = "sudo usermod -aG video $USER, then log in again (in a container: pass the device in)"
            problems.append(Diagnosis("camera_not_readable", words, remedy))
        indices = [path.removeprefix("/dev/video") for path in devices if path not in shut]
        indices = [index for index in indices if index.isdigit()]
    else:
        devices, indices = [], ["0", "1"]  # there is nothing to list: the first two are tried
    opened = {}
    if indices:
        tried = attempt(["-c", _OPEN, *indices], CAMERA_SECONDS)
        opened = dict(json.loads(line) for line in tried.out.splitlines() if line.startswith("["))
        if tried.code != 0:
            how = "does not answer" if tried.code is None else f"ends the program that opens it ({tried.last_line})"
            at = next((index for index in indices if int(index) not in opened), indices[-1])
            remedy = "unplug it and plug it in again; close programs that use it"
            problems.append(Diagnosis("camera_stuck", f"camera {at} {how}", remedy))
    giving = {index: size for index, size in opened.items() if size}
    if giving:
        words = ", ".join(f"camera {index} gives {size[0]} x {size[1]}" for index, size in giving.items())
    elif not devices:
        words = "no camera seen; folders, video files and streams work without"
    else:
        words = f"{len(devices)} devices, none gives a picture"
        if not problems:
            remedy = "close programs that use the camera (browser, meeting), or plug it in again"
            problems.append(Diagnosis("camera_silent", f"{', '.join(devices)}: no picture comes", remedy))
    return Finding("cameras", words, tuple(problems), {"devices": list(devices), "giving": giving})


def torch(attempt: _Try = try_python) -> Finding:
    """Whether torch loads, and how long that takes; every calibration waits for it."""
    tried = attempt(["-c", _TORCH], TORCH_SECONDS)
    fields = tried.out.split()
    if tried.code != 0 or len(fields) != 4:
        how = f"takes longer than {TORCH_SECONDS:.0f} s to load"
        if tried.code is not None:
            how = f"cannot be loaded ({tried.last_line})"
        remedy = by_system(
            pip("install", "--force-reinstall", '"torch>=2.4,<3"'),
            pip("install", "--force-reinstall", '"torch>=2.4,<3"'),
            "winget install Microsoft.VCRedist.2015+.x64, then "
            + pip("install", "--force-reinstall", '"torch>=2.4,<3"'),
        )
        return Finding("torch", "does not load", (Diagnosis("torch_broken", f"torch {how}", remedy, grave=True),))
    seconds = float(fields[0])
    words = f"{fields[1]} loads in {seconds:.1f} s, {fields[2]} threads, {'with' if fields[3] == 'True' else 'no'} CUDA"
    problems: tuple[Diagnosis, ...] = ()
    if seconds > _SLOW_TORCH_SECONDS:
        slow = f"torch takes {seconds:.0f} s to load, and every calibration waits for it"
        remedy = "put the environment on a local disk; have the virus scanner leave it out; try again when warm"
        problems = (Diagnosis("torch_slow", slow, remedy),)
    return Finding("torch", words, problems, {"seconds": round(seconds, 3), "version": fields[1]})
