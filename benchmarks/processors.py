"""The same answers on every processor: `make processors`.

Each scene is simulated once. Then child processes calibrate it and estimate its contacts, each as another processor
would: with another kernel of OpenBLAS, without the wider instructions of NumPy and OpenCV, with two threads. Their
results are compared with this machine's own, in deviations; the table is in benchmarks/processors.md. The variables
are set for the child processes alone. Exit 1 where anything is apart.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from datetime import date
from multiprocessing import get_context
from pathlib import Path
from typing import Any
from unittest.mock import patch

import cv2
import numpy as np
import yaml
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__
from threadpoolctl import threadpool_info

from benchmarks.harness import markdown, replace_marked
from benchmarks.real_sets import SETS
from estimator.contact.contacts import Contacts
from estimator.table.contacts import ContactTable
from estimator.table.files import read_contacts
from vbaa_calib.calibrate.lens.intrinsics import LensSolution, solve_intrinsics
from vbaa_calib.cli.main import main as vbaa
from vbaa_calib.core.files import read_yaml
from vbaa_calib.detect.board.corners import detect_folder
from vbaa_calib.native import core, levels
from vbaa_calib.rig import Rig
from vbaa_calib.simulate.scene.scene import bundled_scene
from viz.cli.demo import SCENES


@dataclass
class Report:
    """Numbers by name with their standard deviations, arrays of one shape each; and what is said in words or flags."""

    numbers: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    statuses: dict[str, Any] = field(default_factory=dict)

    def add(self, name: str, values: Any, std: Any, *, own: bool = True) -> None:
        """Numbers and deviations; `own` adds the deviations themselves, which count in parts of themselves."""
        values, std = np.broadcast_arrays(np.asarray(values, float), np.asarray(std, float))
        self.numbers[name] = values, std
        if own:
            self.numbers[f"{name}: deviation"] = std, np.abs(std)


@dataclass(frozen=True)
class Apart:
    """How far two reports are apart.

    deviations : by name, the largest difference in deviations; infinite where one has a number and the other has not.
    statuses : names of what they say differently. most, where : the largest difference of all, and its name.
    """

    deviations: dict[str, float]
    statuses: list[str]

    @property
    def most(self) -> float:
        return max(self.deviations.values(), default=0.0)

    @property
    def where(self) -> str:
        return max(self.deviations, key=lambda name: self.deviations[name], default="")


def apart(one: Report, other: Report) -> Apart:
    """The difference of two reports in deviations of the first one."""
    names = sorted(one.numbers.keys() | other.numbers.keys())
    deviations = {name: _difference(one.numbers.get(name), other.numbers.get(name)) for name in names}
    said = sorted(one.statuses.keys() | other.statuses.keys())
    return Apart(deviations, [name for name in said if one.statuses.get(name) != other.statuses.get(name)])


def _difference(one: tuple[np.ndarray, np.ndarray] | None, other: tuple[np.ndarray, np.ndarray] | None) -> float:
    if one is None or other is None or one[0].size != other[0].size:
        return float("inf")
    values, std, others = one[0].ravel(), one[1].ravel(), other[0].ravel()
    same = (values == others) | (np.isnan(values) & np.isnan(others))
    with np.errstate(all="ignore"):
        # what has no deviation must be the same
        off = np.where(same, 0.0, np.abs(others - values) / np.where((std > 0.0) & np.isfinite(std), std, 0.0))
    return float(np.nan_to_num(off, nan=np.inf, posinf=np.inf).max(initial=0.0))


def of_lens(lens: LensSolution) -> Report:
    """A lens from pictures of the board."""
    report = Report()
    covariance = lens.camera.covariance
    assert covariance is not None
    free = np.diag(covariance) > 0.0
    report.add("lens", lens.camera.parameters[free], np.sqrt(np.diag(covariance)[free]))
    report.add("lens: rms", lens.rms_inliers_px, lens.rms_inliers_px, own=False)
    shape = lens.board_shape
    report.add("board's shape", shape.parameters, shape.std)
    views = {view.name: [view.corners, sorted(view.outlier_ids), view.outlying] for view in lens.views}
    report.statuses = {
        "model": lens.model,
        "views": views,
        "dropped": sorted([view.name, view.reason] for view in lens.dropped),
        "monotonic": lens.monotonic,
        "verdict": lens.verdict_dict(),
        "models that halves agree on": [row.model for row in lens.comparison if row.split_half_agrees],
    }
    return report


def of_rig(rig: Rig) -> Report:
    """A calibrated rig: camera pose, antenna, sensor, lens, joint axes."""
    report, std = Report(), np.sqrt(np.clip(np.diag(rig.covariance), 0.0, None))
    sensor = rig.moment_sensor
    # a turn by as little as two calibrations differ is the difference of their rotation vectors
    values = [rig.T_antenna_camera.vector, rig.antenna.parameters, [sensor.gain, sensor.offset_Nm]]
    names = {"camera pose": slice(0, 6), "antenna": slice(6, 15), "moment sensor": slice(15, 17)}
    for (name, rows), value in zip(names.items(), values, strict=True):
        report.add(name, value, std[rows])
    report.numbers["EI"] = np.array([rig.antenna.stiffness_Nm2]), np.array([rig.antenna.stiffness_Nm2 * std[12]])
    if rig.with_lens:
        free = std[17:] > 0.0
        report.add("lens", rig.camera.parameters[free], std[17:][free])
    joints = rig.kinematics
    moving = joints.axes_std > 0.0
    axes = np.array([joints.axis_skew_rad, joints.axis_offset_m, joints.tilt_zero_rad])
    report.add("joint axes", axes[moving], joints.axes_std[moving])
    for name, value in (("noise", rig.image.noise_px), ("noise's scale", rig.image.noise_scale)):
        report.add(name, value, value, own=False)
    report.statuses = {"bright": rig.image.bright, "lens model": rig.camera.model}
    return report


def of_contacts(found: Contacts | ContactTable) -> Report:
    """Contacts from the estimator, or out of contacts.csv."""
    report = Report()
    report.add("distance", found.distance_m, found.distance_std_m)
    if isinstance(found, ContactTable):
        force = np.stack([found.force_y_N, found.force_z_N], axis=1)
        std = np.stack([found.force_y_std_N, found.force_z_std_N], axis=1)
    else:
        force, std = found.force_N[:, 1:], found.force_std_N[:, 1:]
    report.add("force", force, std)
    report.add("point", found.point_world_m, _std(found.covariance_world_m2))
    report.add("friction angle", found.friction_angle_rad, found.friction_angle_std_rad)
    report.statuses = {"status": [str(status) for status in found.status]}
    return report


def _std(covariances: np.ndarray) -> np.ndarray:
    return np.sqrt(np.maximum(np.diagonal(covariances, axis1=1, axis2=2), 0.0))


def joined(reports: Mapping[str, Report]) -> Report:
    """Several reports as one, names with the reports' before them."""
    whole = Report()
    for title, report in reports.items():
        whole.numbers |= {f"{title}: {name}": pair for name, pair in report.numbers.items()}
        whole.statuses |= {f"{title}: {name}": said for name, said in report.statuses.items()}
    return whole


