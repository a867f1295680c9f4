"""Finds the verb by name, runs it, and turns errors into one line and an exit code."""

from __future__ import annotations

import argparse
import atexit
import contextlib
import difflib
import gc
import importlib
import os
import re
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import FrameType, ModuleType
from typing import Any, NoReturn

import vbaa_calib
from vbaa_calib.core.errors import InputError, VbaaError, of_extra, one_line, sentence_of

from .completion import EXAMPLES

VERBS = {
    "doctor": ("vbaa_calib.cli.doctor", "is this installation healthy? each problem with its remedy"),
    "demo": ("viz.cli.demo", "the whole chain on a bundled scene, with its errors against the truth"),
    "board": ("vbaa_calib.cli.board", "a ChArUco board to print to scale: PDF or SVG with rulers, or PNG for a screen"),
    "wizard": ("viz.cli.wizard", "guided, resumable calibration: from a printed board to a trusted rig"),
    "intrinsics": ("viz.cli.intrinsics", "lens from photos of a ChArUco board"),
    "calibrate": ("viz.cli.calibrate", "a session to rig.json: lens, plane C, antenna, sensors; or a rig over time"),
    "handeye": ("vbaa_calib.cli.handeye", "camera and antenna on a robot's arm: its poses and views of the board"),
    "stiffness": (
        "vbaa_calib.cli.stiffness",
        "EI from a table of measured deflections, or from one photograph of a bent rod",
    ),
    "check": ("viz.cli.check", "is the calibration still valid? a verdict and a report"),
    "budget": ("viz.cli.budget", "what limits this rig's contacts, and what to improve first"),
    "estimate": (
        "viz.cli.estimate",
        "a recording to contacts.csv and report.html: where and how hard, with standard deviations",
    ),
    "live": (
        "viz.cli.live",
        "pictures and readings in, contacts out as they happen; from cameras, bags, videos, lines",
    ),
    "batch": ("viz.cli.batch", "many recordings at once, on dask: a data set of contacts, resumable"),
    "compare": ("viz.cli.compare", "two results or rigs side by side: what differs, in deviations"),
    "refine": (
        "estimator.cli.refine",
        "all frames of a recording in one solve, with the rig errors and friction that they share",
    ),
    "next": ("estimator.cli.next", "where to touch next, to know surface, friction or stiffness better"),
    "look": ("viz.cli.look", "what is detected of the antenna in one picture, in words and as a picture"),
    "track": ("estimator.cli.track", "contacts over time: first contact, loss, slip and stick, ringing"),
    "reconstruct": ("viz.cli.reconstruct", "contacts to the object's surface and stiffness: .vtp, .ply or .glb"),
    "report": ("viz.cli.report", "report.html from contacts: plots, map, friction cone, table"),
    "view": ("viz.cli.view", "the 3-D scene as a window, a PNG or a self-contained HTML page"),
    "simulate": ("vbaa_calib.cli.simulate", "a synthetic session from a scene file, with truth.json"),
    "convert": ("vbaa_calib.cli.convert", "the camera to and from ROS, OpenCV, Kalibr, mrcal and COLMAP files"),
    "export": ("vbaa_calib.cli.export", "the antenna as calibrated for MuJoCo, Newton, PyElastica, URDF"),
    "completion": ("vbaa_calib.cli.completion", "a script that completes verbs and options in bash, zsh or fish"),
    "schema": ("vbaa_calib.cli.schema", "print the JSON Schema of session.yaml, rig.json or whiskers.yaml"),
    "bench": ("vbaa_calib.cli.bench", "speed against error, with the alternatives in the same run"),
}
"""Name → (module with `configure`, which sets `run`, and one line of help), in the order of use."""
# the collection at exit takes a tenth of a second
atexit.register(gc.freeze)


def _module(verb: str) -> ModuleType:
    """The module of a verb. Raises InputError where another folder hides its package."""
    name = VERBS[verb][0]
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name is None or not name.startswith(error.name):
            raise
        package = name.partition(".")[0]
        raise InputError(f"the package {package} is hidden ({error})", remedy="`vbaa doctor` says by what") from None


