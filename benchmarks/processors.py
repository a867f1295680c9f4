"""The same answers on every processor: `make processors`.

Each scene is simulated once. Then child processes calibrate it, estimate contacts and object, and make the error
budget, each as another processor would: with another kernel of OpenBLAS, without the wider instructions of NumPy
and OpenCV, with two threads. What they report is held against this machine's own, in deviations; the table stands in
docs/processors.md. The variables are set for the child processes alone. Exit 1 where anything is apart.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from viz.cli.demo import SCENES

from .pages import markdown, replace_marked
from .reported import Apart, Report, apart, joined, of_budget, of_contacts, of_lens, of_object, of_rig

ROOT = Path(__file__).resolve().parents[1]
ALIKE = 1e-3
"""Deviations by which a number may differ from one processor to another."""
WAYS = "three ways"
"""The demo's scene with few frames, whose plane C is found by jig, sweep and the board under the antenna."""
STAGES = ("calibration", "contacts", "budget", "object")
_KERNELS = {"Nehalem": "SSE42", "Sandybridge": "AVX", "Haswell": "AVX2", "Zen": "AVX2", "SkylakeX": "AVX512_SKX"}
"""OpenBLAS' kernels, each with what a processor must have to run it, as NumPy calls it."""


@dataclass(frozen=True)
class Machine:
    """Another processor: its name in the table, what its processes' environment says, and their threads."""

    name: str
    environment: Mapping[str, str]
    threads: int = 1


def _machines() -> list[Machine]:
    """Those that this processor can stand in for."""
    from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

    able = {name for name, has in __cpu_features__.items() if has}
    narrow = {
        "NPY_DISABLE_CPU_FEATURES": " ".join(name for name in __cpu_dispatch__ if name in able),
        "OPENCV_CPU_DISABLE": ",".join(
            word.strip("*?") for word in cv2.getCPUFeaturesLine().split() if word.startswith("*")
        ),
    }
    narrow = {name: words for name, words in narrow.items() if words}
    kernels = [Machine(name, {"OPENBLAS_CORETYPE": name}) for name, needed in _KERNELS.items() if needed in able]
    others = [
        *kernels,
        *(Machine(f"{name.split('_')[0]} narrow", {name: words}) for name, words in narrow.items()),
        Machine("two threads", {}, 2),
    ]
    if kernels:
        others.append(Machine(f"{kernels[0].name}, all narrow, two threads", dict(kernels[0].environment) | narrow, 2))
    return others


def measure(sessions: Mapping[str, Path], boards: Path | None) -> dict[str, Any]:
    """What one process reports of all sessions, and what it ran on."""
    reports: dict[str, dict[str, Any]] = {}
    for title, session in sessions.items():
        reports[title] = {stage: report.to_dict() for stage, report in _whole_way(session).items()}
    if boards is not None:
        reports["photographs"] = {"calibration": joined(dict(_photographs(boards))).to_dict()}
    return {"reports": reports, **_running()}


def _running() -> dict[str, Any]:
    """What this process runs on: OpenBLAS' kernels, and which wider instructions NumPy and OpenCV use."""
    from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__
    from threadpoolctl import threadpool_info

    ran = {str(library["architecture"]) for library in threadpool_info() if library["internal_api"] == "openblas"}
    words = cv2.getCPUFeaturesLine().split()
    return {
        "kernels": sorted(ran),
        "numpy": [name for name in __cpu_dispatch__ if __cpu_features__[name]],
        "opencv": [word for word in words if word.startswith("*") and not word.endswith("?")],
    }


def _whole_way(session: Path) -> dict[str, Report]:
    """By the commands that a user types, and the library for what they do not write down."""
    from estimator.budget.budget import error_budget
    from estimator.object.estimate import estimate_object
    from estimator.table.files import read_contacts
    from vbaa_calib.cli.main import main
    from vbaa_calib.rig import Rig

    with tempfile.TemporaryDirectory() as folder:
        rig_file, contacts_file = Path(folder) / "rig.json", Path(folder) / "contacts.csv"
        for argv in (
            ["calibrate", str(session), "-o", str(rig_file)],
            ["estimate", str(session), "--rig", str(rig_file), "-o", str(contacts_file), "--no-report"],
        ):
            if main(argv) != 0:
                raise SystemExit(f"vbaa {argv[0]} failed on {session}")
        rig, contacts = Rig.load(rig_file), read_contacts(contacts_file)
    return {
        "calibration": of_rig(rig),
        "contacts": of_contacts(contacts),
        "budget": of_budget(error_budget(rig)),
        "object": of_object(estimate_object(contacts, rig), contacts),
    }


def _photographs(boards: Path) -> Iterator[tuple[str, Report]]:
    from vbaa_calib.calibrate.lens.intrinsics import solve_intrinsics
    from vbaa_calib.detect.board.corners import detect_folder

    from .real_sets import SETS

    for one in SETS:
        yield one.title, of_lens(solve_intrinsics(detect_folder(boards / one.folder, one.spec), one.spec))


