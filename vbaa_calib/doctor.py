"""Health of the installation: Python and its packages, folders, disk, memory, terminal, drawing, cameras and torch.

Checks that may crash (drawing, cameras, torch) run in a process of their own.
"""

from __future__ import annotations

import contextlib
import glob
import importlib
import importlib.metadata as metadata
import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from vbaa_calib.core.errors import Diagnosis, Severity
from vbaa_calib.core.threads import cores


@dataclass(frozen=True, eq=False)
class HealthFinding:
    """The result of one check: what was seen, in words and as numbers for JSON, and the problems, if any."""

    name: str
    words: str
    problems: tuple[Diagnosis, ...] = ()
    numbers: dict[str, Any] = field(default_factory=dict)

    @property
    def status(self) -> Literal["ok", "look", "fails"]:
        return "fails" if any(problem.grave for problem in self.problems) else "look" if self.problems else "ok"

    def to_dict(self) -> dict[str, Any]:
        problems = [problem.to_dict() for problem in self.problems]
        head = {"name": self.name, "status": self.status, "words": self.words}
        return head | {"problems": problems, "numbers": self.numbers}


def _by_system(debian: str, macos: str, windows: str) -> str:
    """The remedy for this operating system; every Linux gets Debian's."""
    return {"darwin": macos, "win32": windows}.get(sys.platform, debian)


def _pip(*words: str) -> str:
    """A pip command for this Python (plain `pip` may belong to another)."""
    return " ".join([sys.executable, "-m", "pip", *words])


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


_Ended = tuple[int | None, str, str]
"""How a process ended: its exit code (None when it took too long, negative when a signal ended it), output, errors."""
_Try = Callable[[Sequence[str], float], _Ended]


def _how(code: int | None, err: str, late: str, failed: str) -> str:
    """How a process ended in words, with the last thing that it complained of."""
    lines = err.strip().splitlines()
    return late if code is None else f"{failed} ({lines[-1].strip() if lines else 'it said nothing'})"


def _try_python(arguments: Sequence[str], seconds: float) -> _Ended:
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
        return None, out if isinstance(out, str) else out.decode(errors="replace"), ""
    except OSError as error:
        return 127, "", str(error)
    return done.returncode, done.stdout, done.stderr


def _drawing(attempt: _Try = _try_python) -> HealthFinding:
    """Whether 3-D pictures can be drawn. Pages and glTF need no OpenGL, so a failure here alone stops nothing."""
    code, _, err = attempt(["-m", "viz.render.probe"], _LIMITS.drawing_s)
    if code == 0:
        return HealthFinding("drawing", "3-D pictures can be drawn")
    how = _how(code, err, f"took longer than {_LIMITS.drawing_s:.0f} s", "failed")
    if code is not None and (code < 0 or not err.strip()):
        how = f"was ended by signal {-code}" if code < 0 else "found no OpenGL that works"
    remedy = _by_system(
        "apt-get install libegl1 libgl1-mesa-dri",
        "log in at the screen: macOS draws for a logged-in user only",
        "update the graphics driver, or put Mesa's opengl32.dll beside python.exe",
    )
    if "No module named" in err:
        how, remedy = "needs pyvista, which is not installed", _pip("install", "'vbaa-calib[view]'")
        return HealthFinding("drawing", "no 3-D pictures", (Diagnosis("no_drawing", f"drawing {how}", remedy),))
    problem = Diagnosis("no_drawing", f"drawing a 3-D picture {how}", f"{remedy}; pages and glTF work without")
    return HealthFinding("drawing", "3-D pictures cannot be drawn", (problem,), {"exit_code": code})


