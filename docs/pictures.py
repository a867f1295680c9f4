"""Renew the documentation's pictures from a run of this release: `make docs-pictures`.

    python docs/pictures.py [FOLDER]      # FOLDER of a demo that was run already; without it the demo is run

Needs Chromium for the pages. `python examples/NAME.py --figures docs/images/examples` renews
the figure of an example, `drawings.py` the drawings.
"""

from __future__ import annotations

import argparse
import os
import pty
import re
import select
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np
import yaml

from viz.cli import view
from viz.parts.assemble import all_parts
from viz.render.stage import Stage
from viz.render.window import _Controls

IMAGES = Path(__file__).parent / "images"
VISIBLE, HIDDEN = 10, 50
"""Frames of the demo: the contact in sight, and behind the object."""
_BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
_FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--hide-scrollbars",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
)
_LENS_PICTURES = 4
_PATIENCE_S = 180


def vbaa(*words: object) -> None:
    """Run a verb, whose failure ends this program."""
    subprocess.run([sys.executable, "-m", "vbaa_calib", *map(str, words)], check=True)


def page(address: str, name: str, size: tuple[int, int], *flags: str) -> None:
    """A page as a browser of this size shows it, as a PNG, or as a JPEG by the name's suffix."""
    with tempfile.TemporaryDirectory() as folder:
        shot = Path(folder) / "shot.png"
        where = (f"--window-size={size[0]},{size[1]}", f"--screenshot={shot}")
        subprocess.run([str(_BROWSER), *_FLAGS, *flags, *where, address], check=True, stderr=subprocess.DEVNULL)
        quality = [cv2.IMWRITE_JPEG_QUALITY, 88] if name.endswith(".jpg") else []
        cv2.imwrite(str(IMAGES / name), cv2.imread(str(shot)), quality)


def of_the_demo(demo: Path) -> None:
    """Scene, report, overlay, budget and two frames."""
    shutil.copy(demo / "scene.png", IMAGES / "scene.png")
    page(f"{(demo / 'scene.html').as_uri()}#contact=12&view=1", "view.png", (1300, 850), "--virtual-time-budget=15000")
    page((demo / "report.html").as_uri(), "report.jpg", (1180, 900))
    vbaa("budget", demo / "rig.json", "--figure", IMAGES / "budget.svg", "--force")
    vbaa("estimate", demo / "session", "--rig", demo / "rig.json", "-o", demo / "again.csv", "--no-report", "--force",
         "--overlay", demo / "seen")  # fmt: skip
    shutil.copy(next((demo / "seen").glob(f"frame_{HIDDEN:06d}_*.jpg")), IMAGES / "seen.jpg")
    frames = [cv2.imread(str(demo / "session/recording" / f"frame_{frame:04d}.png")) for frame in (VISIBLE, HIDDEN)]
    half = np.hstack([cv2.resize(frame, (576, 432), interpolation=cv2.INTER_AREA) for frame in frames])
    cv2.imwrite(str(IMAGES / "frames.png"), half[72:360])


def of_the_window(demo: Path) -> None:
    """The window of `vbaa view`, drawn without a screen, a contact picked."""
    parser = argparse.ArgumentParser()
    view.configure(parser)
    words = (demo / "contacts.csv", "--rig", demo / "rig.json", "--session", demo / "session")
    scene, _ = view._scene_of(parser.parse_args(list(map(str, words))))
    stage = Stage(scene, all_parts(scene), size=(1250, 850))
    controls = _Controls(stage, "force")
    controls.add_to_window()
    stage.look_at_all()
    controls.pick(12)
    stage.plotter.screenshot(str(IMAGES / "window.png"))
    stage.plotter.close()


def of_the_wizard(demo: Path, folder: Path) -> None:
    """The wizard's page in the lens step, some pictures of the demo's board taken."""
    source = folder / "pictures"
    source.mkdir()
    for path in sorted((demo / "session/intrinsics").glob("*.png"))[:_LENS_PICTURES]:
        shutil.copy(path, source)
    board = yaml.safe_load((demo / "session/session.yaml").read_text(encoding="utf-8"))["board"]
    answers = {
        "board": demo / "session/session.yaml",
        "board-along-x-mm": 1e3 * board["square_m"] * board["squares_x"],
        "board-along-y-mm": 1e3 * board["square_m"] * board["squares_y"],
        "source": source,
        "lens-source": source,
        "antenna-length-mm": 240,
        "camera-distance-mm": 320,
        "camera-inclination-deg": 30,
    }
    flags = [word for key, value in answers.items() for word in (f"--{key}", str(value))]
    command = [sys.executable, "-m", "vbaa_calib", "wizard", "my_rig", *flags]
    ours, theirs = pty.openpty()
    wizard = subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs, close_fds=True, cwd=folder)
    try:
        said, end = "", time.monotonic() + _PATIENCE_S
        while f"{_LENS_PICTURES:04d}.png" not in said:
            if time.monotonic() > end or wizard.poll() is not None:
                raise SystemExit(f"the wizard took no {_LENS_PICTURES} pictures:\n{said}")
            if select.select([ours], [], [], 1.0)[0]:
                said += os.read(ours, 65536).decode(errors="replace")
        address = re.search(r"http://127\.0\.0\.1:\S+", said)
        assert address is not None
        page(address[0], "wizard.png", (1280, 900), "--timeout=15000")
    finally:
        wizard.terminate()
        wizard.wait()


def main() -> None:
    """Pictures of the demo, then of the window and the wizard."""
    if _BROWSER is None:
        raise SystemExit("no Chromium here: install chromium")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        demo = Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else folder / "demo"
        if len(sys.argv) <= 1:
            vbaa("demo", "--out", demo)
        of_the_demo(demo)
        of_the_window(demo)
        of_the_wizard(demo, folder)


if __name__ == "__main__":
    main()
