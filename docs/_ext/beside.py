"""Pages that lie beside docs/, and links that work both where the Markdown lies and on the site.

A page of docs/ that only points to a file beside docs/ (the benchmarks, the changelog) holds that file's text on the
site. Links to such files, to examples and to folders become links to the pages that show them.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

DOCS = Path(__file__).parents[1]
ROOT = DOCS.parent
PAGES = {
    "benchmarks": "benchmarks/README.md",
    "vision_benchmark": "benchmarks/vision.md",
    "experiments": "benchmarks/paper.md",
    "real_sets": "benchmarks/real_sets.md",
    "processors": "benchmarks/processors.md",
    "limits_measured": "benchmarks/limits.md",
    "changelog": "CHANGELOG.md",
    "architecture": "ARCHITECTURE.md",
    "contributing": "CONTRIBUTING.md",
}
"""Page of the site → the file beside docs/ that it shows."""
FOLDERS = {"README.md": "index.md", "benchmarks": "benchmarks.md", "examples": "examples.md", "docs": "index.md"}
"""What else may be linked to → the page that shows it."""
_LINK = re.compile(r"(?<!`)(\]\()([^)\s#]+)((?:#[^)\s]*)?\))")


def setup(app: Sphinx) -> dict[str, Any]:
    """Rewrite each page as it is read."""
    app.connect("source-read", _read)
    return {"parallel_read_safe": True}


def _read(app: Sphinx, docname: str, source: list[str]) -> None:
    home = DOCS
    if docname in PAGES:
        path = ROOT / PAGES[docname]
        source[0], home = path.read_text(encoding="utf-8"), path.parent
        app.env.note_dependency(str(path))
    source[0] = relinked(source[0], home)


def relinked(text: str, home: Path) -> str:
    """Markdown that lies in the folder `home` with its links as seen from docs/; code is left alone."""
    pieces = re.split(r"(^```.*?^```)", text, flags=re.MULTILINE | re.DOTALL)
    pieces[::2] = [_LINK.sub(lambda link: link[1] + target(link[2], home) + link[3], piece) for piece in pieces[::2]]
    return "".join(pieces)


def target(link: str, home: Path) -> str:
    """Where a link leads on the site."""
    if "://" in link or link.startswith("mailto:"):
        return link
    path = Path(os.path.normpath(home / link)).relative_to(ROOT)
    name = path.as_posix()
    pages = {file: f"{page}.md" for page, file in PAGES.items()} | FOLDERS
    if name in pages:
        return pages[name]
    if path.parent.name == "examples" and path.suffix == ".py":
        return "examples.md"
    return os.path.relpath(ROOT / path, DOCS)
