"""`vbaa board -o board.pdf`: the board to print, or to show on a screen."""

from __future__ import annotations

import argparse
import os
from bisect import bisect_left
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vbaa_calib.core.console import say
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import refuse_overwrite, replacing

if TYPE_CHECKING:
    from targets.board import AprilGrid, BoardWithIds


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "-o",
        "--output",
        required=True,
        type=Path,
        metavar="SHEET",
        help="board.pdf or .svg to print, .png for a screen",
    )
    board = parser.add_argument_group("board, described by a file or by flags; what is left out is chosen to fit")
    board.add_argument("--spec", type=Path, metavar="FILE", help="board.yaml, or a session.yaml")
    board.add_argument("--type", choices=("charuco", "aprilgrid"), help="kind of board (default: charuco)")
    board.add_argument("--squares", metavar="CxR", help="columns x rows (default: 11x7)")
    board.add_argument("--tags", metavar="CxR", help="of an AprilGrid: columns x rows (default: 6x6)")
    board.add_argument("--tag-mm", type=float, metavar="MM", help="side of a tag (default: the largest that fits)")
    board.add_argument(
        "--tag-spacing", type=float, metavar="S", help="gap between tags, in sides of a tag (default: 0.3)"
    )
    board.add_argument("--first-id", type=int, metavar="N", help="of the markers (default: 0)")
    board.add_argument(
        "--square-mm", type=float, metavar="MM", help="side of a square (default: the largest that fits)"
    )
    board.add_argument("--marker-mm", type=float, metavar="MM", help="side of a marker (default: 3/4 of the square)")
    dictionary = "of OpenCV's markers (default: DICT_4X4_100)"
    board.add_argument("--dict", "--dictionary", dest="dictionary", metavar="NAME", help=dictionary)
    board.add_argument("--legacy", action="store_true", default=None, help="the pattern of OpenCV before 4.6")
    board.add_argument("--thickness-mm", type=float, metavar="MM", help="of the plate it is mounted on (default: 0)")
    board.add_argument(
        "--write-spec",
        type=Path,
        metavar="FILE",
        help="where the board's description goes (default: SHEET's name, .yaml)",
    )
    paper = parser.add_argument_group("to print")
    paper.add_argument(
        "--paper", metavar="NAME", help="A5 to A0, Letter, Legal, Tabloid or 300x200 in mm (default: A4)"
    )
    paper.add_argument("--margin-mm", type=float, metavar="MM", help="that the printer leaves white (default: 8)")
    screen = parser.add_argument_group("for a screen").add_mutually_exclusive_group()
    screen.add_argument("--px-per-mm", type=float, metavar="N", help="pixels per millimetre of the screen")
    screen.add_argument(
        "--screen-ppi",
        type=float,
        metavar="N",
        help="pixels per inch: those along its diagonal by its diagonal in inches",
    )
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> dict[str, Any]:
    """Write the sheet and, where flags describe the board, its board.yaml. Returns the numbers for `--json`."""
    kind = args.output.suffix.lower()
    suffixes = (".pdf", ".svg", ".png")
    if kind not in suffixes:
        raise InputError(f"has the suffix {kind!r}", where=args.output, remedy=f"take one of {', '.join(suffixes)}")
    _refuse_flags(
        args,
        ("px_per_mm", "screen_ppi") if kind != ".png" else ("paper", "margin_mm"),
        f"has no meaning for a {kind} file",
    )
    refuse_overwrite(args.output, args.force, [args.spec])
    from pydantic import TypeAdapter

    from targets.board import AprilGrid, BoardSpec
    from vbaa_calib.core.models import refusal

    try:
        return _for_screens(args) if kind == ".png" else _for_paper(args, kind)
    except ValueError as error:
        schema = TypeAdapter(AprilGrid if args.type == "aprilgrid" else BoardSpec).json_schema
        raise refusal(error, args.spec or "vbaa board", schema=schema) from None


def _refuse_flags(args: argparse.Namespace, names: tuple[str, ...], why: str) -> None:
    for name in names:
        if getattr(args, name) is not None:
            raise InputError(f"--{name.replace('_', '-')} {why}", where="vbaa board", remedy="leave it out")


