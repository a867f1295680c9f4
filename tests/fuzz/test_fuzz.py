"""Files changed at random, by hypothesis and by what ever broke a reader: read or refused by name, line and column."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_yaml

from ..csv_files import read_rows
from ..hostile import damage as d
from ..hostile.every_file import TO_TEXTS
from .fuzz import READERS, SEEDS, outcome, runs


@pytest.mark.parametrize("count", [250, pytest.param(100_000, marks=pytest.mark.slow)])
def test_changed_files_are_read_or_refused(folder: Path, count: int) -> None:
    broken = [(reader.name, came) for reader, _, came in runs(folder, count, seed=count) if came not in SOUND]
    assert broken == []


def test_good_files_are_read(folder: Path) -> None:
    for reader in READERS:
        assert outcome(reader, folder, (folder / reader.file).read_bytes()) == "read", reader.name


def test_what_once_broke_a_reader(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("vbaa_calib.convert.child._SECONDS", 2.0)  # one keeps its reader busy until it is stopped
    for seed in sorted(SEEDS.glob("*/*")):
        assert outcome(READ[seed.parent.name], folder, seed.read_bytes()) in SOUND, seed


SOUND = ("read", "refused")
READ = {reader.name: reader for reader in READERS}
OFTEN = settings(
    max_examples=40, deadline=None, derandomize=True, database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)  # fmt: skip
NO_NUMBERS = (float("nan"), float("inf"), -float("inf"), 10**400, "much", "1 mm", [], {})
NO_CELLS = ("NaN", "-inf", "1e999", "much", "1 mm", 1000 * "9" + "e9", "1_0", "0x10")
SETTINGS: dict[str, tuple[str, ...]] = {
    "session": ("board", "antenna", "jig", "kinematics", "gravity_world", "moment_sensor"),
    "board": ("",),
    "scene": ("board", "camera", "antenna", "kinematics", "object", "intrinsics", "loads", "recording"),
    "rig": ("camera.matrix", "camera.distortion", "T_antenna_camera", "antenna", "moment_sensor", "joint.covariance"),
    "camera": ("matrix", "distortion", "covariance"),
}
"""Readers, and the sections whose every number counts; of others some keys are notes."""
TABLES: dict[str, tuple[str, ...]] = {
    "recording": ("moment_Nm", "pan_rad", "tilt_rad", "frame", "time_s"),
    "noload": ("pan_rad", "tilt_rad", "moment_Nm"),
    "loads": ("pan_rad", "tilt_rad", "moment_Nm", "distance_m", "force_y_N", "force_z_N"),
    "sweep": ("pan_rad", "tilt_rad"),
    "centrelines": ("frame", "u_px", "v_px"),
    "deflections": ("loaded_y_m", "x_m", "unloaded_y_m"),
    "poses": ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"),
    "corners": ("id", "u_px", "v_px"),
    "contacts": ("frame", "distance_m", "force_y_N", "X_m", "Y_m", "Z_m"),
}
"""Readers of tables, and columns that they need."""


def refusal(name: str, folder: Path, damage: Callable[[Path], None]) -> str:
    """The line in which a reader refuses a file to which this was done; the file is put back."""
    reader = READ[name]
    path = folder / reader.file
    good = path.read_bytes()
    try:
        damage(path)
        with pytest.raises(InputError) as caught:
            reader.read(path)
    finally:
        d.put(path, good)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 2000
    return str(caught.value)


def numbers(data: Any, way: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The ways to all numbers in it."""
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in items:
        if isinstance(value, int | float) and not isinstance(value, bool):
            yield (*way, key)
        else:
            yield from numbers(value, (*way, key))


