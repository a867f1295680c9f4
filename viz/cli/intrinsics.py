"""`vbaa intrinsics IMAGES --board board.yaml -o camera.json`: the lens from photos of a board."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from vbaa_calib.core.console import say
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import refuse_overwrite, write_json, write_text
from viz.files.outputs import PAGES, refuse_output

if TYPE_CHECKING:
    from targets.board import Board
    from vbaa_calib.calibrate.lens.intrinsics import LensSolution

MODELS = ("auto", "none", "radial", "opencv4", "opencv5", "rational", "thin", "tilted", "fisheye")


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "images", type=Path, help="folder of photos of the board in many poses; or a video or bag that shows them"
    )
    parser.add_argument(
        "--topic", metavar="ROLE=NAME", default="", help="of a bag with several topics of pictures: image=NAME"
    )
    parser.add_argument("-o", "--output", type=Path, required=True, help="camera.json to write")
    board = parser.add_argument_group("board, by a file or by flags; lengths in metres")
    board.add_argument("--board", type=Path, metavar="FILE", help="board.yaml, a session.yaml, or Kalibr's target.yaml")
    board.add_argument(
        "--squares", metavar="CxR", help="all squares, columns x rows: ChArUco, or without --marker plain"
    )
    board.add_argument("--square", type=float, metavar="M", help="side of a square, such as 0.025")
    board.add_argument("--marker", type=float, metavar="M", help="side of a marker")
    board.add_argument("--dict", metavar="NAME", help="of OpenCV's markers (default: DICT_4X4_100)")
    board.add_argument("--first-id", type=int, metavar="N", help="of the markers (default: 0)")
    board.add_argument("--legacy", action="store_true", default=None, help="the pattern of OpenCV before 4.6")
    board.add_argument("--circles", metavar="CxR", help="grid of circles, columns x rows")
    board.add_argument(
        "--spacing", type=float, metavar="M", help="of neighbouring circles; of an asymmetric grid between its rows"
    )
    board.add_argument("--asymmetric", action="store_true", default=None, help="every second row is moved half a step")
    parser.add_argument(
        "--lens-model",
        dest="model",
        choices=MODELS,
        default="auto",
        help="lens: auto takes the one with the smallest expected error, the simpler one of two that tie; none, "
        "radial (k1 k2), opencv4 and opencv5 "
        "(coefficients), rational (8), thin (12), tilted (14), fisheye (default: auto)",
    )
    parser.add_argument(
        "--min-corners", type=int, default=6, metavar="N", help="drop photos with fewer corners (default: 6)"
    )
    parser.add_argument("--fix-aspect", action="store_true", help="hold fx = fy (square pixels)")
    parser.add_argument("--html", type=Path, metavar="REPORT", help="write a page that opens offline in any browser")
    parser.set_defaults(run=_run)


_VERB = "vbaa intrinsics"


def _board(args: argparse.Namespace) -> Board:
    """The board of --board, or of the flags. Raises InputError."""
    from vbaa_calib.detect.board.board_file import board_from, counts, load_lens_board

    # The flags that go with each way to describe a board, and the keys of board.yaml that they stand for.
    flags_of = {
        "squares": {"square": "square_m", "marker": "marker_m", "dict": "dictionary", "legacy": "legacy_pattern"}
        | {"first_id": "first_id"},
        "circles": {"spacing": "spacing_m", "asymmetric": "type"},
        "board": {},
    }
    ways = [name for name in flags_of if getattr(args, name) is not None]
    if len(ways) != 1:
        what = " and ".join(f"--{name}" for name in ways) + " each describe a board" if ways else "no board is given"
        raise InputError(what, where=_VERB, remedy="give one of --board FILE, --squares CxR, --circles CxR")
    options: dict[str, Any] = {}
    for way, keys in flags_of.items():
        for flag in (flag for flag in keys if getattr(args, flag) is not None):
            if way != ways[0]:
                raise InputError(f"--{flag} does not go with --{ways[0]}", where=_VERB, remedy="leave it out")
            options[keys[flag]] = value = getattr(args, flag)
            # no board has squares of a metre
            if isinstance(value, float) and value >= 1.0:
                remedy = f"give metres: {value / 1e3:g}, if that is {value:g} mm"
                raise InputError(f"--{flag} is {value:g} m", where=_VERB, remedy=remedy)
    if args.board is not None:
        return load_lens_board(args.board)
    needed = "square" if args.squares is not None else "spacing"
    if getattr(args, needed) is None:
        raise InputError(f"--{ways[0]} without --{needed}", where=_VERB, remedy="measure it, and give it in metres")
    if args.squares is not None:
        options["squares_x"], options["squares_y"] = counts(args.squares, "--squares", _VERB)
        if args.marker is None and (args.dict or args.legacy or args.first_id is not None):
            what, remedy = "--dict, --first-id and --legacy are of markers", "give --marker, or leave them out"
            raise InputError(what, where=_VERB, remedy=remedy)
        options["type"] = "chessboard" if args.marker is None else "charuco"
    else:
        options["columns"], options["rows"] = counts(args.circles, "--circles", _VERB)
        options["type"] = "asymmetric_circles" if args.asymmetric else "circles"
    return board_from(options, _VERB)


@contextmanager
def _folder_of(args: argparse.Namespace) -> Iterator[Path]:
    """The pictures' folder; for a video or bag a folder with its sharp and different pictures. Raises InputError."""
    from vbaa_calib.core.files import is_recorded
    from vbaa_calib.streams.bags import Topics
    from vbaa_calib.streams.pictures import unpack_views

    from .streams import named_topics

    if not is_recorded(args.images):
        if args.topic:
            raise InputError("--topic is for a bag", where=_VERB, remedy="leave it out")
        yield args.images
        return
    topics = Topics.of(named_topics([args.topic] if args.topic else [], ("image",)))
    with TemporaryDirectory(prefix="vbaa-views-") as name:
        # most views of a video or bag
        count = unpack_views(args.images, Path(name), topics, 60)
        kept = len(list(Path(name).iterdir()))
        if not kept:
            raise InputError("holds no pictures", where=args.images, remedy="record the board in many poses")
        say(f"{kept} of the {count} pictures of {args.images.name} are sharp and differ")
        yield Path(name)


