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


def test_another_package_of_the_same_name_is_told(tmp_path: Path) -> None:
    (tmp_path / "estimator").mkdir()
    (tmp_path / "estimator" / "__init__.py").write_text("")
    code = "import sys; sys.path[:0] = sys.argv[1:]; import vbaa; vbaa.ContactEstimator"
    command = [sys.executable, "-c", code, str(tmp_path), str(ROOT)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 1
    assert f"the package estimator is taken from {tmp_path / 'estimator'}, not from {ROOT}" in done.stderr
