"""What is installed: by `make`, as a wheel, and what is named of it."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import subprocess
import sys
import zipfile
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
NATIVE = ROOT / "vbaa_calib" / "native"
PRODUCT = ("vbaa", "vbaa_calib", "targets", "estimator", "viz")
STUB = """#!/bin/sh
case "$*" in
  "-m venv "*) mkdir -p "$3/bin"
    for each in python vbaa ruff mypy cmake clang-format clang-tidy; do cp "$0" "$3/bin/$each"; done ;;
  *) echo "begin $(basename "$0") $*" >> log; sleep 0.05; echo "end $(basename "$0") $*" >> log ;;
esac
"""
"""Stands for Python and all commands of the environment: writes down when it is called for what."""


def made(folder: Path, *words: str) -> list[str]:
    """What `make` calls in a fresh folder, when each begins and ends."""
    for name in ("Makefile", "pyproject.toml", "constraints.txt"):
        shutil.copy(ROOT / name, folder)
    for path in (*NATIVE.glob("*.*"), *NATIVE.glob("src/**/*.?pp")):
        (folder / path.relative_to(ROOT)).parent.mkdir(parents=True, exist_ok=True)
        (folder / path.relative_to(ROOT)).touch()
    stub = folder / "stub"
    stub.write_text(STUB)
    stub.chmod(0o755)
    subprocess.run(["make", "--silent", f"PYTHON={stub}", *words], cwd=folder, check=True, timeout=60)
    return (folder / "log").read_text().splitlines()


@pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")
@pytest.mark.parametrize(
    ("words", "tools"),
    [("gl", False), ("demo", False), ("-j2 demo", False), ("install", True), ("test", True), ("-j2 lint test", True)],
)
def test_a_target_installs_what_it_needs(tmp_path: Path, words: str, tools: bool) -> None:
    log = made(tmp_path, *words.split())
    # the first one builds the core, too
    pips = [line for line in log if " -m pip install " in line or "native/build.py" in line]
    # each has ended before the next one begins, and the first before anything else
    assert [line.partition(" ")[0] for line in pips] == ["begin", "end"] * (len(pips) // 2)
    installed = log.index(next(line for line in pips if line.startswith("end")))
    assert not [line for line in log[:installed] if line not in pips and " -c " not in line]
    named = (found for line in pips for found in re.findall(r"\[([\w,]+)\]|build\.py ([\w,]+)", line))
    extras = {extra for found in named for extra in "".join(found).split(",")}
    assert extras == ({"view", "dev"} if tools else {"view"})
    if words != "gl":
        users = [at for at, line in enumerate(log) if line.startswith(("begin vbaa demo", "begin python -m pytest"))]
        assert len(users) == (words != "install")
        assert all(at > installed for at in users)


def test_the_product_imports_no_tool_of_development() -> None:
    """Whatever it imports, anywhere, comes with it or with one of the extras for its users."""
    spec = importlib.util.spec_from_file_location("sbom", ROOT / "docs" / "sbom.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    users = set(module.closure(frozenset({"view", "batch", "live"})))
    tools = set(module.closure(frozenset({"dev"}))) - users
    brought_by = {
        name: {module.canonicalize_name(each) for each in several} for name, several in packages_distributions().items()
    }
    found = {}
    for path in (path for package in PRODUCT for path in (ROOT / package).rglob("*.py")):
        for name in re.findall(r"^\s*(?:from|import) (\w+)", path.read_text(encoding="utf-8"), re.MULTILINE):
            if brought_by.get(name, set()) & tools:
                found[str(path.relative_to(ROOT))] = name
    assert found == {}
    assert "pytest" in tools


PACKAGES = {"vbaa", "vbaa_calib", "targets", "estimator", "viz"}
CODE = "import vbaa; from vbaa_calib.cli import main; print(vbaa.Rig.__name__, vbaa.__file__); main(['schema', 'rig'])"


@pytest.mark.slow
def test_the_wheel_is_whole_and_works_by_itself(tmp_path: Path) -> None:
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*pip, "wheel", "--no-deps", "--wheel-dir", str(tmp_path), str(ROOT)], check=True)
    (wheel,) = tmp_path.glob("*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    assert {name.partition("/")[0] for name in names if ".dist-info" not in name} == PACKAGES
    kept = (path for package in PACKAGES for path in (ROOT / package).rglob("*"))
    data = {str(path.relative_to(ROOT)) for path in kept if path.is_file() and "__pycache__" not in path.parts}
    assert data <= set(names)
    site = tmp_path / "site"
    subprocess.run([*pip, "install", "--no-deps", "--target", str(site), str(wheel)], check=True)
    environment = os.environ | {"PYTHONPATH": str(site)}
    done = subprocess.run(
        [sys.executable, "-P", "-c", CODE], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(f"Rig {site}")
