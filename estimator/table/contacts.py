"""A contact with its columns, declared once: name, unit, shape and meaning of every number.

The declaration generates the estimator's result (`Contact`), the row and the table of contacts.csv, the attributes in
their docstrings, and the table in docs/formats.md.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields, replace
from functools import lru_cache, partial
from inspect import cleandoc
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

from vbaa_calib.camera.from_plane import pixels_on_plane
from vbaa_calib.core.arrays import ANGLE_REMEDY, MOMENT_REMEDY, PLAUSIBLE, Rows, as_float, as_floats, check_each
from vbaa_calib.core.errors import InputError
from vbaa_calib.geometry import Kinematics
from vbaa_calib.session import READINGS

if TYPE_CHECKING:
    from vbaa_calib.rig import Rig
    from vbaa_calib.session import Frame

FRICTION_RAD = 0.2
"""Default standard deviation of the friction angle: most contacts of steel have friction coefficients below 0.4."""
STATUSES = {
    "ok": "contact located",
    "no_contact": "nothing touches the antenna",
    "tip_contact": "contact at the tip",
    "unobservable": "touched, but this view does not determine where",
    "low_signal": "touched, but too lightly to tell where",
    "not_quasistatic": "the antenna was moving",
    "no_antenna": "the antenna was not seen well enough",
    "failed": "no single contact explains the picture",
    "contradicted": "something that was reported is wrong: the row must not be used",
}
"""What became of a frame, and what that means."""
LOCATED = ("ok", "tip_contact")
"""The statuses whose contact point may be used."""
NEEDED = ("distance_m", "point_antenna_m", "point_world_m")
"""What a located contact must have."""

# int, float, bool and str of one frame; arrays of many
Whole = TypeVar("Whole")
Number = TypeVar("Number")
Flag = TypeVar("Flag")
Text = TypeVar("Text")


@dataclass(frozen=True)
class _Column:
    """Declaration of a contact's field. names : its columns in the file, where they differ from the field's name."""

    unit: str
    meaning: str
    names: tuple[str, ...] = ()
    shape: tuple[int, ...] = ()
    digits: int = 9


def _column(unit: str, meaning: str, default: Any = np.nan, digits: int = 9) -> Any:
    """Declare a number, flag or text."""
    return field(default=default, metadata={"column": _Column(unit, meaning, digits=digits)})


def _vector(unit: str, meaning: str, names: str = "", shape: tuple[int, ...] = (3,)) -> Any:
    """Declare a vector, or a symmetric matrix by its upper triangle; NaN where unknown."""
    column = _Column(unit, meaning, tuple(names.split()), shape)
    return field(default_factory=lambda: np.full(shape, np.nan), metadata={"column": column})


@dataclass(frozen=True, eq=False, kw_only=True, init=False, repr=False)
class _Common(Generic[Number, Flag, Text]):
    """Fields that the estimator's results and the table share."""

    status: Text = _column("–", ", ".join(STATUSES), MISSING)
    in_contact: Flag = _column("–", "true or false; false also if unknown", False)
    model: Text = _column(
        "–", "paper, linear, elastica or rod: the model requested, or else the simplest that would have done", ""
    )
    distance_m: Number = _column("m", "arc length from the clamp to the contact")
    distance_std_m: Number = _column("m", "its standard deviation")
    distance_shared_std_m: Number = _column(
        "m", "the part of the distance's standard deviation that is common to all frames"
    )
    point_antenna_m: np.ndarray = _vector("m", "contact point on the centreline, antenna frame", "x_m y_m z_m")
    point_world_m: np.ndarray = _vector("m", "contact point on the centreline, world frame", "X_m Y_m Z_m")
    covariance_world_m2: np.ndarray = _vector(
        "m²", "covariance of the world point", "cov_XX cov_XY cov_XZ cov_YY cov_YZ cov_ZZ", (3, 3)
    )
    point_shared_std_m: np.ndarray = _vector(
        "m",
        "the part of the world point's standard deviation that is common to all frames",
        "X_shared_std_m Y_shared_std_m Z_shared_std_m",
    )
    force_covariance_yz_N2: Number = _column("N²", "covariance of the force's components along y and z")
    force_shared_std_N: np.ndarray = _vector(
        "N",
        "the part of the force's standard deviation that is common to all frames",
        "force_x_shared_std_N force_y_shared_std_N force_z_shared_std_N",
    )
    force_world_N: np.ndarray = _vector("N", "the object's force on the antenna, world frame", "FX_N FY_N FZ_N")
    tangent_world: np.ndarray = _vector(
        "–", "unit tangent of the antenna at the contact, towards the tip, world frame", "TX TY TZ"
    )
    moment_residual_Nm: Number = _column("N·m", "measured moment minus the fitted contact's; empty without a reading")
    friction_angle_rad: Number = _column(
        "rad", "the force's angle from the antenna's normal, positive towards the clamp; about 0 if undetermined"
    )
    friction_angle_std_rad: Number = _column("rad", "its standard deviation; `--friction` if undetermined")
    friction_prior_rad: Number = _column("rad", "standard deviation of the friction angle beforehand: `--friction`")
    evidence: Number = _column(
        "–", "half the difference of the sums of squares of free and touched antenna; above 14 there is contact"
    )
    condition: Number = _column("–", "condition number of the information on distance, force and friction")


