"""The scene of a result as plain arrays in the world frame, and in words. `viz.parts` draws it with pyvista."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from estimator.table.contacts import ContactTable
from estimator.table.files import read_contacts
from vbaa_calib.core.arrays import Rows
from vbaa_calib.core.errors import InputError
from vbaa_calib.rig import Rig

from .layout import along
from .readable import enlargement, thinned
from .rig_items import RigItems, rig_items

if TYPE_CHECKING:
    from estimator.object.estimate import ObjectEstimate
    from estimator.object.surface import Surface
    from vbaa_calib.simulate.scene.objects import TouchObject

Stamps = tuple[np.ndarray, np.ndarray, str]
"""Contacts (K,), what a shape of size 1 becomes at each (K, 3, 3), m, and a note for the key."""


@dataclass(frozen=True, eq=False)
class Instants(Rows):
    """M instants in the order of time.

    Attributes
    ----------
    row : (M,) index into the contact table. frame : (M,) number of the frame.
    time_s : (M,) since the recording's first frame.
    main : the instant of the greatest force: what a single picture shows.
    words : M sentences on what is known of each instant.
    """

    row: np.ndarray
    time_s: np.ndarray
    frame: np.ndarray
    main: int
    words: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class ShownContacts:
    """P located contacts in the order of time. NaN where the table has no value.

    Attributes
    ----------
    points_m : (P, 3) on the antenna's centreline. force_N : (P, 3) the object's force on the antenna.
    covariance_m2 : (P, 3, 3) of the points. time_s : (P,) since the recording's first frame.
    row : (P,) index into the contact table. words : P sentences, a contact's frame and numbers.
    """

    points_m: np.ndarray
    force_N: np.ndarray
    covariance_m2: np.ndarray
    time_s: np.ndarray
    row: np.ndarray
    words: tuple[str, ...]

    @property
    def size_mN(self) -> np.ndarray:
        """(P,) force magnitudes."""
        return 1e3 * np.linalg.norm(self.force_N, axis=1)

    @property
    def principal(self) -> tuple[np.ndarray, np.ndarray]:
        """(P, 3, 3) unit principal axes of the covariances in columns, and (P, 3) m standard deviations, increasing."""
        known = np.isfinite(self.covariance_m2).all(axis=(1, 2))
        variance, axes = np.linalg.eigh(np.where(known[:, None, None], self.covariance_m2, 0.0))
        return axes, np.where(known[:, None], np.sqrt(np.maximum(variance, 0.0)), np.nan)


@dataclass(frozen=True, eq=False)
class ObjectMesh:
    """The reconstructed object: points (V, 3), normals (V, 3), triangles (T, 3), lines (E, 2).

    `std_m` (V,) is each point's standard deviation along its normal, NaN where it is not known.
    """

    points_m: np.ndarray
    normals: np.ndarray
    triangles: np.ndarray
    lines: np.ndarray
    std_m: np.ndarray

    @staticmethod
    def of(surface: Surface) -> ObjectMesh:
        """The mesh of a reconstructed surface."""
        return ObjectMesh(surface.points_m, surface.normals, surface.triangles, surface.lines, surface.std_m)


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything that is drawn; parts that are None or empty are left out.

    Attributes
    ----------
    normals : (P, 3) the object's outward normal at each contact, NaN where it is undetermined; None for none.
    cone_rad : half angle of the friction cone; None where friction is undetermined.
    framewise_m : (P, 3) where the contacts lay frame by frame, if these are refined ones; None for none.
    facts : sentences on friction, stiffness and shape, or on why they are undetermined.
    pictures : what the camera saw at each instant, (H, W, 3) uint8 RGB all of one size, None where there is none.
    """

    contacts: ShownContacts
    instants: Instants
    rig: RigItems | None = None
    object: ObjectMesh | None = None
    truth: TouchObject | None = None
    normals: np.ndarray | None = None
    cone_rad: float | None = None
    facts: tuple[str, ...] = ()
    framewise_m: np.ndarray | None = None
    pictures: tuple[np.ndarray | None, ...] = ()

    @property
    def bounding_ball_m(self) -> tuple[np.ndarray, float]:
        """Centre (3,) and radius of a sphere around the contacts and the object."""
        points = self.contacts.points_m
        if self.object is not None:
            points = np.concatenate([points, self.object.points_m])
        centre = (points.min(axis=0) + points.max(axis=0)) / 2
        return centre, max(float(np.linalg.norm(points - centre, axis=1).max()), 5e-3)

    @property
    def ball_m(self) -> float:
        """Radius of the sphere drawn at each contact."""
        return 0.02 * self.bounding_ball_m[1]

    def arrows(self) -> Stamps:
        """Contacts with a force, and linear maps (3, 3) from a unit arrow to theirs, with the first column along the
        force."""
        contacts, reach = self.contacts, self.bounding_ball_m[1]
        pushed = thinned(np.flatnonzero(contacts.size_mN > 0), 100)
        lengths = 0.45 * reach * contacts.size_mN[pushed] / contacts.size_mN[pushed].max(initial=1e-12)
        return pushed, lengths[:, None, None] * along(contacts.force_N[pushed]), ""

    def spreads(self) -> Stamps:
        """Ellipsoids of two standard deviations by their half axes, enlarged until the median one is visible."""
        (axes, std), reach = self.contacts.principal, self.bounding_ball_m[1]
        half = 2 * std
        known = np.flatnonzero(half[:, 2] > 0)
        factor, chosen = enlargement(half[known, 2], 0.04 * reach), thinned(known, 60)
        # flat ones get some thickness: a mesh without any has no normals
        half = np.maximum(half[chosen], 0.02 * half[chosen, 2:])
        return chosen, factor * axes[chosen] * half[:, None, :], f"{factor}x enlarged" if factor > 1 else ""

    def cones(self) -> Stamps:
        """Friction cones: the first column leads from the apex to the rim's centre, the others are radii of the rim."""
        if self.normals is None or self.cone_rad is None:
            return np.zeros(0, int), np.zeros((0, 3, 3)), ""
        chosen = thinned(np.flatnonzero(np.isfinite(self.normals).all(axis=1)), 16)
        # steep cones are drawn shorter, for the rim to stay as near
        half = min(self.cone_rad, 1.5)
        height = 0.42 * self.bounding_ball_m[1] * np.cos(half)
        stretch = np.diag([height, height * np.tan(half), height * np.tan(half)])
        return chosen, along(self.normals[chosen]) @ stretch, f"half angle {np.degrees(self.cone_rad):.1f}°"

    def level_grid(self, rig: RigItems) -> tuple[np.ndarray, float]:
        """Lines (N, 2, 3) of a horizontal grid of round squares under everything, and a square's side, m; empty
        where the squares would be too many."""
        centre, reach = self.bounding_ball_m
        known = np.isfinite(rig.poses[:, 0, 0])
        points = np.vstack([rig.bent_m[known].reshape(-1, 3), centre + reach, centre - reach])
        low, high = points.min(axis=0), points.max(axis=0)
        side = float(np.hypot(*(high - low)[:2]))
        step = next(
            (size for size in (0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0) if side / size <= 12), None
        )
        if step is None:
            return np.zeros((0, 2, 3)), 0.0
        first, last = np.floor(low[:2] / step - 0.25) * step, np.ceil(high[:2] / step + 0.25) * step
        level = low[2] - 0.02 * side
        x, y = (np.arange(a, b + step / 2, step) for a, b in zip(first, last, strict=True))
        rows = [np.array([[first[0], at, level], [last[0], at, level]]) for at in y]
        columns = [np.array([[at, first[1], level], [at, last[1], level]]) for at in x]
        return np.array([*rows, *columns]), step


