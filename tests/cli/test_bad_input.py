"""Whatever comes from outside and is wrong: exit 2, one line that names the file, and nothing left behind."""

from __future__ import annotations

import csv
import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from estimator import recording
from vbaa_calib.detect import corners
from vbaa_calib.files import read_yaml
from vbaa_calib.rig import Rig

from .conftest import Call, Outcome

Damage = Callable[[Path], None]

PICTURES = {
    "intrinsics": "intrinsics/board_002.png",
    "plane": "plane/jig_000.png",
    "noload": "noload/noload_001.png",
    "loads": "loads/loads_002.png",
    "recording": "recording/frame_0003.png",
}


def remove(name: str) -> Damage:
    def damage(root: Path) -> None:
        shutil.rmtree(root / name) if (root / name).is_dir() else (root / name).unlink()

    return damage


def write(name: str, content: str | bytes) -> Damage:
    return lambda root: (root / name).write_bytes(content.encode() if isinstance(content, str) else content) and None


def truncate(name: str, fraction: float = 0.7) -> Damage:
    def damage(root: Path) -> None:
        data = (root / name).read_bytes()
        (root / name).write_bytes(data[: int(len(data) * fraction)])

    return damage


def replace(name: str, old: str, new: str) -> Damage:
    """One place of a text file changed."""

    def damage(root: Path) -> None:
        text = (root / name).read_text()
        assert old in text
        (root / name).write_text(text.replace(old, new, 1))

    return damage


def cell(name: str, line: int, column: str, value: str) -> Damage:
    """One cell of a CSV set."""

    def damage(root: Path) -> None:
        rows = list(csv.reader((root / name).read_text().splitlines()))
        rows[line - 1][rows[0].index(column)] = value
        (root / name).write_text("\n".join(map(",".join, rows)) + "\n")

    return damage


def board(**keys: object) -> Damage:
    """session.yaml with another board."""

    def damage(root: Path) -> None:
        data = read_yaml(root / "session.yaml")
        data["board"] |= keys
        (root / "session.yaml").write_text(yaml.safe_dump(data))

    return damage


def without(key: str) -> Damage:
    """session.yaml without a key."""

    def damage(root: Path) -> None:
        data = read_yaml(root / "session.yaml")
        del data[key]
        (root / "session.yaml").write_text(yaml.safe_dump(data))

    return damage


def repaint(name: str, change: Callable[[np.ndarray], np.ndarray]) -> Damage:
    """A picture put in place of another."""

    def damage(root: Path) -> None:
        for path in sorted(root.glob(name)):
            picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
            assert cv2.imwrite(str(path), change(picture))

    return damage


def grey(picture: np.ndarray) -> np.ndarray:
    return np.full_like(picture, 90)


def noise(picture: np.ndarray) -> np.ndarray:
    return np.random.default_rng(1).normal(90, 12, picture.shape).clip(0, 255).astype(np.uint8)


