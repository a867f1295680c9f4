"""`vbaa bench mistakes`: what people and hardware get wrong in sessions and recordings, and what is reported."""

from __future__ import annotations

import argparse
import csv
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness import Findings, Options, column, replace_marked, table
from estimator import ContactEstimator, recording_verdict
from estimator.table.contacts import LOCATED, Contact
from vbaa_calib.core.console import progress
from vbaa_calib.core.errors import Diagnosis, InputError, VbaaError, Verdict

from .recordings import (
    DOUBTED,
    NAMED,
    NOTHING,
    RECORDING,
    REPORTED,
    Data,
    Mistake,
    Recording,
    Truth,
    clean_recording,
    motion,
    recorded,
)
from .rigs import KINDS, calibrated_rig, drawn_kind, drifted
from .sessions import SESSION, Taken, calibrated, clean_session

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
    except InputError as error:
        return _refused(mistake, error)
    verdict = recording_verdict(recording.rig, recording.frames, contacts)
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
    # a force that was mistyped is the right cause only where its words say how
    names = [
        one.name if one.name != "load_force_mistyped" or re.search(mistake.says, one.words) else "other"
        for one in verdict.findings
    ]
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


RECORDED, TAKEN = "recording", "session"
TABLES: dict[str, Sequence[Mistake[Any]]] = {RECORDED: RECORDING, TAKEN: SESSION}


@dataclass(frozen=True)
class Row:
    """One mistake on one rig.

    Attributes
    ----------
    table : recording or session. must : be reported: N the right cause first, D a doubt, note the right cause if only
        as a note, none nothing.
    named, doubted, silent, alarms : how often the right cause came first; another finding; nothing; a false one.
    worst : largest error of a located row in its stated standard deviations, where no `wrong` warns of it; infinite
        where nothing touches. found : names of the first findings, the commonest first.
    """

    table: str = column("of")
    what: str = column("mistake")
    must: str = column("must")
    rig: str = column("rig")
    draws: int = column("draws", "d")
    named: float = column("named %", ".0f", 100.0)
    doubted: float = column("doubted %", ".0f", 100.0)
    silent: float = column("silent %", ".0f", 100.0)
    alarms: float = column("alarms %", ".0f", 100.0)
    worst: float = column("worst", ".1f")
    found: str = column()


def outcomes(options: Options) -> Iterator[tuple[str, Mistake[Any], str, Outcome]]:
    """Every mistake on every rig; quick: each on one of them."""
    tasks = [
        (name, index, mistake, number, draw)
        for name, several in TABLES.items()
        for index, mistake in enumerate(several)
        for number in range(len(KINDS))
        for draw in range(options.draws)
        if not options.quick or index % len(KINDS) == number
    ]
    for name, index, mistake, number, draw in progress(tasks, "mistakes"):
        yield name, mistake, KINDS[number].name, drawn(name, mistake, number, (options.seed, index, draw))


def drawn(name: str, mistake: Mistake[Any], number: int, seed: tuple[int, int, int]) -> Outcome:
    """A mistake of a table with a value of its own, on a recording or session of its own, on the rig of that number."""
    rng, own = np.random.default_rng((*seed, number)), 100 * seed[0] + 10 * seed[1] + seed[2]
    if name == TAKEN:
        return judged_session(mistake, clean_session(KINDS[number], own), rng)
    return judged(mistake, clean_recording(KINDS[number], own, int(rng.choice([60, 100, 150]))), rng)


def clean_outcomes(options: Options) -> Iterator[tuple[str, Outcome]]:
    """Sessions and recordings without a mistake, of rigs unlike ours; a quarter of the recordings has no free frame."""
    for seed in progress(range(8 * options.draws if not options.quick else 4), "clean"):
        yield from clean_pair((options.seed, seed))


def clean_pair(seed: tuple[int, int]) -> tuple[tuple[str, Outcome], tuple[str, Outcome]]:
    """A session and a recording of a rig that is drawn, without a mistake."""
    rng = np.random.default_rng((56, *seed))
    kind, own = drawn_kind(rng), 1000 * seed[0] + seed[1]
    frames = int(rng.choice([60, 100, 200]))
    known = calibrated_rig(kind, own)
    done = motion(kind, frames, rng, free=bool(rng.uniform() < 0.75))
    recording = recorded(known.rig, [drifted(known.world, rng.normal(size=20))] * frames, done, own)
    return ((TAKEN, judged_session(CLEAN, clean_session(kind, own), rng)), (RECORDED, judged(CLEAN, recording, rng)))


def row_of(name: str, mistake: Mistake[Any], rig: str, several: Sequence[Outcome]) -> Row:
    """What became of one mistake on one rig."""
    share = {what: float(np.mean([one.what == what for one in several])) for what in _WHAT}
    first = Counter(one.findings[0] if one.findings else "–" for one in several)
    return Row(
        *(name, mistake.what, mistake.must, rig, len(several)),
        *(share[NAMED_RIGHT], share[ONLY_DOUBTED], share[SILENT], share[ALARM]),
        worst=max(one.silent_std for one in several),
        found="; ".join(f"{each[:60]}" for each, _ in first.most_common(3)),
    )


