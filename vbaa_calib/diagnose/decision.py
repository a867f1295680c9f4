"""Decision between hypotheses that explain a set of observations: posterior odds against everything being as
reported."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Generic, TypeVar, get_args

from vbaa_calib.core.errors import Diagnosis, Severity

_Data = TypeVar("_Data")
"""A session, a recording, or a set of board views."""


@dataclass(frozen=True)
class DecisionSettings:
    """Thresholds from which a hypothesis is reported."""

    least_log_odds: float = 5.0  # posterior log odds over "as reported": 150 to 1
    least_doubt: float = 2.5  # the same from which it is reported as a doubt: 12 to 1; clean material stays below 0
    lead: float = 2.0  # log odds by which one must lead the next to be named alone
    rounds: int = 3  # further hypotheses are sought with the best one applied
    named: int = 3  # hypotheses that are named together, where the data do not decide
    least_share: float = 0.5  # part of the misfit that a cause must explain to be more than the nearest one


@dataclass(frozen=True, eq=False)
class Explanation(Generic[_Data]):
    """A hypothesis with its evidence from a set of observations.

    Attributes
    ----------
    diagnosis : what would be wrong, with the estimated value and its unit.
    log_odds : posterior, against "as reported".
    applied : the observations with the mistake put right; None where nothing can be sought behind it.
    covers : names of the hypotheses that this one makes superfluous.
    first : row of the observations from which on it holds, where they have an order.
    """

    diagnosis: Diagnosis
    log_odds: float
    applied: Callable[[], _Data] | None = None
    covers: tuple[str, ...] = ()
    first: int = 0


Hypothesis = Callable[[_Data], Iterable[Explanation[_Data]]]
"""A row of a table of hypotheses: of observations, the explanations that it offers; none where it does not apply."""


def decide(explanations: Iterable[Explanation[_Data]]) -> list[Explanation[_Data]]:
    """The likeliest explanation, together with those that the data hardly distinguish from it, as doubts where the
    odds are low; empty where everything may be as reported."""
    likely = [one for one in explanations if one.log_odds >= DecisionSettings.least_doubt]
    likely.sort(key=attrgetter("log_odds"), reverse=True)
    close = [one for one in likely if one.log_odds > likely[0].log_odds - DecisionSettings.lead]
    named = [one for one in close if one.diagnosis.name not in close[0].covers][: DecisionSettings.named]
    certain = not named or named[0].log_odds >= DecisionSettings.least_log_odds
    return named if certain else [_doubtful(one) for one in named]


def _doubtful(one: Explanation[_Data]) -> Explanation[_Data]:
    """An explanation as a doubt, too uncertain to search for further ones with it applied."""
    severity: Severity = "doubt" if one.diagnosis.severity == "wrong" else one.diagnosis.severity
    return replace(one, diagnosis=replace(one.diagnosis, severity=severity), applied=None)


def diagnose(data: _Data, table: Sequence[Hypothesis[_Data]]) -> list[Diagnosis]:
    """The diagnoses, the likeliest first: see `explained`."""
    return causes(explained(data, table)[0])


def causes(found: Sequence[Sequence[Explanation[_Data]]], left: float = 0.0) -> list[Diagnosis]:
    """The diagnoses of `explained`, the likeliest first. left : log odds of something that is in no table over the
    corrected observations; where they are high the likeliest cause is the nearest one only, or not the only one."""
    every = [_joined(best) for best in found]
    if not every or left < DecisionSettings.least_doubt:
        return every
    first, gained = every[0], sum(best[0].log_odds for best in found)
    share = gained / (gained + left)
    words = (
        f"{first.words}; that explains {100 * share:.0f} % of the misfit: something else is wrong as well, or instead"
    )
    if share < DecisionSettings.least_share:
        words = (
            "something is wrong that none of the known causes explains; the nearest, with "
            f"{100 * share:.0f} % of the misfit: {first.words}"
        )
        first = replace(first, name="unexplained")
    return [replace(first, words=words), *every[1:]]


def explained(data: _Data, table: Sequence[Hypothesis[_Data]]) -> tuple[list[list[Explanation[_Data]]], _Data]:
    """The diagnoses, the likeliest first, each with those that the data hardly distinguish from it; and the
    corrected observations. The table is evaluated again with each round's best explanation applied."""
    found: list[list[Explanation[_Data]]] = []
    for _ in range(DecisionSettings.rounds):
        known = {_subject(_joined(each)) for each in found}
        best = decide(one for row in table for one in row(data) if _subject(one.diagnosis) not in known)
        if not best:
            break
        found.append(best)
        if best[0].applied is None:
            break
        data = best[0].applied()
    return found, data


def _subject(one: Diagnosis) -> str:
    """The mistake, or the row with it, that is reported at most once."""
    return one.words if " row " in one.words else one.name


def _joined(alike: Sequence[Explanation[_Data]]) -> Diagnosis:
    """One diagnosis for several explanations that the data do not distinguish, with the first one's name and the
    gravest one's severity."""
    first, *others = every = [one.diagnosis for one in alike]
    if not others:
        return first
    words = "; or ".join(dict.fromkeys(one.words for one in every))
    remedy = "; or ".join(dict.fromkeys(one.remedy for one in every))
    return Diagnosis(first.name, words, remedy, min((one.severity for one in every), key=get_args(Severity).index))
