"""The one exception root. Library code raises these; only the command line turns them into exit codes."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Literal, get_args

_LONGEST = 600
"""Characters of each part of an error."""


class VbaaError(Exception):
    """Root of every error this project raises on purpose."""

    exit_code = 1


class InputError(VbaaError):
    """Something that came from outside is wrong: a file, a value, a call.

    what : what is wrong, in one clause.
    where : file, and row or key, if there is one.
    remedy : what the user can do about it.
    """

    exit_code = 2

    def __init__(self, what: str, *, where: object = None, remedy: str | None = None) -> None:
        self.what, self.where, self.remedy = what, where, remedy
        line = clipped(what) if where is None else f"{clipped(str(where))}: {clipped(what)}"
        super().__init__(f"{line}; {clipped(remedy)}" if remedy else line)


def of_extra(error: Exception, extra: str = "") -> InputError | None:
    """The message for an ImportError of a package that belongs to an extra; None for any other error."""
    name = (getattr(error, "name", None) or "").partition(".")[0]
    extra = extra or ("view" if name in ("pyvista", "vtkmodules", "trame_vtk") else "")
    if not (isinstance(error, ModuleNotFoundError) and extra):
        return None
    return InputError(f"{name} is not installed", remedy=f"pip install 'vbaa-calib[{extra}]'")


def require_extra(module: str, extra: str) -> Any:
    """Import a module of an extra. Raises InputError where it is not installed."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise of_extra(error, extra) or error from None


@contextmanager
def about(where: object) -> Iterator[None]:
    """Context in which input errors without a place get this one."""
    try:
        yield
    except InputError as error:
        raise error if error.where else InputError(error.what, where=where, remedy=error.remedy) from None


def one_line(text: str) -> str:
    """The text in one line, with control characters replaced, so that a name from outside cannot control the
    terminal."""
    blank = (" " if each.isspace() else each for each in text)
    return "".join(each if each.isprintable() else "\N{REPLACEMENT CHARACTER}" for each in blank)


def clipped(text: str) -> str:
    """The text in one line with the middle of a long one left out: a value from a file may have any length."""
    half = _LONGEST // 2
    return one_line(text if len(text) <= _LONGEST else f"{text[:half]} ... {text[-half:]}")


def quoted(value: object) -> str:
    """A value from outside for a message: its Python repr in one line of at most 60 characters."""
    try:
        text = " ".join(repr(value).split())
    except (RecursionError, ValueError):  # nested without end; a number of thousands of digits
        text = f"a {type(value).__name__}"
    return text if len(text) <= 60 else text[:57] + "..."


def reason_of(error: Exception) -> object:
    """The reason why the system refused a path, in its words; the error itself for an invalid path."""
    return getattr(error, "strerror", None) or error


def sentence_of(error: BaseException) -> str | None:
    """The message for an error that can come from outside, such as ours or a full disk's; None for a bug of ours."""
    if isinstance(error, VbaaError):
        return str(error)
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    return None


class Disconnected(InputError):
    """A source of pictures or a scheduler is gone: unplugged, removed, ended."""


class SolveError(VbaaError):
    """A solver did not reach a trustworthy solution."""


Severity = Literal["wrong", "doubt", "note"]
"""Of a finding, the worst first."""


@dataclass(frozen=True)
class Diagnosis:
    """A fault, or possible fault, of what was measured, with its remedy.

    Attributes
    ----------
    name : stable, in snake_case: for scripts.
    words : what was seen, one clause, with its numbers.
    remedy : what to do.
    severity : "wrong": the measurement must not be used as it is; "doubt": it deserves a look; "note": good to know.
    """

    name: str
    words: str
    remedy: str
    severity: Severity = "doubt"

    @property
    def grave(self) -> bool:
        """Whether the measurement must not be used as it is."""
        return self.severity == "wrong"

    @property
    def label(self) -> str:
        """The word that precedes a finding in a list."""
        return "look at" if self.severity == "doubt" else self.severity

    def __str__(self) -> str:
        return f"{self.words}; {self.remedy}"

    def to_dict(self) -> dict[str, str | bool]:
        return {**vars(self), "grave": self.grave}


@dataclass(frozen=True)
class Verdict:
    """Whether a calibration or a recording may be used: as good as its worst finding."""

    severity: Severity | Literal["none"] = "none"
    findings: tuple[Diagnosis, ...] = ()

    @staticmethod
    def of(findings: Iterable[Diagnosis]) -> Verdict:
        """The verdict from these findings, the worst first."""
        ranked = sorted(findings, key=lambda one: get_args(Severity).index(one.severity))
        return Verdict(ranked[0].severity if ranked else "none", tuple(ranked))

    @property
    def causes(self) -> str:
        """The reasons why it must not be used, in words; empty without any."""
        return "; ".join(one.words for one in self.findings if one.grave)

    @property
    def lines(self) -> list[str]:
        """A line for each finding, with its remedy."""
        return [f"{one.label}: {one}" for one in self.findings]

    def to_dict(self) -> dict[str, Any]:
        """The entry `verdict` of rig.json and of `--json`."""
        return {"severity": self.severity, "findings": [one.to_dict() for one in self.findings]}
