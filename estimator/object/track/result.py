"""What following a recording in time gives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

FREE, TOUCHING, STICKING, SLIDING, ROLLING, UNKNOWN = "free", "touching", "sticking", "sliding", "rolling", "unknown"
PHASES = (FREE, TOUCHING, STICKING, SLIDING, ROLLING, UNKNOWN)
FIRST_CONTACT, LOSS, SLIP_START, SLIP_END, RINGING = "first_contact", "loss", "slip_start", "slip_end", "ringing"


@dataclass(frozen=True)
class Event:
    """Something that happened: its kind, and the number of the frame with which it was known.

    `time_s`, `time_std_s` say when it happened, NaN where that cannot be told, `delay_s` how much later it was known,
    `words` the same for a reader.
    """

    kind: str
    frame: int
    time_s: float
    time_std_s: float
    delay_s: float
    words: str


@dataclass(frozen=True, eq=False)
class Track:
    """A recording of B frames in time.

    Attributes
    ----------
    phase : (B,) of `PHASES`: "touching" is contact, its motion undecided, "unknown" that not even contact is known.
    slip_velocity_m_s, slip_covariance_m2_s2 : (B, 3), (B, 3, 3) world, of the antenna's material point at the contact
        against the object, in the plane of contact; NaN where the data do not hold it.
    slip_std_m_s : (B,) largest standard deviation of its components.
    longitudinal_m_s, lateral_m_s : (B,) along the antenna towards the tip, and along normal × tangent.
    ringing : (B,) bool. events : in order of time. notes : what the recording could not tell, in words.
    """

    phase: np.ndarray
    slip_velocity_m_s: np.ndarray
    slip_std_m_s: np.ndarray
    longitudinal_m_s: np.ndarray
    lateral_m_s: np.ndarray
    slip_covariance_m2_s2: np.ndarray
    ringing: np.ndarray
    events: tuple[Event, ...]
    notes: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.phase)