ALIKE = 1e-3
"""Deviations by which a number may differ from one processor to another."""
WAYS = "three ways"
"""The demo's scene with few frames, whose plane C is found by jig, sweep and the board under the antenna."""
STAGES = ("calibration", "contacts")
_KERNELS = {"Nehalem": "SSE42", "Sandybridge": "AVX", "Haswell": "AVX2", "Zen": "AVX2", "SkylakeX": "AVX512_SKX"}
"""OpenBLAS' kernels, each with what a processor must have to run it, as NumPy calls it."""


Machine = tuple[str, Mapping[str, str], int]
"""Another processor: its name in the table, what its processes' environment says, and their threads."""


def _machines() -> list[Machine]:
    """Those that this processor can stand in for."""
    able = {name for name, has in __cpu_features__.items() if has}
    wide = [word.strip("*?") for word in cv2.getCPUFeaturesLine().split() if word.startswith("*")]
    narrow = {
        "NPY_DISABLE_CPU_FEATURES": " ".join(name for name in __cpu_dispatch__ if name in able),
        "OPENCV_CPU_DISABLE": ",".join(wide),
    }
    narrow["VBAA_PROCESSOR"] = "" if len(levels) == 1 else levels[0]
    narrow = {name: words for name, words in narrow.items() if words}
    kernels = [name for name, needed in _KERNELS.items() if needed in able]
    found: list[Machine] = [(name, {"OPENBLAS_CORETYPE": name}, 1) for name in kernels]
    found += [(f"{name.split('_')[0]} narrow", {name: words}, 1) for name, words in narrow.items()]
    found += [(f"VBAA {level}", {"VBAA_PROCESSOR": level}, 1) for level in levels[1:-1]]
    found.append(("two threads", {}, 2))
    if kernels:
        found.append((f"{kernels[0]}, all narrow, two threads", {"OPENBLAS_CORETYPE": kernels[0]} | narrow, 2))
    return found


def simulated(folder: Path, scenes: Sequence[str]) -> dict[str, Path]:
    """The sessions, made in a folder if they are not there yet."""
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
        if vbaa(["simulate", scene, "-o", str(found[title])]) != 0:
            raise SystemExit(f"vbaa simulate {scene} failed")
    return found