def _for_paper(args: argparse.Namespace, kind: str) -> dict[str, Any]:
    from targets.board import AprilGrid
    from targets.sheet import SHEET, lay_out, paper_name, paper_named
    from targets.write_sheet import as_pdf, as_svg

    paper = paper_named("A4" if args.paper is None else args.paper)
    margin = SHEET.margin_mm if args.margin_mm is None else args.margin_mm
    spec: BoardWithIds = _wanted_grid(args, lambda grid: lay_out(grid, paper, margin)) or _wanted(
        args, paper=paper, margin_mm=margin
    )
    layout = lay_out(spec, paper, margin)
    description = _description(args, spec, changed=False)
    sheet = as_pdf(spec, layout) if kind == ".pdf" else as_svg(spec, layout).encode()
    result = _write(args, sheet, spec, description) | {
        "paper": paper_name(paper),
        "orientation": layout.orientation,
        "page_mm": [layout.width, layout.height],
        "size_mm": [round(layout.board_width, 6), round(layout.board_height, 6)],
        "rulers_mm": {"x": layout.ruler_x, "y": layout.ruler_y},
    }
    say(f"paper    {paper_name(paper)} {layout.orientation}, {layout.width:g} x {layout.height:g} mm")
    say(f"rulers   {layout.ruler_x:g} mm along the lower edge (x), {layout.ruler_y:g} mm along the left one (y)")
    side_m = spec.tag_m if isinstance(spec, AprilGrid) else spec.marker_m
    module = 1e3 * side_m / spec.modules
    gap = 1e3 * spec.pitch_m if isinstance(spec, AprilGrid) else 500 * (spec.square_m - spec.marker_m)
    fine = f"a marker's module is {module:.2g} mm: few printers draw it clean, few cameras see it"
    tight = f"{gap:.2g} mm of white around a marker is little: markers of 3/4 of the square are found best"
    rules = (module < 0.5, fine), (gap < 0.5 * module, tight)
    result["warnings"] = [words for holds, words in rules if holds]
    for warning in result["warnings"]:
        say(f"look at  {warning}")
    say("next     print it at 100 %, glue it to something flat, and measure both rulers (docs/board.md)")
    return result


def _for_screens(args: argparse.Namespace) -> dict[str, Any]:
    import cv2

    from targets.board import AprilGrid
    from targets.sheet import size_words
    from targets.write_sheet import on_screen

    if args.px_per_mm is None and args.screen_ppi is None:
        remedy = "give --screen-ppi (pixels along the diagonal by its inches) or --px-per-mm"
        raise InputError("a .png needs the screen's pixel size", where="vbaa board", remedy=remedy)
    px_per_mm = args.px_per_mm if args.screen_ppi is None else args.screen_ppi / 25.4
    wanted: BoardWithIds = _wanted_grid(args) or _wanted(args)
    board = on_screen(wanted, px_per_mm)
    description = _description(args, board.spec, changed=board.spec != wanted)
    result = _write(args, cv2.imencode(".png", board.pixels)[1].tobytes(), board.spec, description) | {
        "px_per_mm": px_per_mm,
        "image_size": list(board.size_px),
        "square_px": board.square_px,
        "marker_px": board.marker_px,
        "margin_px": board.margin_px,
        "size_mm": [round(1e3 * side, 6) for side in board.spec.size_m],
    }
    name, side_px = ("tag", board.marker_px) if isinstance(wanted, AprilGrid) else ("square", board.square_px)
    say(f"picture  {board.size_px[0]} x {board.size_px[1]} pixels, a {name} is {side_px} of them")
    if board.spec != wanted:
        say(f"look at  that is not {size_words(wanted)}")
    say("next     show it at 100 %, one pixel on one pixel, and measure the board: the pixel density is what you gave")
    return result


