"""Two cameras from the scene to contacts: tables, pictures by name, one rig, and what a user would do wrong."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from vbaa import ContactEstimator, InputError, Rig, load_session
from vbaa_calib.cli.main import main
from vbaa_calib.core.files import read_yaml
from vbaa_calib.session import read_noload, read_recording
from vbaa_calib.simulate.scene.lens import Lens
from vbaa_calib.simulate.scene.scene import bundled_scene
from vbaa_calib.streams.bag_of_session import write_recording

from ..csv_files import read_rows
from ..made_once import made_once
from ..small_scene import calibrated

CAMERAS = ("left", "right")


def _scene() -> dict:
    """The bundled one, with few and small pictures."""
    scene = read_yaml(bundled_scene("two_cameras"))
    for camera, width, focal in zip(scene["cameras"].values(), (640, 704), (645.0, 608.0), strict=True):
        height = 3 * width // 4
        camera["image_size"] = [width, height]
        camera["matrix"] = [[focal, 0.0, width / 2 - 1.0], [0.0, focal, height / 2 + 2.0], [0.0, 0.0, 1.0]]
    scene["intrinsics"]["pictures"] = 6
    scene["jig"]["pictures"] = 1
    scene["noload"] = scene["noload"][:3]
    scene["loads"] = [scene["loads"][index] for index in (1, 3, 7, 8)]
    scene["recording"]["sweeps"] = [scene["recording"]["sweeps"][0] | {"frames": 4, "free_frames": 1}]
    return scene


def two_cameras() -> Path:
    """Folder of a scene with two cameras: session, rig.json."""
    return made_once("two_cameras", lambda folder: calibrated(folder, _scene()))


@pytest.fixture(scope="module")
def made() -> Path:
    return two_cameras()


def _truth(made: Path) -> dict:
    return json.loads((made / "session" / "truth.json").read_text())


def test_pictures_and_columns_are_by_name(made: Path) -> None:
    session = load_session(made / "session")
    assert (tuple(session.cameras), session.camera) == (CAMERAS, "left")
    for name in CAMERAS:
        own = session.of_camera(name)
        assert len(list(own.folder("intrinsics").glob("*.png"))) == 6
        assert {still.image.parent.name for still in read_noload(own)} == {name}
        other = CAMERAS[1 - CAMERAS.index(name)]
        for frame in read_recording(own):
            assert (frame.image.parent.name, [*frame.others]) == (name, [other])
            assert frame.others[other].name == frame.image.name


def test_the_rig_has_both_within_its_deviations(made: Path) -> None:
    rig, truth = Rig.load(made / "rig.json"), _truth(made)
    assert tuple(rig.cameras) == CAMERAS
    for name, one in rig.cameras.items():
        off_m = one.T_antenna_camera.translation_m - truth["cameras"][name]["T_antenna_camera"]["translation_m"]
        assert (np.abs(off_m) < 4.0 * np.sqrt(np.diag(one.covariance)[3:6])).all(), name
    off = np.log(rig.antenna.stiffness_Nm2 / truth["stiffness_Nm2"])
    assert abs(off) < 4.0 * rig.std("log_stiffness_Nm2")
    assert rig.others["right"].antenna is rig.antenna
    quality = json.loads((made / "rig.json").read_text())["quality"]
    assert quality["cameras"].keys() == {"right"}


def test_contacts_of_both_are_better_than_of_one(made: Path, tmp_path: Path) -> None:
    """Every row has its numbers, which the truth is within; so by `estimate` on pictures, and by the library's call."""
    out = tmp_path / "contacts.csv"
    rig, session, truth = made / "rig.json", made / "session", _truth(made)["frames"]
    assert main(["estimate", str(session), "--rig", str(rig), "-o", str(out), "--no-report"]) == 0
    rows = read_rows(out)
    touched = [(row, frame) for row, frame in zip(rows, truth, strict=True) if frame["in_contact"]]
    assert {row["status"] for row, _ in touched} == {"ok"}
    for row, frame in touched:
        assert abs(float(row["distance_m"]) - frame["distance_m"]) < 4.0 * float(row["distance_std_m"])
    estimator = ContactEstimator(Rig.load(rig))
    frame = read_recording(load_session(session))[2]
    read = {"moment": frame.moment_Nm, "pan": frame.pan_rad, "tilt": frame.tilt_rad}
    both = estimator.estimate(image={"left": frame.image, "right": frame.others["right"]}, **read)
    # what the recording's free frames tell of the rig is not known to a single one
    assert both.distance_m == pytest.approx(float(rows[2]["distance_m"]), abs=1.5 * both.distance_std_m)
    for name, image in (("left", frame.image), ("right", frame.others["right"])):
        one = estimator.estimate(image={name: image}, **read)
        assert one.distance_std_m > both.distance_std_m
        other = CAMERAS[1 - CAMERAS.index(name)]
        assert f"{other}: there is no picture" in one.reason
        alone = ContactEstimator(estimator.rig.cameras[name]).estimate(image=image, **read)
        # the fit ends a hundredth of a standard deviation from its minimum
        assert one.distance_m == pytest.approx(alone.distance_m, abs=0.01 * alone.distance_std_m)
    several = list(estimator.live([{"image": {"left": frame.image, "right": frame.others["right"]}, **read}]))
    assert several[0].distance_m == pytest.approx(both.distance_m, rel=1e-9)
    with pytest.raises(InputError, match="several cameras"):
        estimator.estimate(image=frame.image, **read)


