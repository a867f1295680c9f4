"""Put the table of hypotheses about a recording into docs/troubleshooting.md.

python docs/quote_hypotheses.py
"""

from __future__ import annotations

import re
import sys
from itertools import takewhile
from pathlib import Path

from estimator.diagnose.changes import CHANGES
from estimator.diagnose.hypotheses import ERRORS, READINGS

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "troubleshooting.md"


def hypotheses() -> str:
    """The table in Markdown, a row for each remedy: the beginnings of its messages, without numbers and columns' names,
    the words that several begin with once."""
    by_remedy = dict[str, dict[str, None]]()
    for row in (*READINGS, *ERRORS, *CHANGES):
        begins = re.split(r": | since the calibration|,? by (?:up to )?\{", row.words)[0]
        words = re.sub(r"\w+_Nm?\b|\{\}|\b(before|after)$", "…", begins)
        by_remedy.setdefault(re.sub(r"[\d.e-]+(?=:)", "…", row.remedy), {})[words] = None
    lines = ["| message | do |", "|---|---|"]
    for remedy, group in by_remedy.items():
        messages = [
            words.split() for words in group if not any(one != words and one.startswith(words) for one in group)
        ]
        common = len(list(takewhile(lambda each: len(set(each)) == 1, zip(*messages, strict=False))))
        begin = common if common > 2 and len(messages) > 1 else 0
        shown = [f"*{' '.join(messages[0][:begin])}*"] if begin else []
        shown.append(", ".join(f"*{' '.join(words[begin:])}*" for words in messages))
        lines.append(f"| {' '.join(shown)} | {remedy} |")
    return "\n".join(lines)


def main() -> None:
    """Replace the page's table."""
    sys.path.insert(0, str(ROOT))
    from benchmarks.harness import replace_marked

    replace_marked(PAGE, "docs/quote_hypotheses.py", hypotheses())


if __name__ == "__main__":
    main()