@pytest.mark.parametrize("name", SETTINGS)
@OFTEN
@given(draw=st.data())
def test_a_number_that_is_none_is_refused_by_its_key(name: str, folder: Path, draw: st.DataObject) -> None:
    file = READ[name].file
    text = (folder / file).read_text()
    whole = json.loads(text) if file.endswith(".json") else yaml.safe_load(text)
    begin = [tuple(section.split(".")) if section else () for section in SETTINGS[name]]
    ways = [way for way in numbers(whole) if any(way[: len(one)] == one for one in begin)]
    way = draw.draw(st.sampled_from(ways))
    words = refusal(name, folder, d.at(".".join(map(str, way)), draw.draw(st.sampled_from(NO_NUMBERS))))
    assert file.rpartition("/")[2] in words
    assert any(str(key) in words for key in way if isinstance(key, str)), words


@pytest.mark.parametrize("name", TABLES)
@OFTEN
@given(draw=st.data())
def test_a_cell_that_is_no_number_is_refused_by_line_and_column(name: str, folder: Path, draw: st.DataObject) -> None:
    rows = read_rows(folder / READ[name].file)
    column = draw.draw(st.sampled_from(TABLES[name]))
    line = 2 + draw.draw(st.sampled_from([number for number, row in enumerate(rows) if row[column]]))
    words = refusal(name, folder, d.cell(line, column, draw.draw(st.sampled_from(NO_CELLS))))
    assert f"line {line}" in words
    assert column in words


def twice(column: str) -> Callable[[bytes], bytes]:
    """The table with a column a second time."""

    def change(data: bytes) -> bytes:
        lines = data.decode().splitlines()
        at = lines[0].split(",").index(column)
        return "\n".join(f"{line},{line.split(',')[at]}" for line in lines).encode()

    return change


@pytest.mark.parametrize("name", TABLES)
def test_a_table_that_is_none_is_refused(name: str, folder: Path) -> None:
    column = TABLES[name][-1]
    for damage, words in (
        (d.changed(lambda data: data.split(b"\n")[0] + b"\n"), "has a header but no rows"),
        (d.changed(lambda data: data.partition(b"\n")[2]), "is missing"),
        (d.text(column, "other"), f"column {column} is missing"),
        (d.changed(twice(column)), f"column {column} stands twice"),
        (d.changed(lambda data: data.rstrip().rpartition(b",")[0]), "cells, the header"),
        (d.changed(lambda data: data.rstrip() + b",1\n"), "cells, the header"),
        (d.changed(lambda data: data.rstrip() + b'\n"'), "is not a valid CSV"),
        (d.changed(lambda data: data.rstrip() + b"\n" + 200_000 * b"x"), "is not a valid CSV"),
        (d.content(b",,,,,\n,,,,,\n"), "is empty"),
    ):
        assert words in refusal(name, folder, damage)


TEXTS = [
    *SETTINGS, *TABLES, "wizard", "readings", "answers", "truth", "ros", "kalibr", "colmap", "opencv", "mrcal",
    "numbers", "orbslam", "cahvor",
]  # fmt: skip


@pytest.mark.parametrize("name", TEXTS)
def test_what_is_no_text_is_refused(name: str, folder: Path) -> None:
    """Missing, a folder, a pipe, a link to nothing or to a device, empty, not UTF-8."""
    for what, damage, words in TO_TEXTS:
        if name in ("wizard", "centrelines") and what in ("missing", "a link to nothing", "a link to itself"):
            continue  # there need not be one
        found = refusal(name, folder, damage)
        assert all(word in found for word in (Path(READ[name].file).name, *words)), f"{what}: {found}"


@pytest.mark.parametrize("name", ["session", "board", "scene", "rig", "camera"])
def test_a_key_twice_without_end_or_nested_without_end_is_refused(name: str, folder: Path) -> None:
    first = next(iter(read_yaml(folder / READ[name].file)))
    brace = '{"a":' if READ[name].file.endswith(".json") else "a: "
    for damage, words in (
        (d.text(f"{first}", f"{first}: 1\n{first}"), "twice")
        if brace == "a: "
        else (d.text(f'"{first}"', f'"{first}": 1, "{first}"'), "twice"),
        (d.content(brace + 100_000 * "["), "nested too deeply"),
        (d.content("[1, 2]"), "must be a"),
    ):
        assert words in refusal(name, folder, damage)