def build_scene(
    table: ContactTable,
    rig: Rig | None = None,
    estimate: ObjectEstimate | None = None,
    truth: TouchObject | None = None,
    with_words: bool = True,
) -> Scene:
    """The scene without the camera's pictures.

    with_words : also each contact's numbers in words.

    Raises InputError when nothing is located, a contact is out of reach, or the contacts are not of this rig.
    """
    instants = _instants_of(table, None if estimate is None else estimate.track.phase)
    items = None if rig is None else rig_items(rig, table, instants.row, instants.main)
    row, time_s = np.flatnonzero(table.located), table.time_s - table.time_s[0]
    points, forces, covariances = table.point_world_m, table.force_world_N, table.covariance_world_m2
    phase = [""] * len(table) if estimate is None else list(map(str, estimate.track.phase))
    std = lateral_force_N(table)[1]
    words = tuple(_numbers(table, int(index), phase[index], std[index]) for index in row) if with_words else ()
    contacts = ShownContacts(points[row], forces[row], covariances[row], time_s[row], row, words)
    if estimate is None:
        return Scene(contacts, instants, items, truth=truth)
    # a normal less certain than 20° would show the force's direction, not the object's: not drawn
    friction, known = estimate.friction, estimate.normals.std_rad < np.radians(20)
    normals = np.full((len(table), 3), np.nan)
    normals[friction.row[known]] = estimate.normals.normal[known]
    facts = [f"{fact.label}: {fact.words}" for fact in object_facts(estimate)]
    return Scene(
        contacts,
        instants,
        items,
        ObjectMesh.of(estimate.surface),
        truth,
        normals=normals[row],
        cone_rad=float(friction.cone_half_angle_rad) if friction.determined else None,
        facts=(*facts, *map(sentence, estimate.surface.notes)),
    )


