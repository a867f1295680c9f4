"""What is reported of a recording or a session, and how far off the rows are that count as located."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from estimator import ContactEstimator, recording_verdict
from estimator.contact.recording import estimate_pictures
from estimator.table.contacts import LOCATED, Contact, Measured
from vbaa_calib.core.errors import Diagnosis, InputError, VbaaError, Verdict

from .pictures import Pictured
from .recordings import NAMED, NOTHING, REPORTED, Data, Mistake, Recording, Truth
from .sessions import Taken, calibrated

NAMED_RIGHT, ONLY_DOUBTED, SILENT, QUIET, ALARM = "named", "doubted", "silent", "quiet", "false alarm"
"""What became of a mistake. quiet: nothing had to be reported, and nothing was."""


@dataclass(frozen=True)
class Outcome:
    """Of one recording or session with one mistake.

    what : as above. findings : names, the worst first. severity : of the verdict. worst_std : largest error of a
    located row in its stated standard deviations, 0 without one. located : such rows.
    """

    what: str
    findings: tuple[str, ...]
    severity: str
    worst_std: float = 0.0
    located: int = 0

    @property
    def silent_std(self) -> float:
        """The largest error that no `wrong` warns of."""
        return 0.0 if self.severity == "wrong" else self.worst_std


def judged(mistake: Mistake[Recording], clean: Recording, rng: np.random.Generator) -> Outcome:
    """A recording with a mistake, estimated."""
    try:
        recording = mistake.altered(clean, rng)
        contacts = list(ContactEstimator(recording.rig).run(recording.frames))
        return _judged(mistake, recording, recording.frames, contacts)
    except InputError as error:
        return _refused(mistake, error)


def judged_pictures(mistake: Mistake[Pictured], clean: Pictured, rng: np.random.Generator) -> Outcome:
    """A recording with a mistake in its pictures, estimated."""
    try:
        recording = mistake.altered(clean, rng)
        found = list(estimate_pictures(ContactEstimator(recording.rig), recording.frames))
        return _judged(mistake, recording, [one.measured for one in found], [one.contact for one in found])
    except InputError as error:
        return _refused(mistake, error)


def _judged(
    mistake: Mistake[Data], recording: Recording | Pictured, several: Sequence[Measured], contacts: Sequence[Contact]
) -> Outcome:
    verdict = recording_verdict(recording.rig, several, contacts)
    names = tuple(one.name for one in verdict.findings)
    located = sum(one.status in LOCATED for one in contacts)
    # where the joints are not to be tested, and that is reported, only what the antenna's own frame says is judged
    worst = errors_std(recording.truth, contacts, in_world="joints_untested" not in names)
    return Outcome(outcome_of(mistake, verdict), names, verdict.severity, worst, located)


def judged_session(mistake: Mistake[Taken], clean: Taken, rng: np.random.Generator) -> Outcome:
    """A session with a mistake, calibrated."""
    try:
        verdict = calibrated(mistake.altered(clean, rng)).rig.verdict
    except VbaaError as error:
        return _refused(mistake, error)
    return Outcome(outcome_of(mistake, verdict), tuple(one.name for one in verdict.findings), verdict.severity)


def _refused(mistake: Mistake[Data], error: VbaaError) -> Outcome:
    """What was refused in words: as good as a finding of the cause that it names."""
    right = mistake.says and re.search(mistake.says, str(error))
    name = min(mistake.right) if right else "refused"
    words = Diagnosis(name, str(error), "", "wrong")
    return Outcome(outcome_of(mistake, Verdict.of([words])), (f"refused: {getattr(error, 'what', error)}",), "wrong")


def outcome_of(mistake: Mistake[Data], verdict: Verdict) -> str:
    """What a verdict makes of a mistake."""
    names = [one.name for one in verdict.findings]
    loud = verdict.severity in ("wrong", "doubt")
    if mistake.must == NOTHING:
        # a name that is right is no alarm, but a note
        alarming = [one for one in verdict.findings if one.severity != "note" and one.name not in mistake.right]
        return ALARM if alarming else QUIET
    if mistake.must == REPORTED:
        return NAMED_RIGHT if mistake.right & set(names) else ONLY_DOUBTED if loud else SILENT
    if names and names[0] in mistake.right and (loud or mistake.must != NAMED):
        return NAMED_RIGHT
    return ONLY_DOUBTED if loud else SILENT


def errors_std(truth: Truth, contacts: Sequence[Contact], in_world: bool = True) -> float:
    """The largest error of a located row in its standard deviations: distance, force, place in the world.

    Where nothing touches, there is none to be located: that counts as infinite.
    """
    worst = 0.0
    for row, one in enumerate(contacts):
        if one.status not in LOCATED:
            continue
        if not np.isfinite(truth.distance_m[row]):
            return np.inf
        off = [
            np.atleast_1d((one.distance_m - truth.distance_m[row]) / one.distance_std_m),
            (one.force_N - truth.force_N[row])[1:] / one.force_std_N[1:],
            in_world * (one.point_world_m - truth.point_world_m[row]) / np.sqrt(np.diag(one.covariance_world_m2)),
        ]
        worst = max(worst, float(np.nanmax(np.abs(np.concatenate(off)))))
    return worst


CLEAN: Mistake[Any] = Mistake("nothing", NOTHING, frozenset(), lambda was, rng: replace(was))
"""A recording as it is."""
