"""What docs/accuracy.md says of the benchmarks stands in their tables."""

from __future__ import annotations

import csv
import math
import re
from pathlib import Path

import numpy as np
import pytest

from viz.cli.demo import SCENES

from .readme_table import table_in_readme

ROOT = Path(__file__).parents[1]
PAGE = " ".join((ROOT / "docs" / "accuracy.md").read_text(encoding="utf-8").split())


def rows(name: str) -> list[dict[str, str]]:
    """A benchmark's table as it lies in the repository."""
    with (ROOT / "benchmarks" / name).open(encoding="utf-8", newline="") as lines:
        return list(csv.DictReader(lines))


def numbers(table: list[dict[str, str]], column: str, **where: str) -> np.ndarray:
    """A column's numbers, empty cells NaN, of the rows whose cells are as said."""
    return np.array(
        [float(row[column] or "nan") for row in table if all(row[name] == value for name, value in where.items())]
    )


def said(pattern: str) -> tuple[float, ...]:
    """The numbers of a sentence of docs/accuracy.md, as groups of a pattern."""
    found = re.search(pattern, PAGE)
    assert found is not None, f"docs/accuracy.md does not contain {pattern!r}: change this test, too"
    return tuple(float(group.replace(",", "")) for group in found.groups())


def test_errors_over_the_bound_and_coverage() -> None:
    """Rms over all cells of each quantity, and the least and the largest share of intervals that hold the truth."""
    low, high = said(r"([\d.]+) to ([\d.]+) of the Cramér–Rao bound")
    least, most = said(r"95 % intervals hold the truth in ([\d.]+) to ([\d.]+) %")
    table = rows("estimator.csv")
    quantities = sorted({row["quantity"] for row in table})
    of_bound = [math.sqrt(np.nanmean(numbers(table, "of_bound", quantity=name) ** 2)) for name in quantities]
    covered = [100 * np.nanmean(numbers(table, "covered", quantity=name)) for name in quantities]
    assert [f"{min(of_bound):.2f}", f"{max(of_bound):.2f}"] == [f"{low:.2f}", f"{high:.2f}"]
    assert [f"{min(covered):.1f}", f"{max(covered):.1f}"] == [f"{least:.1f}", f"{most:.1f}"]
    (cells,) = said(r"over (\d+) kinds of matched scenes")
    assert cells == len(table) / len(quantities)


def test_speed_of_the_estimator() -> None:
    """A calibrated rig, friction as by default, `auto`, in a batch and one by one; beside the older commit."""
    per_second, single_ms, batch_times, single_times = said(
        r"500 points some ([\d,]+) frames a second in a batch, ([\d.]+) ms for one, ([\d.]+) and ([\d.]+) times"
    )
    of = {"rig": "calibrated", "method": "auto", "points": "500", "threads": "1"}
    for work, column, value in (
        ("batch", "us", 1e6 / per_second),
        ("one frame", "us", 1e3 * single_ms),
        ("batch", "times", batch_times),
        ("one frame", "times", single_times),
    ):
        assert numbers(rows("speed.csv"), column, work=work, **of).item() == pytest.approx(value, rel=0.05)


def test_objects() -> None:
    """The worst cell of each column."""
    table = rows("object.csv")
    (surface_mm,) = said(r"the surface of cylinder, sphere, box edge and free form within ([\d.]+) mm")
    assert f"{numbers(table, 'surface_mm').max():.1f}" == f"{surface_mm:.1f}"
    normal_deg, cells, worst_deg = said(r"normals within ([\d.]+)° \(one of (\d+) cells: ([\d.]+)°\)")
    normals = np.sort(numbers(table, "normal_deg"))
    assert normals[-2] <= normal_deg < normals[-1]
    assert round(normals[-1]) == worst_deg
    assert len(table) == cells
    (mu,) = said(r"μ within ([\d.]+) where it is determined")
    assert np.nanmax(np.abs(numbers(table, "mu_error"))) <= mu
    newtons, percent = said(r"stiffness of (\d+) N/m within (\d+) %")
    assert round(100 * np.nanmax(np.abs(numbers(table, "stiffness_error", stiffness_N_m=f"{newtons:.1f}")))) == percent


def test_what_calibrations_say_of_themselves() -> None:
    """docs/calibrating.md: the least and the largest ratio of sampled to predicted deviations, and the coverage."""
    table = rows("coverage.csv")
    ratio = numbers(table, "ratio")
    covered = 100 * numbers(table, "covered", judged="True")
    page = (ROOT / "docs" / "calibrating.md").read_text(encoding="utf-8")
    assert f"scatter by {ratio.min():.2f} to {ratio.max():.2f} of them, over six rigs" in page
    assert f"hold the truth in {covered.min():.0f} to {covered.max():.0f} %" in page
    assert len({row["rig"] for row in table}) == 6


def test_pictures_for_the_lens() -> None:
    """How many pictures reach 0.1 mm on plane C and stay there, on each camera."""
    table = rows("guided.csv")
    needed: dict[str, list[float]] = {way: [] for way in ("as suggested", "random, as people do")}
    for way, found in needed.items():
        for rig in dict.fromkeys(row["rig"] for row in table):
            pictures, error = (numbers(table, column, rig=rig, way=way) for column in ("pictures", "true_rms_mm"))
            short = pictures[error > 0.1]
            found.append(pictures[pictures > short.max(initial=0)].min(initial=np.inf))
    assert needed["as suggested"] == [3, 3, 3, 3]
    assert sorted(needed["random, as people do"])[:2] == [4, 12]


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
