"""Pages mention every table of the benchmarks, and docs/accuracy.md has a column for every scene of the demo."""

from __future__ import annotations

from pathlib import Path

from viz.cli.demo import SCENES

from .readme_table import table_in_readme

ROOT = Path(__file__).parents[1]


def test_every_csv_and_figure_of_the_benchmarks_is_mentioned() -> None:
    """In a page of the benchmarks or of the documentation."""
    pages = [*(ROOT / "benchmarks").glob("*.md"), *(ROOT / "docs").glob("*.md")]
    text = "".join(path.read_text(encoding="utf-8") for path in pages)
    lying = [path.name for suffix in ("csv", "png") for path in (ROOT / "benchmarks").glob(f"*.{suffix}")]
    assert [name for name in lying if name not in text] == []


def test_the_demos_table_has_a_column_for_every_scene() -> None:
    """`tests/cli/test_demo.py` holds each against a demo that it has run."""
    table = table_in_readme()
    assert set(table) == set(SCENES)
    assert all(len(rows) == 11 and all(rows.values()) for rows in table.values())
