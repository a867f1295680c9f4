"""`vbaa`: the public calls under one name, whatever else is called `estimator`."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import vbaa

ROOT = Path(__file__).parents[1]


def test_every_public_name_is_there() -> None:
    for name in vbaa.__all__:
        assert getattr(vbaa, name) is not None


def test_importing_it_loads_nothing_heavy() -> None:
    code = "import sys, vbaa; print([name for name in ('numpy', 'torch', 'cv2') if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout == "[]\n"
