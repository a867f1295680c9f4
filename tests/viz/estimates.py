"""Made-up object estimates of a table of contacts, without the work."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from estimator.table.contacts import ContactTable

MU, STIFFNESS_N_M = 0.3, 250.0


def object_estimate(table: ContactTable, *, determined: bool = True) -> Any:
    """Sliding one way, then the other, on a soft object; without `determined`, the same without its conclusions."""
    row = np.flatnonzero(table.located)
    force = table.force_world_N[row]
    size = np.linalg.norm(force, axis=1)
    normal = force / size[:, None]
    sign = np.where(np.arange(len(row)) < len(row) // 2, 1.0, -1.0)
    phase = np.where(table.located, "sliding", "free")
    slip = np.full(len(table), np.nan)
    slip[row] = 0.01 * sign
    surface = SimpleNamespace(
        points_m=table.point_world_m[row],
        normals=normal,
        triangles=np.array([[0, 1, 2]]),
        lines=np.array([[0, 1]]),
        std_m=np.full(len(row), 1e-4),
        touched_m=table.point_world_m[row] + normal * (size / STIFFNESS_N_M)[:, None],
        touched_normal=normal,
        touched_patch=np.zeros(len(row), int),
        touched_row=row,
        compliance=SimpleNamespace(
            determined=determined,
            compliance_m_N=1 / STIFFNESS_N_M,
            std_m_N=1e-4,
            stiffness_N_m=STIFFNESS_N_M if determined else np.nan,
            interval_N_m=np.array([238.0, 263.0]) if determined else np.full(2, np.nan),
            reason="" if determined else "the force hardly varied",
        ),
        notes=("one patch was withheld",),
    )
    friction = SimpleNamespace(
        determined=determined,
        mu=MU if determined else np.nan,
        std=0.01,
        interval=np.array([0.28, 0.32] if determined else [0.1, np.inf]),
        cone_half_angle_rad=np.arctan(MU),
        reason="" if determined else "it never slid",
        lateral_rad=-sign * np.arctan(MU),
        lateral_std_rad=np.full(len(row), 0.01),
        used_as=np.full(len(row), "sliding"),
        row=row,
    )
    events = (
        SimpleNamespace(
            kind="first_contact", frame=0, time_s=0.1, time_std_s=0.02, delay_s=0.05, words="<touch> at 0.10 s"
        ),
        SimpleNamespace(kind="slip_start", frame=3, time_s=0.2, time_std_s=np.nan, delay_s=np.nan, words="it slips"),
    )
    track = SimpleNamespace(
        phase=phase,
        slip_std_m_s=np.where(table.located, 1e-3, np.nan),
        longitudinal_m_s=slip,
        lateral_m_s=0.5 * slip,
        ringing=table.frame == 4,
        events=events,
        notes=("the frames come too seldom to tell a frequency",),
    )
    normals = SimpleNamespace(normal=normal, std_rad=np.full(len(row), 0.05))
    return SimpleNamespace(track=track, surface=surface, friction=friction, normals=normals)
