"""The object from contacts.csv: events, surface, friction and compliance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from estimator.contact.common_errors import CommonErrors, shared_errors
from estimator.table.contacts import ContactTable
from vbaa_calib.core.arrays import validate_arguments
from vbaa_calib.core.robust import finite_median, finite_or_none

from .friction import Friction, FrictionSettings, friction
from .surface import Compliance, Normals, Surface, reconstruct, touches_of
from .track import Track, follow

if TYPE_CHECKING:
    from vbaa_calib.rig import Rig


@dataclass(frozen=True, eq=False)
class ObjectEstimate:
    """An object: for every frame whether the antenna touched, stuck or slid; its shape and compliance; friction, per
    touch of the surface; and the frames' shared errors."""

    track: Track
    surface: Surface
    friction: Friction
    shared: CommonErrors

    @property
    def compliance(self) -> Compliance:
        """The object's compliance."""
        return self.surface.compliance

    @property
    def normals(self) -> Normals:
        """The object's normals at the touches, from shape, tangents and forces."""
        return self.friction.normals

    def summary(self) -> dict[str, Any]:
        """The object's numbers as plain data; None for undetermined ones, with the reason in words."""
        surface, rub, soft = self.surface, self.friction, self.surface.compliance
        return {
            "contacts": len(surface.touched_m),
            "patches": len(np.unique(surface.touched_patch)),
            "triangles": len(surface.triangles),
            "surface_std_m": finite_or_none(finite_median(surface.touched_std_m)),
            "normal_std_rad": finite_or_none(finite_median(self.normals.std_rad)),
            "friction": rub.to_dict()
            | {
                "cone_half_angle_rad": finite_or_none(rub.cone_half_angle_rad),
                "sliding": int(np.sum(rub.used_as == "sliding")),
                "at_most": int(np.sum(rub.used_as == "sticking")),
                "force_from_normal_rad": finite_or_none(finite_median(np.abs(rub.lateral_rad))),
            },
            "stiffness": {
                "told": soft.determined,
                "stiffness_N_m": finite_or_none(soft.stiffness_N_m),
                "interval_N_m": [finite_or_none(end) for end in soft.interval_N_m],
                "compliance_m_N": finite_or_none(soft.compliance_m_N),
                "compliance_std_m_N": finite_or_none(soft.std_m_N),
                "reason": soft.reason,
            },
            "events": [
                {
                    "kind": event.kind,
                    "frame": int(event.frame),
                    "time_s": finite_or_none(event.time_s),
                    "words": event.words,
                }
                for event in self.track.events
            ],
            "notes": list(surface.notes),
        }


@validate_arguments
def estimate_object(
    table: ContactTable, rig: Rig | None = None, friction_rad: float | None = None, *, events: bool = True
) -> ObjectEstimate:
    """The object at rest from its contacts, in order of time.

    Parameters
    ----------
    rig : that of the contacts; without it the antenna's radius counts as zero, and which errors are common is unknown:
        the shape takes them for each frame's own, friction for both.
    friction_rad : standard deviation of the friction angle in the estimate of the contacts, by default the table's.
    events : whether the track also has the instants at which contact began and ended.

    Raises
    ------
    InputError : where no frame has a contact point with its force, or the contacts are not of this rig.
    """
    touches_of(table)  # says what is missing before any work
    friction_rad = table.assumed_friction_rad if friction_rad is None else friction_rad
    shared = CommonErrors.none(table) if rig is None else shared_errors(rig, table, friction_rad)
    touches = touches_of(table, shared)
    surface = reconstruct(touches, 0.0 if rig is None else rig.antenna.radius_at(touches.distance_m))
    # the shape's normals where it determines them, NaN elsewhere
    known = (
        Normals(surface.touched_normal, surface.touched_normal_covariance).std_rad < FrictionSettings.normal_known_rad
    )
    normals = np.full((len(table), 3), np.nan)
    normals[surface.touched_row[known]] = surface.touched_normal[known]
    track = follow(table, rig, shared, normals, events=events)
    return ObjectEstimate(track, surface, friction(table, surface, track, shared, friction_rad, rig), shared)
