"""What there is to see, as plain arrays in the world frame. `viz.actors` draws it; pyvista stays there."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from estimator.surface import Surface
from estimator.table import ContactTable
from vbaa_calib.errors import InputError


@dataclass(frozen=True, eq=False)
class RigItems:
    """The rig at one moment of the recording.

    Attributes
    ----------
    bent_m : (N, 3) the antenna at that moment; free_m (N, 3): where it would be without the object.
    ghosts_m : the antenna in other frames, (N, 3) each.
    antenna_radius_m : of the wire.
    plane_m : (4, 3) corners of the drawn patch of plane C.
    frustum_m : (5, 3) the camera's centre, then the four corners of its picture, brought near.
    """

    bent_m: np.ndarray
    free_m: np.ndarray
    ghosts_m: tuple[np.ndarray, ...]
    antenna_radius_m: float
    plane_m: np.ndarray
    frustum_m: np.ndarray


@dataclass(frozen=True, eq=False)
class Contacts:
    """Located contacts.

    Attributes
    ----------
    points_m : (P, 3) on the antenna's centreline.
    force_N : (P, 3) the object's force on the antenna; NaN where the table gives none.
    bars_m : (P, 2, 3) ends of the longest axis of each 2σ ellipsoid; both at the point where the table gives none.
    """

    points_m: np.ndarray
    force_N: np.ndarray
    bars_m: np.ndarray

    @property
    def size_mN(self) -> np.ndarray:
        """(P,) force magnitudes."""
        return 1e3 * np.linalg.norm(self.force_N, axis=1)


@dataclass(frozen=True, eq=False)
class ObjectMesh:
    """The reconstructed object: points (P, 3), normals (P, 3), triangles (T, 3), lines (E, 2)."""

    points_m: np.ndarray
    normals: np.ndarray
    triangles: np.ndarray
    lines: np.ndarray

    @staticmethod
    def of(surface: Surface) -> ObjectMesh:
        """What is drawn of a reconstructed surface."""
        return ObjectMesh(surface.points_m, surface.normals, surface.triangles, surface.lines)


@dataclass(frozen=True, eq=False)
class TruthObject:
    """The object that was really there: "cylinder", "sphere" or "knife_edge", as in truth.json."""

    shape: str
    center_m: np.ndarray
    axis: np.ndarray
    wedge: np.ndarray
    radius_m: float
    half_length_m: float


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything that is drawn; what is None is left out."""

    contacts: Contacts
    rig: RigItems | None = None
    object: ObjectMesh | None = None
    truth: TruthObject | None = None

    @property
    def touched_m(self) -> tuple[np.ndarray, float]:
        """Centre (3,) and radius of a ball around what was touched."""
        points = [self.contacts.points_m]
        if self.object is not None:
            points.append(self.object.points_m)
        if self.truth is not None:
            points.append(self.truth.center_m[None])
        stacked = np.concatenate(points)
        centre = (stacked.min(axis=0) + stacked.max(axis=0)) / 2
        return centre, max(float(np.linalg.norm(stacked - centre, axis=1).max()), 5e-3)


def build_scene(
    table: ContactTable,
    *,
    rig: RigItems | None = None,
    surface: ObjectMesh | None = None,
    truth: TruthObject | None = None,
) -> Scene:
    """The scene of one recording.

    Parameters
    ----------
    table : its contacts; frames without a located contact are not drawn.

    Raises
    ------
    InputError : there is nothing to draw.
    """
    located = table.located
    if not located.any():
        raise InputError(
            "no frame has a located contact (status ok or tip_contact)", remedy="see the reason column of contacts.csv"
        )
    points = table.point_world_m[located]
    bars = _longest_axes(points, table.covariance_world_m2[located])
    contacts = Contacts(points, table.force_world_N[located], bars)
    return Scene(contacts, rig, surface, truth)


def _longest_axes(points_m: np.ndarray, covariance_m2: np.ndarray) -> np.ndarray:
    known = np.isfinite(covariance_m2).all(axis=(1, 2))
    variance, axes = np.linalg.eigh(np.where(known[:, None, None], covariance_m2, 0.0))
    half = 2 * np.sqrt(np.maximum(variance[:, -1:], 0.0)) * axes[:, :, -1]
    return np.stack([points_m - half, points_m + half], axis=1)


def truth_object(truth: Mapping[str, Any], where: object = "truth.json") -> TruthObject:
    """The touched object out of truth.json's contents. Raises InputError when it is not there or wrong."""
    remedy = "give the truth.json that vbaa simulate wrote"
    data = truth.get("object")
    if not isinstance(data, Mapping):
        raise InputError("has no object", where=where, remedy=remedy)
    shape = data.get("shape")
    if shape not in ("cylinder", "sphere", "knife_edge"):
        raise InputError(f"object.shape is {shape!r}", where=where, remedy=remedy)
    # what a shape does not need may be missing
    spare: dict[str, Any] = {"wedge_world": (0.0, 0.0, 0.0)}
    if shape == "sphere":
        spare |= {"axis_world": (0.0, 0.0, 1.0), "half_length_m": 1.0}
    vectors, numbers = {}, {}
    for name in ("center_world_m", "axis_world", "wedge_world"):
        vectors[name] = _numbers(data.get(name, spare.get(name)), 3, f"object.{name}", where, remedy)
    for name in ("radius_m", "half_length_m"):
        numbers[name] = float(_numbers([data.get(name, spare.get(name))], 1, f"object.{name}", where, remedy)[0])
        if numbers[name] <= 0:
            raise InputError(f"object.{name} is {numbers[name]:g}", where=where, remedy=remedy)
    length = np.linalg.norm(vectors["axis_world"])
    if length == 0:
        raise InputError("object.axis_world has no direction", where=where, remedy=remedy)
    return TruthObject(
        shape,
        vectors["center_world_m"],
        vectors["axis_world"] / length,
        vectors["wedge_world"],
        numbers["radius_m"],
        numbers["half_length_m"],
    )


def _numbers(value: Any, size: int, name: str, where: object, remedy: str) -> np.ndarray:
    try:
        array = np.array(value, float)
    except (TypeError, ValueError, OverflowError):
        array = np.array(math.nan)
    if array.shape != (size,) or not np.isfinite(array).all():
        raise InputError(f"{name} is {value!r}", where=where, remedy=remedy)
    return array
