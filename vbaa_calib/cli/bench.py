"""`vbaa bench`: runs the repository's benchmarks/, which the installed package does not carry."""

from __future__ import annotations

import argparse
import importlib
from pathlib import Path
from types import ModuleType
from typing import Any

import vbaa_calib
from vbaa_calib.core.errors import InputError


def configure(parser: argparse.ArgumentParser) -> None:
    _suite().configure(parser)
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> dict[str, Any]:
    """Run one benchmark, or several in sequence."""
    result: dict[str, Any] = _suite().run(args)
    return result


def _suite() -> ModuleType:
    checkout = Path(vbaa_calib.__file__).parents[1]
    if not (checkout / "benchmarks" / "suite.py").is_file():
        raise InputError(
            "the benchmarks are not part of the installed package",
            where="bench",
            remedy="run `vbaa bench` in a checkout of the repository, after `make install`",
        )
    return importlib.import_module("benchmarks.suite")
