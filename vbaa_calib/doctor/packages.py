"""Python, the packages that pyproject.toml asks for, OpenCV above all, and whether any comes from elsewhere."""

from __future__ import annotations

import contextlib
import importlib
import importlib.metadata as metadata
import importlib.util
import re
import sys
import tomllib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from vbaa_calib.core.errors import Diagnosis, Severity

from . import HealthFinding, by_system, pip

_DISTRIBUTION = "vbaa-calib"
_ROOT = Path(__file__).parents[2]
"""The folder that holds our packages: a source tree, or site-packages."""


def python_version(version: tuple[int, ...] = tuple(sys.version_info[:3])) -> HealthFinding:
    """Whether this Python is new enough, and where it lives."""
    least = (3, 11)
    words, wanted = f"{'.'.join(map(str, version))}, {sys.executable}", ".".join(map(str, least))
    packages = f"apt-get install python{wanted} python{wanted}-venv", f"brew install python@{wanted}"
    remedy = by_system(*packages, f"winget install Python.Python.{wanted}") + ", then make a new environment with it"
    problem = Diagnosis("python_too_old", f"this is Python {words}, and {wanted} is needed", remedy, "wrong")
    found = () if version[:2] >= least else (problem,)
    return HealthFinding("python", words, found, {"version": list(version)})


def packages(
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
                    "not_installed",
                    f"{_DISTRIBUTION} is not installed",
                    pip("install", _DISTRIBUTION),
                    "wrong",
                )
                return HealthFinding("packages", "unknown", (problem,))
        requirements = asked or known
    wanted = [Requirement(line) for line in requirements]
    for one in wanted:
        remedy = pip("install", f'"{one.name}{one.specifier}"')
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
        problems.append(Diagnosis("installation_stale", words, pip("install", "--editable", str(_ROOT))))
    words = f"{len(versions)} of {len(wanted)} there: " + ", ".join(f"{n} {v}" for n, v in versions.items())
    return HealthFinding("packages", words, tuple(problems), {"versions": versions})


def shadows(
    folder: Path | None = None,
    owners: Callable[[], Mapping[str, list[str]]] = metadata.packages_distributions,
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
            again = pip("uninstall", "--yes", other) + ", then "
            again += pip("install", "--force-reinstall", "--no-deps", _DISTRIBUTION)
            words = f"{other} has installed a package {name}, too: one has overwritten the other's files"
            problems.append(Diagnosis("package_overwritten", words, again, "wrong"))
    words = f"{len(places)} packages come from where they were installed"
    if problems:
        words = "some packages do not come, or may not come, from where they were installed"
    return HealthFinding("shadows", words, tuple(problems), {"places": places})


def opencv(
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
    again = f'{pip("install", "--force-reinstall", "--no-deps")} "opencv-contrib-python-headless>=4.14,<5"'
    problems = []
    if len(installed) > 1:
        remedy = f"{pip('uninstall', '--yes', *sorted(installed))}, then {again}"
        words = f"{named} are installed at once and overwrite each other's cv2"
        problems.append(Diagnosis("several_opencv", words, remedy, "wrong"))
    try:
        cv2 = load()
        version, objects = cv2.__version__, hasattr(cv2, "aruco") and hasattr(cv2.aruco, "CharucoDetector")
    except Exception as error:  # a broken binary raises what it likes
        text, remedy = " ".join(str(error).split()), again
        if re.search(r"(lib[\w+-]+\.so[.\d]*)", text):
            remedy = by_system(f"apt-get install libgl1 libglib2.0-0, or without windows: {again}", again, again)
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
