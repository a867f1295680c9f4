"""The house rules that a machine can hold: imports point down, and the README's equation table is true."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("targets", "vbaa_calib", "estimator", "viz")

FLOORS = {
    "vbaa_calib.errors": 0,
    "vbaa_calib.diagnosis": 0,
    "vbaa_calib.console": 0,
    "vbaa_calib.unique_yaml": 0,
    "vbaa_calib.files": 0,
    "vbaa_calib.csv_rows": 0,
    "vbaa_calib.schemas": 0,
    "vbaa_calib.folders": 0,
    "vbaa_calib.verbs": 0,
    "estimator.verbs": 0,
    "viz.verbs": 0,
    "targets": 1,
    "vbaa_calib.arrays": 1,
    "vbaa_calib.picture_size": 0,
    "vbaa_calib.images": 1,
    "vbaa_calib.geometry": 1,
    "vbaa_calib.session": 2,
    "vbaa_calib.antenna": 2,
    "vbaa_calib.camera": 3,
    "vbaa_calib.detect": 4,
    "vbaa_calib.rig": 4,
    "vbaa_calib.reprojection": 4,
    "vbaa_calib.formats": 5,
    "vbaa_calib.calibrate": 5,
    "vbaa_calib.synth": 5,
    "estimator": 5,
    "viz": 6,
    "vbaa_calib.bench": 6,
    "vbaa_calib.wizard": 7,
    "vbaa_calib.cli": 8,
}
"""Room → floor (ARCHITECTURE.md). A room may import from lower floors and from itself."""

STRANGERS = [
    ("vbaa_calib.synth", "estimator"),
    ("vbaa_calib.synth", "vbaa_calib.detect"),
    ("vbaa_calib.synth", "vbaa_calib.camera"),
    ("vbaa_calib.synth", "vbaa_calib.rig"),
    ("targets", "vbaa_calib"),
]
"""Rooms that must not know each other, whatever their floors: the simulator is not to share code with what it tests."""


def modules() -> dict[str, Path]:
    """Dotted name → file, sub-packages included."""
    found = {}
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            parts = path.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imported(name: str, path: Path, known: set[str], *, typing: bool = False) -> set[str]:
    """Our modules that a module imports, anywhere in its text, relative imports resolved."""
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    tree = ast.parse(path.read_text(encoding="utf-8"))
    skipped = {
        id(child)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
        for child in ast.walk(node)
    }
    names: set[str] = set()
    for node in ast.walk(tree):
        if id(node) in skipped and not typing:
            continue
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                above = package.split(".")[: len(package.split(".")) - node.level + 1]
                base = ".".join([*above, base] if base else above)
            names |= {f"{base}.{alias.name}" if f"{base}.{alias.name}" in known else base for alias in node.names}
    return {name for name in names if name.partition(".")[0] in PACKAGES}


def room(name: str) -> str | None:
    """The longest entry of FLOORS that a module lies in; None for the bare top of `vbaa_calib`."""
    fitting = [entry for entry in FLOORS if name == entry or name.startswith(entry + ".")]
    return max(fitting, key=len) if fitting else None


def upward(name: str, targets: set[str]) -> list[str]:
    """What a module imports from its own floor's neighbours or from above."""
    home = room(name)
    if home is None:
        return []
    wrong = []
    for target in targets:
        there = room(target)
        if there is not None and there != home and FLOORS[there] >= FLOORS[home] and FLOORS[home] > 0:
            wrong.append(target)
        if any(
            _inside(name, a) and _inside(target, b) and not _inside(target, "vbaa_calib.errors") for a, b in STRANGERS
        ):
            wrong.append(target)
    return wrong


def _inside(name: str, package: str) -> bool:
    return name == package or name.startswith(package + ".")


ALL = modules()


@pytest.mark.parametrize("name", sorted(ALL))
def test_imports_point_down(name: str) -> None:
    """No module imports from a room above it or beside it."""
    assert upward(name, imported(name, ALL[name], set(ALL))) == []


def test_every_module_has_a_floor() -> None:
    """A new room must be given its floor, or the rule above would not see it."""
    assert [name for name in ALL if room(name) is None] == ["vbaa_calib"]


def test_the_rule_sees_an_upward_import(tmp_path: Path) -> None:
    """The walker finds upward imports in every spelling, inside functions and sub-packages too."""
    spellings = [
        "import viz.scene",
        "from viz import scene",
        "from ..synth import write",
        "def f():\n    import estimator.estimate",
    ]
    for text in spellings:
        path = tmp_path / "module.py"
        path.write_text(text)
        assert upward("vbaa_calib.antenna.module", imported("vbaa_calib.antenna.module", path, set(ALL))), text


def test_no_cycles_between_modules() -> None:
    """No module reaches itself through what it imports."""
    graph = {name: imported(name, path, set(ALL)) & set(ALL) - {name} for name, path in ALL.items()}
    for package in [name for name, path in ALL.items() if path.name == "__init__.py"]:
        graph[package] = set()  # packages re-export their own parts
    finished: set[str] = set()

    def visit(name: str, trail: tuple[str, ...]) -> None:
        assert name not in trail, " → ".join([*trail, name])
        if name not in finished:
            for target in graph[name]:
                visit(target, (*trail, name))
            finished.add(name)

    for name in graph:
        visit(name, ())


def equation_tags() -> dict[int, set[str]]:
    """Equation number → files whose docstrings carry its tag."""
    found: dict[int, set[str]] = {}
    for path in ALL.values():
        tree = ast.parse(path.read_text(encoding="utf-8"))
        nodes = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
        docstrings = [ast.get_docstring(node) or "" for node in ast.walk(tree) if isinstance(node, nodes)]
        for text in docstrings:
            for numbers in re.findall(r"Eqs?\. ((?:\(\d+\)(?:[,–-]| and |, )?\s?)+)", text):
                for number in expand(numbers):
                    found.setdefault(number, set()).add(path.relative_to(ROOT).as_posix())
    return found


def expand(text: str) -> set[int]:
    """{8, 9, 10, 15} from "(8)–(10), (15)"."""
    found: set[int] = set()
    for first, last in re.findall(r"\((\d+)\)(?:[–-]\((\d+)\))?", text):
        found |= set(range(int(first), int(last or first) + 1))
    return found


def readme_table() -> dict[int, set[str]]:
    """Equation number → files, as the README's table says."""
    found: dict[int, set[str]] = {}
    for line in (ROOT / "README.md").read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if line.startswith("| (") and len(cells) >= 3:
            for number in expand(cells[0]):
                found.setdefault(number, set()).update(re.findall(r"`([\w/]+\.py)`", cells[2]))
    return found


def test_equation_table_agrees_with_the_docstrings() -> None:
    """Who holds an equation of the paper finds its code in the README, and the other way round."""
    assert readme_table() == equation_tags()


def test_every_equation_of_the_paper_has_code() -> None:
    """Eqs. (1)–(30), all of them."""
    assert set(readme_table()) == set(range(1, 31))
