"""The fits of frames as plain numbers: contact points, forces and their covariances."""

from __future__ import annotations

from dataclasses import Field, dataclass, field, fields

import numpy as np

from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.native import core


def _each(*shape: int, dtype: type = float) -> np.ndarray:
    """Field of an array with one entry of this shape and kind per frame."""
    values: np.ndarray = field(metadata={"shape": shape, "dtype": dtype})
    return values


@dataclass(frozen=True, eq=False)
class FitNumbers:
    """The fits of B frames as plain numbers, before it is decided what the data support; arrays of B rows.

    Attributes
    ----------
    points : (B,) how many could be used. evaluations : (B,) of the model that the fit took.
    rung : index in `antenna.rungs.RUNGS`, of the one that was asked for, or of the lowest that is good enough.
    unknowns, std : (B, 4), see `rig_arrays.UNKNOWNS`.
    point_m, force_N, deflection_m : (B, 3) antenna frame. tangent : (B, 3) of the antenna at the contact, likewise.
    covariance : (B, 6, 6) of point and force. with_pose : (B, 6, 6) theirs with the camera pose's tangent.
    shared : (B, 6, 6) the part of it that all frames of a recording have in common, the rig's. shared_std : (B,) that
        part of the distance's deviation.
    friction_share : (B,) of the distance's variance, the part by friction's angle: gone, were that known.
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
    outliers : (B,) points that lie far off their neighbours and were left out.
    pieces_m, pieces_std_m : points of the fitted antenna at `Beam.pieces_m`, antenna frame, and their deviations by
        the noise of one frame. push : how far a load of 1 N/m on each piece, along y and z, would move the distance,
        in deviations. NaN where motion is not tested.
    """

    points: np.ndarray = _each(dtype=int)
    evaluations: np.ndarray = _each(dtype=int)
    rung: np.ndarray = _each(dtype=int)
    unknowns: np.ndarray = _each(4)
    std: np.ndarray = _each(4)
    point_m: np.ndarray = _each(3)
    force_N: np.ndarray = _each(3)
    tangent: np.ndarray = _each(3)
    deflection_m: np.ndarray = _each(3)
    covariance: np.ndarray = _each(6, 6)
    with_pose: np.ndarray = _each(6, 6)
    shared: np.ndarray = _each(6, 6)
    shared_std: np.ndarray = _each()
    friction_share: np.ndarray = _each()
    tip_std: np.ndarray = _each()
    cost: np.ndarray = _each()
    residual: np.ndarray = _each(6)
    residual_std: np.ndarray = _each(6)
    sensor_available: np.ndarray = _each(6, dtype=bool)
    rig_chi_square: np.ndarray = _each()
    rig_axes: np.ndarray = _each(dtype=int)
    evidence: np.ndarray = _each()
    converged: np.ndarray = _each(dtype=bool)
    at_tip: np.ndarray = _each(dtype=bool)
    scatter: np.ndarray = _each()
    condition: np.ndarray = _each()
    finite: np.ndarray = _each(dtype=bool)
    alternative_cost: np.ndarray = _each()
    alternative_unknowns: np.ndarray = _each(4)
    ambiguous: np.ndarray = _each(dtype=bool)
    marginal: np.ndarray = _each(dtype=bool)
    second_gain: np.ndarray = _each()
    second_place: np.ndarray = _each()
    second_shift: np.ndarray = _each()
    edge_on_rad: np.ndarray = _each()
    explained_alone: np.ndarray = _each(dtype=bool)
    explained_drifted: np.ndarray = _each(dtype=bool)
    drift_px: np.ndarray = _each()
    drift_readings: np.ndarray = _each()
    left_px: np.ndarray = _each()
    bias: np.ndarray = _each(len(RUNGS))
    farthest: np.ndarray = _each()
    farthest_camera: np.ndarray = _each(dtype=int)
    outliers: np.ndarray = _each(dtype=int)
    pieces_m: np.ndarray = _each(core.solver.PIECES, 3)
    pieces_std_m: np.ndarray = _each(core.solver.PIECES)
    push: np.ndarray = _each(core.solver.PIECES, 2)

    def __len__(self) -> int:
        return len(self.rung)

    @property
    def force_determined(self) -> np.ndarray:
        """(B, 2) mask of the force's components along y and z that are known to half of their size."""
        force = np.hypot(self.unknowns[:, 1], self.unknowns[:, 2])
        return np.asarray((self.std[:, 1:3] < 0.5 * force[:, None]) | ~self.marginal[:, None])

    @staticmethod
    def empty(count: int) -> FitNumbers:
        """The numbers of `count` frames without a fit: NaN, 0 and False."""

        def none(f: Field[np.ndarray]) -> np.ndarray:
            dtype = f.metadata["dtype"]
            return np.full((count, *f.metadata["shape"]), np.nan if dtype is float else 0, dtype)

        return FitNumbers(*map(none, fields(FitNumbers)))

    @staticmethod
    def unwritten(count: int) -> FitNumbers:
        """Uninitialised arrays for the numbers of fits."""
        return FitNumbers(*(np.zeros((count, *shape), dtype) for shape, dtype in _KINDS))

    def row(self, index: int) -> FitNumbers:
        """The numbers of one frame."""
        return self if len(self) == 1 else FitNumbers(*(values[index : index + 1] for values in self.tables))

    @property
    def tables(self) -> tuple[np.ndarray, ...]:
        """All arrays, for the core."""
        return tuple(vars(self).values())

    def put(self, rows: np.ndarray, part: FitNumbers) -> None:
        """Write the numbers of some frames into their rows."""
        for whole, values in zip(self.tables, part.tables, strict=True):
            whole[rows] = values


_KINDS = [(f.metadata["shape"], f.metadata["dtype"]) for f in fields(FitNumbers)]
