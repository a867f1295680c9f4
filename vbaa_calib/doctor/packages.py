"""Python, the packages that pyproject.toml asks for, and whether any comes from where it should not."""

from __future__ import annotations

import contextlib
import importlib.metadata as metadata
import importlib.util
import re
import sys
import tomllib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from vbaa_calib.core.errors import Diagnosis

from .finding import Finding, by_system, pip

_DISTRIBUTION = "vbaa-calib"
_LEAST_PYTHON = (3, 11)
ROOT = Path(__file__).parents[2]
"""The folder that holds our packages: a source tree, or site-packages."""

_Version = Callable[[str], str]


def python_version(version: tuple[int, ...] = tuple(sys.version_info[:3])) -> Finding:
    """Whether this Python is new enough, and where it lives."""
    words, wanted = f"{'.'.join(map(str, version))}, {sys.executable}", ".".join(map(str, _LEAST_PYTHON))
    packages = f"apt-get install python{wanted} python{wanted}-venv", f"brew install python@{wanted}"
    remedy = by_system(*packages, f"winget install Python.Python.{wanted}") + ", then make a new environment with it"
    problem = Diagnosis("python_too_old", f"this is Python {words}, and {wanted} is needed", remedy, grave=True)
    found = () if version[:2] >= _LEAST_PYTHON else (problem,)
    return Finding("python", words, found, {"version": list(version)})


def declared(root: Path = ROOT) -> tuple[list[str], bool]:
    """What is asked for, and whether the installation knows less than the source tree it comes from.

    Raises PackageNotFoundError where there is neither a source tree nor an installation.
    """
    asked: list[str] | None = None
    with contextlib.suppress(OSError, ValueError, KeyError):
        project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        asked = list(project["dependencies"]) if project["name"] == _DISTRIBUTION else None
    try:
        installed = [line for line in metadata.requires(_DISTRIBUTION) or [] if "extra ==" not in line]
    except metadata.PackageNotFoundError:
        if asked is None:
            raise
        return asked, True
    if asked is None:
        return installed, False
    return asked, {_plain(line) for line in asked} != {_plain(line) for line in installed}


def _plain(requirement: str) -> tuple[str, frozenset[str]]:
    name, ranges = _split(requirement)
    return name, frozenset(ranges.replace(" ", "").split(","))


def _split(requirement: str) -> tuple[str, str]:
    found = re.match(r"\s*([A-Za-z0-9._-]+)\s*([^;]*)", requirement)
    assert found is not None
    return re.sub(r"[-_.]+", "-", found[1]).lower(), found[2].strip()


def packages(requirements: Iterable[str] | None = None, version_of: _Version = metadata.version) -> Finding:
    """Every package that is asked for: there, and of a version that fits."""
    stale = False
    if requirements is None:
        try:
            requirements, stale = declared()
        except metadata.PackageNotFoundError:
            words = f"{_DISTRIBUTION} is not installed"
            problem = Diagnosis("not_installed", words, pip("install", _DISTRIBUTION), grave=True)
            return Finding("packages", "unknown", (problem,))
    requirements = list(requirements)
    problems, versions = [], {}
    for requirement in requirements:
        name, ranges = _split(requirement)
        remedy = pip("install", f'"{name}{ranges}"')
        try:
            versions[name] = version_of(name)
        except metadata.PackageNotFoundError:
            problems.append(Diagnosis("package_missing", f"{name} is not installed", remedy, grave=True))
            continue
        if ranges and _fits(ranges, versions[name]) is False:
            words = f"{name} is {versions[name]}, and {ranges} is needed"
            problems.append(Diagnosis("package_version", words, remedy, grave=True))
    if importlib.util.find_spec("packaging") is None:
        words = "the packages' versions cannot be compared without the package packaging"
        problems.append(Diagnosis("versions_unknown", words, pip("install", "packaging")))
    if stale:
        words = "the source tree asks for other packages than the installation knows of"
        problems.append(Diagnosis("installation_stale", words, pip("install", "--editable", str(ROOT))))
    words = f"{len(versions)} of {len(requirements)} there: " + ", ".join(f"{n} {v}" for n, v in versions.items())
    return Finding("packages", words, tuple(problems), {"versions": versions})


def _fits(ranges: str, version: str) -> bool | None:
    """Whether a version is in its range; None where that cannot be told."""
    try:
        from packaging.specifiers import InvalidSpecifier, SpecifierSet
        from packaging.version import InvalidVersion
    except ImportError:
        return None
    try:
        return SpecifierSet(ranges).contains(version, prereleases=True)
    except (InvalidSpecifier, InvalidVersion):
        return None


_OURS = ("vbaa_calib", "targets", "estimator", "viz")
_LIBRARIES = {"cv2": "opencv-contrib-python-headless", "yaml": "PyYAML"} | {
    name: name
    for name in ("numpy", "scipy", "torch", "kornia", "pyvista", "matplotlib", "reportlab", "pydantic", "rich")
}
"""Name that is imported → distribution that it comes from."""


def origin(name: str) -> Path | None:
    """The folder or file that `import name` would take; None where there is none, or only an empty namespace."""
    try:
        spec = importlib.util.find_spec(name)
    except (ImportError, ValueError):
        return None
    if spec is None or spec.origin is None:
        return None
    path = Path(spec.origin)
    return path.parent if path.stem == "__init__" else path


def _home(distribution: str) -> Path | None:
    """The folder that a distribution was installed into."""
    try:
        return Path(str(metadata.distribution(distribution).locate_file("")))
    except metadata.PackageNotFoundError:
        return None


def shadows(folder: Path | None = None, root: Path = ROOT, origin_of: Callable[[str], Path | None] = origin) -> Finding:
    """Where packages are taken from now, and what the current folder would put in their place."""
    homes = dict.fromkeys(_OURS, root) | {name: _home(distribution) for name, distribution in _LIBRARIES.items()}
    problems, places = [], {}
    for name, expected in homes.items():
        place = origin_of(name)
        if place is None:
            # a library that is not there is told of with the packages
            if name in _OURS:
                words = f"the package {name} is not found beside vbaa_calib, in {root}"
                problems.append(Diagnosis("package_hidden", words, "install vbaa-calib again", grave=True))
            continue
        places[name] = str(place)
        if expected is not None and place.resolve().parent != expected.resolve():
            words = f"{name} is taken from {place}, not from {expected}"
            problems.append(Diagnosis("package_shadowed", words, _out_of_the_way(place), grave=True))
    problems += _waiting(Path.cwd() if folder is None else folder, homes, places)
    words = f"{len(places)} packages come from where they were installed"
    if problems:
        words = "some packages do not come, or may not come, from where they were installed"
    return Finding("shadows", words, tuple(problems), {"places": places})


def _waiting(folder: Path, homes: Mapping[str, Path | None], places: Mapping[str, str]) -> list[Diagnosis]:
    """What stands in the current folder under a package's name: `python script.py` there would take it."""
    problems = []
    for name, expected in homes.items():
        if expected is not None and folder.resolve() == expected.resolve():
            continue
        for candidate in (folder / name / "__init__.py", folder / f"{name}.py"):
            place = candidate.parent if candidate.name == "__init__.py" else candidate
            if candidate.is_file() and places.get(name) != str(place):
                words = f"{place} takes the place of the package {name} for every script that is run from there"
                problems.append(Diagnosis("name_taken", words, _out_of_the_way(place)))
    return problems


def _out_of_the_way(place: Path) -> str:
    return f"rename {place}, or work in another folder and leave it out of PYTHONPATH"