def test_streams_give_the_contacts_of_the_session(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A bag with both cameras' topics, a table of pictures, and JSON lines that come live; so does one that fails."""
    rig, session = str(made / "rig.json"), made / "session"
    recording = session / "recording"
    bag, tail = str(tmp_path / "two.mcap"), ["--no-report", "--force"]
    cameras = {name: one.camera for name, one in Rig.load(rig).cameras.items()}
    lenses = {name: Lens(one.model, one.image_size, one.matrix, one.distortion) for name, one in cameras.items()}
    write_recording(Path(bag), session, lenses)
    table = str(recording / "recording.csv")
    contacts = []
    for source in (str(session), bag, table):
        out = tmp_path / f"{len(contacts)}.csv"
        assert main(["estimate", source, "--rig", rig, "-o", str(out), *tail]) == 0
        contacts.append([row | {"time_s": ""} for row in read_rows(out)])
    assert contacts[0] == contacts[1] == contacts[2]
    assert main(["estimate", bag, "--rig", rig, "-o", str(out), *tail, "--topic", "middle=/x"]) == 2
    assert "cameras left, right" in capsys.readouterr().err

    def live(change: Callable[[dict], dict]) -> list[dict[str, str]]:
        lines = []
        for row in read_rows(recording / "recording.csv"):
            read = {name: float(row[name]) for name in ("time_s", "moment_Nm", "pan_rad", "tilt_rad")}
            image = change({name: str(recording / row[f"image_{name}"]) for name in CAMERAS})
            lines.append(json.dumps(read | {"image": image}))
        (tmp_path / "lines").write_text("\n".join(lines))
        with (tmp_path / "lines").open() as stream:
            monkeypatch.setattr("sys.stdin", stream)
            assert main(["live", rig, "-", "-o", str(out), "--force"]) == 0
        return [row | {"time_s": ""} for row in read_rows(out)]

    assert live(lambda image: image) == contacts[0]
    alone = live(lambda image: {"right": image["right"]})
    assert all("left: there is no picture" in row["reason"] for row in alone)
    assert {row["status"] for row in alone} <= {"ok", "no_contact", "low_signal"}
    assert "6 frames without left" in capsys.readouterr().err


def _edited(path: Path, change: Callable[[list[str]], list[str]]) -> None:
    path.write_text("\n".join(change(path.read_text().splitlines())) + "\n")


def test_a_camera_without_a_picture_drops_out_of_the_frame(made: Path, tmp_path: Path) -> None:
    """An empty cell is no picture; two of them are an error."""
    session, out = shutil.copytree(made / "session", tmp_path / "session"), tmp_path / "contacts.csv"
    table = session / "recording" / "recording.csv"
    _edited(table, lambda lines: [*lines[:3], lines[3].replace("right/frame_0002.png", ""), *lines[4:]])
    call = ["estimate", str(session), "--rig", str(made / "rig.json"), "-o", str(out), "--no-report", "--force"]
    assert main(call) == 0
    row = read_rows(out)[2]
    assert row["status"] == "ok"
    assert "right: there is no picture" in row["reason"]
    _edited(table, lambda lines: [*lines[:3], lines[3].replace("left/frame_0002.png", ""), *lines[4:]])
    assert main(call) == 2


def test_each_camera_is_checked_by_its_own_pictures(made: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The check of a camera answers by its folder; one that the rig lacks is refused by name."""
    found = {}
    for name in (*CAMERAS, "behind"):
        code = main(["check", str(made / "rig.json"), str(made / "session"), "--camera-name", name, "--json"])
        printed = capsys.readouterr()
        if name == "behind":
            assert code == 2
            assert "left, right" in printed.err
        else:
            found[name] = json.loads(printed.out)
    for document in found.values():
        assert document["verdict"] != "does not hold"
        assert {one["question"] for one in document["session_findings"]} >= {"Is the camera where it was?"}
    left, right = (document["numbers"] for document in found.values())
    assert left != right