@dataclass(frozen=True, eq=False, kw_only=True, init=False, repr=False)
class ContactEstimate(_Common[Number, Flag, Text]):
    """Numbers of one frame or, as arrays with a leading axis, of many; NaN where the data do not support them."""

    force_N: np.ndarray = _vector("N", "the object's force on the antenna, antenna frame")
    force_std_N: np.ndarray = _vector("N", "its standard deviation")
    deflection_m: np.ndarray = _vector("m", "contact point minus the same point of the free antenna, antenna frame")


def _declared(cls: type) -> dict[str, _Column]:
    """The declared fields of a contact class."""
    return {f.name: f.metadata["column"] for f in fields(cls) if "column" in f.metadata}


_SHARED = tuple(_declared(_Common))


@dataclass(frozen=True, eq=False)
class Jacobian(Rows):
    """Derivatives of B contacts' distance_m, force_N (3, antenna frame) and point_world_m (3); without B for a
    single one.

    By the implicit function theorem at the minimum of each fit, without second derivatives of the prediction, as in
    Gauss–Newton. Points that the robust loss takes for gross errors have the derivative 0. NaN where a contact is not
    located, and where its numbers are means over all forces along the line of sight.

    Attributes
    ----------
    by_pixels : (B, 7, N, 2) per px, of the points as they were listed.
    by_readings : (B, 7, 2) per N·m about y and z; (B, 7, 6) of a wrench sensor, as `session.READINGS`.
    by_joints : (B, 7, 2) per rad of pan and tilt, gravity included.
    by_rig : (B, 7, P) by the rig's parameters, `Rig.parameter_names`, as if they were mistaken.
    """

    by_pixels: np.ndarray
    by_readings: np.ndarray
    by_joints: np.ndarray
    by_rig: np.ndarray

    def of(self, index: int) -> Jacobian:
        """The derivatives of one contact."""
        return Jacobian(*(each[index] for each in vars(self).values()))


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Contact(ContactEstimate[float, bool, str]):
    """The result of one frame: a contact, or the reason why there is none. Numbers that the data do not support are
    NaN.

    `reason` gives the status and the choice of the model in words; `bias` the predicted bias of the models that were
    compared, by name, in standard deviations of distance or force; `outside_points` is the number of centreline points
    that lie outside the picture and are left out; `end_used` says whether the antenna's visible end agrees with the
    rest and is used, None where no end is seen; `jacobian` its derivatives by pixels, moments, joints and rig, if they
    were asked for.
    """

    reason: str = ""
    outside_points: int = 0
    end_used: bool | None = None
    bias: Mapping[str, float] = field(default_factory=dict)
    jacobian: Jacobian | None = None

    def __repr__(self) -> str:
        """The contact in a line: distance and force, ± one standard deviation, and the reason if it is not located."""
        if self.status not in LOCATED:
            return f"<Contact: {self.status}: {self.reason}>"
        x, y, z = 1e3 * self.point_world_m
        force = ", ".join(
            f"{axis} {1e3 * value:.1f} ± {1e3 * std:.1f}"
            for axis, value, std in zip("yz", self.force_N[1:], self.force_std_N[1:], strict=True)
            if np.isfinite(value)
        )
        where = f"{1e3 * self.distance_m:.2f} ± {1e3 * self.distance_std_m:.2f} mm from the clamp"
        point = f"world ({x:.2f}, {y:.2f}, {z:.2f}) mm"
        return f"<Contact: {self.status}, {where}, force {force or 'not known'} mN, {point}>"

    @property
    def predicted_bias_std(self) -> float:
        """Predicted bias of `model`, in standard deviations; NaN where it was not compared."""
        return float(self.bias.get(self.model, np.nan))


