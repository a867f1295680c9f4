"""Python, the packages that pyproject.toml asks for, and whether any comes from where it should not."""

from __future__ import annotations

import contextlib
import importlib.metadata as metadata
import importlib.util
import sys
import tomllib
from collections.abc import Callable, Iterable
from pathlib import Path

from vbaa_calib.core.errors import Diagnosis

from .finding import Finding, by_system, pip

_DISTRIBUTION = "vbaa-calib"
_LEAST_PYTHON = (3, 11)
_ROOT = Path(__file__).parents[2]
"""The folder that holds our packages: a source tree, or site-packages."""


def python_version(version: tuple[int, ...] = tuple(sys.version_info[:3])) -> Finding:
    """Whether this Python is new enough, and where it lives."""
    words, wanted = f"{'.'.join(map(str, version))}, {sys.executable}", ".".join(map(str, _LEAST_PYTHON))
    packages = f"apt-get install python{wanted} python{wanted}-venv", f"brew install python@{wanted}"
    remedy = by_system(*packages, f"winget install Python.Python.{wanted}") + ", then make a new environment with it"
    problem = Diagnosis("python_too_old", f"this is Python {words}, and {wanted} is needed", remedy, grave=True)
    found = () if version[:2] >= _LEAST_PYTHON else (problem,)
    return Finding("python", words, found, {"version": list(version)})


def _asked_for() -> tuple[list[str], list[str]]:
    """What the source tree, where there is one, and the installation ask for. Raises PackageNotFoundError."""
    asked: list[str] = []
    with contextlib.suppress(OSError, ValueError, KeyError):
        project = tomllib.loads((_ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        asked = list(project["dependencies"]) if project["name"] == _DISTRIBUTION else []
    try:
        installed = [line for line in metadata.requires(_DISTRIBUTION) or [] if "extra ==" not in line]
    except metadata.PackageNotFoundError:
        if not asked:
            raise
        installed = []
    return asked or installed, installed


def packages(requirements: Iterable[str] | None = None, version_of: Callable[[str], str] = metadata.version) -> Finding:
    """Every package that is asked for: there, and of a version that fits."""
    from packaging.requirements import Requirement

    problems, versions, known = list[Diagnosis](), dict[str, str](), None
    if requirements is None:
        try:
            requirements, known = _asked_for()
        except metadata.PackageNotFoundError:
            words = f"{_DISTRIBUTION} is not installed"
            problem = Diagnosis("not_installed", words, pip("install", _DISTRIBUTION), grave=True)
            return Finding("packages", "unknown", (problem,))
    wanted = [Requirement(line) for line in requirements]
    for one in wanted:
        remedy = pip("install", f'"{one.name}{one.specifier}"')
        try:
            versions[one.name] = version = version_of(one.name)
        except metadata.PackageNotFoundError:
            problems.append(Diagnosis("package_missing", f"{one.name} is not installed", remedy, grave=True))
            continue
        if not one.specifier.contains(version, prereleases=True):
            words = f"{one.name} is {version}, and {one.specifier} is needed"
            problems.append(Diagnosis("package_version", words, remedy, grave=True))
    if known is not None and {str(one) for one in wanted} != {str(Requirement(line)) for line in known}:
        words = "the source tree asks for other packages than the installation knows of"
        problems.append(Diagnosis("installation_stale", words, pip("install", "--editable", str(_ROOT))))
    words = f"{len(versions)} of {len(wanted)} there: " + ", ".join(f"{n} {v}" for n, v in versions.items())
    return Finding("packages", words, tuple(problems), {"versions": versions})


_OURS = ("vbaa_calib", "targets", "estimator", "viz")
_LIBRARIES = {"cv2": "opencv-contrib-python-headless", "yaml": "PyYAML"} | {
    name: name
    for name in ("numpy", "scipy", "torch", "kornia", "pyvista", "matplotlib", "reportlab", "pydantic", "rich")
}
"""Name that is imported → distribution that it comes from."""


def _origin(name: str) -> Path | None:
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


def shadows(folder: Path | None = None) -> Finding:
    """Where packages are taken from now, and what the current folder would put in their place."""
    homes = dict.fromkeys(_OURS, _ROOT) | {name: _home(distribution) for name, distribution in _LIBRARIES.items()}
    folder, problems, places = (folder or Path.cwd()).resolve(), [], dict[str, str]()

    def stands_in(name: str, words: str, place: Path, grave: bool) -> Diagnosis:
        remedy = f"rename {place}, or work in another folder and leave it out of PYTHONPATH"
        return Diagnosis(name, words, remedy, grave=grave)

    for name, expected in homes.items():
        place = _origin(name)
        if place is not None:
            places[name] = str(place)
            if expected is not None and place.resolve().parent != expected.resolve():
                words = f"{name} is taken from {place}, not from {expected}"
                problems.append(stands_in("package_shadowed", words, place, True))
        elif name in _OURS:  # a library that is not there is told of with the packages
            words = f"the package {name} is not found beside vbaa_calib, in {_ROOT}"
            problems.append(Diagnosis("package_hidden", words, "install vbaa-calib again", grave=True))
    for name, expected in homes.items():
        if expected is None or folder != expected.resolve():
            for place in (folder / name, folder / f"{name}.py"):
                module = place / "__init__.py" if place.suffix != ".py" else place
                if module.is_file() and places.get(name) != str(place):
                    words = f"{place} takes the place of the package {name} for every script that is run from there"
                    problems.append(stands_in("name_taken", words, place, False))
    words = f"{len(places)} packages come from where they were installed"
    if problems:
        words = "some packages do not come, or may not come, from where they were installed"
    return Finding("shadows", words, tuple(problems), {"places": places})
