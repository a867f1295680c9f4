"""Place and force of the same contacts by our estimators, by SciPy, also with PyElastica's rod, and by what others
publish: the neuroscience method (force from the curvature near the base, place known) and the paper's formulas.

Planar contacts bend the antenna across the camera's line of sight; spatial ones in any direction. The frames come from
the closed form, which the estimators do not use, with white noise on every point.
"""

from __future__ import annotations

import json
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.calibration.methods import INTERPRETERS, MARK, interpreter_of, version_in
from benchmarks.estimator.baselines import at_shares, one_contact
from benchmarks.estimator.bound import bound
from benchmarks.estimator.cameras import Answer, ContactsRow, answer, cameras_text, judged, run
from benchmarks.estimator.scenes import Scenes, elastica_shapes, push_for_slope, rolled, scenes
from benchmarks.estimator.setup import Setup
from benchmarks.harness import Findings, Options, table, timed
from benchmarks.simulators import peer_script
from estimator.paper.two_point import force_z, two_point_contact
from vbaa_calib.antenna.elastica import _planar_elastica as planar_elastica
from vbaa_calib.core.console import progress
from vbaa_calib.export.simulators import export

NOISES_PX = (0.05, 0.5)
_REACH = (0.2, 0.95)
"""Contact distances in lengths."""
_SLOPES_RAD = (0.05, 0.6)
"""Slopes of the antenna at the contact."""
_AT = 0.3
"""Where the neuroscience method takes the curvature, in contact distances: near the base, as Pammer et al.,
J. Neurosci. 33 (2013) 6726, and Birdwell et al., J. Neurophysiol. 98 (2007) 2439, do."""
_SEGMENTS = 20
"""Of PyElastica's rod: its tip is then right to 0.03 % of the length."""
_SPAN = 0.2
"""How far to both sides the cubic is fitted that the curvature is of, in contact distances."""


def ours(frames: Scenes, moment: bool = True) -> Answer:
    """By `ContactEstimator.estimate_batch`, with the moment's reading or without."""
    read = frames.moment_Nm if moment else np.full(len(frames), np.nan)
    return answer(frames.estimated(moment_Nm=read))


def _unstated(distance_m: np.ndarray, force_N: np.ndarray) -> Answer:
    """Of a method that does not say how well it knows."""
    return distance_m, np.full(len(distance_m), np.nan), force_N, np.full_like(force_N, np.nan)


def scipy_loop(frames: Scenes) -> Answer:
    """By SciPy's least squares over distance and force, frame by frame."""
    return _bent_forces(frames, np.array([one_contact(frames, index) for index in range(len(frames))]))


def _bent_forces(frames: Scenes, found: np.ndarray) -> Answer:
    """Of distances and forces (B, 3), these on the straight antenna."""
    distance, *push = found.T
    force = np.full((2, len(frames)), np.nan)
    good = np.isfinite(distance) & (distance > 0.0)
    if good.any():  # the force stands on the bent antenna: across the straight one it is smaller
        shape = planar_elastica(
            distance[good, None], distance[good], np.hypot(*push)[good], frames.rig.antenna.stiffness_Nm2, 0.0
        )
        force[:, good] = np.cos(shape.theta_rad[:, 0]) * np.array(push)[:, good]
    return _unstated(distance, force.T)


def two_points(frames: Scenes) -> Answer:
    """By the paper's formulas, from a point on the curved part and one on the straight part, named by the truth."""
    pixels = np.take_along_axis(frames.points_px, at_shares(frames, (0.6, 2.0))[..., None], axis=1)
    x, y = np.moveaxis(frames.rig.camera_on_plane().project(pixels)[0], -1, 0)
    antenna = frames.rig.antenna
    found = two_point_contact(x, y, antenna.stiffness_Nm2, antenna.length_m)
    force = np.column_stack([found.force_y_N, force_z(frames.moment_Nm, found.contact_m)])
    return _unstated(np.asarray(found.contact_m), force)


def from_curvature(frames: Scenes) -> Answer:
    """By κ·EI near the base over the lever of the force, which acts along the antenna's normal at the known place."""
    xy = frames.rig.camera_on_plane().project(frames.points_px)[0]
    force = np.full((len(frames), 2), np.nan)
    for index, (line, contact) in enumerate(zip(xy, frames.distance_m, strict=True)):
        share = frames.arclength_m / contact
        x, y = line[np.abs(share - _AT) < _SPAN].T
        along = np.polynomial.Polynomial.fit(x, y, 3)
        at = float(line[np.argmin(np.abs(share - _AT)), 0])
        slope = along.deriv()(at)
        moment = frames.rig.antenna.stiffness_Nm2 * along.deriv(2)(at) / (1.0 + slope**2) ** 1.5
        end = line[np.abs(share - 1.0) < 0.1]
        tangent = np.linalg.svd(end - end.mean(axis=0))[2][0]
        normal = np.array([-tangent[1], tangent[0]]) * np.sign(tangent[0])
        lever = end.mean(axis=0) - [at, float(along(at))]
        force[index] = moment / (lever[0] * normal[1] - lever[1] * normal[0]) * normal[1], 0.0
    return _unstated(np.full(len(frames), np.nan), force)


