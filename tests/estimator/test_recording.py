"""From a recording's files to the estimator and back: what is handed over, in which order, and how much at a time."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path

import numpy as np

from estimator.contact.recording import estimate_centrelines
from estimator.table.contacts import Contact, Measured
from estimator.table.files import read_contacts
from tests.estimator.drawn_frames import CONTACT_M, path_px, rig_of, shape
from vbaa_calib.cli.main import main
from vbaa_calib.rig import Rig
from vbaa_calib.session import Frame

FRAMES = [
    Frame(None, 0.01 * n, -0.02 * n, 1e-3 * n, frame=10 + n, time_s=0.1 * n, moment_z_Nm=-1e-3 * n) for n in range(10)
]
SIGMAS = [0.1, 0.2, np.nan, 0.3]
LINES = {frame.frame: np.column_stack([np.full((4, 2), float(frame.frame)), SIGMAS]) for frame in FRAMES}


class Chunked:
    """Stands in for an estimator that takes its frames four at a time and answers with each frame's own time."""

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.taken: list[Measured] = []

    def run(self, recording: Iterable[Measured]) -> Iterator[Contact]:
        rest = iter(recording)
        while chunk := list(islice(rest, 4)):
            self.taken += chunk
            yield from (
                Contact(status="ok", reason=f"{seen.time_s:.1f}", model="rod", in_contact=True) for seen in chunk
            )


def test_every_frame_gets_its_own_contact() -> None:
    estimator = Chunked(rig_of((320, 240)))
    found = list(estimate_centrelines(estimator, FRAMES, LINES))
    assert [item.frame for item in found] == FRAMES
    assert [item.contact.reason for item in found] == [f"{frame.time_s:.1f}" for frame in FRAMES]
    for item in found:
        seen = item.measured
        assert seen is not None
        assert (seen.points_px == item.frame.frame).all()
        noise = estimator.rig.image.noise_px
        np.testing.assert_array_equal(seen.sigma_px, [0.1, 0.2, noise, 0.3])
        expected = item.frame
        assert (seen.moment_Nm, seen.moment_z_Nm) == (expected.moment_Nm, expected.moment_z_Nm)
        assert (seen.pan_rad, seen.tilt_rad, seen.time_s) == (expected.pan_rad, expected.tilt_rad, expected.time_s)


def test_frames_are_made_when_they_are_asked_for() -> None:
    estimator = Chunked(rig_of((320, 240)))
    found = estimate_centrelines(estimator, FRAMES, LINES)
    assert not estimator.taken
    assert [item.frame.frame for item in islice(found, 5)] == [10, 11, 12, 13, 14]
    assert len(estimator.taken) == 8


def written(folder: Path, moments: str) -> Path:
    """A session of three touched frames, as centrelines with noise, with these moments (comma-separated cells)."""
    rig = rig_of((640, 480))
    path = path_px(rig, shape(rig))[::8]
    (folder / "recording").mkdir(parents=True)
    (folder / "rig.json").write_text(json.dumps(rig.to_dict()))
    (folder / "session.yaml").write_text(
        "schema: vbaa.session/1\nboard: {squares_x: 9, squares_y: 6, square_m: 0.012, marker_m: 0.009}\n"
        "antenna: {length_m: 0.24, diameter_m: 0.001, youngs_modulus_Pa: 193.0e9, density_kg_m3: 7900.0}\n"
        "gravity_world: [0, 0, -9.80665]\nmoment_sensor: {std_Nm: 2.0e-5}\n"
    )
    cells = [f"{n},{0.1 * n},0,0,{moment}" for n, moment in enumerate(moments.split(","))]
    (folder / "recording" / "recording.csv").write_text("\n".join(["frame,time_s,pan_rad,tilt_rad,moment_Nm", *cells]))
    rng, lines = np.random.default_rng(3), ["frame,u_px,v_px,sigma_px"]
    for n in range(3):
        seen = path + rig.image.noise_px * rng.normal(size=path.shape)
        lines += [f"{n},{u:.6f},{v:.6f},{rig.image.noise_px}" for u, v in seen]
    (folder / "recording" / "centrelines.csv").write_text("\n".join(lines))
    return folder


def test_centrelines_from_a_folder_to_a_table(tmp_path: Path) -> None:
    rig = rig_of((640, 480))
    moment = float(shape(rig).moment_Nm[0])
    folder = written(tmp_path, f"{moment},{moment},")
    argv = ["estimate", str(folder), "--rig", str(folder / "rig.json"), "-o", str(folder / "contacts.csv")]
    assert main(argv) == 0
    table = read_contacts(folder / "contacts.csv")
    assert table.frame.tolist() == [0, 1, 2]
    assert table.status[:2].tolist() == ["ok", "ok"]
    assert (np.abs(table.distance_m[:2] - CONTACT_M) < 4 * table.distance_std_m[:2]).all()
    assert np.isfinite(table.moment_residual_Nm).tolist() == [True, True, False]
    assert np.isfinite(table.friction_angle_std_rad[:2]).all()
    assert np.isfinite(table.condition[:2]).all()