def _wanted_grid(args: argparse.Namespace, lay_out: Callable[[AprilGrid], Any] | None = None) -> AprilGrid | None:
    """The AprilGrid of --spec, or of the flags, with tags as large as `lay_out` fits; None where another board is
    wanted."""
    from targets.board import AprilGrid
    from vbaa_calib.detect.board.board_file import counts, load_lens_board

    of_charuco = ("squares", "square_mm", "marker_mm", "legacy")
    of_grid = ("tags", "tag_mm", "tag_spacing")
    if args.spec is not None:
        _refuse_flags(
            args,
            (*of_charuco, *of_grid, "dictionary", "first_id", "thickness_mm", "type"),
            "and --spec both describe the board",
        )
        spec = load_lens_board(args.spec)
        return spec if isinstance(spec, AprilGrid) else None
    if args.type != "aprilgrid":
        _refuse_flags(args, of_grid, "is of an AprilGrid: give --type aprilgrid")
        return None
    _refuse_flags(args, of_charuco, "is of a ChArUco board")
    columns, rows = (6, 6) if args.tags is None else counts(args.tags, "--tags", "vbaa board")
    spacing = 0.3 if args.tag_spacing is None else args.tag_spacing
    family = args.dictionary or "DICT_APRILTAG_36h11"

    def grid(tag_mm: float) -> AprilGrid:
        tag_m = round(1e-3 * tag_mm, 12)
        thickness_m = round(1e-3 * (args.thickness_mm or 0.0), 12)
        first = args.first_id or 0
        return AprilGrid("aprilgrid", columns, rows, tag_m, spacing, family, first_id=first, thickness_m=thickness_m)

    if args.tag_mm is not None or lay_out is None:
        return grid(20.0 if args.tag_mm is None else args.tag_mm)

    def is_too_large(tag_mm: int) -> bool:
        try:
            lay_out(grid(tag_mm))
        except ValueError:
            return True
        return False

    sizes_mm = range(5, 200)
    return grid(sizes_mm[max(bisect_left(sizes_mm, True, key=is_too_large) - 1, 0)])


def _wanted(args: argparse.Namespace, **room: Any) -> BoardWithIds:
    """The board of --spec, or of the flags, with defaults for what is missing."""
    from targets.sheet import fill_in
    from vbaa_calib.detect.board.board_file import counts, load_board

    if args.spec is not None:
        return load_board(args.spec)
    largest_mm = 10_000.0
    for name in ("square_mm", "marker_mm"):
        length = getattr(args, name)
        if length is not None and not 0 < length < largest_mm:
            what, remedy = f"--{name.replace('_', '-')} is {length:g}", f"give millimetres, 0 to {largest_mm:g}"
            raise InputError(what, where="vbaa board", remedy=remedy)
    options = {name: getattr(args, name) for name in ("square_mm", "marker_mm", "dictionary")} | room
    options |= {"first_id": args.first_id or 0, "legacy_pattern": bool(args.legacy)}
    options |= {"thickness_m": round(1e-3 * (args.thickness_mm or 0.0), 12)}
    if args.squares is None:
        return fill_in(**options)
    return fill_in(counts(args.squares, "--squares", "vbaa board"), **options)


def _description(args: argparse.Namespace, spec: BoardWithIds, changed: bool) -> tuple[Path | None, bool]:
    """Path of the board's description (None if it is --spec), and whether to write it."""
    from vbaa_calib.detect.board.board_file import load_lens_board

    if args.spec is not None and not changed and args.write_spec is None:
        return None, False
    path = args.write_spec or args.output.with_suffix(".yaml")
    if os.path.realpath(path) == os.path.realpath(args.output):
        raise InputError("is the sheet itself", where=path, remedy="give --write-spec another name")
    refuse_overwrite(path, True, [args.spec])
    if path.is_file():
        try:
            if load_lens_board(path) == spec:
                return path, False
        except InputError:
            pass  # no board: refused below as any other file
        # it may hold what was measured since: a print's scale, the mount's thickness
        if args.write_spec is None or not args.force:
            remedy = f"print that one with --spec {path}, or name another with --write-spec (--force replaces that)"
            raise InputError("exists already and describes another board", where=path, remedy=remedy)
    return path, True


def _write(
    args: argparse.Namespace, data: bytes, spec: BoardWithIds, description: tuple[Path | None, bool]
) -> dict[str, Any]:
    """Write the sheet and its description, both or neither. Returns the numbers for `--json`."""
    from targets.sheet import board_id, size_words, spec_document

    described, missing = description
    with ExitStack() as both:
        # the last one entered is moved into place first: no description without its sheet
        if described is not None and missing:
            words = spec_document(spec, f"as `vbaa board` drew it in {args.output.name}")
            both.enter_context(replacing(described)).write_text(words, encoding="utf-8")
        both.enter_context(replacing(args.output, args.force)).write_bytes(data)
    say(f"board    {board_id(spec)}: {size_words(spec)}")
    say(f"wrote    {args.output}" + (f", described in {described}" if described else ""))
    return {
        "output": str(args.output),
        "spec_file": str(described or args.spec),
        "id": board_id(spec),
        "board": spec.to_dict(),
        "corners": spec.corner_count,
        "markers": len(spec.marker_ids),
    }
