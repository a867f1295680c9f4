"""Whether a window can be opened, and what is said where not. Light: `vbaa view --help` needs no more."""

from __future__ import annotations

import os
import sys

from vbaa_calib.core.errors import InputError


def no_display() -> InputError:
    """What is said where no window opens."""
    return InputError(
        "there is no display to open a window on", remedy="give --screenshot PNG, --html PAGE or --gltf FILE"
    )


def require_display() -> None:
    """Raises InputError where the system names no display to open a window on."""
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise no_display()
