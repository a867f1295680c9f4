"""Comparison of two results: contacts, whole batches or rigs; their differences in standard deviations, and the
page."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from estimator.table.contacts import ContactTable
from vbaa_calib.camera import Camera
from vbaa_calib.core.robust import finite_or_none
from vbaa_calib.rig import RIG_PARAMETERS, Rig
from vbaa_calib.rig.over_time import parameter_std
from viz.figures.drawing import Plot, limits
from viz.figures.settings import STYLE
from viz.pages.page import Table, number, render
from viz.scene.readable import thinned

_QUANTITIES = {
    "distance": ("distance_m", "distance_std_m", "m"),
    "force_y": ("force_y_N", "force_y_std_N", "N"),
    "force_z": ("force_z_N", "force_z_std_N", "N"),
}


@dataclass(frozen=True, eq=False)
class ComparedContacts:
    """Two tables of the same frames.

    A difference is B minus A. Differences are also compared with the root of the mean of both variances: results from
    the same measurements differ by a small part of it, results from independent ones by 1.4 of it, rms.

    Attributes
    ----------
    frames : (F,) numbers of the frames in both. only_a, only_b : how many are in one alone.
    changed : (status of A, of B) → frames, where they differ.
    located : (K,) frames in which both have a contact.
    differences : (K,) of distance, force_y and force_z, m or N; of the point its distance, m.
    deviations : the same over that root; of the point by its whole covariance.
    """

    frames: np.ndarray
    only_a: int
    only_b: int
    changed: Mapping[tuple[str, str], int]
    located: np.ndarray
    differences: Mapping[str, np.ndarray]
    deviations: Mapping[str, np.ndarray]

    def off(self, tolerance: float) -> int:
        """Frames that only one table has, that differ in status, or that are more than `tolerance` standard
        deviations apart."""
        far = np.zeros(len(self.located), bool)
        for values in self.deviations.values():
            far |= ~(np.abs(values) <= tolerance)
        return self.only_a + self.only_b + sum(self.changed.values()) + int(far.sum())

    @property
    def count(self) -> int:
        """Number of frames of A or B."""
        return len(self.frames) + self.only_a + self.only_b

    def to_dict(self, tolerance: float) -> dict[str, Any]:
        """The comparison in numbers."""
        return {
            "frames": self.count,
            "off": self.off(tolerance),
            "only_a": self.only_a,
            "only_b": self.only_b,
            "changed": [{"a": a, "b": b, "frames": count} for (a, b), count in self.changed.items()],
            "located": len(self.located),
            "deviations": {
                name: _spread(values, self.differences[name], self.located) for name, values in self.deviations.items()
            },
        }


def _spread(deviations: np.ndarray, differences: np.ndarray, frames: np.ndarray) -> dict[str, Any] | None:
    """Rms of the deviations (N,), the largest, its difference and its frame; None without any."""
    if not len(deviations):
        return None
    size = np.abs(deviations)
    most = int(np.argmax(np.where(np.isnan(size), np.inf, size)))
    return {
        "rms": finite_or_none(np.sqrt(np.mean(size**2))),
        "largest": finite_or_none(deviations[most]),
        "largest_difference": finite_or_none(differences[most]),
        "largest_frame": int(frames[most]),
    }


def compare_contacts(a: ContactTable, b: ContactTable) -> ComparedContacts:
    """Differences b − a of two contact tables in the frames that both have."""
    frames, at_a, at_b = np.intersect1d(a.frame, b.frame, return_indices=True)
    one, other = a.picked(at_a), b.picked(at_b)
    differ = one.status != other.status
    changed = Counter(zip(one.status[differ].tolist(), other.status[differ].tolist(), strict=True))
    both = one.located & other.located
    one, other = one.picked(both), other.picked(both)
    differences, deviations = {}, {}
    for name, (value, std, _) in _QUANTITIES.items():
        difference = getattr(other, value) - getattr(one, value)
        differences[name] = difference
        deviations[name] = _over(difference, _pooled(getattr(one, std), getattr(other, std)))
    apart = other.point_world_m - one.point_world_m
    differences["point"] = np.linalg.norm(apart, axis=1)
    deviations["point"] = _mahalanobis(apart, 0.5 * (one.covariance_world_m2 + other.covariance_world_m2))
    alone = len(a) - len(frames), len(b) - len(frames)
    return ComparedContacts(frames, *alone, dict(changed.most_common()), frames[both], differences, deviations)


def _pooled(own_std: np.ndarray, other_std: np.ndarray) -> np.ndarray:
    return np.sqrt(0.5 * (own_std**2 + other_std**2))


def _over(difference: np.ndarray, std: np.ndarray) -> np.ndarray:
    """Differences divided by their standard deviations; 0 where they are equal, also for exact quantities."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(difference == 0.0, 0.0, difference / std)


