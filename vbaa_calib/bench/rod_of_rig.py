"""A rig's antenna as the rod that the benchmarks simulate."""

from __future__ import annotations

import numpy as np

from ..antenna.rod import Rod
from ..geometry import Pose
from ..rig import Rig
from ..synth.scene import POISSON_STEEL


def rod_of(rig: Rig) -> Rod:
    """The rig's antenna as a round steel wire, rigidly clamped: GJ = EI / (1 + ν)."""
    antenna = rig.antenna
    y, z, about_y, about_z, bow_y, bow_z = antenna.parameters[:6]
    return Rod(
        length_m=antenna.length_m,
        bending_stiffness_Nm2=antenna.stiffness_Nm2,
        torsional_stiffness_Nm2=antenna.stiffness_Nm2 / (1.0 + POISSON_STEEL),
        mass_per_length_kg_m=antenna.mass_per_length_kg_m,
        T_antenna_clamp=Pose.from_rotvec(np.array([0.0, about_y, about_z]), np.array([0.0, y, z])),
        natural_curvature_per_m=np.array([bow_y, bow_z]),
    )
