"""Bags and videos where folders of pictures were: the same contacts, the sharp and different ones of many views."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from estimator.table.files import read_contacts
from vbaa_calib.cli.main import main
from vbaa_calib.core.errors import InputError
from vbaa_calib.streams.bags import BagWriter, Logged
from vbaa_calib.streams.pictures import BagPictures, thinned
from viz.batch.recordings import BatchRecording
from viz.batch.results import Results
from viz.batch.work import BatchSettings, do

from ..small_scene import small_rig
from .recordings import write

COUNT = 20
"""Pictures in a bag."""

PNG = "sensor_msgs/msg/CompressedImage"


def pattern(number: int, blur: float = 0.0) -> np.ndarray:
    """One of several pictures with detail."""
    rng = np.random.default_rng(number)
    coarse = cv2.resize(rng.uniform(0, 255, (9, 12)).astype(np.uint8), (240, 180), interpolation=cv2.INTER_NEAREST)
    return coarse if blur == 0.0 else np.asarray(cv2.GaussianBlur(coarse, (0, 0), blur))


def test_the_sharp_one_of_each_view_is_kept() -> None:
    shown = [(view, blur) for view in range(6) for blur in (3.0, 0.0, 2.0, 4.0)]
    kept = thinned(((each, pattern(*each)) for each in shown), 24)
    assert [each for each, _ in kept] == [(view, 0.0) for view in range(6)]


@pytest.mark.parametrize("count", [1, 7, 100, 1000])
def test_no_more_than_asked_and_from_all_over(count: int) -> None:
    kept = [number for number, _ in thinned(((n, pattern(n)) for n in range(count)), 20)]
    assert min(count, 20) <= len(kept) <= 40
    assert np.diff([0, *kept, count]).max() <= max(2 * count / min(count, 20), 2)
    assert kept == sorted(kept)


def as_bag(path: Path, pictures: list[np.ndarray], topics: tuple[str, ...] = ("/image",)) -> Path:
    writer = BagWriter(path)
    for number, picture in enumerate(pictures):
        data = np.frombuffer(cv2.imencode(".png", picture)[1].tobytes(), np.uint8)
        for topic in topics:
            writer.write(Logged(topic, PNG, {"format": "png", "data": data}, 10**9 + number * 10**8))
    writer.close()
    return path


def test_the_wizard_takes_a_bag(tmp_path: Path) -> None:
    several = [pattern(n) for n in range(4)]
    source = BagPictures(str(as_bag(tmp_path / "a.mcap", several)))
    found = [source.next(0.0) for _ in range(4)]
    assert [each.name for each in found if each] == [f"frame {n}" for n in range(4)]
    assert [each.time_s for each in found if each] == pytest.approx([0.0, 0.1, 0.2, 0.3])
    np.testing.assert_array_equal(found[2].image, several[2])  # type: ignore[union-attr]
    assert source.next(0.0) is None
    assert source.ended
    source.close()
    two = as_bag(tmp_path / "two.mcap", several, ("/left", "/right"))
    with pytest.raises(InputError, match="#TOPIC"):
        BagPictures(str(two))
    assert BagPictures(f"{two}#/right").next(0.0) is not None


def test_a_lens_from_a_bag_is_that_of_the_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each view three times, blurred but for one: the views that are used are those of the folder."""
    session = small_rig() / "session"
    views = [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in sorted((session / "intrinsics").iterdir())]
    several = [np.asarray(cv2.GaussianBlur(view, (0, 0), b)) if b else view for view in views for b in (2.0, 0.0, 3.0)]
    bag = as_bag(tmp_path / "board.mcap", several)
    found = []
    for given in (bag, session / "intrinsics"):
        words = ["intrinsics", str(given), "--board", str(session / "session.yaml"), "-o", str(tmp_path / "c.json")]
        main([*words, "--lens-model", "opencv4", "--json", "--force"])
        found.append(json.loads(capsys.readouterr().out))
    assert found[0]["matrix"] == found[1]["matrix"]
    assert main(["intrinsics", str(bag), "--squares", "5x4", "--square", "0.02", "-o", "x", "--topic", "eyes=/a"]) == 2
    assert "--topic" in capsys.readouterr().err


def test_a_batch_takes_a_bag(tmp_path: Path) -> None:
    """Its rows are those of `vbaa estimate`; and it is not done again until it changes."""
    bag, rig, out = write(tmp_path / "demo.mcap", count=COUNT), small_rig() / "rig.json", tmp_path / "one.csv"
    assert main(["estimate", str(bag), "--rig", str(rig), "-o", str(out), "--no-report"]) == 0
    results = Results(tmp_path / "results")
    results.prepare(["vbaa", "batch"])
    recording = BatchRecording("demo", bag, rig)
    outcome = do(recording, BatchSettings(background=Path("auto")), results)
    assert (outcome.state, outcome.row["frames"]) == ("done", COUNT)
    one, other = read_contacts(out), read_contacts(results.contacts("demo"))
    assert one.status.tolist() == other.status.tolist()
    np.testing.assert_allclose(other.distance_m, one.distance_m, rtol=1e-8)
    assert do(recording, BatchSettings(background=Path("auto")), results).state == "unchanged"
    bag.write_bytes(bag.read_bytes()[:-200])
    assert do(recording, BatchSettings(background=Path("auto")), results).state == "failed"