@dataclass(frozen=True, eq=False, kw_only=True, init=False, repr=False)
class _Columns(_Common[Number, Flag, Text], Generic[Whole, Number, Flag, Text]):
    """Further columns of contacts.csv."""

    frame: Whole = _column("–", "number of the frame in the recording", MISSING)
    time_s: Number = _column("s", "from the recording", MISSING, digits=15)  # clocks that count from 1970 need them
    force_y_N: Number = _column("N", "the object's force on the antenna, along y of the antenna frame")
    force_y_std_N: Number = _column("N", "its standard deviation")
    force_z_N: Number = _column("N", "the object's force on the antenna, along z of the antenna frame")
    force_z_std_N: Number = _column("N", "its standard deviation")
    deflection_y_m: Number = _column("m", "contact point less the same point of the free antenna, along y")
    deflection_z_m: Number = _column("m", "the same along z")
    reason: Text = _column("–", "the status and the choice of the model in words", "")
    bias_std: Number = _column("–", "predicted bias of `model` in standard deviations; by default not in the numbers")
    pan_rad: Number = _column("rad", "joint angle, from the recording")
    tilt_rad: Number = _column("rad", "joint angle, from the recording")
    contact: Whole = _column("–", "which of the frame's contacts, from 0", 0)
    antenna: Text = _column("–", "name of the antenna, where there are several or clamps move", "")
    clamp_world_m: np.ndarray = _vector("m", "where its clamp is, world frame", "clamp_X_m clamp_Y_m clamp_Z_m")
    clamp_angle_rad: Number = _column("rad", "where it points: its angle from the rig's x axis in plane C")


@dataclass(frozen=True, eq=False, kw_only=True)
class ContactRow(_Columns[int, float, bool, str]):
    """One frame of contacts.csv. A missing number is NaN here and an empty cell in the file."""

    @staticmethod
    def of(frame: Frame, contact: Contact) -> ContactRow:
        """The row of one estimated frame."""
        (_, force_y, force_z), (_, std_y, std_z) = contact.force_N.tolist(), contact.force_std_N.tolist()
        row = object.__new__(ContactRow)  # of all fields at once: to set each takes longer than all else here
        vars(row).update(
            _absent(),
            frame=frame.frame,
            time_s=frame.time_s,
            pan_rad=frame.pan_rad,
            tilt_rad=frame.tilt_rad,
            force_y_N=force_y,
            force_y_std_N=std_y,
            force_z_N=force_z,
            force_z_std_N=std_z,
            deflection_y_m=float(contact.deflection_m[1]),
            deflection_z_m=float(contact.deflection_m[2]),
            reason=contact.reason,
            bias_std=contact.predicted_bias_std,
            **{name: getattr(contact, name) for name in _SHARED},
        )
        return row

    def estimate(self, kinematics: Kinematics) -> Contact:
        """The contact of this row. The standard deviation of the force along x is NaN, as no table has it; of an old
        table, which has no force in the world, that force itself is 0."""
        along = kinematics.T_world_antenna(self.pan_rad, self.tilt_rad).rotation[:, 0] @ self.force_world_N
        return Contact(
            reason=self.reason,
            force_N=np.array([np.nan_to_num(along), self.force_y_N, self.force_z_N]),
            force_std_N=np.array([np.nan, self.force_y_std_N, self.force_z_std_N]),
            deflection_m=np.array([np.nan, self.deflection_y_m, self.deflection_z_m]),
            bias={self.model: self.bias_std} if np.isfinite(self.bias_std) else {},
            **{name: getattr(self, name) for name in _SHARED},
        )


