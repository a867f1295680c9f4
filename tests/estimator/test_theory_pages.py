"""Every claim that docs/*.md marks ✓ names a test, and every test, module and page that they name is there."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCS = sorted((ROOT / "docs").glob("*.md"))
TEST = re.compile(r"tests/[\w/*]+\.py(?:::\w+)*|(?<=`)::\w+(?:::\w+)*")
MODULE = re.compile(r"`((?:vbaa_calib|estimator|antenna|calibrate|examples|benchmarks)/[\w/]+\.py)`")
LINK = re.compile(r"\]\(([^)#]+?)(?:#[^)]*)?\)")
EXEMPT = "✓ marks what a test shows"


@cache
def names(path: Path) -> frozenset[str]:
    """Tests and classes of a file, and Class::test."""
    found = set()
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        if isinstance(node, ast.ClassDef):
            found |= {f"{node.name}::{inner.name}" for inner in node.body if isinstance(inner, ast.FunctionDef)}
    return frozenset(found)


def missing(text: str) -> list[str]:
    """Tests that a page names and that are not there; a bare ::name belongs to the file named last before it."""
    lost, last = [], ""
    for name in TEST.findall(text):
        path, _, inside = name.partition("::")
        last = path or last
        known = frozenset[str]().union(*(names(file) for file in ROOT.glob(last))) if last else frozenset()
        if not known or (inside and inside not in known and not any(n.endswith(f"::{inside}") for n in known)):
            lost.append(name)
    return lost


def unproved(text: str) -> list[str]:
    """✓ without a test in the same paragraph behind it, or, in a heading, in the next paragraph."""
    bare = []
    for match in re.finditer("✓", text.replace(EXEMPT, " " * len(EXEMPT))):
        rest = text[match.end() :]
        heading = text[text.rfind("\n", 0, match.start()) + 1] == "#"
        paragraphs = rest.split("\n\n")
        behind = "".join(paragraphs[: 2 if heading else 1]).split("✓")[0]
        if not TEST.search(behind):
            bare.append(text[max(match.start() - 60, 0) : match.end()])
    return bare


@pytest.mark.parametrize("page", DOCS, ids=lambda page: page.name)
def test_tests_modules_and_pages_that_are_named_are_there(page: Path) -> None:
    text = page.read_text()
    assert not missing(text)
    assert not unproved(text)
    if page.name.startswith("theory") or page.name in ("ladder.md", "limits.md"):
        starts = (ROOT, ROOT / "vbaa_calib")
        lost = [name for name in MODULE.findall(text) if not any((start / name).is_file() for start in starts)]
        lost += [link for link in LINK.findall(text) if "://" not in link and not (page.parent / link).exists()]
        assert not lost


def test_these_tests_can_fail() -> None:
    assert missing("`tests/estimator/test_nothing.py`") == ["tests/estimator/test_nothing.py"]
    assert missing("`tests/estimator/test_misprints.py::TestUpright` `::test_nothing`") == ["::test_nothing"]
    assert not missing("`tests/estimator/test_misprints.py::TestUpright`, `::test_15_holds`")
    assert unproved("It holds ✓.\n\nMore `tests/estimator/test_misprints.py`.")
    assert unproved("It holds ✓, and so ✓ `tests/estimator/test_misprints.py`.")
    assert not unproved("# (14) ✓\n\n`tests/estimator/test_misprints.py`")


def test_every_equation_of_the_paper_is_stated() -> None:
    """(1) to (30) in docs/theory_paper.md."""
    stated = re.sub(r"\((\d+)\)–\((\d+)\)", _spelt_out, (ROOT / "docs/theory_paper.md").read_text())
    assert not [number for number in range(1, 31) if f"({number})" not in stated]


def _spelt_out(match: re.Match[str]) -> str:
    first, last = map(int, match.groups())
    # a range of equations in a heading states none of them
    return "" if last - first > 2 else " ".join(f"({number})" for number in range(first, last + 1))
