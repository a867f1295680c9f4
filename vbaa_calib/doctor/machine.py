"""The machine: folders, disk, memory, terminal; and drawing, cameras and torch, tried in processes of their own."""

from __future__ import annotations

import contextlib
import glob
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vbaa_calib.core.errors import Diagnosis, Severity

from . import HealthFinding, by_system, pip


@dataclass(frozen=True)
class _MachineSettings:
    """How long the checks may take, and how much room a session needs."""

    drawing_s: float = 90.0  # to draw a ball without a screen
    camera_s: float = 30.0  # to take a picture with each camera
    torch_s: float = 120.0  # to load torch
    slow_torch_s: float = 20.0  # from which loading torch counts as slow
    full_disk_bytes: int = 200_000_000  # free bytes below which nothing is worth starting
    low_disk_bytes: int = 2_000_000_000  # free bytes below which a session may not fit
    low_memory_bytes: int = 2_000_000_000  # free bytes of memory below which a calibration may fail


_LIMITS = _MachineSettings()


@dataclass(frozen=True)
class _EndedProcess:
    """How a process ended: its exit code, None when it took too long; negative when a signal ended it."""

    code: int | None
    out: str = ""
    err: str = ""

    def how(self, late: str, failed: str) -> str:
        """In words, with the last thing that it complained of."""
        lines = self.err.strip().splitlines()
        return late if self.code is None else f"{failed} ({lines[-1].strip() if lines else 'it said nothing'})"


_Try = Callable[[Sequence[str], float], _EndedProcess]


def _try_python(arguments: Sequence[str], seconds: float) -> _EndedProcess:
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
        return _EndedProcess(None, out if isinstance(out, str) else out.decode(errors="replace"))
    except OSError as error:
        return _EndedProcess(127, err=str(error))
    return _EndedProcess(done.returncode, done.stdout, done.stderr)


def drawing(attempt: _Try = _try_python) -> HealthFinding:
    """Whether 3-D pictures can be drawn. Pages and glTF need no OpenGL, so this alone stops nothing."""
    tried = attempt(["-m", "viz.render.probe"], _LIMITS.drawing_s)
    if tried.code == 0:
        return HealthFinding("drawing", "3-D pictures can be drawn")
    how = tried.how(f"took longer than {_LIMITS.drawing_s:.0f} s", "failed")
    if tried.code is not None and (tried.code < 0 or not tried.err.strip()):
        how = f"was ended by signal {-tried.code}" if tried.code < 0 else "found no OpenGL that works"
    remedy = by_system(
        "apt-get install libegl1 libgl1-mesa-dri",
        "log in at the screen: macOS draws for a logged-in user only",
        "update the graphics driver, or put Mesa's opengl32.dll beside python.exe",
    )
    if "No module named" in tried.err:
        how, remedy = "needs pyvista, which is not installed", pip("install", "'vbaa-calib[view]'")
        return HealthFinding("drawing", "no 3-D pictures", (Diagnosis("no_drawing", f"drawing {how}", remedy),))
    problem = Diagnosis("no_drawing", f"drawing a 3-D picture {how}", f"{remedy}; pages and glTF work without")
    return HealthFinding("drawing", "3-D pictures cannot be drawn", (problem,), {"exit_code": tried.code})


def cameras(
    devices: Sequence[str] | None = None,
    readable: Callable[[str], bool] = lambda path: os.access(path, os.R_OK | os.W_OK),
    attempt: _Try = _try_python,
    system: str = sys.platform,
) -> HealthFinding:
    """Cameras, and whether they give a picture. None is no fault: pictures come from files and streams too."""
    problems: list[Diagnosis] = []
    if system == "linux":
        there = glob.glob("/dev/video*") if devices is None else devices
        devices = sorted(there, key=lambda path: (len(path), path))
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
        program = (
            "import json, sys, cv2\n"
            "for index in map(int, sys.argv[1:]):\n"
            "    camera = cv2.VideoCapture(index)\n"
            "    taken, image = camera.read() if camera.isOpened() else (False, None)\n"
            "    print(json.dumps([index, list(image.shape[1::-1]) if taken else None]), flush=True)\n"
            "    camera.release()\n"
        )
        tried = attempt(["-c", program, *indices], _LIMITS.camera_s)
        opened = dict(json.loads(line) for line in tried.out.splitlines() if line.startswith("["))
        if tried.code != 0:
            how = tried.how("does not answer", "ends the program that opens it")
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
    return HealthFinding("cameras", words, tuple(problems), {"devices": list(devices), "giving": giving})


def torch(attempt: _Try = _try_python) -> HealthFinding:
    """Whether torch loads, and how long that takes; `vbaa check` and calls with tensors wait for it."""
    program = (
        "import time; begun = time.perf_counter(); import torch; "
        "print(time.perf_counter() - begun, torch.__version__, torch.get_num_threads(), torch.cuda.is_available())"
    )
    tried = attempt(["-c", program], _LIMITS.torch_s)
    fields = tried.out.split()
    if tried.code != 0 or len(fields) != 4:
        how = tried.how(f"takes longer than {_LIMITS.torch_s:.0f} s to load", "cannot be loaded")
        again = pip("install", "--force-reinstall", '"torch>=2.4,<3"')
        remedy = by_system(again, again, f"winget install Microsoft.VCRedist.2015+.x64, then {again}")
        return HealthFinding("torch", "does not load", (Diagnosis("torch_broken", f"torch {how}", remedy, "wrong"),))
    seconds = float(fields[0])
    words = f"{fields[1]} loads in {seconds:.1f} s, {fields[2]} threads, {'with' if fields[3] == 'True' else 'no'} CUDA"
    problems: tuple[Diagnosis, ...] = ()
    if seconds > _LIMITS.slow_torch_s:
        slow = f"torch takes {seconds:.0f} s to load, and `vbaa check` waits for it"
        remedy = "put the environment on a local disk; have the virus scanner leave it out; try again when warm"
        problems = (Diagnosis("torch_slow", slow, remedy),)
    return HealthFinding("torch", words, problems, {"seconds": round(seconds, 3), "version": fields[1]})