@lru_cache
def _absent() -> dict[str, Any]:
    """Values of a row's columns that a frame need not have."""
    known = {f.name: f.default if f.default_factory is MISSING else f.default_factory() for f in fields(ContactRow)}
    return {name: value for name, value in known.items() if value is not MISSING}


@dataclass(frozen=True, eq=False, kw_only=True)
class ContactTable(_Columns[np.ndarray, np.ndarray, np.ndarray, np.ndarray], Rows):
    """contacts.csv as columns, B frames: (B,), (B, 3) or (B, 3, 3); NaN for missing numbers."""

    @staticmethod
    def from_rows(rows: Sequence[ContactRow]) -> ContactTable:
        """The table of one or more rows."""
        return ContactTable(**{name: np.array([getattr(row, name) for row in rows]) for name in COLUMNS})

    @staticmethod
    def of(estimates: ContactEstimate[np.ndarray, np.ndarray, np.ndarray], **others: np.ndarray) -> ContactTable:
        """The table of the estimates of B frames. others : the columns (B,) that estimates do not have, by name."""
        count, force, std = len(estimates.status), estimates.force_N, estimates.force_std_N
        absent = {
            name: np.full(count, value) if np.ndim(value) == 0 else np.tile(value, (count, 1))
            for name, value in _absent().items()
            if name not in (*_SHARED, *others)
        }
        axes = {f"force_{axis}_N": force[:, at] for at, axis in enumerate("xyz") if at}
        axes |= {f"force_{axis}_std_N": std[:, at] for at, axis in enumerate("xyz") if at}
        axes |= {f"deflection_{axis}_m": estimates.deflection_m[:, at] for at, axis in enumerate("xyz") if at}
        return ContactTable(**absent | axes | {name: getattr(estimates, name) for name in _SHARED} | others)

    def rows(self) -> Iterator[ContactRow]:
        """The rows, frame by frame."""
        return (ContactRow(**{name: getattr(self, name)[i] for name in COLUMNS}) for i in range(len(self)))

    @property
    def assumed_friction_rad(self) -> float:
        """The friction prior that the contacts were estimated with; the default where the table does not have it."""
        known = self.friction_prior_rad[np.isfinite(self.friction_prior_rad)]
        return float(np.median(known)) if len(known) else FRICTION_RAD

    @property
    def clamp_moves(self) -> bool:
        """Whether every frame has an antenna frame of its own, at a moving clamp, instead of the rig's."""
        return bool(np.isfinite(self.clamp_angle_rad).any())

    @property
    def paired(self) -> np.ndarray:
        """(B,) mask of the rows that are one of several contacts of a frame."""
        return np.isin(self.frame, self.frame[self.contact > 0])

    def without_pairs(self) -> ContactTable:
        """The table with one row a frame; where a frame had several contacts, a row that states this, without
        numbers."""
        if not (paired := self.paired).any():
            return self
        reason = "shows several contacts, which are not used here"
        rows = [
            ContactRow(
                frame=row.frame,
                time_s=row.time_s,
                status="failed",
                in_contact=True,
                model=row.model,
                reason=reason,
                pan_rad=row.pan_rad,
                tilt_rad=row.tilt_rad,
                friction_prior_rad=row.friction_prior_rad,
            )
            if pair
            else row
            for row, pair in zip(self.rows(), paired, strict=True)
            if row.contact == 0
        ]
        return ContactTable.from_rows(rows)

    @property
    def located(self) -> np.ndarray:
        """(B,) mask of the frames with a usable contact point."""
        return np.isin(self.status, LOCATED)


