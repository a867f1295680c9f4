"""A user's way by commands on a drawn world; its contacts against the truth, and against those of the true rig."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import chi2

from benchmarks.harness import SILENT
from estimator.table.contacts import LOCATED, ContactTable
from estimator.table.files import read_contacts
from vbaa_calib.camera import Camera
from vbaa_calib.cli import main
from vbaa_calib.core.errors import VbaaError
from vbaa_calib.core.files import read_json, write_json
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.rig import Antenna, AntennaImage, MomentSensor, Rig
from vbaa_calib.rig.parts import RIG_PARAMETERS
from vbaa_calib.session.drift import Drift

from .rigs import GRAVITY, Place, World
from .session import Truth, follow


@dataclass(frozen=True, eq=False)
class Judged:
    """A recording's located contacts (K,) with one rig.

    error_m, std_m : of the distances. point_covered : how many world points lie in their 95 % regions.
    free_located : free frames in which a contact was located. touched : contacts that there are.
    """

    error_m: np.ndarray
    std_m: np.ndarray
    point_covered: int
    free_located: int
    touched: int

    @property
    def silent(self) -> int:
        """Located, and far beyond what is stated, or where nothing touches."""
        return int((np.abs(self.error_m) > SILENT * self.std_m).sum()) + self.free_located


def called(*words: str | Path) -> tuple[int, str]:
    """Exit code of a command of `vbaa`, and all that it printed."""
    heard = StringIO()
    with redirect_stderr(heard), redirect_stdout(heard):
        code = main([str(word) for word in words])
    return code, heard.getvalue()


def _last(text: str) -> str:
    return (text.strip().splitlines() or [""])[-1].removeprefix("vbaa: ")


def contacts_of(folder: Path, rig: Path, output: Path) -> tuple[int, str, ContactTable | None]:
    """Exit code, what is wrong or else the last words, and the table of `vbaa estimate`; None where it refuses."""
    code, text = called("estimate", folder, "--rig", rig, "-o", output, "--no-report", "--accept-rig", "--force")
    words = next((line for line in text.splitlines() if line.startswith("wrong")), _last(text))
    return code, words, read_contacts(output) if code < 2 and output.exists() else None


def judge(table: ContactTable, truth: Truth) -> Judged:
    """Contacts against the truth."""
    located, touched = np.isin(table.status, LOCATED), np.isfinite(truth.distance_m)
    rows = np.flatnonzero(located & touched)
    off = table.point_world_m[rows] - truth.point_world_m[rows]
    squares = [e @ np.linalg.pinv(c) @ e for e, c in zip(off, table.covariance_world_m2[rows], strict=True)]
    return Judged(
        error_m=table.distance_m[rows] - truth.distance_m[rows],
        std_m=table.distance_std_m[rows],
        point_covered=int((np.array(squares) <= chi2.ppf(0.95, 3)).sum()),
        free_located=int((located & ~touched).sum()),
        touched=int(touched.sum()),
    )


def true_rig(world: World, like: Rig | None) -> Rig:
    """The rig as it is, known exactly; what it looks like is a calibration's, where there is one."""
    wire, optics = world.wire, world.optics
    matrix = np.array(
        [[optics.focal_px[0], 0, optics.centre_px[0]], [0, optics.focal_px[1], optics.centre_px[1]], [0, 0, 1]]
    )
    model = "fisheye" if optics.family == "fisheye" else "opencv"
    coefficients = np.pad(optics.coefficients, (0, 2)) if optics.family == "radial" else optics.coefficients
    own = [*wire.clamp_yz_m, *wire.clamp_yz_rad, *wire.bow_yz_per_m]
    own += [np.log(wire.stiffness_Nm2), np.log(wire.mass_per_length_kg_m), wire.give_m]
    return Rig(
        camera=Camera(model, optics.size, matrix, coefficients),
        T_antenna_camera=pose_of(world.camera),
        antenna=Antenna(wire.length_m, wire.diameter_m, np.array(own)),
        moment_sensor=MomentSensor.none() if world.reads is None else MomentSensor(*world.reads),
        kinematics=Kinematics(pose_of(world.actuator), world.origin_m),
        gravity_world_m_s2=GRAVITY,
        image=AntennaImage(0.1, 1.0, world.paint[0] > 0.5) if like is None else like.image,
        covariance=np.zeros((len(RIG_PARAMETERS), len(RIG_PARAMETERS))),
    )


def pose_of(place: Place) -> Pose:
    """As the library has it."""
    return Pose(place.turn.as_matrix(), place.shift_m)


