"""Live: the same answers as afterwards, and files that are whole however it ends."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from estimator import ContactEstimator
from estimator.contact.estimate import STREAM
from estimator.contact.recording import estimate_taken
from estimator.live import LiveContact, LiveEstimator
from estimator.live.outputs import Datagrams, GrowingTable, json_line
from estimator.table.contacts import ContactRow
from estimator.table.files import cells_of, read_contacts
from vbaa_calib.cli.main import main
from vbaa_calib.core.errors import InputError
from vbaa_calib.session import DRIFTS
from vbaa_calib.streams import Reading, Synchronizer, Taken, Timing
from vbaa_calib.streams.messages import line_messages

from ..small_scene import small_rig
from .recordings import COUNT, RATE_HZ, frames, messages, rig, shown, write

SIZE = (480, 360)


def live_contacts(drift: str, several: list[Taken | Reading]) -> list[LiveContact]:
    estimator = ContactEstimator(replace(rig(), drift=DRIFTS[drift]), jobs=1)
    live = LiveEstimator(estimator, Synchronizer(Timing(), image_size=SIZE))
    return [each for message in several for each in live.push(message)] + list(live.finish())


@cache
def found() -> list[LiveContact]:
    return live_contacts("lab", messages())


def rows(several: list[LiveContact], final: bool) -> list[dict[str, Any]]:
    return [cells_of(each.row) for each in several if each.final == final]


@cache
def offline() -> list[dict[str, Any]]:
    estimator = ContactEstimator(replace(rig(), drift=DRIFTS["lab"]), jobs=1)
    synchronizer = Synchronizer(Timing())
    pushed = (each for message in messages() for each in synchronizer.push(message))
    taken = ((each.frame, each.taken.image) for each in pushed)
    return [cells_of(ContactRow.of(item.frame, item.contact)) for item in estimate_taken(estimator, taken)]


def same(one: list[dict[str, Any]], other: list[dict[str, Any]]) -> bool:
    """Bit for bit."""
    return [list(map(repr, each.values())) for each in one] == [list(map(repr, each.values())) for each in other]


def test_the_final_contacts_are_those_of_a_recording() -> None:
    """Bit for bit, drift and motion included, in the same order."""
    final = rows(found(), True)
    assert len(final) == COUNT
    assert {row["status"] for row in final} >= {"ok", "no_contact"}
    assert same(final, offline())


def test_every_picture_is_answered_at_once() -> None:
    """Before the next message; and without drift, which later frames show, with what is final, too."""
    assert [each.row.frame for each in found() if not each.final] == list(range(COUNT))
    # few: the same three pictures again and again would have no errors in common
    several = live_contacts("none", messages(16))
    assert same(rows(several, False), rows(several, True))
    waits = next(index for index, each in enumerate(found()) if each.final)
    assert waits <= STREAM + STREAM // 8


def test_contacts_by_udp() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listening:
        listening.bind(("127.0.0.1", 0))
        listening.settimeout(5.0)
        sink = Datagrams(str(listening.getsockname()[1]))
        for each in found()[:3]:
            sink.write(each)
            assert listening.recv(65536).decode() == json_line(each)
    sink.write(found()[0])  # nobody listens
    sink.close()
    for wrong in ("here", "70000", "no such host.invalid:5"):
        with pytest.raises(InputError, match="--udp-out"):
            Datagrams(wrong)


def test_a_parquet_that_grows_leaves_the_csv_next_to_it_alone(tmp_path: Path) -> None:
    (tmp_path / "contacts.csv").write_text("mine")
    table = GrowingTable(tmp_path / "contacts.parquet", force=True)
    for each in found():
        table.write(each)
    table.close()
    assert (tmp_path / "contacts.csv").read_text() == "mine"
    assert len(read_contacts(tmp_path / "contacts.parquet").frame) == COUNT
    assert len(list(tmp_path.iterdir())) == 2


def verb(*words: object) -> int:
    return main([str(word) for word in words])


def test_a_bag_live_is_the_bag_estimated(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The files of `vbaa live` and `vbaa estimate`, byte for byte; and the contacts as a bag that others read."""
    bag = write(tmp_path / "demo.mcap")
    one, other, out = tmp_path / "one.csv", tmp_path / "new/other.csv", tmp_path / "newer/out.mcap"
    assert verb("estimate", bag, "--rig", small_rig() / "rig.json", "-o", one, "--no-report") == 0
    assert verb("live", small_rig() / "rig.json", bag, "-o", other, "--bag", out, "--json") == 0
    assert one.read_bytes() == other.read_bytes()
    summary = json.loads(capsys.readouterr().out)
    assert summary["frames"] == COUNT
    assert summary["dropped"] == 0
    assert 0.0 < summary["latency_p50_s"] <= summary["latency_p99_s"]
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    with out.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        points = [each.decoded_message for each in reader.iter_decoded_messages(["/contact/final/point"])]
    table = read_contacts(one)
    np.testing.assert_allclose(
        [[p.point.x, p.point.y, p.point.z] for p in points], table.point_world_m[table.located], rtol=1e-8
    )


