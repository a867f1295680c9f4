"""What stands under a frame's debug picture: its status and its numbers in words."""

from __future__ import annotations

import numpy as np

from vbaa_calib.detect.overlay import described

from .contact import Contact
from .recording import FrameContact
from .table import LOCATED

STATUS_COLOURS = {
    "ok": "#009e73",
    "no_contact": "#cbd5e1",
    "tip_contact": "#56b4e9",
    "unobservable": "#cc79a7",
    "low_signal": "#e69f00",
    "not_quasistatic": "#0072b2",
    "no_antenna": "#4b5563",
    "failed": "#d55e00",
}
"""As in the report; told apart by the colour-blind as well."""
MEANINGS = {
    "ok": "contact located",
    "no_contact": "nothing touches the antenna",
    "tip_contact": "contact at the tip",
    "unobservable": "touched, but where cannot be told from here",
    "low_signal": "touched, but too lightly to tell where",
    "not_quasistatic": "the antenna was moving",
    "no_antenna": "the antenna was not seen well enough",
    "failed": "no single contact explains the picture",
}


def status_colour(status: str) -> tuple[int, int, int]:
    """Blue, green, red."""
    red, green, blue = bytes.fromhex(STATUS_COLOURS[status][1:])
    return blue, green, red


def numbers(contact: Contact) -> str:
    """Distance and force with their standard deviations, and the moment residual; empty where there are none."""
    parts = []
    if contact.status in LOCATED:
        force, std = 1e3 * contact.force_N, 1e3 * contact.force_std_N
        parts = [
            f"contact {1e3 * contact.distance_m:.2f} ± {1e3 * contact.distance_std_m:.2f} mm from the clamp",
            f"force {np.linalg.norm(force):.2f} mN (y {force[1]:.2f} ± {std[1]:.2f}, z {force[2]:.2f} ± {std[2]:.2f})",
        ]
    if np.isfinite(contact.moment_residual_Nm):
        parts.append(f"moment residual {1e6 * contact.moment_residual_Nm:.1f} µN·m")
    return "; ".join(parts)


def in_brief(contact: Contact) -> str:
    """Where and how hard, or why that is not known."""
    if contact.status not in LOCATED:
        return contact.reason
    distance, std = 1e3 * contact.distance_m, 1e3 * contact.distance_std_m
    return f"{distance:.2f} ± {std:.2f} mm from the clamp, {1e3 * np.linalg.norm(contact.force_N):.1f} mN"


def seen(item: FrameContact) -> str:
    """What was seen of the antenna."""
    if item.line is not None:
        return described(item.line)
    count = 0 if item.measured is None else len(item.measured.points_px)
    return f"{count} points from centrelines.csv, no picture"
