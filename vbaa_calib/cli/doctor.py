"""`vbaa doctor`: checks of the installation."""

from __future__ import annotations

import argparse
import sys
import textwrap
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from vbaa_calib.core.errors import Diagnosis
from vbaa_calib.doctor import CHECKS, HealthFinding

_WIDTH = 118


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--skip", action="append", default=[], choices=list(CHECKS), metavar="CHECK", help=f"one of {', '.join(CHECKS)}"
    )
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> dict[str, Any]:
    """Run and print the checks. `exit_code` in the result is 1 if any fails, else 0."""
    findings = []
    for finding in _examine({name: check for name, check in CHECKS.items() if name not in args.skip}):
        findings.append(finding)
        _print(_as_lines(finding))
    counts = {status: sum(finding.status == status for finding in findings) for status in ("ok", "look", "fails")}
    total = len(findings)
    verdict = f"healthy; to look at: {counts['look']} of {total}" if counts["look"] else "healthy"
    if counts["fails"]:
        verdict = f"not healthy; failed: {counts['fails']} of {total}; follow their remedies, then run it again"
    _print(["", verdict])
    return {
        "healthy": counts["fails"] == 0,
        "exit_code": int(counts["fails"] > 0),
        "counts": counts,
        "findings": [finding.to_dict() for finding in findings],
    }


def _examine(checks: Mapping[str, Callable[[], HealthFinding]]) -> Iterator[HealthFinding]:
    """Each check's finding; an exception in a check becomes a finding, too."""
    for name, check in checks.items():
        try:
            yield check()
        except Exception as error:  # whatever an unhealthy installation raises
            words = f"could not be looked at ({type(error).__name__}: {' '.join(str(error).split())})"
            remedy = "fix the problems above, then run `vbaa doctor` again"
            yield HealthFinding(name, words, (Diagnosis("check_broke", f"{name} {words}", remedy, "wrong"),))


def _as_lines(finding: HealthFinding) -> list[str]:
    head = f"{finding.status:<6}{finding.name:<11}"
    if not finding.problems:
        return textwrap.wrap(finding.words, _WIDTH, initial_indent=head, subsequent_indent=" " * len(head))
    lines = []
    for problem in finding.problems:
        lines += textwrap.wrap(
            problem.words, _WIDTH, initial_indent=head, subsequent_indent=" " * len(head), break_long_words=False
        )
        # a command must stay on one line to be copied
        lines.append(f"{'':<{len(head)}}→ {problem.remedy}")
        head = " " * len(head)
    return lines


def _print(lines: list[str]) -> None:
    """Print lines to stderr, with ? for characters that its encoding lacks."""
    encoding = getattr(sys.stderr, "encoding", None) or "ascii"
    for line in lines:
        print(line.encode(encoding, "replace").decode(encoding), file=sys.stderr, flush=True)