@dataclass(frozen=True, eq=False)
class Outcome:
    """Of one world.

    Attributes
    ----------
    calibrated, words : exit code and last line of `vbaa calibrate`. verdict : severity, names of findings.
    pulls : name → error over standard deviation of what was calibrated. loads_left_out : clean ones.
    shared_m : deviation of distance that all frames share: now, as forecast after what the calibration advises, and
        as it is after that; NaN without.
    ours, true, refined : contacts with the calibrated rig, the true one, and after `vbaa refine`; None: refused.
    alone : with the calibrated rig as it is, without what free frames of the recording show of it.
    """

    calibrated: int
    words: str
    verdict: str = ""
    lens: str = ""
    pulls: dict[str, float] | None = None
    loads_left_out: int = 0
    shared_m: tuple[float, float, float] = (np.nan, np.nan, np.nan)
    ours: Judged | None = None
    true: Judged | None = None
    refined: Judged | None = None
    alone: Judged | None = None
    estimate_words: str = ""
    refine_words: str = ""

    @property
    def sentences(self) -> tuple[str, ...]:
        """Why something was refused, and what was found."""
        return self.words * (self.calibrated > 1), self.verdict, self.estimate_words, self.refine_words


def outcome(world: World, truth: Truth, folder: Path) -> Outcome:
    """Calibrate, estimate, refine; and estimate with the true rig."""
    rig_json, csv = folder.parent / "rig.json", folder.parent / "contacts.csv"
    code, text = called("calibrate", folder, "-o", rig_json, "--force")
    found, rig = Outcome(code, _last(text)), None
    try:
        rig = Rig.load(rig_json) if code < 2 else None
    except VbaaError as error:
        found = replace(found, words=f"written and refused: {error}")
    true_json = folder.parent / "true.json"
    write_json(true_json, true_rig(world, rig).to_dict(), True)
    exact = contacts_of(folder, true_json, folder.parent / "true.csv")
    found = replace(found, true=None if exact[2] is None else judge(exact[2], truth))
    if rig is None:
        return found
    described = read_json(rig_json)["quality"]
    estimated = contacts_of(folder, rig_json, csv)
    found = replace(
        found,
        verdict=", ".join([rig.verdict.severity, *(one.name for one in rig.verdict.findings)]),
        lens=described["lens"].get("lens_model", rig.camera.model),
        pulls=pulls(world, rig),
        loads_left_out=sum(not still["kept"] for still in described["stills"] if "distance_m" in still),
        estimate_words=estimated[1] if estimated[0] else "",
    )
    if estimated[2] is None:
        return found
    unmoved = folder.parent / "alone.json"
    write_json(unmoved, replace(rig, drift=Drift()).to_dict(), True)
    alone = contacts_of(folder, unmoved, folder.parent / "alone.csv")[2]
    refined, words = _refined(folder, rig_json, csv, truth)
    shared = _followed(world, folder, described["guide"])
    found = replace(found, refined=refined, refine_words=words, shared_m=shared)
    return replace(found, ours=judge(estimated[2], truth), alone=None if alone is None else judge(alone, truth))


def _followed(world: World, folder: Path, guide: Mapping[str, Any]) -> tuple[float, float, float]:
    """Shared deviation of distance now, as forecast, and once the session has what its calibration advises."""
    now, advised, after = guide.get("distance_shared_std_m", np.nan), guide.get("next", ()), np.nan
    if not advised:
        return now, np.nan, np.nan
    follow(world, folder, advised)
    rig = folder.parent / "followed.json"
    if called("calibrate", folder, "-o", rig, "--force")[0] < 2:
        after = read_json(rig)["quality"]["guide"].get("distance_shared_std_m", np.nan)
    return now, advised[-1]["distance_shared_std_m"], after


def _refined(folder: Path, rig: Path, csv: Path, truth: Truth) -> tuple[Judged | None, str]:
    """The contacts after `vbaa refine`; None and why, where it leaves them as they are."""
    output = csv.with_name("refined.csv")
    code, text = called("refine", csv, "--rig", rig, "--session", folder, "-o", output, "--accept-rig", "--force")
    why = next((line for line in text.splitlines() if line.startswith("not refined")), _last(text) * (code > 0))
    return (None, why) if why else (judge(read_contacts(output), truth), "")


def pulls(world: World, rig: Rig) -> dict[str, float]:
    """Errors of stiffness, focal length and camera pose in their standard deviations; of the pose's six the largest."""
    true = true_rig(world, rig)
    stiffness = (rig.antenna.parameters[6] - true.antenna.parameters[6]) / rig.std("log_stiffness_Nm2")
    focal = (rig.camera.matrix[0, 0] - world.optics.focal_px[0]) / rig.std("fx") if rig.with_lens else np.nan
    step = true.T_antenna_camera.tangent_from(rig.T_antenna_camera)
    pose = np.abs(step / np.sqrt(np.diag(rig.covariance)[:6]))
    return {"stiffness": float(stiffness), "focal": float(focal), "pose": float(pose.max())}


def together(several: Sequence[Judged]) -> tuple[np.ndarray, np.ndarray]:
    """Errors and standard deviations of many worlds' contacts."""
    errors, stds = ([getattr(one, name) for one in several] for name in ("error_m", "std_m"))
    return np.concatenate([np.zeros(0), *errors]), np.concatenate([np.zeros(0), *stds])