_Reports = dict[str, dict[str, Report]]
"""By scene and stage."""


def _child(
    threads: int, sessions: Mapping[str, Path], boards: Path | None
) -> tuple[_Reports, list[str], dict[str, list[str]]]:
    """What a child process does: calibrates and estimates all sessions.

    Beside the reports the kernels of OpenBLAS, and by variable the wider instructions that it used all the same.
    """
    import torch

    cv2.setNumThreads(threads)
    torch.set_num_threads(threads)
    reports = {title: _whole_way(session) for title, session in sessions.items()}
    if boards is not None:
        lenses = {one.title: solve_intrinsics(detect_folder(boards / one.folder, one.spec), one.spec) for one in SETS}
        reports["photographs"] = {"calibration": joined({title: of_lens(lens) for title, lens in lenses.items()})}
    words = cv2.getCPUFeaturesLine().split()
    used = {
        "NPY_DISABLE_CPU_FEATURES": [name for name in __cpu_dispatch__ if __cpu_features__[name]],
        "OPENCV_CPU_DISABLE": [word for word in words if word.startswith("*") and not word.endswith("?")],
        "VBAA_PROCESSOR": [core.__name__] if f".{os.environ.get('VBAA_PROCESSOR')}." not in core.__name__ else [],
    }
    kernels = {str(each["architecture"]) for each in threadpool_info() if each["internal_api"] == "openblas"}
    return reports, sorted(kernels), used


def _whole_way(session: Path) -> dict[str, Report]:
    """By the commands that a user types, and the library for what they do not write down."""
    with tempfile.TemporaryDirectory() as folder:
        rig_file, contacts_file = f"{folder}/rig.json", f"{folder}/contacts.csv"
        for argv in (
            ["calibrate", str(session), "-o", rig_file],
            ["estimate", str(session), "--rig", rig_file, "-o", contacts_file, "--no-report"],
        ):
            if vbaa(argv) != 0:
                raise SystemExit(f"vbaa {argv[0]} failed on {session}")
        rig, contacts = Rig.load(Path(rig_file)), read_contacts(Path(contacts_file))
    return {"calibration": of_rig(rig), "contacts": of_contacts(contacts)}


def _on(machine: Machine, sessions: Mapping[str, Path], boards: Path | None) -> tuple[_Reports, str]:
    """What a child process reports, and the kernels it ran on."""
    name, environment, count = machine
    threads = {variable: str(count) for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")}
    with patch.dict(os.environ, {**threads, **environment}), ProcessPoolExecutor(1, get_context("spawn")) as pool:
        reports, kernels, used = pool.submit(_child, count, sessions, boards).result()
    asked = environment.get("OPENBLAS_CORETYPE")
    if asked is not None and asked not in kernels:
        raise SystemExit(f"{name}: OpenBLAS ran on {kernels}")
    for variable, wide in used.items():
        if variable in environment and wide:
            raise SystemExit(f"{name}: {wide} in spite of {variable}")
    return reports, " ".join(kernels)


def main() -> int:
    """Measure, print and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", nargs="+", default=[*SCENES, WAYS], help="which scenes (default: all)")
    parser.add_argument("--photographs", type=Path, metavar="DATA", help="the real photo sets: their lenses, too")
    parser.add_argument("--folder", type=Path, help="where the sessions are kept (default: nowhere)")
    parser.add_argument("--page", type=Path, help="page to write the table into (benchmarks/processors.md)")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        sessions = simulated(args.folder or Path(folder), args.scenes)
        here, kernel = _on(("this machine", {}, 1), sessions, args.photographs)
        rows = [["this machine", kernel, *_key_numbers(here), *["" for _ in STAGES]]]
        good = True
        for machine in _machines():
            there, kernel = _on(machine, sessions, args.photographs)
            cells = []
            for stage in STAGES:
                found = [joined({t: r[stage] for t, r in each.items() if stage in r}) for each in (here, there)]
                off = apart(*found)
                words = f"{off.most:.0e}" if off.most else "0"
                cells.append(f"{words}, {len(off.statuses)} statuses" if off.statuses else words)
                if off.statuses or off.most > ALIKE:
                    good = False
                    print(f"{machine[0]}, {stage}: {off.most:.1e} at {off.where}; {off.statuses}", file=sys.stderr)
            rows.append([machine[0], kernel, *_key_numbers(there), *cells])
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
    words = []
    for value, std in ((rig["EI"][0][0], rig["EI"][1][0]), (rig["lens"][0][0], rig["lens"][1][0])):
        words.append(f"{value:.{max(0, 4 - int(np.floor(np.log10(std))))}f}")
    return words


if __name__ == "__main__":
    sys.exit(main())
