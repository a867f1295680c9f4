"""Put the table of hypotheses about a recording into docs/troubleshooting.md.

python docs/quote_hypotheses.py
"""

from __future__ import annotations

import re
import sys
from itertools import groupby, takewhile
from pathlib import Path

from estimator.diagnose.changes import CHANGES
from estimator.diagnose.hypotheses import READINGS

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "troubleshooting.md"


def hypotheses() -> str:
    """The table in Markdown, a row for each remedy: its messages, with the words that they begin with once."""
    lines = ["| message | do |", "|---|---|"]
    for remedy, group in groupby((*READINGS, *CHANGES), key=lambda row: re.sub(r"[\d.e-]+(?=:)", "…", row.remedy)):
        messages = [words.split() for words in dict.fromkeys(row.words.replace("{}", "…") for row in group)]
        common = len(list(takewhile(lambda each: len(set(each)) == 1, zip(*messages, strict=False))))
        begin = common if common > 2 else 0
        shown = [words if number == 0 else ["…"] * bool(begin) + words[begin:] for number, words in enumerate(messages)]
        lines.append(f"| {', '.join('*' + ' '.join(words) + '*' for words in shown)} | {remedy} |")
    return "\n".join(lines)


def main() -> None:
    """Replace the page's table."""
    sys.path.insert(0, str(ROOT))
    from benchmarks.harness import replace_marked

    replace_marked(PAGE, "docs/quote_hypotheses.py", hypotheses())


if __name__ == "__main__":
    main()
