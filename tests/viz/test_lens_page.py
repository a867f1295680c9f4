"""The page of `vbaa intrinsics`: whole, standalone, with the verdict of the file; and what it shows is so."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from vbaa_calib.calibrate.lens.models import LENS_MODELS, camera_of
from vbaa_calib.cli.main import main
from viz.report.lens import _maps

from ..small_scene import small_rig

BARREL = np.array([460.0, 458.0, 318.0, 243.0, -0.28, 0.09, 7e-4, -5e-4])


BARREL = np.array([460.0, 458.0, 318.0, 243.0, -0.28, 0.09, 7e-4, -5e-4])


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, dict]:
    """The page, and camera.json."""
    folder, session = tmp_path_factory.mktemp("lens"), small_rig() / "session"
    out, html = folder / "camera.json", folder / "camera.html"
    call = ["intrinsics", str(session / "intrinsics"), "--board", str(session / "session.yaml"), "-o", str(out)]
    assert main([*call, "--html", str(folder / "camera.txt")]) == 2
    assert not out.exists()
    main([*call, "--html", str(html), "--lens-model", "opencv4"])
    return html.read_text(), json.loads(out.read_text())


def test_the_page_stands_alone_and_says_what_the_file_says(made: tuple[str, dict]) -> None:
    text, document = made
    assert not re.search(r"""(src|href)\s*=\s*["'](https?:)?//|@import|url\((?!#)""", text)
    assert not re.search(r"\bnan\b|\binf\b|None", re.sub(r"base64,[^\"]*", "", text))
    head = text.partition("</header>")[0]
    assert document["verdict"].partition(". ")[0] in head
    for one in document["diagnoses"]:
        assert one["words"] in head
    assert text.count('role="img"') == 6
    assert text.count("data:image/jpeg") == 2
    for view in document["views"]:
        assert view["name"] in text


def test_the_map_is_what_moved_lenses_do_to_points_on_a_plane() -> None:
    """One standard deviation of the focal length alone, a turn of the camera left out: by moving the lens."""
    camera = camera_of(LENS_MODELS["opencv4"], BARREL, (640, 480))
    std = np.zeros(8)
    std[:2] = 1e-3 * BARREL[:2]
    covariance = np.outer(std, std)
    plane, _ = _maps(type(camera)(camera.model, camera.image_size, camera.matrix, camera.distortion, covariance), 0.5)
    row, column = 12, 40
    pixel = np.array([plane["columns_px"][column], plane["rows_px"][row]])
    first, second = (one.unproject_normalized(pixel)[0] for one in (camera, camera.moved(std)))
    assert plane["std"][row, column] == pytest.approx(500.0 * float(np.linalg.norm(second - first)), rel=0.1)
