"""Packages that come from where they should not: a folder of the user's that has one of our names, or a library's."""

from __future__ import annotations

import importlib.metadata as metadata
import importlib.util
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from vbaa_calib.core.errors import Diagnosis

from .finding import Finding
from .packages import ROOT

OURS = ("vbaa_calib", "targets", "estimator", "viz")
LIBRARIES = {
    "numpy": "numpy",
    "scipy": "scipy",
    "cv2": "opencv-contrib-python-headless",
    "torch": "torch",
    "kornia": "kornia",
    "yaml": "PyYAML",
    "pyvista": "pyvista",
    "matplotlib": "matplotlib",
    "reportlab": "reportlab",
    "pydantic": "pydantic",
    "rich": "rich",
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


def home(distribution: str) -> Path | None:
    """The folder that a distribution was installed into."""
    try:
        return Path(str(metadata.distribution(distribution).locate_file("")))
    except metadata.PackageNotFoundError:
        return None


def shadows(
    folder: Path | None = None,
    ours: Iterable[str] = OURS,
    libraries: Mapping[str, str] = LIBRARIES,
    root: Path = ROOT,
    origin_of: Callable[[str], Path | None] = origin,
) -> Finding:
    """Where packages are taken from now, and what the current folder would put in their place."""
    homes = dict.fromkeys(ours, root) | {name: home(distribution) for name, distribution in libraries.items()}
    problems, places = [], {}
    for name, expected in homes.items():
        place = origin_of(name)
        if place is None:
            # a library that is not there is told of with the packages
            if name in ours:
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