def _mahalanobis(apart: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(K,) Mahalanobis lengths of (K, 3) by covariances (K, 3, 3); NaN where one is unknown."""
    found = np.where((apart == 0.0).all(axis=1), 0.0, np.nan)
    known = np.flatnonzero(np.isfinite(covariance).all(axis=(1, 2)) & np.isfinite(apart).all(axis=1) & (found != 0.0))
    inverse = np.linalg.pinv(covariance[known], hermitian=True)
    found[known] = np.sqrt(np.clip(np.einsum("ki,kij,kj->k", apart[known], inverse, apart[known]), 0.0, None))
    return found


@dataclass(frozen=True, eq=False)
class _ComparedRigs:
    """Two rigs compared parameter by parameter: names, standard deviations of A and B, B minus A, and that in
    standard deviations, (P,) each; and the settings, which count as exact, that differ. Lenses of two models are
    compared by `_apart_px`."""

    names: tuple[str, ...]
    std_a: np.ndarray
    std_b: np.ndarray
    difference: np.ndarray
    deviations: np.ndarray
    settings: tuple[str, ...]

    def beyond(self, tolerance: float) -> list[str]:
        """Parameters more than `tolerance` standard deviations apart, and settings that differ."""
        far = ~(np.abs(self.deviations) <= tolerance)
        return [*(name for name, is_far in zip(self.names, far, strict=True) if is_far), *self.settings]

    def to_dict(self, tolerance: float) -> dict[str, Any]:
        """The comparison in numbers."""
        columns = zip(self.names, self.difference, self.std_a, self.std_b, self.deviations, strict=True)
        return {
            "beyond": self.beyond(tolerance),
            "settings": list(self.settings),
            "parameters": {
                name: {
                    "difference": finite_or_none(difference),
                    "std_a": finite_or_none(std_a),
                    "std_b": finite_or_none(std_b),
                    "deviations": finite_or_none(deviations),
                }
                for name, difference, std_a, std_b, deviations in columns
            },
        }


def compare_rigs(a: Rig, b: Rig) -> _ComparedRigs:
    """Comparison of two rigs, with any lens models."""
    step = b.step_from(a)
    std = [parameter_std(rig)[: len(step)] for rig in (a, b)]
    names = (*RIG_PARAMETERS, *a.camera.parameter_names)[: len(step)]
    one, other = a.to_dict(), b.to_dict()
    same_lens = len(step) > len(RIG_PARAMETERS)
    sensors = a.moment_sensor.exists and b.moment_sensor.exists
    known = [index for index, name in enumerate(names) if sensors or not name.startswith("moment_")]
    names, step, std = tuple(names[index] for index in known), step[known], [one[known] for one in std]
    settings = [name for name in ("kinematics", "gravity_world", "drift") if one[name] != other[name]]
    settings += ["moment_sensor"] * (a.moment_sensor.exists != b.moment_sensor.exists)
    sizes = ("length_m", "diameter_m", "profile", "stiffness_profile")
    settings += [f"antenna.{name}" for name in sizes if one["antenna"].get(name) != other["antenna"].get(name)]
    if a.camera.image_size != b.camera.image_size:
        settings.append("camera.image_size")
    elif not same_lens:
        difference, *stds = _apart_px(a.camera, b.camera)
        names, step = (*names, "projection_px"), np.append(step, difference)
        std = [np.append(own, each) for own, each in zip(std, stds, strict=True)]
    return _ComparedRigs(names, std[0], std[1], step, _over(step, _pooled(std[0], std[1])), tuple(settings))


def _apart_px(a: Camera, b: Camera) -> tuple[float, float, float]:
    """Displacement, px, between two lenses' projections of the same rays, with A's and B's standard deviations, at
    the place over the picture, along columns or rows, where it is largest in standard deviations. NaN where B sees
    no ray of A."""
    width, height = a.image_size
    grid = 9
    u, v = np.meshgrid(np.linspace(0.0, width - 1.0, grid), np.linspace(0.0, height - 1.0, grid))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    rays, known = a.unproject(pixels)
    there, seen = b.project(rays)
    both = known & seen
    std = [_projection_std(camera, at[both]) for camera, at in ((a, pixels), (b, there))]
    apart = np.round((there - pixels)[both], 9)  # less is rounding, also where both lenses count as exact
    size = np.nan_to_num(np.abs(_over(apart, _pooled(*std))), nan=-1.0)
    if size.max(initial=-1.0) < 0.0:
        return math.nan, math.nan, math.nan
    most = np.unravel_index(np.argmax(size), size.shape)
    return float(apart[most]), float(std[0][most]), float(std[1][most])


def _projection_std(camera: Camera, pixels: np.ndarray) -> np.ndarray:
    """(N, 2) standard deviations, px, of the projections of the rays of pixels (N, 2); NaN beyond 90° off the axis."""
    if camera.covariance is None:
        return np.zeros(pixels.shape)
    points, by_pixel, _ = camera.normalized_with_slopes(pixels)
    moved = np.linalg.solve(np.where(np.isnan(by_pixel), np.eye(2), by_pixel), camera.lens_slopes_at(points))
    return np.sqrt(np.einsum("nip,pq,niq->ni", moved, camera.covariance, moved))


def contacts_page(
    title: str, compared: Mapping[str, ComparedContacts], missing: Sequence[str], result: Mapping[str, Any]
) -> str:
    """The page on contacts, by recording where there are several. missing : recordings that only one result has."""
    tolerance = float(result["tolerance"])
    every = [each.to_dict(tolerance) | {"name": name} for name, each in compared.items()]
    rows = [[one["name"], one["frames"], one["off"], *_cells(one["deviations"])] for one in every]
    changed = Counter[tuple[str, str]]()
    for each in compared.values():
        changed.update(each.changed)
    head = ["recording", "frames", "off", *(f"{name}, rms" for name in (*_QUANTITIES, "point")), "largest"]
    figures = []
    if len(compared) == 1:
        (one,) = compared.values()
        figures = [_over_frames(name, one, values, tolerance).svg() for name, values in one.deviations.items()]
    return _page(
        title,
        result,
        figures=figures,
        heading="Contacts",
        numbers=Table(head, rows, ("recording",)),
        changed=Table(("A", "B", "frames"), [[a, b, count] for (a, b), count in changed.most_common()], ("A", "B")),
        missing=missing,
    )


def _cells(deviations: Mapping[str, Any]) -> list[str]:
    known = [one for one in deviations.values() if one is not None]
    largest = max((abs(one["largest"] or 0.0) for one in known), default=0.0)
    return [*(number(one["rms"] if one else None, 3) for one in deviations.values()), number(largest, 3)]


def _over_frames(name: str, one: ComparedContacts, values: np.ndarray, tolerance: float) -> Plot:
    pick = thinned(np.arange(len(values)), 4000)
    # a point beyond this many standard deviations stands at the figure's edge
    top = max(8.0, 1.2 * tolerance)
    x, y = one.located[pick], np.clip(np.nan_to_num(values[pick], nan=top), -top, top)
    labels = ("frame", "deviations")
    axes = Plot(f"{name}: B minus A", x=limits(x), y=limits([-top, top]), labels=labels)
    axes.level(-tolerance, STYLE.amber)
    axes.level(tolerance, STYLE.amber)
    far = np.abs(y) > tolerance
    axes.dots(x[~far], y[~far], STYLE.slate, 3.0)
    axes.dots(x[far], y[far], STYLE.red, 4.0)
    return axes


def rigs_page(title: str, compared: _ComparedRigs, result: Mapping[str, Any]) -> str:
    """The page on two rigs."""
    columns = zip(compared.names, compared.difference, compared.std_a, compared.std_b, compared.deviations, strict=True)
    rows = [[name, *(number(float(value), 3) for value in values)] for name, *values in columns]
    return _page(
        title,
        result,
        figures=[],
        heading="Parameters",
        numbers=Table(("parameter", "B minus A", "± A", "± B", "in deviations"), rows, ("parameter",)),
        changed=Table((), ()),
        missing=(),
    )


def _page(title: str, result: Mapping[str, Any], **parts: Any) -> str:
    headline, colour = ("They agree.", STYLE.teal) if result["agree"] else ("They differ.", STYLE.red)
    return render("compare.html.j2", title=title, colour=colour, headline=headline, words=result["words"], **parts)