def framewise(path: Path, refined: ContactTable) -> ContactTable:
    """The frame-wise contacts of a refined table, row for row. Raises InputError for those of another recording."""
    table = read_contacts(path)
    if len(table) != len(refined) or (table.frame != refined.frame).any():
        raise InputError(
            "has other frames than the refined contacts", where=path, remedy="give the contacts.csv they were made of"
        )
    return table


def _instants_of(table: ContactTable, phase: np.ndarray | None = None, most: int = 240) -> Instants:
    """The instants of a recording. phase : (B,) a word per frame on its motion, as in `Track`.

    Raises InputError when no frame has a located contact, or one is out of reach.
    """
    refuse_out_of_reach(table)
    if not table.located.any():
        raise InputError(
            "no frame has a located contact (status ok or tip_contact)", remedy="see the reason column of contacts.csv"
        )
    # tables of other makers may have points without forces
    force, std = np.linalg.norm(table.force_world_N, axis=1), lateral_force_N(table)[1]
    strongest = int(np.argmax(np.where(table.located, np.nan_to_num(force), -1.0)))
    rows = np.union1d(thinned(np.arange(len(table)), most), strongest)
    return Instants(
        row=rows,
        time_s=table.time_s[rows] - table.time_s[0],
        frame=table.frame[rows],
        main=int(np.searchsorted(rows, strongest)),
        words=tuple(
            _words(table, int(row), "" if phase is None else str(phase[row]), (force[row], std[row])) for row in rows
        ),
    )


def refuse_out_of_reach(table: ContactTable, where: object = None) -> None:
    """Raises InputError for a contact beyond 10 km or 10 kN, where single precision, in which all is drawn, fails."""
    for values, unit in ((table.force_world_N, "N"), (table.point_world_m, "m")):
        beyond = np.flatnonzero(table.located & (np.abs(np.nan_to_num(values)) > 1e4).any(axis=1))
        if len(beyond):
            what = f"frame {table.frame[beyond[0]]} has a contact beyond 10000 {unit}"
            raise InputError(what, where=where, remedy="estimate it again: no antenna reaches that far")


