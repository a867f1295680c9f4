"""Finds the verb by name, runs it, and turns errors into one line and an exit code."""

from __future__ import annotations

import argparse
import contextlib
import importlib
import json
import os
import signal
import sys
import threading
import traceback
from collections.abc import Sequence
from typing import NoReturn

import vbaa_calib
from vbaa_calib.core.errors import InputError, VbaaError

from . import verbs as our_verbs


def _verbs_of(package: str) -> dict[str, tuple[str, str]]:
    """A package's verbs; none, and a word about it, where a folder of the user's stands in the package's place."""
    try:
        verbs: dict[str, tuple[str, str]] = importlib.import_module(f"{package}.cli.verbs").VERBS
    except ImportError as error:
        print(f"vbaa: the package {package} is hidden ({error}); `vbaa doctor` says by what", file=sys.stderr)
        return {}
    return verbs


VERBS: dict[str, tuple[str, str]] = {
    **our_verbs.VERBS,
    **_verbs_of("estimator"),
    **_verbs_of("viz"),
    "doctor": ("vbaa_calib.cli.doctor", "is this installation healthy? each problem with its remedy"),
    "demo": ("viz.cli.demo", "the whole way on a bundled scene, with a table of error against truth"),
}


class _Parser(argparse.ArgumentParser):
    """argparse that raises our error instead of leaving the process."""

    def error(self, message: str) -> NoReturn:
        verb = self.prog.removeprefix("vbaa").strip()
        raise InputError(message, where=verb or None, remedy=f"see {self.prog} --help")


def _front_parser() -> _Parser:
    width = max(map(len, VERBS))
    listing = "\n".join(f"  {name:<{width}}  {line}" for name, (_, line) in VERBS.items())
    parser = _Parser(
        prog="vbaa",
        description="From photos of a bent antenna to contacts in millimetres and newtons.",
        usage="vbaa VERB ... [--json] [--force]",
        epilog=f"verbs:\n{listing}\n\n`vbaa VERB --help` says more. Exit codes: 0 done, 2 the input or the call is "
        "wrong, 1 anything else, 130 interrupted.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("verb", help=argparse.SUPPRESS)
    parser.add_argument("--version", action="version", version=f"vbaa-calib {vbaa_calib.__version__}")
    return parser


def _verb_parser(name: str) -> _Parser:
    module, line = VERBS[name]
    parser = _Parser(prog=f"vbaa {name}", description=line[0].upper() + line[1:] + ".", allow_abbrev=False)
    parser.add_argument("--json", action="store_true", help="print the result's numbers as one JSON object on stdout")
    parser.add_argument("--force", action="store_true", help="replace outputs that exist already")
    parser.add_argument("--debug", action="store_true", help="show the whole traceback of an error")
    # last, so that a verb may take one of these names for itself (`stiffness --force N`)
    importlib.import_module(module).configure(parser)
    return parser


def run_verb(argv: Sequence[str]) -> int:
    """Run one command line. Errors of ours pass through; the caller turns them into exit codes."""
    name = _front_parser().parse_args(argv[:1]).verb
    if name not in VERBS:
        raise InputError(f"there is no verb {name!r}", remedy=f"the verbs are {', '.join(VERBS)}")
    args = _verb_parser(name).parse_args(argv[1:])
    args.argv = ["vbaa", *argv]
    result = importlib.import_module(VERBS[name][0]).run(args)
    if args.json:
        print(json.dumps(result, allow_nan=False))
    return int(result.get("exit_code", 0))  # `doctor` has bad news and its numbers at once


class _Ended(BaseException):
    """A signal that ends the process was received: what is half-written is removed on the way out."""


def _end(number: int, _frame: object) -> NoReturn:
    raise _Ended(number)


def _unwind_when_ended() -> None:
    """SIGTERM and a closed terminal clean up as Ctrl-C does; a signal that is ignored (nohup) stays so."""
    if threading.current_thread() is not threading.main_thread():
        return
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, _end)


def main(argv: Sequence[str] | None = None) -> int:
    """The `vbaa` command. Returns the exit code: 0 done, 2 wrong input or call, 1 anything else, 130 interrupted."""
    argv = sys.argv[1:] if argv is None else list(argv)
    if sys.stderr is None:  # closed by the caller (`2>&-`), as daemons do
        sys.stderr = os.fdopen(os.open(os.devnull, os.O_WRONLY), "w")
    _unwind_when_ended()
    try:
        code = run_verb(argv or ["--help"])
        if sys.stdout is not None:  # closed by the caller (`>&-`)
            sys.stdout.flush()
        return code
    except SystemExit as leave:  # argparse's --help and --version
        return int(leave.code or 0)
    except KeyboardInterrupt:
        print("vbaa: interrupted", file=sys.stderr)
        return 130
    except _Ended as ended:
        with contextlib.suppress(OSError):  # the terminal may be what went away
            print("vbaa: ended by a signal", file=sys.stderr)
        return 128 + int(ended.args[0])
    except BrokenPipeError:
        # the reader went away (`vbaa ... | head`); the interpreter must not complain about it again at exit
        with contextlib.suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except Exception as error:
        if "--debug" in argv:
            traceback.print_exc()
        print(f"vbaa: {_printable(_in_words(error))}", file=sys.stderr)
        return error.exit_code if isinstance(error, VbaaError) else 1


def _printable(text: str) -> str:
    """One line in which a name from outside moves no cursor and paints nothing."""
    return "".join(each if each.isprintable() else "\N{REPLACEMENT CHARACTER}" for each in " ".join(text.split()))


def _in_words(error: Exception) -> str:
    if isinstance(error, VbaaError):
        return str(error)
    if isinstance(error, OSError) and error.strerror:  # a full disk, a lost network drive
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    return (
        f"something went wrong that should not ({type(error).__name__}: {error}); "
        "run again with --debug and report what it shows"
    )