def test_a_video_with_a_table_of_readings(tmp_path: Path) -> None:
    """Lossless, so that its pixels are those of the pictures: the rows are, too."""
    path, table = tmp_path / "video.mkv", tmp_path / "readings.csv"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), RATE_HZ, SIZE)
    lines = ["time_s,moment_Nm,pan_rad,tilt_rad"]
    several = shown()[:20]
    for time_s, frame in several:
        writer.write(cv2.imread(str(frame.image)))
        lines.append(f"{time_s - 1.0!r},{frame.moment_Nm!r},{frame.pan_rad!r},{frame.tilt_rad!r}")
    writer.release()
    table.write_text("\n".join(lines))
    out = tmp_path / "contacts.csv"
    words = (path, "--rig", small_rig() / "rig.json", "--readings", table, "-o", out, "--no-report", "--drift", "none")
    assert verb("estimate", *words, "--gap", "0.5") == 0
    contacts = read_contacts(out)
    estimator = ContactEstimator(replace(rig(), drift=DRIFTS["none"]), jobs=1)
    pictures = [cv2.imread(str(frame.image)) for _, frame in several]
    numbered = [replace(frame, frame=number, time_s=time_s) for number, (time_s, frame) in enumerate(several)]
    expected = list(estimate_taken(estimator, zip(numbered, pictures, strict=True)))
    assert contacts.status.tolist() == [item.contact.status for item in expected]
    np.testing.assert_allclose(contacts.distance_m, [item.contact.distance_m for item in expected], rtol=1e-6)


def test_centrelines_of_ones_own_tracker(tmp_path: Path) -> None:
    """No session, no pictures: the rows of the session with the same centrelines."""
    lines, readings, out = (tmp_path / name for name in ("lines.csv", "readings.csv", "contacts.csv"))
    estimator = ContactEstimator(rig(), jobs=1)
    seen = list(estimate_taken(estimator, [(f, cv2.imread(str(f.image), cv2.IMREAD_GRAYSCALE)) for f in frames()]))
    with lines.open("w") as stream:
        stream.write("frame,u_px,v_px,sigma_px\n")
        for item in seen:
            for (u, v), sigma in zip(item.measured.points_px, item.measured.sigma_px, strict=True):
                stream.write(f"{item.frame.frame},{u!r},{v!r},{sigma!r}\n".replace("np.float64(", "").replace(")", ""))
    readings.write_text(
        "frame,time_s,pan_rad,tilt_rad,moment_Nm\n"
        + "".join(f"{f.frame},{f.time_s!r},{f.pan_rad!r},{f.tilt_rad!r},{f.moment_Nm!r}\n" for f in frames())
    )
    words = ("--centrelines", lines, "--rig", small_rig() / "rig.json", "-o", out, "--no-report")
    assert verb("estimate", *words, "--readings", readings) == 0
    contacts = read_contacts(out)
    assert contacts.frame.tolist() == [f.frame for f in frames()]
    assert contacts.status.tolist() == [item.contact.status for item in seen]
    whole = contacts.located
    expected = np.array([item.contact.distance_m for item in seen])
    assert (abs(contacts.distance_m - expected)[whole] < contacts.distance_std_m[whole]).all()
    assert verb("estimate", *words, "--force") == 0
    assert np.isnan(read_contacts(out).moment_residual_Nm).all()


@pytest.mark.parametrize("entry", [{}, {"time_s": 1.0}, {"time_s": 1.0, "moment": 0.1, "tilt_deg": 3.0}])
def test_a_line_of_other_names_is_not_lost_in_silence(entry: dict[str, float]) -> None:
    with pytest.raises(InputError, match="nothing to read"):
        list(line_messages(json.dumps(entry).encode(), Path()))


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_files_are_whole_however_it_ends(number: signal.Signals, tmp_path: Path) -> None:
    """Ctrl-C: nothing is lost; a kill: at most what is in work."""
    out = tmp_path / "contacts.csv"
    words = ["live", str(small_rig() / "rig.json"), "-", "-o", str(out), "--lines"]
    code = "import sys; from vbaa_calib.cli.main import main; sys.exit(main(sys.argv[1:]))"
    process = subprocess.Popen(
        [sys.executable, "-c", code, *words], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert process.stdin is not None
    assert process.stdout is not None
    said = []
    for n, frame in enumerate([*frames(), *frames()]):
        line = {"time_s": 1.0 + n, "image": str(frame.image), "moment_Nm": frame.moment_Nm}
        process.stdin.write(json.dumps(line | {"pan_rad": frame.pan_rad, "tilt_rad": frame.tilt_rad}).encode() + b"\n")
        process.stdin.flush()
        said.append(json.loads(process.stdout.readline()))
    assert [each["frame"] for each in said] == list(range(2 * len(frames())))
    process.send_signal(number)
    rest, words_said = process.communicate(timeout=60)
    assert read_contacts(out).frame.tolist() == [each["frame"] for each in said]
    assert list(tmp_path.iterdir()) == [out]
    if number == signal.SIGINT:
        assert process.returncode == 0
        assert b"interrupted" in words_said
        assert len(rest.splitlines()) == len(said)  # the final ones
