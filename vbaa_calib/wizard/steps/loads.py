"""Known loads: how stiff the antenna is."""

from __future__ import annotations

from collections.abc import Mapping

from vbaa_calib.calibrate.guide.next_load import load_progress
from vbaa_calib.core.errors import VbaaError
from vbaa_calib.session import Load
from vbaa_calib.wizard.sources.offered import Offered
from vbaa_calib.wizard.state.progress import Judged, Number, Progress
from vbaa_calib.wizard.state.session_state import Known

from .pictures import found_antenna
from .step import Step

GOAL = 0.01
LEAST = 2


def judge(known: Known, offered: Offered, readings: Mapping[str, float] | None) -> Judged:
    """A picture of the loaded antenna."""
    return found_antenna(known, "loads", offered, readings)


def look(known: Known) -> Progress:
    """How far the stiffness is."""
    taken = known.taken("loads")
    seen = [f"{len(taken)} load{'' if len(taken) == 1 else 's'}"]
    masses = [1e-3 * float(mass) for mass in known.store.journal.answers["weights_g"]]
    try:
        joint, session = known.joint(), known.session
        now = load_progress(joint, session, masses, GOAL, known.kinematics)
    except VbaaError as error:
        then = "mend what is said above; `back` leads to it" if taken else "hang a weight on the antenna"
        return Progress(tuple(seen), (str(error),), then)
    loaded = any(isinstance(still, Load) for still in known.stills())
    enough = now.enough and len(taken) >= LEAST
    suggested = now.suggestion.words if now.suggestion else ""
    return Progress(
        seen=tuple(seen),
        missing=(*(() if enough else (now.words,)), *now.missing),
        next="enough, more will not help" if enough else suggested,
        enough=enough,
        usable=len(taken) >= LEAST,
        numbers=(
            Number(
                "stiffness EI, one standard deviation",
                f"{100 * now.std_relative_with_readings:.2f} %" if loaded else "not known yet",
                f"{100 * GOAL:.0f} %",
                now.reached if loaded else None,
            ),
        ),
        diagnoses=tuple(known.still_diagnoses()) if loaded else (),
    )


STEP = Step(
    "loads",
    "Known loads",
    "Hang known masses on the antenna, one at a time, at measured distances from the clamp; let it rest.",
    "How far a known force bends it is its stiffness EI, and EI turns every bend seen later into newtons.",
    look,
    judge,
)
