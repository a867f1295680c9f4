"""What rigs, contacts, budgets and objects report, numbers with their deviations, and how far reports are apart."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from estimator.budget.budget import Budget
from estimator.contact.contacts import Contacts
from estimator.object.estimate import ObjectEstimate
from estimator.table.contacts import ContactTable
from vbaa_calib.calibrate.lens.intrinsics import LensSolution
from vbaa_calib.rig import Rig

ACROSS, _NORMALS = "surface", "normals"
"""Names of a surface's points, which are compared across it, and of the normals along which that is done."""


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

    def to_dict(self) -> dict[str, Any]:
        """As JSON takes it; what is not finite as words."""
        numbers = {name: [part.ravel().tolist() for part in pair] for name, pair in self.numbers.items()}
        return {"numbers": numbers, "statuses": self.statuses}

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> Report:
        """What `to_dict` made."""
        pairs = data["numbers"].items()
        return Report(
            {name: (np.array(one, float), np.array(std, float)) for name, (one, std) in pairs}, data["statuses"]
        )


@dataclass(frozen=True)
class Apart:
    """How far two reports are apart.

    Attributes
    ----------
    deviations : by name, the largest difference in deviations; infinite where one has a number and the other has not.
    statuses : names of what they say differently.
    """

    deviations: dict[str, float]
    statuses: list[str]

    @property
    def most(self) -> float:
        """The largest difference of all."""
        return max(self.deviations.values(), default=0.0)

    @property
    def where(self) -> str:
        """Its name."""
        return max(self.deviations, key=lambda name: self.deviations[name], default="")


def apart(one: Report, other: Report) -> Apart:
    """The difference of two reports in deviations of the first one."""
    names = sorted(one.numbers.keys() | other.numbers.keys())
    deviations = {}
    for name in names:
        mine, theirs = one.numbers.get(name), other.numbers.get(name)
        if name.endswith(ACROSS) and mine is not None and theirs is not None and mine[0].size == theirs[0].size:
            mine, theirs = (_across(pair, one.numbers[name.replace(ACROSS, _NORMALS)][0]) for pair in (mine, theirs))
        deviations[name] = _difference(mine, theirs)
    said = sorted(one.statuses.keys() | other.statuses.keys())
    return Apart(deviations, [name for name in said if one.statuses.get(name) != other.statuses.get(name)])


def _across(pair: tuple[np.ndarray, np.ndarray], normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) along given normals (N, 3), and their deviations across the surface (N,)."""
    points, std = (part.reshape(-1, 3) for part in pair)
    return (points * normals.reshape(-1, 3)).sum(axis=1), std[:, 0]


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
    flex = lens.board_flex
    if flex.std_m is not None:
        report.add("board's bend", flex.sagittas_m, flex.std_m)
    views = {view.name: [view.corners, sorted(view.outlier_ids), view.outlying] for view in lens.views}
    report.statuses = {
        "model": lens.model,
        "views": views,
        "dropped": sorted([view.name, view.reason] for view in lens.dropped),
        "bent": flex.used,
        "monotonic": lens.monotonic,
        "verdict": lens.verdict,
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


def of_budget(budget: Budget) -> Report:
    """An error budget: every part, in parts of the whole deviation of its result."""
    report = Report()
    for name, result in budget.results.items():
        parts = [[part.std, part.if_halved, part.if_exact] for part in result.parts.values()]
        report.add(name, parts, result.std, own=False)
        report.add(f"{name}: whole", result.std, result.std, own=False)
    report.statuses = {"touches": len(budget.touches), "first": budget.first, "exact": list(budget.exact)}
    return report


def of_object(felt: ObjectEstimate, contacts: ContactTable) -> Report:
    """The object that contacts tell of: shape, normals, friction, stiffness, events."""
    report, surface, friction, soft = Report(), felt.surface, felt.friction, felt.compliance
    # across the surface its own deviation counts, along it the contact's
    std, along = surface.touched_std_m[:, None], _std(contacts.covariance_world_m2[surface.touched_row])
    report.add(ACROSS, surface.touched_m, std)
    report.add("surface's points", surface.touched_m, np.hypot(std, along), own=False)
    report.add(_NORMALS, surface.touched_normal, _std(surface.touched_normal_covariance))
    report.add("friction", friction.mu, friction.std)
    report.add("compliance", soft.compliance_m_N, soft.std_m_N)
    report.statuses = {
        "patches": surface.touched_patch.tolist(),
        "triangles": len(surface.triangles),
        "friction": [friction.determined, list(map(str, friction.used_as))],
        "stiffness": soft.determined,
        "events": [[event.kind, int(event.frame)] for event in felt.track.events],
    }
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
