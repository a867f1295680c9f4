"""The machine: folders, disk, memory, cores, and whether the terminal can show what is printed."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from vbaa_calib.core.errors import Diagnosis

from .finding import Finding, by_system

MB, GB = 1_000_000, 1_000_000_000
DISK_FULL, DISK_LOW = 200 * MB, 2 * GB
_MEMORY_LOW = 2 * GB


def the_folders() -> dict[str, Path | None]:
    """What is written to: where one stands, for what passes, and for what is kept. None: there is none."""
    cache = Path(os.environ.get("MPLCONFIGDIR") or os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser())
    while not cache.exists() and cache != cache.parent:
        cache = cache.parent  # it would be made there
    folders: dict[str, Path | None] = {"current": None, "temporary": None, "cache": cache}
    for name, find in (("current", Path.cwd), ("temporary", lambda: Path(tempfile.gettempdir()))):
        with contextlib.suppress(OSError):
            folders[name] = find()
    return folders


def _try_to_write(folder: Path) -> None:
    """Write a file there that vanishes again. Raises OSError. Permissions alone say too little."""
    with tempfile.TemporaryFile(dir=folder) as stream:
        stream.write(b"vbaa doctor")
        stream.flush()


def writable(
    folders: Mapping[str, Path | None] | None = None, write: Callable[[Path], None] = _try_to_write
) -> Finding:
    """Whether files can be written where one stands, to the temporary folder and to the cache."""
    folders = the_folders() if folders is None else folders
    problems = []
    for name, folder in folders.items():
        remedy = {
            "current": "change to a folder of your own, or give outputs there",
            "temporary": "set TMPDIR (on Windows TEMP) to a folder that you may write to",
        }.get(name, "set MPLCONFIGDIR to a folder that you may write to; else every start is slow")
        try:
            if folder is None:
                raise FileNotFoundError(2, "there is none")
            write(folder)
        except OSError as error:
            words = f"the {name} folder {folder or ''} cannot be written to ({error.strerror or error})"
            problems.append(Diagnosis("folder_not_writable", words, remedy, grave=name != "cache"))
    words = ", ".join(f"{name} {folder}" for name, folder in folders.items())
    return Finding("folders", words, tuple(problems))


def disk(folder: Path | None = None, free_bytes: int | None = None) -> Finding:
    """Free space where one stands."""
    if free_bytes is None:
        free_bytes = shutil.disk_usage(Path.cwd() if folder is None else folder).free
    words = f"{free_bytes / GB:.1f} GB free"
    problems: tuple[Diagnosis, ...] = ()
    if free_bytes < DISK_LOW:
        said = f"only {free_bytes / MB:.0f} MB are free on this disk, and a session with its pictures may need some GB"
        problems = (Diagnosis("disk_low", said, "make room, or work on another disk", grave=free_bytes < DISK_FULL),)
    return Finding("disk", words, problems, {"free_bytes": free_bytes})


def available_memory(meminfo: Path = Path("/proc/meminfo")) -> int | None:
    """Bytes that may still be used; None where the system does not say."""
    try:
        found = re.search(r"MemAvailable:\s*(\d+) kB", meminfo.read_text())
        if found:
            return 1024 * int(found[1])
    except OSError:
        pass
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):  # Windows has no sysconf
        return None


def cores() -> int:
    """Processor cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def computing(memory: Callable[[], int | None] = available_memory, environ: Mapping[str, str] = os.environ) -> Finding:
    """Cores, threads and memory."""
    free, threads, count = memory(), environ.get("OMP_NUM_THREADS"), cores()
    said = f"{free / GB:.1f} GB of memory" if free is not None else "memory unknown"
    words = f"{count} cores, {said}, OMP_NUM_THREADS {threads or 'not set'}"
    problems = []
    if free is not None and free < _MEMORY_LOW:
        low = f"only {free / GB:.1f} GB of memory are free"
        problems.append(Diagnosis("memory_low", low, "close other programs; large pictures and torch need about 2 GB"))
    if threads is not None and (not threads.isdigit() or int(threads) < 1):
        wrong = f"OMP_NUM_THREADS is {threads!r}, which is no number of threads"
        problems.append(Diagnosis("threads_wrong", wrong, f"set it to a number from 1 to {count}, or unset it"))
    elif threads is not None and int(threads) > count:
        many = f"OMP_NUM_THREADS is {threads}, and there are {count} cores: threads wait for each other"
        problems.append(Diagnosis("threads_many", many, f"set it to {count}, or unset it"))
    return Finding("computing", words, tuple(problems), {"cores": count, "memory_bytes": free})


def terminal(streams: Mapping[str, Any] | None = None) -> Finding:
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
    return Finding("terminal", words, tuple(problems), encodings)
