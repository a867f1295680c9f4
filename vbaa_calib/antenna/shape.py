"""Shape of the antenna for the inverse problems: from clamp, bow, weight and one point force to a curve in space."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vbaa_calib.core.arrays import Rows
from vbaa_calib.native import core

from .taper import UNIFORM, Taper

PARAMETERS = (
    "clamp_y_m",
    "clamp_z_m",
    "clamp_about_y_rad",
    "clamp_about_z_rad",
    "bow_about_y_per_m",
    "bow_about_z_per_m",
    "log_stiffness_Nm2",
    "log_mass_per_length_kg_m",
    "clamp_give_m",
)
"""Order of an antenna's parameter vector. Logarithms keep stiffness and mass positive, their errors relative.

No clamp is rigid: it turns with the moment that it holds, as if a short piece of the antenna, `clamp_give_m` long, bent
inside it."""
CONTACT: int = core.antenna.NODES_TO_CONTACT - 1
"""The contact's node of a shape (`nodes.hpp` of the core)."""


def _aligned_arclength(contact_m: np.ndarray, length_m: float) -> np.ndarray:
    """(B, N) arc lengths of nodes from clamp to tip, one of them at the contact, where the shape's curvature has a
    kink."""
    contact = contact_m[:, None]
    beyond = contact + (length_m - contact) * np.linspace(0.0, 1.0, core.antenna.NODES_BEYOND + 1)[1:]
    return np.concatenate([contact * np.linspace(0.0, 1.0, core.antenna.NODES_TO_CONTACT), beyond], -1)


@dataclass(frozen=True, eq=False)
class Curves(Rows):
    """A batch of B antenna shapes, each at its own N nodes.

    Attributes
    ----------
    arclength_m : (B, N) from the clamp; node `CONTACT` is the contact.
    points_m, tangents : (B, N, 3) antenna frame.
    force_N : (B, 3) the object's force on the antenna, antenna frame.
    moment_Nm : (B,) x·f_z − z·f_x of force and weight about the antenna frame's origin, the sign of the paper's τ_y.
    radius_m : (B, N) of the round antenna; None: too thin to matter in a picture.
    """

    arclength_m: np.ndarray
    points_m: np.ndarray
    tangents: np.ndarray
    force_N: np.ndarray
    moment_Nm: np.ndarray
    radius_m: np.ndarray | None = None

    @property
    def contact_m(self) -> np.ndarray:
        """(B, 3) point of the centreline at the contact, antenna frame."""
        return self.points_m[:, CONTACT]


def bend(
    parameters: np.ndarray,
    length_m: float,
    gravity_m_s2: np.ndarray,
    contact_m: np.ndarray,
    force_N: np.ndarray,
    *,
    dead: bool = False,
    sweeps: int = 2,
    friction_rad: np.ndarray | None = None,
    taper: Taper = UNIFORM,
    diameter_m: float = 0.0,
) -> Curves:
    """Shapes of antennas under weight and one point force each.

    Parameters
    ----------
    parameters : (B, 9), see `PARAMETERS`.
    gravity_m_s2 : (B, 3) antenna frame.
    contact_m : (B,) arc length of the force from the clamp.
    force_N : (B, 2). By default the components (y, z), in the clamp's frame, of a force along the antenna's normal at
        the contact before it is turned with the antenna, by the least rotation that takes the clamped tangent to the
        one at the contact. With `dead`, the components (y, z) of a hanging load, antenna frame, which keeps its
        direction.
    sweeps : passes over the equilibrium of moments. Each leaves a tenth to a fortieth of the error at contact slopes of
        up to 35°; under a `dead` load a tenth at 20°, 0.3 at 35°.
    friction_rad : (B,) within ±π/2, angle of the contact force from the antenna's normal at the contact; positive leans
        towards the clamp. `force_N` stays the component along the normal: the whole force is |force_N|/cos of the
        angle. None is a contact without friction. Ignored with `dead`.
    taper : how the antennas' stiffness and weight, which are the clamp's, change along them.
    diameter_m : at the clamp; it widens the antenna in pictures and does not affect its shape.

    Notes
    -----
    Without weight, bow and `dead` the elastica is in equilibrium, and the sweeps leave it as it is.
    """
    friction_rad = np.zeros(len(contact_m)) if friction_rad is None else friction_rad
    wires, pushes = (parameters, length_m, taper.pieces), (contact_m, force_N, friction_rad)
    bent = core.antenna.bend(dead, sweeps, wires, gravity_m_s2, pushes)
    curves = curves_of(contact_m, length_m, bent)
    if diameter_m == 0.0:
        return curves
    return replace(curves, radius_m=0.5 * diameter_m * taper.diameter(curves.arclength_m / length_m))


def curves_of(contact_m: np.ndarray, length_m: float, bent: tuple[np.ndarray, ...]) -> Curves:
    """Curves with contacts (B,) from the arrays that the core returns."""
    contact = np.minimum(contact_m, (1.0 - core.antenna.NEAREST_TO_TIP) * length_m)
    return Curves(_aligned_arclength(contact, length_m), *bent)