def simulated(folder: Path, scenes: Sequence[str]) -> dict[str, Path]:
    """The sessions, made in a folder if they are not there yet."""
    from vbaa_calib.cli.main import main
    from vbaa_calib.core.files import read_yaml
    from vbaa_calib.simulate.scene.scene import bundled_scene

    found = {}
    for title in scenes:
        found[title] = folder / title.replace(" ", "_")
        if (found[title] / "session.yaml").is_file():
            continue
        scene = title
        if title == WAYS:
            data = read_yaml(bundled_scene("demo")) | {
                "name": "ways",
                "seed": 777,
                "sweep": True,
                "over": {"height_m": 0.012, "center_m": [0.13, 0.0], "turn_deg": 8.0, "pictures": 1},
            }
            few = {"frames": 6, "free_frames": 1}
            data["recording"]["sweeps"] = [each | few for each in data["recording"]["sweeps"]]
            scene = str(folder / "ways.yaml")
            Path(scene).write_text(yaml.safe_dump(data), encoding="utf-8")
        if main(["simulate", scene, "-o", str(found[title])]) != 0:
            raise SystemExit(f"vbaa simulate {scene} failed")
    return found


def on(machine: Machine, sessions: Mapping[str, Path], boards: Path | None) -> tuple[dict[str, dict[str, Report]], str]:
    """What a child process reports, and the kernels it ran on."""
    given = {"sessions": {title: str(path) for title, path in sessions.items()}, "threads": machine.threads}
    given["boards"] = None if boards is None else str(boards)
    threads = {"OMP_NUM_THREADS": str(machine.threads), "OPENBLAS_NUM_THREADS": str(machine.threads)}
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **threads, **machine.environment}
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "reports.json"
        done = subprocess.run(
            [sys.executable, "-m", "benchmarks.processors", "--child", json.dumps(given), str(out)],
            cwd=ROOT,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode != 0:
            raise SystemExit(f"{machine.name}: {done.stderr[-2000:]}")
        data = json.loads(out.read_text())
    asked = machine.environment.get("OPENBLAS_CORETYPE")
    if asked is not None and asked not in data["kernels"]:
        raise SystemExit(f"{machine.name}: OpenBLAS ran on {data['kernels']}")
    for library, variable in (("numpy", "NPY_DISABLE_CPU_FEATURES"), ("opencv", "OPENCV_CPU_DISABLE")):
        if variable in machine.environment and data[library]:
            raise SystemExit(f"{machine.name}: {library} ran with {data[library]}")
    reports = {
        title: {stage: Report.from_dict(report) for stage, report in stages.items()}
        for title, stages in data["reports"].items()
    }
    return reports, " ".join(data["kernels"])


def child(given: str, out: str) -> None:
    """What a child process does."""
    import torch

    data = json.loads(given)
    cv2.setNumThreads(data["threads"])
    torch.set_num_threads(data["threads"])
    sessions = {title: Path(path) for title, path in data["sessions"].items()}
    Path(out).write_text(json.dumps(measure(sessions, data["boards"] and Path(data["boards"]))))


def _cell(found: Apart) -> str:
    words = f"{found.most:.0e}" if found.most else "0"
    return f"{words}, {len(found.statuses)} statuses" if found.statuses else words


def main() -> int:
    """Measure, print and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--child", nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--scenes", nargs="+", default=[*SCENES, WAYS], help="which scenes (default: all)")
    parser.add_argument("--photographs", type=Path, metavar="DATA", help="the real photo sets: their lenses, too")
    parser.add_argument("--folder", type=Path, help="where the sessions are kept (default: nowhere)")
    parser.add_argument("--page", type=Path, help="page to write the table into (docs/processors.md)")
    args = parser.parse_args()
    if args.child:
        child(*args.child)
        return 0
    with tempfile.TemporaryDirectory() as folder:
        sessions = simulated(args.folder or Path(folder), args.scenes)
        here, kernel = on(Machine("this machine", {}), sessions, args.photographs)
        rows = [["this machine", kernel, *_key_numbers(here), *["" for _ in STAGES]]]
        good = True
        for machine in _machines():
            there, kernel = on(machine, sessions, args.photographs)
            cells = []
            for stage in STAGES:
                found = [joined({t: r[stage] for t, r in each.items() if stage in r}) for each in (here, there)]
                off = apart(*found)
                cells.append(_cell(off))
                if off.statuses or off.most > ALIKE:
                    good = False
                    print(f"{machine.name}, {stage}: {off.most:.1e} at {off.where}; {off.statuses}", file=sys.stderr)
            rows.append([machine.name, kernel, *_key_numbers(there), *cells])
            print(" | ".join(rows[-1]), file=sys.stderr)
    head = ["processor", "OpenBLAS", "EI of the first scene, N·m²", "focal length, px", *STAGES]
    table = markdown(head, rows)
    print(table)
    if args.page is not None:
        about = f"Measured on {date.today()}, {platform.machine()}, NumPy {np.__version__}, OpenCV {cv2.__version__}."
        replace_marked(args.page, "benchmarks/processors.py", f"{table}\n\n{about}")
    return 0 if good else 1


def _key_numbers(reports: Mapping[str, Mapping[str, Report]]) -> list[str]:
    """EI, N·m², and the focal length, px, of the first scene, to a ten-thousandth of their deviations."""
    rig = next(iter(reports.values()))["calibration"].numbers
    told = []
    for value, std in ((rig["EI"][0][0], rig["EI"][1][0]), (rig["lens"][0][0], rig["lens"][1][0])):
        told.append(f"{value:.{max(0, 4 - int(np.floor(np.log10(std))))}f}")
    return told


if __name__ == "__main__":
    sys.exit(main())
