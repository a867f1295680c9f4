"""The estimator's door for users: centrelines, moments and joint angles in, contacts out, with what they are worth."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
import torch

from estimator.solver.frames import Frames, frames_from_pixels
from estimator.solver.ladder import COARSE_RUNG, find_starts, solve
from estimator.solver.prediction import predict
from estimator.solver.rig_arrays import RigArrays
from estimator.table.contacts import FRICTION_RAD, Contact, Measured
from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.core.arrays import as_index, like
from vbaa_calib.core.errors import InputError
from vbaa_calib.rig import Rig

from .contacts import Contacts, judge
from .inputs import checked_device, column, deviations, in_order, padded, stacked, started
from .motion import Beam
from .quantities import Numbers, none_of, numbers, placed, plain
from .stream import Stream, beam
from .verdict import CONTACT_EVIDENCE, FEWEST_POINTS, unexplained

CHUNK, CHUNK_ON_DEVICE = 512, 1024
"""Frames that are solved at once: on the processor their arrays stay in its cache."""
STREAM = 64
"""Frames of a recording that are solved at once, each chunk from where the one before ended."""
SINGLE = 4
"""Batches up to this size stay on the processor."""
PROCESSOR = "cpu"
"""Where NumPy works, which has shorter calls than torch, and on one core is quicker for batches of any size."""


class ContactEstimator:
    """Contacts from centrelines, for one calibrated rig.

    Parameters
    ----------
    rig : the calibrated rig.
    model : a rung of the ladder, `antenna.rungs.RUNGS`, or "auto" for the lowest whose predicted bias is small against
        the noise.
    friction : rad, standard deviation of the angle by which friction may tilt the force from the antenna's normal;
        0 for contacts that are known to be slippery.
    device : where batches are solved: "cpu" is NumPy on the processor, all others are torch devices ("cpu:0" is torch
        on the processor). Single frames stay in NumPy.

    Raises
    ------
    InputError : an unknown model, a friction that is none, a device that is not there.
    """

    def __init__(
        self, rig: Rig, model: str = "auto", *, friction: float = FRICTION_RAD, device: str = PROCESSOR
    ) -> None:
        if model != "auto" and model not in RUNGS:
            raise InputError(f"model is {model!r}", remedy=f"one of auto, {', '.join(RUNGS)} is needed")
        if not isinstance(friction, int | float) or not 0.0 <= friction <= 1.0:
            raise InputError(f"friction is {friction}", remedy="give the angle's deviation in rad, 0 to 1")
        self.rig = rig
        self.model = model
        self.friction_rad = float(friction)
        self.device = checked_device(device)
        self._rig_arrays = RigArrays.from_rig(rig, self.friction_rad, np.empty(0))
        self._rig_arrays_on_device = self._rig_arrays
        if device != PROCESSOR:
            reference = torch.empty(0, dtype=torch.float64, device=self.device)
            self._rig_arrays_on_device = RigArrays.from_rig(rig, self.friction_rad, reference)

    def estimate(
        self,
        centreline_px: np.ndarray,
        *,
        moment: float | None,
        pan: float,
        tilt: float,
        sigma_px: np.ndarray | float | None = None,
        moment_z: float | None = None,
    ) -> Contact:
        """One frame.

        Parameters
        ----------
        centreline_px : (N, 2) pixels on the antenna's centreline, in any order; rows with NaN are left out.
        moment : the sensor's reading, N·m; None or NaN for vision alone.
        pan, tilt : joint angles, rad.
        sigma_px : standard deviation across the antenna, one or (N,); by default what the rig's own pictures showed.
        moment_z : reading of a second sensor about z, if the rig has one.

        Raises
        ------
        InputError : wrong shapes, or numbers that are not finite.
        """
        points = np.asarray(centreline_px, float)
        if points.ndim != 2 or points.shape[1] != 2:
            raise InputError(f"centreline_px has shape {points.shape}", remedy="give (N, 2) pixels")
        sigma = None if sigma_px is None else np.asarray(sigma_px, float)
        if sigma is not None and sigma.shape not in ((), points.shape[:1]):
            raise InputError(f"sigma_px has shape {sigma.shape}", remedy="give one number or (N,) of them")
        sigma = sigma if sigma is None or sigma.ndim == 0 else sigma[None]
        return self.estimate_batch(points[None], [moment], [pan], [tilt], sigma_px=sigma, moments_z=[moment_z])[0]

    def estimate_batch(
        self,
        centrelines_px: np.ndarray | Sequence[np.ndarray],
        moments: Sequence[float | None] | np.ndarray | None,
        pans: Sequence[float] | np.ndarray,
        tilts: Sequence[float] | np.ndarray,
        *,
        sigma_px: np.ndarray | float | None = None,
        moments_z: Sequence[float | None] | np.ndarray | None = None,
    ) -> Contacts:
        """B frames at once: a sequence of `Contact`, and its columns as arrays.

        Parameters
        ----------
        centrelines_px : (B, N, 2), or B arrays (N_i, 2) of their own lengths; rows with NaN are left out.
        moments, moments_z : (B,) N·m, None or an entry None or NaN for vision alone. pans, tilts : (B,) rad.
        sigma_px : one, (B, 1) or (B, N); by default what the rig's own pictures showed.

        Raises
        ------
        InputError : as `estimate`, or when not everything is there for every frame.
        """
        points = padded(centrelines_px)
        count = len(points)
        given = {"moments": moments, "moments_z": moments_z, "pans": pans, "tilts": tilts}
        columns = {name: column(name, values, count) for name, values in given.items()}
        if not np.isfinite([columns["pans"], columns["tilts"]]).all():
            raise InputError("a pan or tilt is not a finite number", remedy="give radians")
        for name in ("moments", "moments_z"):
            if np.isinf(columns[name]).any():
                raise InputError(f"one of {name} is infinite", remedy="give N·m, or None where there is no reading")
        sigma = deviations(points, self.rig.image.noise_px if sigma_px is None else sigma_px)
        readings = np.stack([columns["moments"], columns["moments_z"]], axis=-1)
        return self._judged(points, sigma, readings, columns["pans"], columns["tilts"], None)

    def run(self, recording: Iterable[Measured], *, live: bool = False) -> Iterator[Contact]:
        """A recording frame by frame, in order and in constant memory.

        Frames are taken `STREAM` at a time, and looked for first where the last contact before them was. Frames with
        times are judged for motion by those around them (`motion`), so that a contact comes out a little later. With
        `live` each frame is answered as it comes, judged by those before it.
        """
        frames, warm = iter(recording), None
        stream = Stream(self.rig, live)
        while several := list(islice(frames, 1 if live else STREAM)):
            found = self._measured(several, warm, beam(self.rig))
            located = np.flatnonzero(np.isfinite(found.distance_m))
            warm = found.numbers.unknowns[located[-1]] if len(located) else None
            yield from stream.push(several, found)
        yield from stream.finish()

    def measure(self, measured: Measured) -> Contact:
        """One frame that was checked already."""
        return self._measured([measured], None)[0]

    def rough(self, several: Sequence[Measured]) -> list[Rough | None]:
        """A quick fit of each frame on a low rung. None with too few points."""
        frames = self._frames(self._rig_arrays, *stacked(several))
        found: list[Rough | None] = [None] * len(several)
        enough = np.flatnonzero(frames.usable.sum(-1) >= FEWEST_POINTS)
        if len(enough):
            frames = frames.select(enough)
            unknowns = find_starts(frames, always=True).minima[:, 0]
            shapes = predict(frames, COARSE_RUNG, unknowns, derivatives=False).points_m
            for index, own, points_m in zip(enough, unknowns, shapes, strict=True):
                found[index] = Rough(own, points_m)
        return found

    def shape(self, measured: Measured) -> np.ndarray | None:
        """(M, 3) nodes of the fitted antenna, antenna frame. None with too few points."""
        frames = self._frames(self._rig_arrays, *stacked([measured]))
        if int(frames.usable.sum()) < FEWEST_POINTS:
            return None
        part = solve(frames, self.model, started([measured]))[0]
        return np.asarray(part.fits.prediction.points_m[0])

    def _measured(self, several: Sequence[Measured], warm: np.ndarray | None, shaken: Beam | None = None) -> Contacts:
        return self._judged(*stacked(several), started(several, warm), shaken)

    def _judged(
        self,
        points_px: np.ndarray,
        sigma_px: np.ndarray,
        readings_Nm: np.ndarray,
        pan_rad: np.ndarray,
        tilt_rad: np.ndarray,
        warm: np.ndarray | None,
        shaken: Beam | None = None,
    ) -> Contacts:
        count = len(points_px)
        found = none_of(count)
        rig_arrays = self._rig_arrays if count <= SINGLE else self._rig_arrays_on_device
        chunk = CHUNK if rig_arrays is self._rig_arrays else CHUNK_ON_DEVICE
        for begin in range(0, count, chunk):
            part = slice(begin, min(begin + chunk, count))
            frames = self._frames(
                rig_arrays, points_px[part], sigma_px[part], readings_Nm[part], pan_rad[part], tilt_rad[part]
            )
            usable = frames.usable.sum(-1)
            enough = usable >= FEWEST_POINTS
            found.points[part] = plain(usable)
            if not bool(enough.any()):
                continue
            rows = np.flatnonzero(plain(enough)) + begin
            start = None if warm is None else like(frames.points, warm[rows])
            if not bool(enough.all()):
                frames = frames.select(enough)
            with np.errstate(all="ignore"):  # what leaves the domain of the model is judged by its numbers
                fitted = numbers(solve(frames, self.model, start), shaken)
                self._without_reading(frames, fitted)
            placed(found, rows, fitted)
        return judge(found, self.rig, self.friction_rad, pan_rad, tilt_rad, self.model)

    def _without_reading(self, frames: Frames, fitted: Numbers) -> None:
        """Fit frames that no contact explains once more by the picture alone: does it contradict the readings?"""
        touching = fitted.evidence >= CONTACT_EVIDENCE
        rows = np.flatnonzero(touching & unexplained(fitted) & fitted.felt.any(axis=1))
        if len(rows) == 0:
            return
        alone = frames.select(as_index(like(frames.points, rows)))
        silent = replace(alone, sensor_available=0.0 * alone.sensor_available)
        fitted.explained_alone[rows] = ~unexplained(numbers(solve(silent, self.model)))

    def _frames(
        self,
        rig_arrays: RigArrays,
        points_px: np.ndarray,
        sigma_px: np.ndarray,
        readings_Nm: np.ndarray,
        pan_rad: np.ndarray,
        tilt_rad: np.ndarray,
    ) -> Frames:
        rotation, _ = self.rig.kinematics.world_antenna(pan_rad, tilt_rad)
        gravity = np.einsum("bji,j->bi", rotation, self.rig.gravity_world_m_s2)
        points_px, sigma_px = in_order(points_px, sigma_px)
        given = (np.require(values, float, ["C", "W"]) for values in (points_px, sigma_px, readings_Nm, gravity))
        return frames_from_pixels(rig_arrays, *(like(rig_arrays.prior, values) for values in given))


@dataclass(frozen=True, eq=False)
class Rough:
    """A quick fit: unknowns (4,), `rig_arrays.UNKNOWNS`, and the antenna's nodes (M, 3), antenna frame."""

    unknowns: np.ndarray
    points_m: np.ndarray
