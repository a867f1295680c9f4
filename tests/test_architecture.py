"""The house rules that a machine can hold: imports point down, and docs/theory_paper.md names each equation's code."""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Iterator
from functools import cache, lru_cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGES = ("targets", "vbaa_calib", "estimator", "viz")

STRANGERS = [
    ("vbaa_calib.simulate", "estimator"),
    ("vbaa_calib.simulate", "vbaa_calib.detect"),
    ("vbaa_calib.simulate", "vbaa_calib.camera"),
    ("vbaa_calib.simulate", "vbaa_calib.rig"),
    ("targets", "vbaa_calib"),
]
"""Packages that must not know each other: the simulator is not to share code with what it tests."""
NAMED = (ast.FunctionDef, ast.ClassDef)
MOST_MODULES = 16
"""In a folder."""
PRIVATE_WORDS = re.compile(
    r"\b(given|held|beside|aside|shown|whose|stills?|told|said|looked|odd|lean|worth|settled?|clamour|desk|felt)\b"
)
"""Words that mean more in this project than in the field's books: docs/glossary.md has better ones."""
NATIVE = [path for kind in ("cpp", "hpp") for path in sorted((ROOT / "vbaa_calib/native/src").rglob(f"*.{kind}"))]
CXX_CONSTANTS = re.compile(r"^(?:inline )?(?:constexpr|const) .*", re.MULTILINE)
CXX_CONSTANT = re.compile(r"\b[A-Z][A-Z0-9_]+\b(?=[^=;(,]*=)")
MOST = {
    "module constants": 770,
    "class names used twice": 0,
    "classes": 418,
    "public names": 1084,
    "private words": 38,
    "type: ignore": 4,
    "words on pages": 29914,
}
"""What there may be of each. A number only goes down: a change that needs fewer lowers it."""


def tree_of(path: Path) -> ast.Module:
    """A module, parsed once however many rules look at it."""
    return _parsed(path.read_text(encoding="utf-8"))


_parsed = lru_cache(maxsize=None)(ast.parse)


def modules() -> dict[str, Path]:
    """Dotted name → file, sub-packages included."""
    found = {}
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            parts = path.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