def _words(table: ContactTable, row: int, phase: str, force: tuple[float, float]) -> str:
    """A contact in words, such as "sliding: 157.4 ± 0.2 mm from the clamp, 69.1 ± 0.4 mN". force : its size and
    standard deviation, N."""
    status = str(table.status[row]).replace("_", " ")
    known = [phase] if phase not in ("", "unknown", "free") else []
    head = ", ".join(known if known and status == "ok" else [*known, "located" if status == "ok" else status])
    if not table.located[row]:
        return head
    distance, std = table.distance_m[row], table.distance_std_m[row]
    parts = []
    if np.isfinite(distance):
        spread = f" ± {1e3 * std:.2g}" if np.isfinite(std) else ""
        parts.append(f"{1e3 * distance:.1f}{spread} mm from the clamp")
    size, std = force
    if np.isfinite(size):
        parts.append(f"{1e3 * size:.1f}{f' ± {1e3 * std:.2g}' if np.isfinite(std) else ''} mN")
    return f"{head}: {', '.join(parts)}" if parts else head


def lateral_force_N(table: ContactTable) -> tuple[np.ndarray, np.ndarray]:
    """(B,) sizes of the forces across the antenna, and their standard deviations: the largest possible ones where the
    covariance of y and z is not known."""
    y, z = table.force_y_N, table.force_z_N
    y_part, z_part = np.abs(y) * table.force_y_std_N, np.abs(z) * table.force_z_std_N
    size, covariance = np.hypot(y, z), table.force_covariance_yz_N2
    crossed = np.where(np.isfinite(covariance), y * z * covariance, y_part * z_part)
    std = np.sqrt(np.clip(y_part**2 + z_part**2 + 2.0 * crossed, 0.0, None))
    return size, std / np.where(size > 0.0, size, np.nan)


def _numbers(table: ContactTable, row: int, phase: str, force_std_N: float) -> str:
    """All numbers of a located contact, one a line."""
    force, point = 1e3 * table.force_world_N[row], 1e3 * table.point_world_m[row]
    std = 1e3 * np.sqrt(np.diagonal(table.covariance_world_m2[row]).clip(min=0))
    places = zip("XYZ", point, std, strict=True)
    return "\n".join(
        [
            f"frame {table.frame[row]}, {table.time_s[row] - table.time_s[0]:.3f} s",
            _words(table, row, phase, (float(np.linalg.norm(force)) / 1e3, force_std_N)),
            *(
                f"{axis} {value:.2f}" + (f" ± {sd:.2g}" if np.isfinite(sd) else "") + " mm"
                for axis, value, sd in places
            ),
            *([f"force {', '.join(f'{part:.1f}' for part in force)} mN"] if np.isfinite(force).all() else []),
        ]
    )


@dataclass(frozen=True)
class Fact:
    """A line of a verdict. kind : "undetermined", "look" for a problem, or ""."""

    label: str
    words: str
    kind: str = ""


def sentence(text: str) -> str:
    """The text with a capital at its beginning and a full stop at its end."""
    text = text.strip().rstrip(".")
    return f"{text[:1].upper()}{text[1:]}."


def object_facts(estimate: ObjectEstimate) -> tuple[Fact, Fact]:
    """μ and the object's stiffness with their intervals, or the reasons why they are undetermined."""
    friction, compliance = estimate.friction, estimate.surface.compliance
    slides = Fact("Friction", sentence(f"Undetermined: {friction.reason}"), "undetermined")
    if friction.determined:
        low, high = friction.interval
        alpha = np.degrees(friction.cone_half_angle_rad)
        words = f"μ = {friction.mu:.3f} ± {friction.std:.3f} (95 %: {low:.3f} to {high:.3f}), cone half angle α = "
        slides = Fact("Friction", "; ".join(filter(None, [f"{words}{alpha:.1f}°", friction.reason.rstrip(".")])) + ".")
    low, high = compliance.interval_N_m
    if compliance.determined:
        most = f"to {high:.4g} N/m" if np.isfinite(high) else "upwards"
        return slides, Fact("Stiffness", f"{compliance.stiffness_N_m:.4g} N/m (95 %: {low:.4g} {most}).")
    bound = np.isfinite(low) and low > 0
    words = compliance.reason if bound else f"Undetermined: {compliance.reason}"
    return slides, Fact("Stiffness", sentence(words), "undetermined")
