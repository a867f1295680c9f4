"""What friction sees of each touch: angles of the force about the object's normal, and against what it slides."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

SLIDING, STICKING, UNUSED = "sliding", "sticking", "unused"


@dataclass(frozen=True, eq=False)
class Rubs:
    """P touches. The lateral axis is n × t, across the antenna on the object's surface; the longitudinal one is t.

    Angles that are not known, or not well enough to be used, are NaN.
    All errors are of unit standard deviation times what stands here: the K common
    ones move all touches at once (rig, neighbouring normals), the own ones each touch by itself.

    Attributes
    ----------
    used_as : (P,) "sliding": friction is μ times the normal force, against the slip; "sticking": at most that, which
        holds for touches whose motion is undecided, too; "unused".
    slides : (P,) bool, whether a touch is in the midst of sliding, used or not.
    beside : (P,) bool, whether the shape was felt side by side across the antenna, so that it can tell the normal.
    lateral_rad : (P,) of the force from the shape's normal, about the antenna, positive along n × t.
    lateral_std_rad, lateral_modes_rad : (P,), (P, K) its own and common errors, those of the normal included.
    normal_std_rad, normal_modes_rad : (P,), (P, K) of these the normal's: how far it may be turned along n × t.
    longitudinal_rad : (P,) the friction angle as the data alone say it, positive for a force towards the clamp.
    longitudinal_std_rad, longitudinal_modes_rad : (P,), (P, K).
    slip : (P, 2) unit direction of the antenna's slip, lateral and longitudinal; NaN where it does not slide.
    slip_std_rad : (P,) of that direction.
    """

    used_as: np.ndarray
    slides: np.ndarray
    beside: np.ndarray
    lateral_rad: np.ndarray
    lateral_std_rad: np.ndarray
    lateral_modes_rad: np.ndarray
    normal_std_rad: np.ndarray
    normal_modes_rad: np.ndarray
    longitudinal_rad: np.ndarray
    longitudinal_std_rad: np.ndarray
    longitudinal_modes_rad: np.ndarray
    slip: np.ndarray
    slip_std_rad: np.ndarray

    @property
    def across(self) -> np.ndarray:
        """(P,) bool: the lateral angle is used."""
        return (self.used_as != UNUSED) & np.isfinite(self.lateral_rad)

    def __len__(self) -> int:
        return len(self.used_as)

    def picked(self, which: np.ndarray) -> Rubs:
        """Those with the indices or the mask (P,), as for the friction of one patch."""
        return Rubs(**{each.name: getattr(self, each.name)[which] for each in fields(Rubs)})

    def at_rest(self) -> Rubs:
        """The same, taken as if nothing were known to slide: friction is at most μ times the normal force."""
        resting = np.where(self.used_as == SLIDING, STICKING, self.used_as)
        return replace(self, used_as=resting, slides=np.zeros(len(self), bool))