@cache
def imported(name: str) -> set[str]:
    """Our modules that a module imports, anywhere in its text but for types alone, relative imports resolved."""
    path, known = ALL[name], ALL
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    names: set[str] = set()
    for node in _statements(tree_of(path)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                above = package.split(".")[: len(package.split(".")) - node.level + 1]
                base = ".".join([*above, base] if base else above)
            names |= {f"{base}.{alias.name}" if f"{base}.{alias.name}" in known else base for alias in node.names}
    return {name for name in names if name.partition(".")[0] in PACKAGES}


def _statements(node: ast.AST) -> Iterator[ast.AST]:
    """Those within, but for what types alone need."""
    for child in ast.iter_child_nodes(node):
        of_types = isinstance(child, ast.If) and isinstance(child.test, ast.Name) and child.test.id == "TYPE_CHECKING"
        if not (of_types or isinstance(child, ast.expr)):
            yield child
            yield from _statements(child)


@lru_cache
def graph() -> dict[str, set[str]]:
    """Module → our modules that it imports."""
    return {name: imported(name) & set(ALL) - {name} for name in ALL}


def upward(name: str, targets: set[str]) -> list[str]:
    """What a module imports from a package above its own, or from one that it must not know."""
    floor = PACKAGES.index(name.partition(".")[0])
    above = [target for target in targets if PACKAGES.index(target.partition(".")[0]) > floor]
    strange = [target for target in targets for a, b in STRANGERS if _inside(name, a) and _inside(target, b)]
    return above + [target for target in strange if target != "vbaa_calib.core.errors"]


def _inside(name: str, package: str) -> bool:
    return name == package or name.startswith(package + ".")


ALL = modules()


def test_imports_point_down() -> None:
    """No module imports from a package above its own, nor from a stranger."""
    assert {name: found for name in ALL if (found := upward(name, imported(name)))} == {}


def test_folders_are_small() -> None:
    """A folder is seen at a glance."""
    folders = Counter(path.parent for path in ALL.values())
    assert [str(folder) for folder, count in folders.items() if count > MOST_MODULES] == []


def concepts() -> dict[str, int]:
    """What a newcomer has to hold in mind: how many there are of each, in the packages and on the pages; constants and
    private words of the core, too."""
    counts, classes = Counter[str](), Counter[str]()
    files = [path for top in (*PACKAGES, "vbaa") for path in sorted((ROOT / top).rglob("*.py"))]
    for path in files:
        tree, names = tree_of(path), set[str]()
        counts["public names"] += sum(isinstance(node, NAMED) and not node.name.startswith("_") for node in tree.body)
        for node in tree.body:
            targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", node)]
            each = [one for target in targets for one in (target.elts if isinstance(target, ast.Tuple) else [target])]
            counts["module constants"] += sum(isinstance(one, ast.Name) and one.id.isupper() for one in each)
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                classes[node.name.lstrip("_")] += 1
            if isinstance(node, (*NAMED, ast.Module)):
                counts["private words"] += len(PRIVATE_WORDS.findall(ast.get_docstring(node) or ""))
            if isinstance(node, NAMED):
                names.add(node.name)
            elif isinstance(node, ast.arg):
                names.add(node.arg)
            elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                names.add(node.id)
        counts["private words"] += sum(len(PRIVATE_WORDS.findall(name.lower().replace("_", " "))) for name in names)
        counts["type: ignore"] += path.read_text(encoding="utf-8").count("type: ignore")
    for path in NATIVE:
        text = path.read_text(encoding="utf-8")
        counts["module constants"] += sum(len(CXX_CONSTANT.findall(line)) for line in CXX_CONSTANTS.findall(text))
        comments = " ".join(re.findall(r"//(.*)", text))
        words = set(re.findall(r"\b[a-z]\w*\b", re.sub(r"//.*", "", text)))
        counts["private words"] += len(PRIVATE_WORDS.findall(comments))
        counts["private words"] += sum(len(PRIVATE_WORDS.findall(word.replace("_", " "))) for word in words)
    settings = sum(count for name, count in classes.items() if name.endswith("Settings"))  # what were constants
    counts["classes"] = classes.total() - settings
    counts["class names used twice"] = sum(n > 1 for n in classes.values())
    pages = [*(ROOT / "docs").rglob("*.md"), *ROOT.glob("*.md")]
    counts["words on pages"] = sum(len(path.read_text(encoding="utf-8").split()) for path in pages)
    return dict(counts)


def test_concepts_become_fewer() -> None:
    """Nothing is added to what a newcomer has to hold in mind without taking as much away."""
    counts = concepts()
    assert counts.keys() == MOST.keys()
    assert {name: count for name, count in counts.items() if count > MOST[name]} == {}


def cycle(arrows: dict[str, set[str]]) -> list[str]:
    """A way from a node back to itself; empty without one."""
    finished: set[str] = set()

    def visit(name: str, trail: tuple[str, ...]) -> list[str]:
        if name in trail:
            return [*trail[trail.index(name) :], name]
        if name not in finished:
            for target in sorted(arrows.get(name, ())):
                found = visit(target, (*trail, name))
                if found:
                    return found
            finished.add(name)
        return []

    return next((found for name in sorted(arrows) if (found := visit(name, ()))), [])


def test_no_cycles_between_folders() -> None:
    """No folder reaches itself through what its modules import. `__init__` only re-exports its folder's own parts."""
    arrows: dict[str, set[str]] = {}
    for name, targets in graph().items():
        if ALL[name].name != "__init__.py":
            arrows.setdefault(_folder(name), set()).update(_folder(target) for target in targets)
    assert cycle({folder: targets - {folder} for folder, targets in arrows.items()}) == []


def _folder(name: str) -> str:
    return name if ALL[name].name == "__init__.py" else name.rpartition(".")[0]


def test_no_cycles_between_modules() -> None:
    """No module reaches itself through what it imports."""
    packages = {name for name, path in ALL.items() if path.name == "__init__.py"}  # they re-export their own parts
    assert cycle({name: set() if name in packages else targets for name, targets in graph().items()}) == []
    assert cycle({"a": {"b"}, "b": {"c"}, "c": {"b"}}) == ["b", "c", "b"]


def equation_tags() -> dict[int, set[str]]:
    """Equation number → files whose docstrings carry its tag."""
    found: dict[int, set[str]] = {}
    for path in ALL.values():
        tree = tree_of(path)
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
    """Equation number → files, as the table in docs/theory_paper.md says."""
    found: dict[int, set[str]] = {}
    for line in (ROOT / "docs/theory_paper.md").read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if line.startswith("| (") and len(cells) >= 3:
            for number in expand(cells[0]):
                found.setdefault(number, set()).update(re.findall(r"`([\w/]+\.py)`", cells[2]))
    return found


def test_equation_table_agrees_with_the_docstrings() -> None:
    """Who holds an equation of the paper finds its code in docs/theory_paper.md, and the other way round."""
    assert readme_table() == equation_tags()


def test_every_equation_of_the_paper_has_code() -> None:
    """Eqs. (1)–(30), all of them."""
    assert set(readme_table()) == set(range(1, 31))


def retired_words() -> set[str]:
    """The words that docs/glossary.md lists with better ones beside them."""
    page = (ROOT / "docs/glossary.md").read_text(encoding="utf-8").partition("## Words that we do not use")[2]
    return {row.split("|")[1].strip() for row in page.splitlines() if row.startswith("| ")} - {"not"}


def test_names_keep_to_the_glossary() -> None:
    """No module, class or function is named by a word that the glossary has retired, in whatever form."""
    words = retired_words()
    assert len(words) >= 10
    forms = words | {f"{word}s" for word in words} | {f"{word}d" for word in words} | {f"{word}ed" for word in words}
    found = []
    for name, path in ALL.items():
        defined = [node.name for node in ast.walk(tree_of(path)) if isinstance(node, NAMED)]
        for one in (name.rpartition(".")[2], *defined):
            parts = re.sub(r"([a-z])([A-Z])", r"\1_\2", one).lower().replace("line_of_sight", "").split("_")
            found += [f"{name}: {one}"] if forms & set(parts) else []
    assert found == []


def test_the_core_has_no_typedef() -> None:
    """Names of types are given by `using`: looked for here, which clang-tidy takes a quarter of its rules' time for."""
    assert [path.name for path in NATIVE if re.search(r"\btypedef\b", path.read_text(encoding="utf-8"))] == []


MOST_PARAMETERS = 6
LONG_STILL = {"vbaa_calib.antenna.rungs.curves", "vbaa_calib.antenna.shape.bend"}
"""Those that have more and are still to be mended; none may be added."""


def test_argument_lists_are_short() -> None:
    """At most six parameters, but for those still to be mended."""
    long = {
        f"{name}.{node.name}"
        for name, path in ALL.items()
        for node in ast.walk(tree_of(path))
        if isinstance(node, ast.FunctionDef) and _parameters(node) > MOST_PARAMETERS
    }
    assert long == LONG_STILL


def _parameters(node: ast.FunctionDef) -> int:
    found = node.args.posonlyargs + node.args.args + node.args.kwonlyargs
    return sum(one.arg not in ("self", "cls") for one in found)
