"""Generated tables in pages of docs/: what is between a script's marks is replaced, the rest is kept."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from vbaa_calib.core.files import write_text


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    return "\n".join(f"| {' | '.join(line)} |" for line in [head, ["---"] * len(head), *rows])


def replace_marked(page: Path, script: str, text: str) -> None:
    """Replace what is between the marks of a script, `benchmarks/NAME.py`."""
    begin, end = f"<!-- begin: {script} -->", f"<!-- end: {script} -->"
    before, _, rest = page.read_text(encoding="utf-8").partition(begin)
    _, _, after = rest.partition(end)
    write_text(page, f"{before}{begin}\n{text}\n{end}{after}", force=True)
