"""Run every example, draw its figure into docs/images/examples, and renew what docs/examples.md quotes of it.

    python docs/quote_examples.py

After a change that moves the examples' numbers. `tests/test_examples.py` says when that is.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

DOCS = Path(__file__).parent
PAGE = DOCS / "examples.md"


def quoted(page: str, name: str, printed: str) -> str:
    """The page with what an example prints in the block below its command, if there is one."""
    block = re.compile(rf"(    python examples/{re.escape(name)}\n\n```text\n).*?(```)", re.DOTALL)
    return block.sub(lambda match: match[1] + printed.rstrip() + "\n" + match[2], page)


def main() -> None:
    """Example by example; one that fails ends it, with the page as it was."""
    page = PAGE.read_text(encoding="utf-8")
    for path in sorted((DOCS.parent / "examples").glob("[0-9]*.py")):
        print(path.name)
        command = [sys.executable, str(path), "--figures", str(DOCS / "images" / "examples")]
        page = quoted(page, path.name, subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    PAGE.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