REQUIRED = (
    *("frame", "time_s", "status", "in_contact", "model", "distance_m", "distance_std_m"),
    *("force_y_N", "force_y_std_N", "force_z_N", "force_z_std_N", "deflection_y_m", "deflection_z_m"),
    *("point_antenna_m", "point_world_m", "covariance_world_m2", "moment_residual_Nm", "reason"),
)
"""What every contacts.csv has, in the order of its columns."""
OPTIONAL = (
    *("force_world_N", "friction_angle_rad", "friction_angle_std_rad", "bias_std", "condition"),
    *("pan_rad", "tilt_rad", "evidence", "friction_prior_rad", "tangent_world"),
    *("distance_shared_std_m", "point_shared_std_m", "force_covariance_yz_N2", "force_shared_std_N", "contact"),
    *("antenna", "clamp_world_m", "clamp_angle_rad"),
)
"""What ours has after that; optional when read. The last three only where antennas are named."""
COLUMNS: dict[str, _Column] = {name: _declared(_Columns)[name] for name in (*REQUIRED, *OPTIONAL)}
"""Field → its declaration, in the order of the file."""


@lru_cache
def columns_of(named: bool) -> tuple[str, ...]:
    """The file's columns, with or without those of named antennas and moving clamps."""
    return column_names(tuple(COLUMNS)[: None if named else -3])


def column_names(which: Sequence[str] = tuple(COLUMNS)) -> tuple[str, ...]:
    """The file's columns of these fields."""
    return tuple(column for name in which for column in COLUMNS[name].names or (name,))


for _class in (Contact, ContactRow, ContactTable):
    _attributes = "\n".join(
        f"{name} : {f'{column.shape} ' if column.shape else ''}{column.meaning}; {column.unit}."
        for name, column in _declared(_class).items()
    )
    _class.__doc__ = f"{cleandoc(_class.__doc__ or '')}\n\nAttributes\n----------\n{_attributes}"


@lru_cache
def _nothing(value: float, count: int) -> np.ndarray:
    """(count,) read-only array of a missing value, cached, so that columns without values share it."""
    return np.frombuffer(np.full(count, value).tobytes())


