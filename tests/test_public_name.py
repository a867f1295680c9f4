"""`vbaa`: the public calls under one name, whatever else is called `estimator`."""

from __future__ import annotations

import pickle
import subprocess
import sys
from pathlib import Path

import vbaa

from .estimator.contact_scenes import RIG, frame

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


FIRST = """
import pickle, sys
from pathlib import Path
from vbaa import ContactEstimator

heavy = set("torch kornia matplotlib pyarrow vtk pyvista scipy numba imagesize PIL pydantic rich starlette".split())
assert not heavy & set(sys.modules), heavy & set(sys.modules)
rig, points, xy, readings = pickle.loads(Path(sys.argv[1]).read_bytes())
for line in ({"centreline_px": points}, {"plane_xy_m": xy}):
    assert ContactEstimator(rig).estimate(**line, **readings).status == "ok"
assert not heavy & set(sys.modules), heavy & set(sys.modules)
"""


def test_the_estimator_loads_little(tmp_path: Path) -> None:
    """Neither its import nor the first contact of a process waits for what only others need."""
    seen = frame()
    readings = {"moment": seen.moment_Nm, "pan": 0.0, "tilt": seen.tilt_rad}
    given = (RIG, seen.points_px, RIG.camera_on_plane()(seen.points_px)[0], readings)
    (tmp_path / "frame").write_bytes(pickle.dumps(given))
    command = [sys.executable, "-c", FIRST, str(tmp_path / "frame")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.returncode == 0, done.stderr
