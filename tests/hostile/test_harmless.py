"""What looks odd and is sound: it works, and the answer is the same."""

from __future__ import annotations

import contextlib
import functools
import io
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from . import damage as d
from .case import Damage, expect_refused, run
from .conftest import good_files

BOM = d.changed(lambda data: b"\xef\xbb\xbf" + data)
CRLF = d.changed(lambda data: data.replace(b"\n", b"\r\n"))
BLANK_LINES = d.changed(lambda data: data.replace(b"\n", b"\n\n") + b"\n\n")
SPACES = d.changed(lambda data: data.replace(b",", b" , "))
COMMENT = d.changed(lambda data: b"# mine\n" + data + b"# the end\n")


def quoted(data: bytes) -> bytes:
    return b"\n".join(b",".join(b'"%s"' % cell for cell in line.split(b",")) for line in data.splitlines())


def turned(data: bytes) -> bytes:
    """The columns from right to left, and one more."""
    return b"\n".join(b",".join([b"more", *line.split(b",")[::-1]]) for line in data.splitlines())


QUOTED, TURNED = d.changed(quoted), d.changed(turned)


LINED = "estimate lined --rig rig.json --no-report -o {}.csv"
TRACK = "track contacts.csv --rig rig.json -o {}.csv"
CONVERT = "convert camera.json --to kalibr -o {}.yaml"
TEXTS: tuple[tuple[str, str, Damage, str], ...] = (
    *((name, f"lined/recording/{table}.csv", damage, LINED)
      for name, damage in (("BOM", BOM), ("CRLF", CRLF), ("blank lines", BLANK_LINES), ("spaces", SPACES),
                           ("columns turned", TURNED), ("every cell quoted", QUOTED))
      for table in ("recording", "centrelines")),
    *((name, path, damage, line)
      for name, damage in (("BOM", BOM), ("CRLF", CRLF))
      for path, line in (("contacts.csv", TRACK), ("camera.json", CONVERT),
                         *((f"{one}.txt", f"convert {one}.txt --to ros -o {{}}.yaml") for one in ("opencv", "mrcal")),
                         ("colmap.txt", "convert colmap.txt --camera-name 3 --to ros -o {}.yaml"))),
    ("BOM", "lined/session.yaml", BOM, LINED),
    ("BOM", "rig.json", BOM, LINED),
    ("comments", "lined/session.yaml", COMMENT, LINED),
    ("a key of one's own", "lined/session.yaml", d.at("remark", "mine"), LINED),
)  # fmt: skip


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], bytes]:
    """What a command writes of files as they were."""
    folder = tmp_path_factory.mktemp("sound")

    @functools.cache
    def written(line: str) -> bytes:
        place = folder / line.split()[1]
        # the command finds its inputs in the case's folder, by their names
        assert run(line.format(place)) == 0
        return place.with_name(f"{place.name}.{line.rpartition('.')[2]}").read_bytes()

    return written


@pytest.mark.parametrize(
    ("name", "path", "damage", "line"), TEXTS, ids=lambda value: value if isinstance(value, str) else ""
)
def test_the_same_to_the_bit(
    name: str, path: str, damage: Damage, line: str, folder: Path, sound: Callable[[str], bytes]
) -> None:
    before = sound(line)
    damage(folder / path)
    assert run(line.format("after")) == 0
    assert (folder / f"after.{line.rpartition('.')[2]}").read_bytes() == before


def by_pillow(kind: str, change: Callable[[Image.Image], Image.Image], **options: object) -> Damage:
    """The picture as another program saves it, under the same name."""

    def damage(path: Path) -> None:
        made = io.BytesIO()
        change(Image.open(path)).save(made, kind, **options)
        d.put(path, made.getvalue())

    return damage


def deep(factor: int) -> Callable[[np.ndarray], np.ndarray]:
    return lambda picture: picture.astype(np.uint16) * factor


def of_mode(mode: str) -> Callable[[Image.Image], Image.Image]:
    return lambda picture: picture.convert(mode)


def turned_by_exif() -> bytes:
    exif = Image.Exif()
    exif[0x0112] = 6
    return exif.tobytes()


def frames(picture: Image.Image) -> Image.Image:
    return picture


BLACK = Image.new("L", (480, 360))
PICTURES: tuple[tuple[str, Damage, float], ...] = (
    ("16 bits of colour", d.encoded(".png", lambda picture: np.dstack([deep(257)(picture)] * 3)), 0.02),
    ("alpha", by_pillow("PNG", of_mode("RGBA")), 0.0),
    ("a BMP named .png", d.encoded(".bmp"), 0.0),
    ("a TIFF of several pages", by_pillow("TIFF", frames, save_all=True, append_images=[BLACK]), 0.0),
    ("a JPEG that EXIF turns", by_pillow("JPEG", frames, quality=98, exif=turned_by_exif()), 0.2),
    ("a CMYK JPEG", by_pillow("JPEG", of_mode("CMYK"), quality=98), 0.3),
)
"""Name, damage, and by how many pixels the antenna's end may move: by rounding alone, where there is any."""


LOOK = "look free.png --rig rig.json --json"


@pytest.fixture(scope="module")
def before() -> dict[str, Any]:
    """What is seen in the picture as it is."""
    with contextlib.chdir(good_files()), contextlib.redirect_stdout(io.StringIO()) as said:
        assert run(LOOK) == 0
    return json.loads(said.getvalue())


@pytest.mark.parametrize(
    ("name", "damage", "moved_px"), PICTURES, ids=lambda value: value if isinstance(value, str) else ""
)
def test_the_same_antenna_is_seen(
    name: str, damage: Damage, moved_px: float, before: dict[str, Any], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    damage(folder / "free.png")
    assert run(LOOK) == 0
    after = json.loads(capsys.readouterr().out)
    assert after["verdict"] == before["verdict"] == "ok"
    assert np.abs(np.subtract(after["end_px"], before["end_px"])).max() <= moved_px
    if not moved_px:
        assert after == before


@pytest.mark.parametrize(
    "line", ["view contacts.csv --html a.html", "reconstruct contacts.csv -o a.ply", "demo --out a"]
)
def test_what_draws_says_which_extra_brings_that(
    line: str, folder: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [name for name in sys.modules if name.startswith(("viz.render", "viz.parts", "viz.files"))]:
        monkeypatch.delitem(sys.modules, name)
    absent = ("pyvista", "vtkmodules", "trame_vtk")
    for name in [*absent, *(name for name in sys.modules if name.startswith(tuple(f"{one}." for one in absent)))]:
        monkeypatch.setitem(sys.modules, name, None)
    capfd.readouterr()
    code = run(line)
    expect_refused(code, *capfd.readouterr(), ("is not installed", "pip install 'vbaa-calib[view]'"))
