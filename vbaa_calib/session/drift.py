"""Changes of a rig between calibration and recording, and during the recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from types import MappingProxyType
from typing import Annotated

from vbaa_calib.core.arrays import Within


@dataclass(frozen=True)
class MovingClamp:
    """A clamp that moves between frames: a follicle, or a probe in a hand. Its position and rotation in the image
    plane are measured in the picture; the other motions have priors, as standard deviations.

    depth_std_m : of its place along the antenna frame's z.
    elevation_std_rad : of its turn out of plane C.
    roll_std_rad : of its turn about the antenna's own axis, by which the bow leaves the picture's plane.
    """

    depth_std_m: Annotated[float, Within(ge=0, le=0.1, description="of its place along the antenna frame's z")] = 1e-3
    elevation_std_rad: Annotated[float, Within(ge=0, le=0.5, description="of its turn out of plane C")] = 0.03
    roll_std_rad: Annotated[float, Within(ge=0, le=1, description="of its turn about the antenna's own axis")] = 0.1


_Small = Annotated[float, Within(ge=0, le=0.1)]
_OF_FRAMES = ("line_px", "light_px", "lock_px", "hourly", "zero_hourly")


@dataclass(frozen=True)
class Drift:
    """Standard deviations of the changes between calibration and recording; 0: no change.

    Attributes
    ----------
    camera_turn_rad, camera_shift_m : of the camera in the antenna frame, about and along each axis.
    picture_shift_px : of the principal point along each axis, as by a mount or a lens that moved.
    picture_scale : of the focal length, relative: focus and temperature.
    clamp_turn_rad : of the clamp, about y and z. bow_per_m : of the free antenna's curvature along y and z.
    stiffness : of EI, relative: temperature.
    moment_gain : of the sensor's gain, relative. moment_zero : of its zero, in deviations of its noise.
    line_px : what is common to all points of a frame's centreline, in each frame anew: its offset, slope and curvature
        (the Legendre polynomials along the antenna), by light, focus and edges.
    light_px : of the same in all frames alike, by a lamp that moved or another focus; until free frames show it.
    lock_px : of what moves a line towards or away from the pixels' centres, as they sample, are filtered and sharpened,
        rms: where a line follows a row or a column it is an offset, elsewhere it averages out along the line.
    hourly : part of all these, but for the line's, by which the rig goes on changing within an hour of recording.
    zero_hourly : of the moment's zero, in deviations of its noise, within an hour of recording, besides; it is then
        learnt from every free frame.
    """

    camera_turn_rad: _Small = 0.0
    camera_shift_m: _Small = 0.0
    picture_shift_px: Annotated[float, Within(ge=0, le=100)] = 0.0
    picture_scale: _Small = 0.0
    clamp_turn_rad: _Small = 0.0
    bow_per_m: _Small = 0.0
    stiffness: _Small = 0.0
    moment_gain: _Small = 0.0
    moment_zero: Annotated[float, Within(ge=0, le=1e4)] = 0.0
    line_px: Annotated[float, Within(ge=0, le=10)] = 0.0
    light_px: Annotated[float, Within(ge=0, le=10)] = 0.0
    lock_px: Annotated[float, Within(ge=0, le=10)] = 0.0
    hourly: Annotated[float, Within(ge=0, le=100)] = 0.0
    zero_hourly: Annotated[float, Within(ge=0, le=1e4)] = 0.0

    @cached_property
    def of_rig(self) -> bool:
        return any(getattr(self, each.name) for each in fields(self) if each.name not in _OF_FRAMES)

    def tracking_zero(self) -> Drift:
        """The drift with a moment sensor zero that is tracked over the recording."""
        return replace(self, moment_zero=max(self.moment_zero, 50.0), zero_hourly=60.0)

    def times(self, factor: float) -> Drift:
        """The drift with all standard deviations of the rig multiplied by a factor."""
        names = (each.name for each in fields(self) if each.name not in _OF_FRAMES)
        return replace(self, **{name: factor * getattr(self, name) for name in names})


DRIFTS: Mapping[str, Drift] = MappingProxyType(
    {
        "none": Drift(),
        "lab": Drift(
            camera_turn_rad=1.5e-4,
            camera_shift_m=1e-4,
            picture_shift_px=0.2,
            picture_scale=5e-5,
            clamp_turn_rad=3e-5,
            bow_per_m=5e-4,
            stiffness=2.5e-3,
            moment_gain=2e-3,
            moment_zero=5.0,
            line_px=0.003,
            light_px=0.015,
            lock_px=0.02,
            hourly=0.3,
        ),
        "rough": Drift(
            camera_turn_rad=1e-3,
            camera_shift_m=5e-4,
            picture_shift_px=1.0,
            picture_scale=5e-4,
            clamp_turn_rad=3e-4,
            bow_per_m=5e-3,
            stiffness=1e-2,
            moment_gain=1e-2,
            moment_zero=50.0,
            line_px=0.01,
            light_px=0.05,
            lock_px=0.04,
            hourly=0.5,
        ),
    }
)
"""By name. lab: all on one frame, indoors, the recording within days of the calibration. rough: knocks, sun, a mount of
plastic."""


def drift_of(name: str | None, *others: Drift | None, track_zero: bool = False) -> Drift:
    """The drift of this name, or without a name the first of the others; with a tracked zero if asked."""
    found = next(each for each in (None if name is None else DRIFTS[name], *others, Drift()) if each is not None)
    return found.tracking_zero() if track_zero else found
