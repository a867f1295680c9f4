"""The fits of frames as plain numbers: contact points, forces and their covariances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from vbaa_calib.native import core


@dataclass(frozen=True, eq=False)
class FitNumbers:
    """The fits of B frames as plain numbers, before it is decided what the data support; arrays of B rows.

    Attributes
    ----------
    rows : (B,) structures as the core writes them, of all that follows.
    points : (B,) how many could be used. evaluations : (B,) of the model that the fit took.
    rung : index in `antenna.rungs.RUNGS`, of the one that was asked for, or of the lowest that is good enough.
    unknowns, std : (B, 4), see `rig_arrays.UNKNOWNS`.
    point_m, force_N, deflection_m : (B, 3) antenna frame. tangent : (B, 3) of the antenna at the contact, likewise.
    covariance : (B, 6, 6) of point and force. with_pose : (B, 6, 6) theirs with the camera pose's tangent.
    shared : (B, 6, 6) the part of it that all frames of a recording have in common, the rig's. shared_std : (B,) that
        part of the distance's deviation.
    friction_share : (B,) part of the distance's variance due to the unknown friction angle.
    tip_std : (B,) how far the antenna's end lies off its place, in the deviations that are expected of that; NaN
        without one.
    cost : (B,) half the robust sum of squares with the priors, the points' deviations multiplied by `scatter`.
    residual, residual_std : (B, 6) whitened residuals of the readings, and their expected standard deviations.
    sensor_available : (B, 6) bool, whether there was a reading.
    rig_chi_square : (B,) sum of squares of the rig's steps, which has `rig_axes` (B,) degrees of freedom.
    evidence : (B,) for a contact, see `uncertainty.hpp`. condition : (B,) likewise.
    converged, at_tip, scatter : (B,) see `structs.hpp`.
    alternative_cost : (B,) how much more another minimum costs, infinite without one. alternative_unknowns : (B, 4).
    ambiguous : (B,) bool, see `alternative_minima.hpp`. marginal : (B,) bool, the numbers are means over all forces
        along the line of sight, see `marginal.hpp`.
    second_gain, second_place, second_shift : (B,) see `second_contact.hpp`.
    finite : (B,) bool, the fit stayed in the model's domain.
    edge_on_rad : angle between the deformation plane and the ray from the camera's centre to the contact.
    explained_drifted : (B,) bool, one contact explains the frame if the rig has changed, by which the picture moves by
        drift_px (B,) and the readings by drift_readings (B,), in deviations; computed only where nothing fits.
    explained_alone : (B,) bool, one contact explains the picture alone; computed only where the readings do not fit.
    left_px : (B,) how far most points stay from the nearest antenna; NaN unless that is why the fit ended.
    bias : (B, len(RUNGS)), NaN where it was not compared.
    farthest, farthest_camera : (B,) largest residual of a point, in standard deviations, and which camera saw that.
    jump : (B,) largest difference of neighbouring points' median distances, in their deviations; where a point lies
        farther than `core.solver.STRETCH_STD`, else 0.
    outliers : (B,) points that lie far off their neighbours and were left out.
    pieces_m, pieces_std_m : points of the fitted antenna at `Beam.pieces_m`, antenna frame, and their deviations by
        the noise of one frame. push : how far a load of 1 N/m on each piece, along y and z, would move the distance,
        in deviations. NaN where motion is not tested.
    """

    rows: np.ndarray

    def __getattr__(self, name: str) -> np.ndarray:
        """The numbers of that name, of all frames."""
        if name.startswith("_") or name == "rows":  # of a copy that is not whole yet
            raise AttributeError(name)
        try:
            values: np.ndarray = self.rows[name]
        except ValueError:
            raise AttributeError(f"a fit has no {name}") from None
        return values

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def force_determined(self) -> np.ndarray:
        """(B, 2) mask of the force's components along y and z that are known to half of their size."""
        force = np.hypot(self.unknowns[:, 1], self.unknowns[:, 2])
        return np.asarray((self.std[:, 1:3] < 0.5 * force[:, None]) | ~self.marginal[:, None])

    @staticmethod
    def empty(count: int) -> FitNumbers:
        """The numbers of `count` frames without a fit: NaN, 0 and False."""
        nothing, kind = _without_fit()
        return FitNumbers(np.frombuffer(bytearray(nothing) * count, kind))

    @staticmethod
    def joined(several: Sequence[FitNumbers]) -> FitNumbers:
        """The numbers of frames one after the other."""
        return FitNumbers(np.concatenate([each._whole for each in several]).view(several[0].rows.dtype))

    def picked(self, which: slice | np.ndarray) -> FitNumbers:
        """The numbers of some frames."""
        return FitNumbers(self.rows[which])

    def row(self, index: int) -> FitNumbers:
        """The numbers of one frame."""
        return self.picked(slice(index, index + 1))

    def put(self, rows: slice | np.ndarray, part: FitNumbers) -> None:
        """Write the numbers of some frames into their rows."""
        self._whole[rows] = part._whole

    @property
    def _whole(self) -> np.ndarray:
        """The structures as bytes: NumPy would copy their fields one by one."""
        return self.rows.view(np.dtype((np.void, self.rows.dtype.itemsize)))


@lru_cache
def _without_fit() -> tuple[bytes, np.dtype[np.void]]:
    """The numbers of a frame without a fit, as bytes, because NumPy would copy the fields one by one; and their
    dtype."""
    nothing = np.zeros(1, core.solver.NUMBERS)
    for name in core.solver.NUMBERS["names"]:
        if nothing[name].dtype == float:
            nothing[name] = np.nan
    return nothing.tobytes(), nothing.dtype
