"""Python, and the packages that pyproject.toml asks for."""

from __future__ import annotations

import importlib.metadata as metadata
import importlib.util
import re
import sys
import tomllib
from collections.abc import Callable, Iterable
from pathlib import Path

from vbaa_calib.core.errors import Diagnosis

from .finding import Finding, by_system, pip

OURS = "vbaa-calib"
_LEAST_PYTHON = (3, 11)
ROOT = Path(__file__).parents[2]
"""The folder that holds our packages: a source tree, or site-packages."""

_Version = Callable[[str], str]


def python_version(version: tuple[int, ...] = tuple(sys.version_info[:3])) -> Finding:
    """Whether this Python is new enough, and where it lives."""
    words = f"{'.'.join(map(str, version))}, {sys.executable}"
    if version[:2] >= _LEAST_PYTHON:
        return Finding("python", words, numbers={"version": list(version)})
    wanted = ".".join(map(str, _LEAST_PYTHON))
    remedy = by_system(
        f"apt-get install python{wanted} python{wanted}-venv, then make a new environment with it",
        f"brew install python@{wanted}, then make a new environment with it",
        f"winget install Python.Python.{wanted}, then make a new environment with it",
    )
    problem = Diagnosis("python_too_old", f"this is Python {words}, and {wanted} is needed", remedy, grave=True)
    return Finding("python", words, (problem,), {"version": list(version)})


def declared(root: Path = ROOT) -> tuple[list[str], bool]:
    """What is asked for, and whether the installation knows less than the source tree it comes from.

    Raises PackageNotFoundError where there is neither a source tree nor an installation.
    """
    asked = _of_source(root)
    try:
        installed = [line for line in metadata.requires(OURS) or [] if "extra ==" not in line]
    except metadata.PackageNotFoundError:
        if asked is None:
            raise
        return asked, True
    if asked is None:
        return installed, False
    return asked, {_plain(line) for line in asked} != {_plain(line) for line in installed}


def _of_source(root: Path) -> list[str] | None:
    try:
        project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        return list(project["dependencies"]) if project["name"] == OURS else None
    except (OSError, ValueError, KeyError):
        return None


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
            problem = Diagnosis("not_installed", f"{OURS} is not installed", pip("install", OURS), grave=True)
            return Finding("packages", "unknown", (problem,))
    requirements = list(requirements)
    problems, versions = [], {}
    for requirement in requirements:
        name, ranges = _split(requirement)
        try:
            versions[name] = version_of(name)
        except metadata.PackageNotFoundError:
            words = f"{name} is not installed"
            problems.append(Diagnosis("package_missing", words, pip("install", f'"{name}{ranges}"'), grave=True))
            continue
        if ranges and _fits(ranges, versions[name]) is False:
            words = f"{name} is {versions[name]}, and {ranges} is needed"
            problems.append(Diagnosis("package_version", words, pip("install", f'"{name}{ranges}"'), grave=True))
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
