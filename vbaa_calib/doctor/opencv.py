"""OpenCV: one wheel, the right one, whole, and its corners where they belong."""

from __future__ import annotations

import importlib
import importlib.metadata as metadata
import re
from collections.abc import Callable, Mapping
from typing import Any

from vbaa_calib.core.errors import Diagnosis

from .finding import Finding, by_system, pip

_RIGHT = "opencv-contrib-python-headless"
_RIGHT_RANGE = ">=4.14,<5"
_NAMES = frozenset(
    f"opencv{contrib}-python{headless}" for contrib in ("", "-contrib") for headless in ("", "-headless")
)


def _wheels() -> dict[str, str]:
    """Name → version of every wheel that brings a cv2."""
    found = {}
    for each in metadata.distributions():
        name = re.sub(r"[-_.]+", "-", each.metadata["Name"] or "").lower()
        if name in _NAMES:
            found[name] = each.version
    return found


def opencv(
    installed: Mapping[str, str] | None = None, load: Callable[[], Any] = lambda: importlib.import_module("cv2")
) -> Finding:
    """Several wheels at once overwrite each other's files; OpenCV 5 lacks what is needed; some wheels need libGL."""
    installed = _wheels() if installed is None else installed
    named = ", ".join(f"{name} {version}" for name, version in sorted(installed.items())) or "no wheel of OpenCV"
    again = f'{pip("install", "--force-reinstall", "--no-deps")} "{_RIGHT}{_RIGHT_RANGE}"'
    problems = []
    if len(installed) > 1:
        remedy = f"{pip('uninstall', '--yes', *sorted(installed))}, then {again}"
        words = f"{named} are installed at once and overwrite each other's cv2"
        problems.append(Diagnosis("several_opencv", words, remedy, grave=True))
    try:
        cv2 = load()
        version, objects = cv2.__version__, hasattr(cv2, "aruco") and hasattr(cv2.aruco, "CharucoDetector")
    except Exception as error:  # a broken binary raises what it likes
        problems.append(_not_loaded(error, again))
        return Finding("opencv", named, tuple(problems), {"wheels": dict(installed)})
    other = len(installed) == 1 and not next(iter(installed.values())).startswith(version)
    rules = (
        (version.split(".")[0] != "4", "opencv_major", "is loaded, which lacks functions that are needed"),
        (not objects, "opencv_without_charuco", "has no ChArUco detector: not a contrib wheel, or one overwritten"),
        (other, "opencv_other", f"is loaded, but {named} is installed"),
    )
    wrong = [Diagnosis(name, f"OpenCV {version} {words}", again, grave=True) for holds, name, words in rules if holds]
    problems += wrong[:1]
    gui = re.search(r"^\s*GUI:\s*(\S+)", cv2.getBuildInformation(), re.MULTILINE)
    window = gui[1] if gui and gui[1] != "NONE" else None
    words = f"{version} of {named}, {f'windows by {window}' if window else 'headless'}"
    return Finding("opencv", words, tuple(problems), {"version": version, "wheels": dict(installed), "window": window})


def _not_loaded(error: Exception, again: str) -> Diagnosis:
    text = " ".join(str(error).split())
    library = re.search(r"(lib[\w+-]+\.so[.\d]*)", text)
    remedy = again
    if library:
        remedy = by_system(f"apt-get install libgl1 libglib2.0-0, or without windows: {again}", again, again)
    elif "DLL" in text:
        remedy = f"winget install Microsoft.VCRedist.2015+.x64, then {again}"
    return Diagnosis("opencv_broken", f"cv2 cannot be loaded ({text})", remedy, grave=True)


def detector() -> Finding:
    """A board drawn with known corners, and how far off they are found: `vbaa selftest` in short."""
    from targets.board import BoardSpec

    from .detector_test import OPENCV, OURS, is_sound, mean_bias_px, try_detectors

    rows = try_detectors(BoardSpec(9, 6, 0.02, 0.015), pictures=1, seed=0, square_px=(40.0,), blur_px=(1.0,))
    rms = {row.detector: row.rms_px for row in rows}
    numbers: dict[str, Any] = {row.detector: row.to_dict() for row in rows}
    words = f"corners are found within {rms[OPENCV]:.3f} px rms by OpenCV, {rms[OURS]:.3f} px by us"
    if is_sound(rows):
        return Finding("detector", words, numbers=numbers)
    bias = mean_bias_px(rows, OPENCV)
    wrong = f"OpenCV's corners are off by ({bias[0]:+.2f}, {bias[1]:+.2f}) px in the mean, or not found"
    remedy = f'{pip("install")} "{_RIGHT}{_RIGHT_RANGE}", then vbaa selftest with your board'
    return Finding("detector", words, (Diagnosis("detector_biased", wrong, remedy, grave=True),), numbers)
