"""Materials of whiskers: Young's modulus and density of each, and their plausible ranges.

Moduli are those of drawn wire and of rods along their fibres at room temperature, from manufacturers' data sheets.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from vbaa_calib.core.errors import Diagnosis


def round_wire(youngs_modulus_Pa: float, density_kg_m3: float, diameter_m: float) -> tuple[float, float]:
    """EI, N·m², and mass per length, kg/m, of a round wire: E·πd⁴/64 and ρ·πd²/4."""
    return youngs_modulus_Pa * math.pi * diameter_m**4 / 64, density_kg_m3 * math.pi * diameter_m**2 / 4


@dataclass(frozen=True)
class Material:
    """A material: its usual modulus (Pa) and density (kg/m³), and the ranges of what is sold under the name.

    Superelastic and plastic materials have wide ranges: heat treatment, temperature and moisture change them.
    """

    name: str
    youngs_modulus_Pa: float
    modulus_range_Pa: tuple[float, float]
    density_kg_m3: float
    density_range_kg_m3: tuple[float, float]

    def has_modulus(self, youngs_modulus_Pa: float) -> bool:
        """Whether a Young's modulus is in the material's range."""
        low, high = self.modulus_range_Pa
        return low <= youngs_modulus_Pa <= high

    def has_density(self, density_kg_m3: float) -> bool:
        """Whether a density is in the material's range."""
        low, high = self.density_range_kg_m3
        return low <= density_kg_m3 <= high

    @staticmethod
    def named(name: object) -> Material | None:
        """The material of this name in any capitalisation; None if unknown."""
        return next((one for one in MATERIALS.values() if one.name.lower() == str(name).strip().lower()), None)

    def doubts(self, youngs_modulus_Pa: float, density_kg_m3: float) -> list[Diagnosis]:
        """Doubts whether the material can have this modulus and density, each with the materials that can."""
        found = []
        if not self.has_modulus(youngs_modulus_Pa):
            low, high = (1e-9 * bound for bound in self.modulus_range_Pa)
            words = (
                f"Young's modulus is {1e-9 * youngs_modulus_Pa:.4g} GPa, that of {self.name} {low:g} to {high:g} GPa"
            )
            found.append(Diagnosis("modulus_not_of_material", words, _instead(_materials_near(youngs_modulus_Pa))))
        if not self.has_density(density_kg_m3):
            low, high = self.density_range_kg_m3
            words = f"the density is {density_kg_m3:.4g} kg/m³, that of {self.name} {low:g} to {high:g} kg/m³"
            near = tuple(one.name for one in MATERIALS.values() if one.has_density(density_kg_m3))
            found.append(Diagnosis("density_not_of_material", words, _instead(near)))
        return found


def _row(name: str, modulus_GPa: tuple[float, float, float], density_kg_m3: tuple[float, float, float]) -> Material:
    """A material from (usual, least, largest) modulus, GPa, and density."""
    usual, low, high = (1e9 * value for value in modulus_GPa)
    return Material(name, usual, (low, high), density_kg_m3[0], density_kg_m3[1:])


MATERIALS = {
    one.name: one
    for one in (
        _row("stainless steel", (193.0, 175.0, 207.0), (7900.0, 7600.0, 8100.0)),
        _row("steel", (206.0, 195.0, 216.0), (7850.0, 7700.0, 7950.0)),  # spring steel, music wire
        _row("nitinol", (60.0, 28.0, 85.0), (6450.0, 6350.0, 6600.0)),  # martensite 28 to 41, austenite 70 to 85
        _row("carbon fibre", (135.0, 90.0, 300.0), (1550.0, 1400.0, 1750.0)),  # unidirectional rods
        _row("glass fibre", (40.0, 20.0, 56.0), (2000.0, 1650.0, 2200.0)),  # unidirectional rods
        _row("nylon", (2.8, 0.9, 5.5), (1140.0, 1050.0, 1200.0)),  # moist to drawn monofilament
        _row("brass", (103.0, 94.0, 118.0), (8500.0, 8300.0, 8800.0)),
        _row("bronze", (111.0, 96.0, 128.0), (8800.0, 7600.0, 8950.0)),  # phosphor and aluminium bronze
        _row("copper", (119.0, 108.0, 135.0), (8930.0, 8200.0, 8970.0)),  # to beryllium copper
        _row("aluminium", (70.0, 66.0, 75.0), (2710.0, 2600.0, 2850.0)),
        _row("titanium", (110.0, 55.0, 122.0), (4450.0, 4380.0, 5100.0)),  # beta alloys from 55
        _row("tungsten", (405.0, 340.0, 415.0), (19250.0, 17000.0, 19400.0)),
        _row("PEEK", (3.7, 3.0, 5.0), (1310.0, 1250.0, 1350.0)),
        _row("PLA", (3.2, 2.0, 4.2), (1240.0, 1100.0, 1300.0)),  # printed
        _row("polypropylene", (1.4, 0.7, 2.2), (905.0, 880.0, 950.0)),
    )
}
"""By name, the commonest for whiskers first; session.yaml's `antenna.material` is one of these, or any other word."""


def _materials_near(youngs_modulus_Pa: float) -> tuple[str, ...]:
    """Names of the materials that can have this Young's modulus, the likeliest first.

    Likeliest is the material with the usual modulus nearest to it, relative to the material's own range; empty where
    none fits.
    """

    def distance(one: Material) -> float:
        low, high = (math.log(bound / one.youngs_modulus_Pa) for bound in one.modulus_range_Pa)
        off = math.log(youngs_modulus_Pa / one.youngs_modulus_Pa)
        return off / (high if off > 0 else low)

    fitting = [one for one in MATERIALS.values() if one.has_modulus(youngs_modulus_Pa)]
    return tuple(one.name for one in sorted(fitting, key=distance))


def _instead(names: tuple[str, ...]) -> str:
    fits = f"{' or '.join(names[:3])} would fit; " if names else "no material of the table has it: is the unit right? "
    return f"{fits}correct the number, or name the material"