def writable(folders: Mapping[str, Path | None] | None = None) -> HealthFinding:
    """Whether the current folder, the temporary folder and the cache are writable. None: there is none."""
    if folders is None:
        caches = os.environ.get("MPLCONFIGDIR") or os.environ.get("XDG_CACHE_HOME")
        cache = Path(caches) if caches else Path("~/.cache").expanduser()
        while not cache.exists() and cache != cache.parent:
            cache = cache.parent  # it would be made there
        folders = found = {"current": None, "temporary": None, "cache": cache}
        for name, find in (("current", Path.cwd), ("temporary", lambda: Path(tempfile.gettempdir()))):
            with contextlib.suppress(OSError):
                found[name] = find()
    problems = []
    for name, folder in folders.items():
        try:
            if folder is None:
                raise FileNotFoundError(2, "there is none")
            with tempfile.TemporaryFile(dir=folder) as stream:  # permissions alone say too little
                stream.write(b"vbaa doctor")
                stream.flush()
        except OSError as error:
            words = f"the {name} folder {folder or ''} cannot be written to ({error.strerror or error})"
            problems.append(
                Diagnosis(
                    "folder_not_writable",
                    words,
                    {
                        "current": "change to a folder of your own, or give outputs there",
                        "temporary": "set TMPDIR (on Windows TEMP) to a folder that you may write to",
                        "cache": "set MPLCONFIGDIR to a folder that you may write to; else every start is slow",
                    }[name],
                    "doubt" if name == "cache" else "wrong",
                )
            )
    words = ", ".join(f"{name} {folder}" for name, folder in folders.items())
    return HealthFinding("folders", words, tuple(problems))


def disk(free_bytes: int | None = None) -> HealthFinding:
    if free_bytes is None:
        free_bytes = shutil.disk_usage(Path.cwd()).free
    words_now = (
        f"only {free_bytes / 1_000_000:.0f} MB are free on this disk, and a session with its pictures may need some GB"
    )
    severity: Severity = "wrong" if free_bytes < _LIMITS.full_disk_bytes else "doubt"
    low = Diagnosis("disk_low", words_now, "make room, or work on another disk", severity)
    problems = (low,) if free_bytes < _LIMITS.low_disk_bytes else ()
    return HealthFinding("disk", f"{free_bytes / 1_000_000_000:.1f} GB free", problems, {"free_bytes": free_bytes})


def _available_memory() -> int | None:
    """Bytes that are free; None where the system does not say."""
    with contextlib.suppress(OSError):
        found = re.search(r"MemAvailable:\s*(\d+) kB", Path("/proc/meminfo").read_text())
        if found:
            return 1024 * int(found[1])
    with contextlib.suppress(AttributeError, ValueError, OSError):  # Windows has no sysconf
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return None


def computing(
    memory: Callable[[], int | None] = _available_memory, environ: Mapping[str, str] = os.environ
) -> HealthFinding:
    free, threads = memory(), environ.get("OMP_NUM_THREADS")
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    words_now = f"{free / 1_000_000_000:.1f} GB of memory" if free is not None else "memory unknown"
    seen = f"{count} cores, {words_now}, OMP_NUM_THREADS {threads or 'not set'}"
    low = "close other programs; large pictures and torch need about 2 GB"
    wrong = threads is not None and (not threads.isdigit() or int(threads) < 1)
    many = threads is not None and not wrong and int(threads) > count
    setting = f"OMP_NUM_THREADS is {threads!r}, "
    waits = f"{setting}and there are {count} cores: threads wait for each other"
    rules = (
        (free is not None and free < _LIMITS.low_memory_bytes, "memory_low", f"only {words_now} are free", low),
        (wrong, "threads_wrong", f"{setting}which is no number of threads", f"set it to a number from 1 to {count}"),
        (many, "threads_many", waits, f"set it to {count}, or unset it"),
    )
    problems = tuple(Diagnosis(name, words, remedy) for holds, name, words, remedy in rules if holds)
    return HealthFinding("computing", seen, problems, {"cores": count, "memory_bytes": free})


def terminal(streams: Mapping[str, Any] | None = None) -> HealthFinding:
    """Whether ×, ° and ≤ can be printed, and file names with them."""
    streams = {"stdout": sys.stdout, "stderr": sys.stderr} if streams is None else streams
    encodings = {name: getattr(stream, "encoding", None) or "none" for name, stream in streams.items()}
    encodings["file names"] = sys.getfilesystemencoding()
    problems = []
    for name, encoding in encodings.items():
        try:
            "× ° ≤ ± α".encode(encoding)
        except (LookupError, UnicodeEncodeError):
            remedy = by_system("export LANG=C.UTF-8", "export LANG=en_US.UTF-8", "set PYTHONUTF8=1")
            words = f"{name} is in {encoding}, which has no × ° ≤"
            problems.append(Diagnosis("not_utf8", words, f"{remedy}, or set PYTHONUTF8=1"))
    words = ", ".join(f"{name} {encoding}" for name, encoding in encodings.items())
    return HealthFinding("terminal", words, tuple(problems), encodings)