class _Parser(argparse.ArgumentParser):
    """A parser that raises our error instead of exiting."""

    words: Sequence[str] = ()
    """What it was called with: a slip in an option is named before what is missing for it."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        # a number or axis with a minus is an option's value, -1e-3 too, which Python before 3.14 takes for an option
        self._negative_number_matcher = re.compile(r"-(\.?\d|[xyz]$)")

    def error(self, message: str) -> NoReturn:
        verb = self.prog.removeprefix("vbaa").strip()
        options = [word.partition("=")[0] for word in self.words if word.startswith("--")]
        unknown = next((word for word in options if word not in {*self._option_string_actions, "--"}), "")
        close = difflib.get_close_matches(unknown, self._option_string_actions, n=1) if unknown else []
        remedy = f"do you mean {close[0]}?" if close else f"see {self.prog} --help"
        raise InputError(f"there is no option {unknown}" if unknown else message, where=verb or None, remedy=remedy)


def _version() -> str:
    """The version, and a digest of the sources."""
    import hashlib  # loads OpenSSL

    digest, root = hashlib.sha256(), Path(vbaa_calib.__file__).parents[1]
    for package in ("estimator", "targets", "vbaa", "vbaa_calib", "viz"):
        for path in sorted((root / package).rglob("*.py")):
            digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    return f"vbaa-calib {vbaa_calib.__version__} ({digest.hexdigest()[:12]})"


def _front_parser() -> _Parser:
    width = max(map(len, VERBS))
    listing = "\n".join(f"  {name:<{width}}  {line}" for name, (_, line) in VERBS.items())
    parser = _Parser(
        prog="vbaa",
        description="From photos of a bent antenna to contacts in millimetres and newtons.",
        usage="vbaa VERB ... [--json] [--force]",
        epilog=f"verbs:\n{listing}\n\n`vbaa VERB --help` says more. Exit codes: 0 done, 1 done but a verdict is wrong "
        "(or a failure), 2 the input or the call is wrong, 130 interrupted.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("verb", help=argparse.SUPPRESS)
    parser.add_argument("--version", action="store_true", help="version, and digest of the code that runs")
    return parser


def _verb_parser(name: str) -> _Parser:
    line = VERBS[name][1]
    parser = _Parser(
        prog=f"vbaa {name}",
        description=line[0].upper() + line[1:] + ".",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--json", action="store_true", help="print the result's numbers as one JSON object on stdout")
    parser.add_argument("--force", action="store_true", help="replace outputs that exist already")
    parser.add_argument("--debug", action="store_true", help="show the whole traceback of an error")
    _module(name).configure(parser)
    examples = "\n  ".join(["examples:", *EXAMPLES[name]]) if name in EXAMPLES else ""
    parser.epilog = "\n\n".join(filter(None, [parser.epilog, examples]))
    return parser


def run_verb(argv: Sequence[str]) -> int:
    """Run a command line; returns its exit code. Raises our errors."""
    if list(argv[:1]) == ["--version"]:
        print(_version())
        return 0
    name = _front_parser().parse_args(argv[:1]).verb
    if name not in VERBS:
        close = difflib.get_close_matches(name, VERBS, n=1)
        remedy = f"do you mean {close[0]}?" if close else f"the verbs are {', '.join(VERBS)}"
        raise InputError(f"there is no verb {name!r}", remedy=remedy)
    try:
        os.getcwd()
    except OSError:
        raise InputError("the folder that this runs in is gone", remedy="change to one that is there") from None
    parser = _verb_parser(name)
    parser.words = argv[1:]
    args = parser.parse_args(argv[1:])
    args.argv = ["vbaa", *argv]
    result = args.run(args)
    if args.json:
        from vbaa_calib.core.files import json_text

        print(json_text(result))
    return int(result.get("exit_code", 0))  # `doctor` has both findings and a failure


class _Ended(BaseException):
    """Raised by a terminating signal, so that half-written files are removed."""


_signals: list[int] = []
"""That came: what a signal raises inside a function that C calls, as a compiler does, is lost, and what follows from it
is not the error."""


def _end(number: int, frame: FrameType | None) -> NoReturn:
    _signals.append(number)
    if number == signal.SIGINT:
        signal.default_int_handler(number, frame)
    raise _Ended(number)


def _ended() -> int:
    number = _signals[0] if _signals else signal.SIGINT
    with contextlib.suppress(OSError):  # the terminal may be what went away
        print("vbaa: interrupted" if number == signal.SIGINT else "vbaa: ended by a signal", file=sys.stderr)
    return 128 + number


@contextlib.contextmanager
def _unwinding_when_ended() -> Iterator[None]:
    """Context in which SIGTERM and SIGHUP clean up as Ctrl-C does; ignored signals (nohup) stay ignored."""
    named = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    before = {number: signal.getsignal(number) for number in named}
    before = {number: each for number, each in before.items() if each in (signal.SIG_DFL, signal.default_int_handler)}
    if threading.current_thread() is not threading.main_thread():
        before = {}
    _signals.clear()
    for number in before:
        signal.signal(number, _end)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def _seldom_collecting() -> Iterator[None]:
    """Context with rare garbage collection, which would take a tenth of a short command's time while libraries load."""
    before = gc.get_threshold()
    # new objects between two garbage collections
    gc.set_threshold(1_000_000, *before[1:])
    try:
        yield
    finally:
        # what there is counts as old: the lower threshold would collect all of it at once
        gc.freeze()
        gc.unfreeze()
        gc.set_threshold(*before)


def main(argv: Sequence[str] | None = None) -> int:
    """The `vbaa` command. Returns the exit code: 0 done, 1 wrong verdict or failure, 2 wrong input, 130 interrupted."""
    argv = sys.argv[1:] if argv is None else list(argv)
    if "OMP_NUM_THREADS" not in os.environ:
        # matrices of a few hundred rows: threads of linear algebra would only wait for each other
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # we use no plugins of pydantic, and to look for them it reads the metadata of every installed package
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    if sys.stderr is None:  # closed by the caller (`2>&-`), as daemons do
        sys.stderr = os.fdopen(os.open(os.devnull, os.O_WRONLY), "w")
    try:
        with _unwinding_when_ended(), _seldom_collecting():
            code = run_verb(argv or ["--help"])
            if sys.stdout is not None:  # closed by the caller (`>&-`)
                sys.stdout.flush()
            return code
    except SystemExit as leave:  # argparse's --help and --version
        return int(leave.code or 0)
    except (KeyboardInterrupt, _Ended):
        return _ended()
    except BrokenPipeError:
        # the reader went away (`vbaa ... | head`); the interpreter must not complain about it again at exit
        with contextlib.suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except Exception as error:
        if "--debug" in argv:
            import traceback

            traceback.print_exc()
        if _signals:
            return _ended()
        error = of_extra(error) or error
        words = sentence_of(error) or (
            f"something went wrong that should not ({type(error).__name__}: {error}); "
            "run again with --debug and report what it shows"
        )
        print(f"vbaa: {one_line(words)}", file=sys.stderr)
        return error.exit_code if isinstance(error, VbaaError) else 1