@dataclass(frozen=True, eq=False)
class Measured:
    """The measurements of one frame.

    Attributes
    ----------
    points_px, sigma_px : (N, 2) on the centreline, and their deviations (N,) across the antenna.
    moment_Nm and the like : as `session.READINGS`, NaN where nothing is read.
    pan_rad, tilt_rad : joint angles.
    time_s : NaN where not known; a recording's frames are then taken as static.
    start : (4,) initial unknowns, as `ContactEstimator.rough` gives them; NaN where there are none.
    tip_px : (3,) the antenna's visible end, and its deviation along the antenna; NaN where it is not known.
    moment_errors_Nm : (6,) standard deviations of the moments besides the sensors' noise.
    joint_errors_rad : (2,) deviations of pan and tilt.
    outside_points : number of points that were left out because they lie outside the picture.
    sigma_factor : by which `sigma_px` was widened, as the recording's points scatter more than was stated.
    covariance_shape : (N, 2, 2) covariances of the points over sigma_px²; None: the same in every direction.
    others : what further cameras of the rig saw of the same frame, by name; only points and end of theirs count.
    """

    points_px: np.ndarray
    sigma_px: np.ndarray
    moment_Nm: float
    pan_rad: float
    tilt_rad: float
    moment_z_Nm: float = np.nan
    moment_x_Nm: float = np.nan
    sensor_force_x_N: float = np.nan
    sensor_force_y_N: float = np.nan
    sensor_force_z_N: float = np.nan
    time_s: float = np.nan
    start: np.ndarray = field(default_factory=partial(_nothing, np.nan, 4))
    tip_px: np.ndarray = field(default_factory=partial(_nothing, np.nan, 3))
    moment_errors_Nm: np.ndarray = field(default_factory=partial(_nothing, 0.0, len(READINGS)))
    joint_errors_rad: np.ndarray = field(default_factory=partial(_nothing, 0.0, 2))
    outside_points: int = 0
    sigma_factor: float = 1.0
    covariance_shape: np.ndarray | None = None
    others: Mapping[str, Measured] = field(default_factory=dict)

    def of_camera(self, name: str) -> Measured:
        """The measurements of a further camera; without points if it has none."""
        nothing: dict[str, Any] = {"points_px": np.empty((0, 2)), "sigma_px": np.empty(0), "tip_px": np.full(3, np.nan)}
        return self.others[name] if name in self.others else replace(self, **nothing, covariance_shape=None, others={})

    @staticmethod
    def on_plane(
        rig: Rig, plane_xy_m: Any, covariance_m2: Any = None, *, sigma_px: Any = None, **readings: Any
    ) -> Measured:
        """A measurement from points (N, 2) m on plane C, as `rig.camera_on_plane()` returns them: the pixels that
        give these.

        covariance_m2 : (N, 2, 2) or (2, 2); without it `sigma_px`, or what the rig's own pictures have. readings : the
        other attributes, by name. Raises InputError.
        """
        if covariance_m2 is not None and sigma_px is not None:
            raise InputError("covariance_m2 and sigma_px exclude each other", remedy="give one of them")
        points, own, shape = pixels_on_plane(rig.camera, rig.T_antenna_camera, plane_xy_m, covariance_m2)
        if own is None:
            own = as_floats(rig.image.noise_px if sigma_px is None else sigma_px, "sigma_px", "give px")
            own = own if own.ndim else np.full(points.shape[:1], own)
        return Measured(points, own, covariance_shape=shape, **readings)

    @property
    def readings(self) -> list[float]:
        """(6,) readings in the order of `session.READINGS`."""
        return [getattr(self, name) for name in READINGS.values()]

    def __post_init__(self) -> None:
        """Raises InputError for what is not a number, or in another unit."""
        arrays = self.points_px, self.sigma_px
        points, sigma = (as_floats(each, "points_px or sigma_px", "give px") for each in arrays)
        if points.ndim != 2 or points.shape[1] != 2 or sigma.shape != points.shape[:1]:
            what = f"points_px and sigma_px have shapes {points.shape}, {sigma.shape}"
            raise InputError(what, remedy="give (N, 2) and (N,)")
        # each of these is quick for frames that are sound
        if not (len(points) and np.abs(points).max() <= PLAUSIBLE.pixel_px):
            check_each(points, PLAUSIBLE.pixel_px, "points_px", "give pixels", "infinite")
        if not ((len(sigma) and sigma.min() > 0.0) or (sigma[np.isfinite(points).all(axis=1)] > 0.0).all()):
            raise InputError("sigma_px is not everywhere positive", remedy="give standard deviations in px")
        values: dict[str, np.ndarray | float] = {"points_px": points, "sigma_px": sigma}
        numbers = [*self.readings, self.pan_rad, self.tilt_rad, self.time_s]
        least = min(PLAUSIBLE.moment_Nm, PLAUSIBLE.angle_rad)
        sound = all(type(each) is float and not abs(each) > least for each in numbers[:-1])
        limits = (
            {}
            if sound and type(self.time_s) is float
            else {
                **dict.fromkeys(READINGS.values(), (PLAUSIBLE.moment_Nm, MOMENT_REMEDY)),
                **dict.fromkeys(("pan_rad", "tilt_rad"), (PLAUSIBLE.angle_rad, ANGLE_REMEDY)),
                "time_s": (np.inf, "give seconds"),
            }
        )
        for name, (most, remedy) in limits.items():
            number = values[name] = as_float(getattr(self, name), name, remedy)
            if abs(number) > most:
                raise InputError(f"{name} is {number:g}", remedy=remedy)
        for name, count in {"start": 4, "tip_px": 3, "moment_errors_Nm": len(READINGS), "joint_errors_rad": 2}.items():
            several = getattr(self, name)
            if several is _nothing(0.0, count) or several is _nothing(np.nan, count):
                continue
            several = values[name] = as_floats(several, name, f"give ({count},) numbers")
            if several.shape != (count,):
                raise InputError(f"{name} has shape {several.shape}", remedy=f"give ({count},) numbers")
        if self.covariance_shape is not None and np.shape(self.covariance_shape) != (*sigma.shape, 2, 2):
            what = f"covariance_shape has shape {np.shape(self.covariance_shape)}"
            raise InputError(what, remedy="give (N, 2, 2)")
        for name, each in values.items():
            object.__setattr__(self, name, each)