def _run(args: argparse.Namespace) -> dict[str, Any]:
    """Detect, solve, write camera.json and the page. The exit code is 1 where the lens must not be used."""
    if args.html is not None:
        refuse_output(args.html, PAGES, args.force, [args.board])
    refuse_overwrite(args.output, args.force, [args.board])
    if args.min_corners < 4:
        raise InputError(f"--min-corners is {args.min_corners}", remedy="4 corners are the least that fix a pose")
    board = _board(args)
    with _folder_of(args) as images:
        return _solved(args, images, board)


def _solved(args: argparse.Namespace, images: Path, spec: Board) -> dict[str, Any]:
    from vbaa_calib.calibrate.lens_from_views import solve_lens
    from vbaa_calib.calibrate.report import camera_document
    from vbaa_calib.camera import Camera
    from vbaa_calib.core.images import list_images
    from vbaa_calib.detect.board.corners import detect_folder

    refuse_overwrite(args.output, args.force, list_images(images))
    views = detect_folder(images, spec)
    solution = solve_lens(views, spec, args.model, args.min_corners, args.fix_aspect)
    document = camera_document(solution, spec)
    write_json(args.output, document, args.force, Camera.from_dict)
    _report(solution)
    say(f"wrote {args.output}")
    result = {"output": str(args.output), **document, "exit_code": solution.exit_code}
    if args.html is not None:
        from viz.report.lens import page

        write_text(args.html, page(solution, views, spec, result, images), args.force)
        say(f"wrote {args.html}")
    return result


def _report(solution: LensSolution) -> None:
    """Print the result in a few lines of prose."""
    matrix, covariance = solution.camera.matrix, solution.camera.covariance
    assert covariance is not None
    std = covariance.diagonal().clip(0.0) ** 0.5
    for candidate in solution.comparison:
        folds = "" if candidate.monotonic else "  folds inside the picture"
        halves = "" if candidate.halves is None else f", halves differ by {candidate.halves:.1f} predicted deviations"
        say(
            f"  {candidate.model:9s} rms {candidate.rms_px:.3f} px, held out {candidate.held_out_rms_px:.3f} px"
            f"{halves}{folds}"
        )
    used = sum(view.corners for view in solution.views)
    outliers = sum(view.left_out for view in solution.views)
    without = f", {solution.rms_inliers_px:.4f} px without {outliers} outliers" if outliers else ""
    say(
        f"lens       {solution.model}: rms {solution.rms_px:.4f} px over {used + outliers} corners{without}, "
        f"{len(solution.views)} photos"
    )
    say(
        f"focal      {matrix[0, 0]:.2f} ± {std[0]:.2f}, {matrix[1, 1]:.2f} ± {std[1]:.2f} px, "
        f"centre {matrix[0, 2]:.2f} ± {std[2]:.2f}, {matrix[1, 2]:.2f} ± {std[3]:.2f} px"
    )
    for view in solution.views:
        if view.outlying or view.left_out:
            gross = f", {view.left_out} outlier corners left out" if view.left_out else ""
            say(f"look at    {view.name}: rms {view.rms_px:.2f} px{gross}")
    for dropped in solution.dropped:
        say(f"dropped    {dropped.name}: {dropped.reason}")
    say(f"board      {', '.join(solution.board_shape.findings) or 'flat and square'}")
    for one in solution.verdict.findings:
        say(f"{one.label:10s} {one}")
    say(f"verdict    {solution.words}")