def pyelastica(frames: Scenes) -> Answer:
    """By SciPy's least squares over distance and force, with shapes that a rod in PyElastica comes to rest in."""
    interpreter, script = interpreter_of("elastica"), Path(peer_script.__file__)
    found = np.full((len(frames), 3), np.nan)
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder, "antenna.py"))
        export(frames.rig, "pyelastica", path, segments=_SEGMENTS)
        for index in range(len(frames)):  # each from a rod at rest
            command = [interpreter or "", str(script), "contacts", path]
            with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as peer:

                def bent(at_m: float, force_N: np.ndarray, peer: subprocess.Popen[str] = peer) -> np.ndarray:
                    assert peer.stdin is not None
                    assert peer.stdout is not None
                    print(json.dumps({"at_m": at_m, "force_N": force_N.tolist()}), file=peer.stdin, flush=True)
                    return np.array(json.loads(peer.stdout.readline().removeprefix(MARK)))

                found[index] = one_contact(frames, index, bent)
    return _bent_forces(frames, found)


_FEW = {"PyElastica least squares": 2}
"""Contacts of each kind that a method gets which takes many seconds for one."""
METHODS: dict[str, Callable[[Scenes], Answer]] = {
    "ours": ours,
    "ours, no moment": lambda frames: ours(frames, moment=False),
    "SciPy least squares": scipy_loop,
    "PyElastica least squares": pyelastica,
    "curvature near the base, place known": from_curvature,
    "the paper's two points": two_points,
}


def contacts(kind: str, count: int, noise_px: float, rng: np.random.Generator) -> Scenes:
    """Noisy frames of planar or spatial contacts."""
    rig = Setup("brown", swing_m=0.1).rig()
    distance = rig.antenna.length_m * rng.uniform(*_REACH, count)
    size = push_for_slope(rng.uniform(*_SLOPES_RAD, count), distance, rig.antenna.stiffness_Nm2)
    roll = np.where(rng.random(count) < 0.5, 0.0, np.pi) if kind == "planar" else rng.uniform(-np.pi, np.pi, count)
    return scenes(rig, distance, rolled(size, roll), made_by=elastica_shapes, sigma_px=noise_px).noisy(rng)


def _rows(kind: str, noise_px: float, frames: Scenes) -> list[ContactsRow]:
    rows: list[ContactsRow] = []
    for name, method in METHODS.items():
        if method is pyelastica and interpreter_of("elastica") is None:
            continue
        some = frames.picked(np.arange(min(len(frames), _FEW.get(name, len(frames)))))
        if name not in _FEW:
            method(frames.picked(np.arange(2)))  # what is made ready once
        found, seconds = timed(lambda: method(some))  # noqa: B023
        ms = 1e3 * seconds / len(some)
        rows.append(judged((kind, noise_px, name), [some], [found], bound(some), ms, rows[0].ms if rows else ms))
    return rows


def measure(options: Options) -> Findings:
    """All methods on every kind of contacts."""
    rows: list[ContactsRow] = []
    cases = [(kind, noise) for noise in NOISES_PX for kind in ("planar", "spatial")]
    for number, (kind, noise) in enumerate(progress(cases, "contacts", len(cases))):
        frames = contacts(kind, options.draws, noise, np.random.default_rng((options.seed, number)))
        rows += _rows(kind, noise, frames)
    best = next(row for row in rows if row.method == "ours" and row.kind == "spatial")
    scipy = next(row for row in rows if row.method == "SciPy least squares" and row.kind == "spatial")
    headline = f"spatial, 0.05 px: {best.place_median_mm:.2f} mm median; {scipy.ms / best.ms:.0f} times SciPy's speed"
    several = run(options.draws, options.seed)
    text = f"{table(rows, 'contacts by every method', once=2)}\n\n{cameras_text(several)}"
    peer = interpreter_of("elastica")
    if peer is None:
        text += f"\nPyElastica: absent ({INTERPRETERS} names the interpreter that has it)"
    version = {"pyelastica": str(version_in(peer, "elastica")) if peer else "absent"}
    return Findings(text, {"race.csv": rows, "race_cameras.csv": several}, {}, {}, headline, version)