_WHAT = (NAMED_RIGHT, ONLY_DOUBTED, SILENT, ALARM, QUIET)


def rows_of(found: Sequence[tuple[str, Mistake[Any], str, Outcome]], clean: Sequence[tuple[str, Outcome]]) -> list[Row]:
    """All mistakes, each on each rig, and at the end what is clean."""
    groups: dict[tuple[str, str, str], list[Outcome]] = {}
    mistakes = {(name, mistake.what): mistake for name, mistake, _, _ in found}
    for name, mistake, rig, outcome in found:
        groups.setdefault((name, mistake.what, rig), []).append(outcome)
    rows = [row_of(name, mistakes[name, what], rig, several) for (name, what, rig), several in groups.items()]
    for name in TABLES:
        own = [outcome for each, outcome in clean if each == name]
        if own:
            rows.append(row_of(name, CLEAN, "drawn", own))
    return rows


def shares(rows: Sequence[Row]) -> dict[str, dict[str, float]]:
    """By what must be reported of sessions and of recordings: how often it is, and the largest error without a word."""
    found = {}
    for name in TABLES:
        for must in dict.fromkeys(row.must for row in rows):
            own = [row for row in rows if (row.table, row.must) == (name, must)]
            if own:
                weights = np.array([row.draws for row in own], float)
                found[f"{name} {must}"] = {
                    each: float(np.average([getattr(row, each) for row in own], weights=weights))
                    for each in ("named", "doubted", "silent", "alarms")
                } | {"worst": max(row.worst for row in own)}
    return found


def in_markdown(rows: Sequence[Row]) -> str:
    """The matrix for a page: shares, and which mistakes are always named, doubted or silent, and which sometimes."""
    words = []
    for name in TABLES:
        own = [row for row in rows if row.table == name and row.what != CLEAN.what and row.must != NOTHING]
        if not own:
            continue
        groups: dict[str, list[str]] = {each: [] for each in ("named", "doubted", "silent", "sometimes named")}
        for what in dict.fromkeys(row.what for row in own):
            several = [row for row in own if row.what == what]
            always = [each for each in ("named", "doubted", "silent") if _mean(several, each) == 1.0]
            found = f"{what} ({100 * _mean(several, 'named'):.0f} %)" if not always else what
            groups[always[0] if always else "sometimes named"].append(found.removeprefix("pictures "))
        worst = "" if name == TAKEN else f", worst {max((row.worst for row in own), default=0.0):.0f}"
        part = ", ".join(f"{100 * _mean(own, each):.0f} % {each}" for each in ("named", "doubted", "silent"))
        lists = [f"*{each}*: {'; '.join(whats)}" for each, whats in groups.items() if whats]
        words.append(f"**{name.capitalize()}** ({part}{worst}): {'. '.join(lists)}.")
    clean = [row for row in rows if row.what == CLEAN.what]
    counted = ", ".join(f"{row.draws} {row.table}, {100 * row.alarms:.0f} % doubted" for row in clean)
    return "\n\n".join([*words, *([f"Nothing wrong: {counted}."] if clean else [])])


def _mean(several: Sequence[Row], name: str) -> float:
    return float(np.mean([getattr(row, name) for row in several])) if several else 0.0


def measure(options: Options) -> Findings:
    """Both columns of the matrix; a draw is one value of each mistake on each rig."""
    rows = rows_of(list(outcomes(options)), list(clean_outcomes(options)))
    by = shares(rows)
    wrong = {name: each for name, each in by.items() if name.endswith((NAMED, DOUBTED))}
    loud = max((each["worst"] for each in wrong.values()), default=0.0)
    parts = [
        f"{name}: named {100 * each['named']:.0f} %, silent {100 * each['silent']:.0f} %" for name, each in by.items()
    ]
    title = (
        "named: the right cause comes first; worst: error of a located row, in standard deviations, without a `wrong`"
    )
    return Findings(
        "\n".join([table(rows, title, once=3), *parts]),
        {"mistakes.csv": rows},
        numbers={"rows": rows, "shares": by},
        headline=f"{'; '.join(parts[:2])}; worst silent row {loud:.0f} std"[:100],
    )


def rows_in(path: Path) -> list[Row]:
    """The rows of a mistakes.csv."""

    def value(name: str, text: str) -> Any:
        if name in ("named", "doubted", "silent", "alarms", "worst"):
            return float(text or "inf")  # infinity has no place in the file
        return int(text) if name == "draws" else text

    with path.open(newline="") as file:
        return [Row(**{name: value(name, text) for name, text in row.items()}) for row in csv.DictReader(file)]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="put the matrix of mistakes.csv into a page")
    parser.add_argument("table", type=Path)
    parser.add_argument("page", type=Path)
    args = parser.parse_args()
    replace_marked(args.page, "benchmarks/mistakes/mistakes.py", in_markdown(rows_in(args.table)))
