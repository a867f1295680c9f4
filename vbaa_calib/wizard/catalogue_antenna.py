"""What is asked of the antenna, its sensor and the loads on it."""

from __future__ import annotations

from .catalogue_plane import AXES
from .questions import Question

ANTENNA_QUESTIONS = (
    Question(
        "antenna_diameter_mm",
        "noload",
        "How thick is the antenna?",
        "what it should weigh, and what EI should be: E·πd⁴/64",
        unit="mm",
        low=0.001,
        high=100.0,
    ),
    Question(
        "youngs_modulus_GPa",
        "noload",
        "Young's modulus of its material?",
        "only to see that the EI found is plausible",
        unit="GPa",
        default=193.0,
        low=1e-4,
        high=2000.0,
    ),
    Question(
        "density_kg_m3",
        "noload",
        "Density of its material?",
        "its weight makes it sag",
        unit="kg/m³",
        default=7900.0,
        low=10.0,
        high=30_000.0,
    ),
    Question(
        "gravity",
        "noload",
        "Which way is down in the world frame (z is the pan joint's axis)?",
        kind="choice",
        default="-z",
        choices=(*AXES, "none"),
        needed=lambda answers: not answers.get("gravity_given"),
    ),
    Question(
        "moment_std_mNm",
        "noload",
        "How far does the moment sensor scatter when nothing touches the antenna (one standard deviation)?",
        "what it shows later is held against this",
        unit="mN·m",
        default=0.02,
        low=1e-6,
        high=1e4,
    ),
    Question(
        "weights_g",
        "loads",
        "What masses can you hang on the antenna?",
        "three are enough; the wizard says which one to hang where",
        kind="numbers",
        unit="g",
        default=[5.0, 10.0, 20.0],
        low=0.001,
        high=100_000.0,
    ),
    Question(
        "distance_std_mm",
        "loads",
        "How exactly is a load's place along the antenna read off (one standard deviation)?",
        "half a millimetre with a ruler, a tenth with a caliper; it limits EI more than anything else",
        unit="mm",
        default=0.5,
        low=0.0,
        high=50.0,
    ),
    Question(
        "mass_std_percent",
        "loads",
        "And how well are the masses known?",
        unit="%",
        default=0.5,
        low=0.0,
        high=50.0,
    ),
)