def smaller(picture: np.ndarray) -> np.ndarray:
    return cv2.resize(picture, (picture.shape[1] // 2, picture.shape[0] // 2))


def several(*damages: Damage) -> Damage:
    def damage(root: Path) -> None:
        for one in damages:
            one(root)

    return damage


def copied(source: str, target: str) -> Damage:
    return lambda root: shutil.copy(root / source, root / target) and None


def file_in_place_of(name: str) -> Damage:
    return several(remove(name), write(name, "a text file"))


def tree(folder: Path) -> dict[str, tuple[int, int]]:
    """Every file below a folder, hidden ones included, with its size and time."""
    return {str(path): (path.stat().st_size, path.stat().st_mtime_ns) for path in folder.rglob("*")}


def refused(said: Outcome, *words: str) -> None:
    assert said.code == 2, said
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert said.err.startswith("vbaa: ")
    assert "Traceback" not in said.err
    for word in words:
        assert word in said.err


CALIBRATE: dict[str, tuple[Damage, str, str]] = {
    "no session": (remove(""), "session: no such folder", ""),
    "a file for a session": (several(remove(""), write("", "x")), "session: is not a folder", ""),
    "no session.yaml": (remove("session.yaml"), "session.yaml: no such file", ""),
    "session.yaml is another file": (
        copied("truth.json", "session.yaml"),
        "session.yaml: schema is 'vbaa.truth/1'",
        "",
    ),
    "session.yaml is a picture": (copied(PICTURES["plane"], "session.yaml"), "session.yaml: is not UTF-8 text", ""),
    "a key twice": (replace("session.yaml", "board:", "schema: a\nboard:"), "session.yaml line", "stands twice"),
    "no jig": (without("jig"), "session.yaml: jig is missing", ""),
    "no loads": (remove("loads"), "loads.csv: no such file; calibration needs known loads", ""),
    "no load in the table": (write("loads/loads.csv", ""), "loads.csv: is empty", ""),
    "a NaN in the loads": (cell("loads/loads.csv", 3, "force_y_N", "nan"), "loads.csv line 3", "force_y_N is nan"),
    "a load in cm": (cell("loads/loads.csv", 2, "distance_m", "10"), "loads.csv line 2", "the antenna 0.24 m long"),
    "a load without a number": (cell("loads/loads.csv", 2, "moment_Nm", ""), "loads.csv line 2", "moment_Nm is ''"),
    "no no-load frames": (remove("noload"), "noload.csv: no such file; calibration needs the free antenna", ""),
    "a column missing": (
        replace("noload/noload.csv", "tilt_rad", "tilt"),
        "noload.csv: column tilt_rad is missing",
        "",
    ),
    "a NaN": (cell("noload/noload.csv", 2, "pan_rad", "NaN"), "noload.csv line 2", "pan_rad is NaN"),
    "degrees": (cell("noload/noload.csv", 2, "tilt_rad", "20"), "noload.csv line 2", "give radians"),
    "a picture named twice": (
        cell("noload/noload.csv", 3, "image", "noload_000.png"),
        "noload.csv line 3: the picture noload_000.png stands in line 2, too",
        "",
    ),
    "a picture that is not there": (remove(PICTURES["noload"]), "noload.csv line 3: the picture noload_001.png", ""),
    "a row cut short": (truncate("noload/noload.csv", 0.7), "noload.csv line", "cells, the header 4"),
    "no photos": (remove("intrinsics"), "intrinsics: no such folder", ""),
    "an empty folder": (
        several(remove("plane"), lambda root: (root / "plane").mkdir()),
        "plane: holds no pictures",
        "",
    ),
    "a text file for a folder": (file_in_place_of("intrinsics"), "intrinsics: is not a folder", ""),
    "another dictionary": (board(dictionary="DICT_5X5_100"), "plane", "the board spec does not fit the pictures"),
    "another width": (board(squares_x=9), "plane", "squares_x: 11 (not 9)"),
    "the other layout": (board(legacy_pattern=True), "plane", "legacy_pattern: false"),
    "no board in the jig": (repaint("plane/*.png", grey), "plane/jig_000.png: no board is found", ""),
    "no board in the photos": (repaint("intrinsics/*.png", grey), "intrinsics: no board is found", ""),
    "no antenna, plain grey": (repaint(PICTURES["noload"], grey), "noload_001.png: no antenna found", ""),
    "no antenna, only noise": (repaint(PICTURES["noload"], noise), "noload_001.png: no antenna found", ""),
    "no antenna, but a board": (copied(PICTURES["plane"], PICTURES["noload"]), "noload_001.png: no antenna found", ""),
    "no antenna under load": (repaint(PICTURES["loads"], grey), "loads_002.png: no antenna found", ""),
}
for place, name in list(PICTURES.items())[:4]:
    short = name.partition("/")[2]
    CALIBRATE |= {
        f"a truncated picture in {place}": (truncate(name), f"{short}: is truncated or damaged", ""),
        f"an empty picture in {place}": (write(name, b""), f"{short}: is an empty file", ""),
        f"a text for a picture in {place}": (write(name, "text"), f"{short}: is not a picture", ""),
        f"another size in {place}": (repaint(name, smaller), f"{short}: is 240x180 px", "480x360 px"),
    }


@pytest.mark.parametrize("case", CALIBRATE)
def test_calibrate(vbaa: Call, session: Path, tmp_path: Path, case: str) -> None:
    damage, *words = CALIBRATE[case]
    damage(session)
    before = tree(tmp_path)
    refused(vbaa("calibrate", session, "-o", tmp_path / "rig.json", "--model", "radial"), *words)
    assert tree(tmp_path) == before


LATE_IN_A_SESSION = [
    *(f"{what} in {place}" for place in ("noload", "loads") for what in ("a truncated picture", "another size")),
    "no loads",
    "a NaN in the loads",
    "an empty folder",
    "no jig",
]


@pytest.mark.parametrize("case", LATE_IN_A_SESSION)
def test_calibrate_refuses_before_the_long_work(
    vbaa: Call, session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, case: str
) -> None:
    def begun(*_: object) -> None:
        raise AssertionError("the long work has begun")

    monkeypatch.setattr(corners, "detect_corners", begun)
    damage, *words = CALIBRATE[case]
    damage(session)
    refused(vbaa("calibrate", session, "-o", tmp_path / "rig.json"), *words)


def test_estimate_refuses_before_the_long_work(
    vbaa: Call, session: Path, rig: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def begun(*_: object) -> None:
        raise AssertionError("the long work has begun")

    monkeypatch.setattr(recording, "look_at", begun)
    truncate(PICTURES["recording"])(session)
    refused(vbaa("estimate", session, "--rig", rig, "-o", tmp_path / "contacts.csv"), "is truncated or damaged")


ESTIMATE: dict[str, tuple[Damage, str, str]] = {
    "no recording": (remove("recording"), "recording.csv: no such file", ""),
    "a column missing": (replace("recording/recording.csv", "pan_rad", "pan"), "column pan_rad is missing", ""),
    "a NaN": (cell("recording/recording.csv", 4, "moment_Nm", "nan"), "recording.csv line 4: moment_Nm is nan", ""),
    "a duplicate frame": (cell("recording/recording.csv", 4, "frame", "1"), "recording.csv line 4: frame 1 stands", ""),
    "time backwards": (cell("recording/recording.csv", 4, "time_s", "0.05"), "line 4: the time runs backwards", ""),
    "a picture that is not there": (remove(PICTURES["recording"]), "line 5: the picture frame_0003.png is not", ""),
    "no rows": (write("recording/recording.csv", "frame,time_s,image,pan_rad,tilt_rad,moment_Nm\n"), "no rows", ""),
    "a truncated picture": (truncate(PICTURES["recording"]), "frame_0003.png: is truncated or damaged", ""),
    "an empty picture": (write(PICTURES["recording"], b""), "frame_0003.png: is an empty file", ""),
    "another size": (repaint(PICTURES["recording"], smaller), "frame_0003.png: is 240x180 px", "480x360 px"),
    "a centreline of no frame": (
        write("recording/centrelines.csv", "frame,u_px,v_px\n9,100,100\n"),
        "centrelines.csv: frame 9 is not in recording.csv",
        "",
    ),
    "a centreline with a NaN": (
        write("recording/centrelines.csv", "frame,u_px,v_px\n0,100,100\n1,nan,3\n"),
        "centrelines.csv line 3: u_px is nan",
        "",
    ),
    "no rig": (remove("../rig.json"), "rig.json: no such file", ""),
    "a rig that is none": (write("../rig.json", "[1, 2]"), "rig.json: must be a JSON object", ""),
    "a rig that is text": (write("../rig.json", "text"), "rig.json line 1: is not valid JSON", ""),
    "a rig that is a picture": (copied(PICTURES["plane"], "../rig.json"), "rig.json: is not UTF-8 text", ""),
    "a rig that is the truth": (copied("truth.json", "../rig.json"), "rig.json: schema is 'vbaa.truth/1'", ""),
    "a rig cut short": (truncate("../rig.json"), "rig.json line", "is not valid JSON"),
    "a moment that is no number": (
        cell("recording/recording.csv", 3, "moment_Nm", "1 mNm"),
        "recording.csv line 3: moment_Nm is '1 mNm'; a number in SI units is needed",
        "",
    ),
    "a moment under another name": (
        replace("recording/recording.csv", "moment_Nm", "moment_mNm"),
        "recording.csv: column moment_Nm is missing, but there is moment_mNm",
        "",
    ),
    "a rig of kilometres": (
        replace("../rig.json", '"length_m": ', '"length_m": 1e3, "old": '),
        "rig.json: antenna.length_m: 1000.0 is not between 0.001 and 10",
        "",
    ),
    "a rig without a gain": (
        replace("../rig.json", '"gain": ', '"gain": 0, "old": '),
        "rig.json: moment_sensor.gain: 0 is not between",
        "",
    ),
    "a rig with a NaN": (replace("../rig.json", '"gain": ', '"gain": NaN, "old": '), "moment_sensor.gain", ""),
}


@pytest.mark.parametrize("case", ESTIMATE)
def test_estimate(vbaa: Call, session: Path, rig: Path, tmp_path: Path, case: str) -> None:
    damage, *words = ESTIMATE[case]
    damage(session)
    before = tree(tmp_path)
    refused(vbaa("estimate", session, "--rig", rig, "-o", tmp_path / "contacts.csv"), *words)
    assert tree(tmp_path) == before


INTRINSICS: dict[str, tuple[Damage, str, str]] = {
    "no folder": (remove("intrinsics"), "intrinsics: no such folder", ""),
    "a text file": (file_in_place_of("intrinsics"), "intrinsics: is not a folder", ""),
    "no pictures": (several(remove("intrinsics"), lambda root: (root / "intrinsics").mkdir()), "holds no pictures", ""),
    "a truncated picture": (truncate(PICTURES["intrinsics"]), "board_002.png: is truncated or damaged", ""),
    "an empty picture": (write(PICTURES["intrinsics"], b""), "board_002.png: is an empty file", ""),
    "another size": (repaint(PICTURES["intrinsics"], smaller), "board_002.png: is 240x180 px", ""),
    "no board file": (remove("session.yaml"), "session.yaml: no such file", ""),
    "another dictionary": (board(dictionary="DICT_6X6_250"), "intrinsics: the board spec does not fit", "DICT_4X4"),
    "another height": (board(squares_y=6), "intrinsics: the board spec does not fit", "squares_y is 8 or more"),
    "too many squares": (board(squares_x=40, squares_y=40), "session.yaml", "need 800 markers"),
    "no board": (repaint("intrinsics/*.png", noise), "intrinsics: no board is found", ""),
}


@pytest.mark.parametrize("case", INTRINSICS)
def test_intrinsics(vbaa: Call, session: Path, tmp_path: Path, case: str) -> None:
    damage, *words = INTRINSICS[case]
    damage(session)
    before = tree(tmp_path)
    argv = [session / "intrinsics", "--board", session / "session.yaml", "-o", tmp_path / "camera.json"]
    refused(vbaa("intrinsics", *argv), *words)
    assert tree(tmp_path) == before


@pytest.mark.parametrize("output", ["none/out.csv", "session", "session/session.yaml/out.csv", "n" * 300 + ".csv"])
@pytest.mark.parametrize("verb", ["calibrate", "estimate", "intrinsics"])
def test_outputs_that_cannot_be(vbaa: Call, session: Path, rig: Path, tmp_path: Path, verb: str, output: str) -> None:
    inputs = {
        "calibrate": [session],
        "estimate": [session, "--rig", rig],
        "intrinsics": [session / "intrinsics", "--board", session / "session.yaml"],
    }
    before = tree(tmp_path)
    for force in ([], ["--force"]):
        refused(vbaa(verb, *inputs[verb], "-o", tmp_path / output, *force), output)
    assert tree(tmp_path) == before


def test_contacts_are_a_csv_or_parquet(
    vbaa: Call, session: Path, rig: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    words = {
        "contacts.xlsx": "is neither .csv nor .parquet",
        "contacts": "is neither .csv nor .parquet",
        "contacts.parquet": "Parquet needs the package pyarrow; pip install vbaa-calib[parquet]",
    }
    for name, said in words.items():
        refused(vbaa("estimate", session, "--rig", rig, "-o", tmp_path / name), f"{name}: {said}")
        assert not (tmp_path / name).exists()


@pytest.mark.parametrize(
    ("option", "value", "words"),
    [
        ("--friction", "-0.1", "friction is -0.1; give the angle's deviation in rad"),
        ("--friction", "12", "friction is 12"),
        ("--friction", "nan", "friction is nan"),
        ("--friction", "much", "argument --friction: invalid float value: 'much'"),
        ("--model", "beam", "argument --model: invalid choice: 'beam'"),
        ("--device", "abacus", "device 'abacus': "),
        ("--device", "", "device '': "),
    ],
)
def test_options_that_mean_nothing(
    vbaa: Call, session: Path, rig: Path, tmp_path: Path, option: str, value: str, words: str
) -> None:
    before = tree(tmp_path)
    refused(vbaa("estimate", session, "--rig", rig, "-o", tmp_path / "contacts.csv", f"{option}={value}"), words)
    assert tree(tmp_path) == before


def test_vision_alone(vbaa: Call, session: Path, rig: Path, tmp_path: Path) -> None:
    """Without the moments, by the option or in the table, the contacts are the same, and others than with them."""
    tables = {}
    for name, options in (("with", []), ("told", ["--no-moment"])):
        said = vbaa("estimate", session, "--rig", rig, "-o", tmp_path / f"{name}.csv", *options)
        assert said.code == 0
        assert "moment reading" not in said.err
        tables[name] = (tmp_path / f"{name}.csv").read_text()
    path = session / "recording" / "recording.csv"
    path.write_text("".join(line.rpartition(",")[0] + "\n" for line in path.read_text().splitlines()))
    said = vbaa("estimate", session, "--rig", rig, "-o", tmp_path / "silent.csv")
    assert said.code == 0
    assert "4 of 4 frames have no moment reading: vision alone there" in said.err
    tables["silent"] = (tmp_path / "silent.csv").read_text()
    assert tables["told"] == tables["silent"] != tables["with"]
    rows = list(csv.DictReader(tables["told"].splitlines()))
    assert len(rows) == 4
    assert not any(row["moment_residual_Nm"] for row in rows)


def test_a_second_moment_that_the_rig_does_not_know_is_left_aside(
    vbaa: Call, session: Path, rig: Path, tmp_path: Path
) -> None:
    path = session / "recording" / "recording.csv"
    first, *rest = path.read_text().splitlines()
    path.write_text("\n".join([f"{first},moment_z_Nm", *(f"{line},0.001" for line in rest)]))
    said = vbaa("estimate", session, "--rig", rig, "-o", tmp_path / "contacts.csv")
    assert said.code == 0
    assert "moment_z_Nm is left aside: rig.json has no second_moment_sensor" in said.err


@pytest.mark.parametrize(
    ("scene", "output", "words"),
    [
        ("none.yaml", "new", "none.yaml: no such file"),
        ("no_such_scene", "new", "no_such_scene"),
        ("rig.json", "new", "rig.json"),
        ("session", "new", "session"),
        ("scene.yaml", "none/new", "its folder does not exist"),
        ("scene.yaml", "rig.json", "exists already"),
    ],
)
def test_simulate(vbaa: Call, made: Path, rig: Path, tmp_path: Path, scene: str, output: str, words: str) -> None:
    shutil.copy(made / "scene.yaml", tmp_path)
    before = tree(tmp_path)
    refused(vbaa("simulate", tmp_path / scene, "-o", tmp_path / output), words)
    assert tree(tmp_path) == before


def test_pictures_of_any_depth_and_colour_mean_the_same(vbaa: Call, made: Path, session: Path, tmp_path: Path) -> None:
    """The same grey as colour, as 16 bit, and under another suffix gives the same rig and the same contacts.

    To the bit for the lens; where the antenna is looked for, 16 bits are not cut to 8, and rounding differs.
    """
    repaint("intrinsics/*.png", lambda picture: cv2.merge([picture] * 3))(session)
    repaint("noload/*.png", lambda picture: picture.astype(np.uint16) * 257)(session)
    repaint("loads/*.png", lambda picture: cv2.merge([picture] * 4))(session)
    repaint("recording/*.png", lambda picture: cv2.merge([picture.astype(np.uint16) * 257] * 3))(session)
    for path in (session / "plane").iterdir():
        cv2.imwrite(str(path.with_suffix(".tif")), cv2.imread(str(path), cv2.IMREAD_UNCHANGED))
        path.unlink()
    rig = tmp_path / "rig.json"
    assert vbaa("calibrate", session, "-o", rig).code == 0
    mine, theirs = (json.loads(path.read_text()) for path in (rig, made / "rig.json"))
    for key in ("views", "dropped", "rms_px", "model_comparison"):
        assert mine["quality"]["lens"][key] == theirs["quality"]["lens"][key], key
    one, other = Rig.load(rig), Rig.load(made / "rig.json")
    std = np.sqrt(np.diag(other.covariance))
    assert (np.abs(one.T_antenna_camera.tangent_from(other.T_antenna_camera)) < 0.1 * std[:6]).all()
    assert (np.abs(one.antenna.parameters - other.antenna.parameters) < 0.1 * std[6:15]).all()
    # one of a few shapes of the line is chosen for each picture, and with it how high the line stands
    assert one.image.height == pytest.approx(other.image.height, rel=3e-2)
    tables = []
    for folder, name in ((session, "mine.csv"), (made / "session", "theirs.csv")):
        assert vbaa("estimate", folder, "--rig", rig, "-o", tmp_path / name).code == 0
        tables.append((tmp_path / name).read_text())
    mine, theirs = (list(csv.DictReader(table.splitlines())) for table in tables)
    assert [row["status"] for row in mine] == [row["status"] for row in theirs]
    for one_row, other_row in zip(mine, theirs, strict=True):
        if other_row["distance_m"]:
            off = float(one_row["distance_m"]) - float(other_row["distance_m"])
            assert abs(off) < 0.2 * float(other_row["distance_std_m"])


def greened(picture: np.ndarray) -> np.ndarray:
    """What is bright turns green, and as light as the rest: its grey level tells it no more."""
    share = np.clip((picture.astype(float) - 60.0) / 150.0, 0.0, 1.0)[..., None]
    colours = np.array([120.0, 110.0, 115.0]) * (1.0 - share) + np.array([60.0, 130.0, 80.0]) * share
    noise = np.random.default_rng(0).normal(0.0, 2.0, colours.shape)
    return np.clip(np.rint(colours + noise), 0, 255).astype(np.uint8)


def test_an_antenna_that_differs_in_colour_alone_is_learnt_from_the_noload_frames(
    vbaa: Call, made: Path, session: Path, tmp_path: Path
) -> None:
    for name in ("noload", "loads", "recording"):
        repaint(f"{name}/*.png", greened)(session)
    rig = tmp_path / "rig.json"
    assert vbaa("calibrate", session, "-o", rig).code == 0
    assert Rig.load(rig).image.weights is not None
    one, other = Rig.load(rig).antenna, Rig.load(made / "rig.json").antenna
    assert one.stiffness_Nm2 == pytest.approx(other.stiffness_Nm2, rel=5e-3)
    assert vbaa("estimate", session, "--rig", rig, "-o", tmp_path / "contacts.csv").code == 0
    rows = list(csv.DictReader((tmp_path / "contacts.csv").read_text().splitlines()))
    assert [row["status"] for row in rows] == ["no_contact", "ok", "ok", "no_contact"]


def test_a_background_is_taken_off_every_picture(vbaa: Call, session: Path, rig: Path, tmp_path: Path) -> None:
    """Bars lie across the antenna; the picture without it shows them too."""
    usual = cv2.imread(str(next((session / "recording").glob("*.png"))), cv2.IMREAD_GRAYSCALE)
    bars = np.zeros_like(usual)
    for row in range(20, len(usual), 37):
        cv2.line(bars, (0, row), (usual.shape[1], row + 15), 40, 3)
    repaint("recording/*.png", lambda picture: cv2.add(picture, bars))(session)
    cv2.imwrite(str(tmp_path / "empty.png"), bars + np.uint8(np.median(usual)))
    contacts = tmp_path / "contacts.csv"
    call = ("estimate", session, "--rig", rig, "-o", contacts, "--force", "--background")
    assert vbaa(*call, tmp_path / "empty.png").code == 0
    statuses = [row["status"] for row in csv.DictReader(contacts.read_text().splitlines())]
    assert statuses == ["no_contact", "ok", "ok", "no_contact"]
    cv2.imwrite(str(tmp_path / "small.png"), bars[::2, ::2])
    said = vbaa(*call, tmp_path / "small.png")
    assert said.code == 2
    assert "use the resolution of the calibration" in said.err


def test_a_frame_without_an_antenna_stays_in_the_table(vbaa: Call, session: Path, rig: Path, tmp_path: Path) -> None:
    repaint("recording/frame_0001.png", grey)(session)
    repaint("recording/frame_0002.png", noise)(session)
    contacts = tmp_path / "contacts.csv"
    assert vbaa("estimate", session, "--rig", rig, "-o", contacts).code == 0
    rows = list(csv.DictReader(contacts.read_text().splitlines()))
    assert [row["frame"] for row in rows] == ["0", "1", "2", "3"]
    assert [row["status"] for row in rows] == ["no_contact", "no_antenna", "no_antenna", "no_contact"]
    assert all(row["reason"] for row in rows)
    said = vbaa("reconstruct", contacts, "--rig", rig, "-o", tmp_path / "object.vtp")
    refused(said, "contacts.csv")
    assert not (tmp_path / "object.vtp").exists()
