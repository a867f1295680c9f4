"""The whole way on a tiny scene in one process, for the tests that compare processes: everything lands in a folder.

Called as `python -m tests.determinism_run FOLDER THREADS [SESSION]`; a SESSION that is there is not simulated again.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import cv2

from benchmarks.harness import as_json
from estimator import ContactEstimator
from estimator.contact.recording import estimate_picture
from tests.small_scene import simulated, small_scene
from vbaa_calib.cli.main import main
from vbaa_calib.rig import Rig
from vbaa_calib.session import load_session, read_recording


def vbaa(*argv: object) -> None:
    if main([str(part) for part in argv]) != 0:
        raise SystemExit(f"vbaa {argv[0]} failed")


def whole_way(folder: Path, session: Path | None) -> None:
    """Simulate, calibrate, estimate, track, reconstruct; and every contact once more with all its digits."""
    if session is None:
        session = simulated(folder, small_scene(noload=2, loads=(1, 8)))
    rig = folder / "rig.json"
    vbaa("calibrate", session, "-o", rig, "--lens-model", "opencv4")
    vbaa("look", session / "noload" / "noload_001.png", "--rig", rig)
    vbaa("estimate", session, "--rig", rig, "-o", folder / "contacts.csv", "--no-report")
    vbaa("track", folder / "contacts.csv", "--rig", rig, "-o", folder / "track.csv")
    vbaa("reconstruct", folder / "contacts.csv", "--rig", rig, "-o", folder / "object.vtp")
    (folder / "numbers.json").write_text(json.dumps(all_digits(Rig.load(rig), session)))


def all_digits(rig: Rig, session: Path) -> list[dict[str, Any]]:
    """What is known of every frame: contacts.csv rounds to nine digits."""
    estimator = ContactEstimator(rig)
    found = [estimate_picture(estimator, frame) for frame in read_recording(load_session(session))]
    return [as_json(each.contact) for each in found]


if __name__ == "__main__":
    cv2.setNumThreads(int(sys.argv[2]))
    whole_way(Path(sys.argv[1]), Path(sys.argv[3]) if len(sys.argv) > 3 else None)
    assert "torch" not in sys.modules, "it takes a second to load, and nothing here works on tensors"