def joint_angles(kinematics: Kinematics, table: ContactTable) -> tuple[np.ndarray, np.ndarray]:
    """Pan and tilt (B,) in rad; NaN where the table has neither these nor a contact in both frames.

    Raises
    ------
    InputError : the contacts are not of this rig.
    """
    if table.clamp_moves:
        what = "the clamp moved in this recording, which needs none of the rig's joints"
        raise InputError(what, remedy="leave out --rig; refine, next and track need a clamp that does not move")
    recorded = np.isfinite(table.pan_rad) & np.isfinite(table.tilt_rad)
    pan, tilt = _from_points(kinematics, table.point_antenna_m, table.point_world_m)
    pan, tilt = np.where(recorded, table.pan_rad, pan), np.where(recorded, table.tilt_rad, tilt)
    rotation, translation = kinematics.world_antenna(pan, tilt)
    off = np.einsum("bij,bj->bi", rotation, table.point_antenna_m) + translation - table.point_world_m
    # m: points that disagree by more are of another rig
    if (np.linalg.norm(off, axis=1) > 1e-3).any():
        raise InputError(
            "the contacts do not fit the rig's kinematics",
            where="rig.json",
            remedy="give the rig.json they were made with",
        )
    return pan, tilt


def _from_points(
    kinematics: Kinematics, point_antenna_m: np.ndarray, point_world_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The angles (B,) that carry points (B, 3) of the antenna frame to their world positions; |tilt| below 90°."""
    p = kinematics.T_actuator_antenna @ point_antenna_m
    q = point_world_m - kinematics.position_world_m
    sin, cos = np.sin(kinematics.axis_skew_rad), np.cos(kinematics.axis_skew_rad)
    with np.errstate(invalid="ignore", divide="ignore"):
        # sin(tilt)·p_x + cos(tilt)·p_z is what the tilt makes of p_z, before the axis' lean mixes it with p_y
        up = (q[:, 2] - sin * p[:, 1]) / cos
        reach = np.clip(up / np.hypot(p[:, 0], p[:, 2]), -1.0, 1.0)
        tilt = np.arcsin(reach) - np.arctan2(p[:, 2], p[:, 0])
        forward = kinematics.axis_offset_m + np.cos(tilt) * p[:, 0] - np.sin(tilt) * p[:, 2]
        across = cos * p[:, 1] - sin * up
        pan = np.arctan2(q[:, 1], q[:, 0]) - np.arctan2(across, forward)
    return pan, tilt - kinematics.tilt_zero_rad
