"""`vbaa bench simulators`: exported antennas at rest in MuJoCo and PyElastica, beside our static rod."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.estimator.setup import GRAVITY_WORLD_M_S2, LENGTH_M, Setup
from benchmarks.harness import Findings, Options, column, table
from benchmarks.peers import INTERPRETERS, answers, interpreter_of, versions
from vbaa_calib.antenna.rod import solve_rod
from vbaa_calib.core.console import progress
from vbaa_calib.core.errors import SolveError
from vbaa_calib.export.simulators import _ExportSettings as ExportSettings
from vbaa_calib.export.simulators import export
from vbaa_calib.rig import Rig

_PEERS = {"mujoco": ("mujoco", "antenna.xml"), "pyelastica": ("elastica", "antenna.py")}
"""Simulator → the package to import, the file that is exported."""
_MOST_SLOPE = 1.2
_LIMIT = 1e-3  # of the length: what a tip may be off


@dataclass(frozen=True)
class Row:
    """Tips of one simulator over all loads of an antenna; differences in parts of the antenna's length."""

    simulator: str = column("simulator")
    antenna: str = column("antenna")
    segments: int = column("segments", "d")
    loads: int = column("loads", "d")
    deflection: float = column("deflected, % L", ".1f", 100.0)
    median: float = column("median, % L", ".4f", 100.0)
    worst: float = column("worst, % L", ".4f", 100.0)
    moment_Nm: float = column("moment, µN·m", ".2f", 1e6)
    seconds: float = column("s a load", ".2f")


def _antennas(quick: bool) -> dict[str, Rig]:
    """A straight one, and one with bow, clamp off its place and giving way, its joints' axes off, too."""
    straight, real = replace(Setup().rig(), gravity_world_m_s2=GRAVITY_WORLD_M_S2), Setup(real=True).rig()
    parameters = real.antenna.parameters.copy()
    parameters[4:6], parameters[8] = [0.3, -0.2], 1.5e-3
    joints = replace(real.kinematics, axis_skew_rad=0.02, axis_offset_m=0.01, tilt_zero_rad=0.03)
    real = replace(real, antenna=replace(real.antenna, parameters=parameters), kinematics=joints)
    return {"bowed": real} if quick else {"straight": straight, "bowed": real}


def measure(options: Options) -> Findings:
    """Random joint angles and forces at the tip."""
    antennas = _antennas(options.quick)
    counts = (ExportSettings.segments,) if options.quick else (20, ExportSettings.segments, 80)
    present = [name for name, (package, _) in _PEERS.items() if interpreter_of(package)]
    absent = [name for name in _PEERS if name not in present]
    every = [(simulator, antenna, count) for simulator in present for antenna in antennas for count in counts]
    rows = [_row(what, antennas[what[1]], options) for what in progress(every, "antennas at rest")]
    rows += [Row(name, "absent", 0, 0, *[float("nan")] * 5) for name in absent]
    text = table(rows, "tips against the static rod, under gravity and a force at the tip", once=2)
    if absent:
        text += f"\n{' and '.join(absent)}: absent ({INTERPRETERS} names the interpreter that has it)"
    of_default = [row for row in rows if row.segments == ExportSettings.segments]
    most = max((row.worst for row in of_default), default=float("nan"))
    headline = f"tips at most {100 * most:.3f} % of L from the rod (0.1 %)" if present else "no simulator here"
    numbers = {"worst": most, "within": bool(most < _LIMIT), "absent": absent}
    packages = tuple(package for package, _ in _PEERS.values())
    return Findings(text, {"simulators.csv": rows}, {}, numbers, headline, versions(packages))


def _row(what: tuple[str, str, int], rig: Rig, options: Options) -> Row:
    """A simulator, an antenna and its segments: the loads in it and by the rod."""
    rng, rod, draws = np.random.default_rng(options.seed), rig.antenna.rod, options.draws
    (package, file), in_world = _PEERS[what[0]], what[0] == "mujoco"
    angles = rng.uniform(-0.6, 0.6, (draws, 2)) if in_world else np.zeros((draws, 2))
    force = rng.normal(size=(draws, 3)) * [0.3, 1.0, 1.0] * _MOST_SLOPE * rod.bending_stiffness_Nm2 / LENGTH_M**2
    force[0] = 0.0
    turns, places = rig.kinematics.world_antenna(*angles.T)
    gravity = np.einsum("i,bij->bj", rig.gravity_world_m_s2, turns)
    ends = np.full(draws, rod.length_m)
    ours, free = solve_rod(rod, gravity, ends, force), solve_rod(rod, 0.0 * gravity, ends, 0.0 * force)
    tips = ours.points_m[:, -1]
    deflection = np.linalg.norm(tips - free.points_m[:, -1], axis=1)
    if in_world:
        tips = np.einsum("bij,bj->bi", turns, tips) + places
        force = np.einsum("bij,bj->bi", turns, force)
    loads = [
        {"pan": pan, "tilt": tilt, "force_N": one}
        for (pan, tilt), one in zip(angles.tolist(), force.tolist(), strict=True)
    ]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, file)
        export(rig, what[0], path, segments=what[2])
        found, failure = answers(package, loads, str(path))
    failure = next((one["failure"] for one in found if "failure" in one), failure if len(found) < draws else "")
    if failure:
        raise SolveError(f"{what[0]}: {failure}")
    off = np.linalg.norm(np.array([one["tip_m"] for one in found]) - tips, axis=1) / rod.length_m
    moments = np.array([np.nan if one["moment_Nm"] is None else one["moment_Nm"] for one in found])
    return Row(
        *what,
        draws,
        deflection=float(deflection.max()) / rod.length_m,
        median=float(np.median(off)),
        worst=float(off.max()),
        moment_Nm=float(np.abs(moments + ours.clamp_moment_Nm[:, 1]).max()),
        seconds=float(np.mean([one["seconds"] for one in found])),
    )