def _cameras(
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
        code, out, err = attempt(["-c", program, *indices], _LIMITS.camera_s)
        opened = dict(json.loads(line) for line in out.splitlines() if line.startswith("["))
        if code != 0:
            how = _how(code, err, "does not answer", "ends the program that opens it")
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


def _torch(attempt: _Try = _try_python) -> HealthFinding:
    """Whether torch loads, and how long that takes; `vbaa check` and calls with tensors wait for it."""
    program = (
        "import time; begun = time.perf_counter(); import torch; "
        "print(time.perf_counter() - begun, torch.__version__, torch.get_num_threads(), torch.cuda.is_available())"
    )
    code, out, err = attempt(["-c", program], _LIMITS.torch_s)
    fields = out.split()
    if code != 0 or len(fields) != 4:
        how = _how(code, err, f"takes longer than {_LIMITS.torch_s:.0f} s to load", "cannot be loaded")
        again = _pip("install", "--force-reinstall", '"torch>=2.4,<3"')
        remedy = _by_system(again, again, f"winget install Microsoft.VCRedist.2015+.x64, then {again}")
        return HealthFinding("torch", "does not load", (Diagnosis("torch_broken", f"torch {how}", remedy, "wrong"),))
    seconds = float(fields[0])
    words = f"{fields[1]} loads in {seconds:.1f} s, {fields[2]} threads, {'with' if fields[3] == 'True' else 'no'} CUDA"
    problems: tuple[Diagnosis, ...] = ()
    if seconds > _LIMITS.slow_torch_s:
        slow = f"torch takes {seconds:.0f} s to load, and `vbaa check` waits for it"
        remedy = "put the environment on a local disk; have the virus scanner leave it out; try again when warm"
        problems = (Diagnosis("torch_slow", slow, remedy),)
    return HealthFinding("torch", words, problems, {"seconds": round(seconds, 3), "version": fields[1]})


def _writable(folders: Mapping[str, Path | None] | None = None) -> HealthFinding:
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


def _disk(free_bytes: int | None = None) -> HealthFinding:
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


def _computing(
    memory: Callable[[], int | None] = _available_memory, environ: Mapping[str, str] = os.environ
) -> HealthFinding:
    free, threads = memory(), environ.get("OMP_NUM_THREADS")
    count = cores()
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


def _terminal(streams: Mapping[str, Any] | None = None) -> HealthFinding:
    """Whether ×, ° and ≤ can be printed, and file names with them."""
    streams = {"stdout": sys.stdout, "stderr": sys.stderr} if streams is None else streams
    encodings = {name: getattr(stream, "encoding", None) or "none" for name, stream in streams.items()}
    encodings["file names"] = sys.getfilesystemencoding()
    problems = []
    for name, encoding in encodings.items():
        try:
            "× ° ≤ ± α".encode(encoding)
        except (LookupError, UnicodeEncodeError):
            remedy = _by_system("export LANG=C.UTF-8", "export LANG=en_US.UTF-8", "set PYTHONUTF8=1")
            words = f"{name} is in {encoding}, which has no × ° ≤"
            problems.append(Diagnosis("not_utf8", words, f"{remedy}, or set PYTHONUTF8=1"))
    words = ", ".join(f"{name} {encoding}" for name, encoding in encodings.items())
    return HealthFinding("terminal", words, tuple(problems), encodings)


_DISTRIBUTION = "vbaa-calib"
_ROOT = Path(__file__).parents[1]
"""The folder that holds our packages: a source tree, or site-packages."""


def _python_version(version: tuple[int, ...] = tuple(sys.version_info[:3])) -> HealthFinding:
    """Whether this Python is new enough, and where it lives."""
    least = (3, 11)
    words, wanted = f"{'.'.join(map(str, version))}, {sys.executable}", ".".join(map(str, least))
    packages = f"apt-get install python{wanted} python{wanted}-venv", f"brew install python@{wanted}"
    remedy = _by_system(*packages, f"winget install Python.Python.{wanted}") + ", then make a new environment with it"
    problem = Diagnosis("python_too_old", f"this is Python {words}, and {wanted} is needed", remedy, "wrong")
    found = () if version[:2] >= least else (problem,)
    return HealthFinding("python", words, found, {"version": list(version)})


def _packages(
    requirements: Iterable[str] | None = None, version_of: Callable[[str], str] = metadata.version
) -> HealthFinding:
    """Checks that every required package is installed in a version that fits."""
    from packaging.requirements import Requirement

    problems, versions, known = list[Diagnosis](), dict[str, str](), None
    if requirements is None:
        # of the source tree, where there is one, else of the installation
        asked, known = list[str](), list[str]()
        with contextlib.suppress(OSError, ValueError, KeyError):
            project = tomllib.loads((_ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
            asked = list(project["dependencies"]) if project["name"] == _DISTRIBUTION else []
        try:
            known = [line for line in metadata.requires(_DISTRIBUTION) or [] if "extra ==" not in line]
        except metadata.PackageNotFoundError:
            if not asked:
                problem = Diagnosis(
                    "not_installed", f"{_DISTRIBUTION} is not installed", _pip("install", _DISTRIBUTION), "wrong"
                )
                return HealthFinding("packages", "unknown", (problem,))
        requirements = asked or known
    wanted = [Requirement(line) for line in requirements]
    for one in wanted:
        remedy = _pip("install", f'"{one.name}{one.specifier}"')
        try:
            versions[one.name] = version = version_of(one.name)
        except metadata.PackageNotFoundError:
            problems.append(Diagnosis("package_missing", f"{one.name} is not installed", remedy, "wrong"))
            continue
        if not one.specifier.contains(version, prereleases=True):
            words = f"{one.name} is {version}, and {one.specifier} is needed"
            problems.append(Diagnosis("package_version", words, remedy, "wrong"))
    if known is not None and {str(one) for one in wanted} != {str(Requirement(line)) for line in known}:
        words = "the source tree asks for other packages than the installation knows of"
        problems.append(Diagnosis("installation_stale", words, _pip("install", "--editable", str(_ROOT))))
    words = f"{len(versions)} of {len(wanted)} there: " + ", ".join(f"{n} {v}" for n, v in versions.items())
    return HealthFinding("packages", words, tuple(problems), {"versions": versions})


def _shadows(
    folder: Path | None = None, owners: Callable[[], Mapping[str, list[str]]] = metadata.packages_distributions
) -> HealthFinding:
    """Where packages are taken from now, what the current folder would put in their place, and the owner of our files.

    owners : package → the distributions that bring it.
    """
    # Name that is imported → distribution that it comes from.
    libraries = {"cv2": "opencv-contrib-python-headless", "yaml": "PyYAML"} | {
        name: name
        for name in ("numpy", "scipy", "torch", "kornia", "pyvista", "matplotlib", "reportlab", "pydantic", "rich")
    }
    ours = ("vbaa", "vbaa_calib", "targets", "estimator", "viz")
    homes: dict[str, Path | None] = {**dict.fromkeys(ours, _ROOT), **dict.fromkeys(libraries)}
    for name, distribution in libraries.items():
        with contextlib.suppress(metadata.PackageNotFoundError):
            homes[name] = Path(str(metadata.distribution(distribution).locate_file("")))
    folder, problems, places = (folder or Path.cwd()).resolve(), [], dict[str, str]()

    def stands_in(name: str, words: str, place: Path, severity: Severity) -> Diagnosis:
        remedy = f"rename {place}, or work in another folder and leave it out of PYTHONPATH"
        return Diagnosis(name, words, remedy, severity)

    for name, expected in homes.items():
        # the folder or file that an import would take; none for an empty namespace
        try:
            spec = importlib.util.find_spec(name)
        except (ImportError, ValueError):
            spec = None
        if spec is not None and spec.origin is not None:
            place = Path(spec.origin)
            place = place.parent if place.stem == "__init__" else place
            places[name] = str(place)
            if expected is not None and place.resolve().parent != expected.resolve():
                words = f"{name} is taken from {place}, not from {expected}"
                problems.append(stands_in("package_shadowed", words, place, "wrong"))
        elif name in ours:  # a missing library is reported with the packages
            words = f"the package {name} is not found beside vbaa_calib, in {_ROOT}"
            problems.append(Diagnosis("package_hidden", words, "install vbaa-calib again", "wrong"))
    for name, expected in homes.items():
        if expected is None or folder != expected.resolve():
            for place in (folder / name, folder / f"{name}.py"):
                module = place / "__init__.py" if place.suffix != ".py" else place
                if module.is_file() and places.get(name) != str(place):
                    words = f"{place} takes the place of the package {name} for every script that is run from there"
                    problems.append(stands_in("name_taken", words, place, "doubt"))
    brought = owners()
    for name in ours:
        for other in sorted(set(brought.get(name, ())) - {_DISTRIBUTION}):
            again = _pip("uninstall", "--yes", other) + ", then "
            again += _pip("install", "--force-reinstall", "--no-deps", _DISTRIBUTION)
            words = f"{other} has installed a package {name}, too: one has overwritten the other's files"
            problems.append(Diagnosis("package_overwritten", words, again, "wrong"))
    words = f"{len(places)} packages come from where they were installed"
    if problems:
        words = "some packages do not come, or may not come, from where they were installed"
    return HealthFinding("shadows", words, tuple(problems), {"places": places})


def _opencv(
    installed: Mapping[str, str] | None = None, load: Callable[[], Any] = lambda: importlib.import_module("cv2")
) -> HealthFinding:
    """Checks OpenCV: several wheels overwrite each other's files, OpenCV 5 lacks functions, some wheels need libGL."""
    if installed is None:
        known = {re.sub(r"[-_.]+", "-", each.metadata["Name"] or "").lower(): each for each in metadata.distributions()}
        wheels = frozenset(
            f"opencv{contrib}-python{headless}" for contrib in ("", "-contrib") for headless in ("", "-headless")
        )
        installed = {name: each.version for name, each in known.items() if name in wheels}
    named = ", ".join(f"{name} {version}" for name, version in sorted(installed.items())) or "no wheel of OpenCV"
    again = f'{_pip("install", "--force-reinstall", "--no-deps")} "opencv-contrib-python-headless>=4.14,<5"'
    problems = []
    if len(installed) > 1:
        remedy = f"{_pip('uninstall', '--yes', *sorted(installed))}, then {again}"
        words = f"{named} are installed at once and overwrite each other's cv2"
        problems.append(Diagnosis("several_opencv", words, remedy, "wrong"))
    try:
        cv2 = load()
        version, objects = cv2.__version__, hasattr(cv2, "aruco") and hasattr(cv2.aruco, "CharucoDetector")
    except Exception as error:  # a broken binary raises what it likes
        text, remedy = " ".join(str(error).split()), again
        if re.search(r"(lib[\w+-]+\.so[.\d]*)", text):
            remedy = _by_system(f"apt-get install libgl1 libglib2.0-0, or without windows: {again}", again, again)
        elif "DLL" in text:
            remedy = f"winget install Microsoft.VCRedist.2015+.x64, then {again}"
        problems.append(Diagnosis("opencv_broken", f"cv2 cannot be loaded ({text})", remedy, "wrong"))
        return HealthFinding("opencv", named, tuple(problems), {"wheels": dict(installed)})
    other = len(installed) == 1 and not next(iter(installed.values())).startswith(version)
    rules = (
        (version.split(".")[0] != "4", "opencv_major", "is loaded, which lacks functions that are needed"),
        (not objects, "opencv_without_charuco", "has no ChArUco detector: not a contrib wheel, or one overwritten"),
        (other, "opencv_other", f"is loaded, but {named} is installed"),
    )
    wrong = [Diagnosis(name, f"OpenCV {version} {words}", again, "wrong") for holds, name, words in rules if holds]
    problems += wrong[:1]
    gui = re.search(r"^\s*GUI:\s*(\S+)", cv2.getBuildInformation(), re.MULTILINE)
    window = gui[1] if gui and gui[1] != "NONE" else None
    words = f"{version} of {named}, {f'windows by {window}' if window else 'headless'}"
    return HealthFinding(
        "opencv", words, tuple(problems), {"version": version, "wheels": dict(installed), "window": window}
    )


CHECKS: dict[str, Callable[[], HealthFinding]] = {
    "python": _python_version,
    "packages": _packages,
    "shadows": _shadows,
    "opencv": _opencv,
    "torch": _torch,
    "drawing": _drawing,
    "cameras": _cameras,
    "folders": _writable,
    "disk": _disk,
    "computing": _computing,
    "terminal": _terminal,
}
"""Every check of `vbaa doctor`, in the order of its table."""
