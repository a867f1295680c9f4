"""The one exception root. Library code raises these; only the command line turns them into exit codes."""

from __future__ import annotations


class VbaaError(Exception):
    """Root of every error this project raises on purpose."""

    exit_code = 1


class InputError(VbaaError):
    """Something that came from outside is wrong: a file, a value, a call.

    Parameters
    ----------
    what : what is wrong, in one clause.
    where : file, and row or key, if there is one.
    remedy : what the user can do about it.
    """

    exit_code = 2

    def __init__(self, what: str, *, where: object = None, remedy: str | None = None) -> None:
        self.what, self.where, self.remedy = what, where, remedy
        line = what if where is None else f"{where}: {what}"
        super().__init__(f"{line}; {remedy}" if remedy else line)


class SolveError(VbaaError):
    """A solver did not reach an answer that may be trusted."""
