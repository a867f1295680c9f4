"""`vbaa handeye VIEWS --board board.yaml --poses poses.csv -o handeye.json`."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vbaa_calib.cli.options import add_lens_file, usable_rig, wanted_of
from vbaa_calib.core.console import say
from vbaa_calib.core.errors import InputError, about
from vbaa_calib.core.files import refuse_overwrite, sha256, write_json

if TYPE_CHECKING:
    from targets.board import Board
    from vbaa_calib.calibrate.given_lens import GivenLens
    from vbaa_calib.calibrate.lens.intrinsics import LensSolution
    from vbaa_calib.calibrate.pose.hand_eye import HandEye
    from vbaa_calib.detect.board.corners import BoardView
    from vbaa_calib.geometry import Pose


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "views",
        type=Path,
        help="folder of pictures of the board; or a CSV of corners, view,id,u_px,v_px, or of poses of the board (or "
        "any target) in the camera, with the columns of --poses",
    )
    parser.add_argument("--board", type=Path, help="board.yaml, a session.yaml or Kalibr's target.yaml; not with poses")
    parser.add_argument(
        "--poses",
        type=Path,
        required=True,
        help="CSV of the tool's poses in the robot's base: view; x_m,y_m,z_m (or _mm); qx,qy,qz,qw, or a rotation "
        "vector rx_rad,ry_rad,rz_rad, or Euler angles a_deg,b_deg,c_deg",
    )
    parser.add_argument(
        "--euler", metavar="ORDER", help="of Euler angles: ZYX, ZYZ, …; in small letters about fixed axes"
    )
    parser.add_argument(
        "--mount",
        choices=("hand", "fixed"),
        default="hand",
        help="hand: the arm carries the camera; fixed: it carries the board (default: hand)",
    )
    parser.add_argument(
        "--camera", type=Path, help="a known lens, of any format of `vbaa convert` (default: from VIEWS)"
    )
    parser.add_argument(
        "--image-size", type=int, nargs=2, metavar=("W", "H"), help="px, for a CSV without --camera; as --size WxH"
    )
    parser.add_argument(
        "--rig", type=Path, help="rig.json of this camera: gives T_actuator_antenna for a session's arm"
    )
    parser.add_argument("-o", "--output", type=Path, required=True, help="handeye.json to write")
    add_lens_file(parser)
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> dict[str, Any]:
    """Solve from corners or from poses and write handeye.json; the exit code is 1 where the lens must not be used."""
    from vbaa_calib.calibrate.pose.robot_tables import read_robot_poses
    from vbaa_calib.core.csv_rows import header_of

    table = args.views.suffix.lower() in _TABLES
    inputs = [args.board, args.poses, args.camera, args.rig, *([args.views] if table else [])]
    refuse_overwrite(args.output, args.force, inputs)
    if args.rig and args.mount != "hand":
        raise InputError(
            "--rig needs the camera on the arm", remedy="take --mount hand; camera and antenna ride together"
        )
    poses, others = read_robot_poses(args.poses, args.euler)
    rig = usable_rig(args.rig) if args.rig else None
    if table and {"x_m", "x_mm"} & set(header_of(args.views)):
        solution, document = _from_poses(args, poses, others)
        exit_code = 0
    else:
        solution, document, exit_code = _from_corners(args, poses, others)
    if rig:
        antenna, covariance = solution.antenna_on_arm(rig.T_antenna_camera, rig.covariance[:6, :6])
        document["T_actuator_antenna"] = antenna.to_dict()
        document["T_actuator_antenna_covariance"] = covariance.tolist()
    named = {"board": args.board, "poses": args.poses, "camera": args.camera, "rig": args.rig}
    document["inputs_sha256"] = {name: sha256(path) for name, path in named.items() if path}
    document["command"] = shlex.join(args.argv)
    write_json(args.output, document, args.force)
    _report(solution, document)
    say(f"wrote {args.output}")
    return {"output": str(args.output), **document, "exit_code": exit_code}


_TABLES = (".csv", ".tsv", ".txt")


def _from_poses(
    args: argparse.Namespace, poses: Mapping[str, Pose], others: Mapping[str, Mapping[str, Pose]]
) -> tuple[HandEye, dict[str, Any]]:
    """The solution from the board's poses in the camera frame."""
    from vbaa_calib.calibrate.pose.hand_eye import solve_hand_eye
    from vbaa_calib.calibrate.pose.robot_tables import read_robot_poses

    for name in ("board", "camera", "image_size"):
        if getattr(args, name) is not None:
            flag = f"--{name.replace('_', '-')}"
            raise InputError(f"{flag} is not for poses of the board", where=args.views, remedy=f"leave {flag} out")
    wanted_of(args)
    seen, _ = read_robot_poses(args.views, args.euler)
    pairs = _paired(list(seen), poses, args.poses)
    readings = {words: [other[row] for _, row in pairs] for words, other in others.items()}
    views, robot_poses = [(row, seen[view]) for view, row in pairs], [poses[row] for _, row in pairs]
    with about(f"{args.views} by {args.poses}"):
        solution = solve_hand_eye(views, robot_poses, mount=args.mount, readings=readings)
    return solution, solution.to_dict()


def _from_corners(
    args: argparse.Namespace, poses: Mapping[str, Pose], others: Mapping[str, Mapping[str, Pose]]
) -> tuple[HandEye, dict[str, Any], int]:
    """The solution from corners of a board, and the exit code: 1 where the lens must not be used."""
    import numpy as np

    from vbaa_calib.calibrate.given_lens import read_lens
    from vbaa_calib.calibrate.pose.hand_eye import solve_hand_eye
    from vbaa_calib.convert.values import Wanted
    from vbaa_calib.detect.board.board_file import load_lens_board

    if args.board is None:
        remedy = "give --board FILE, or poses of the board in the camera as a CSV"
        raise InputError("no board is given", where="vbaa handeye", remedy=remedy)
    spec = load_lens_board(args.board)
    file = args.camera or args.rig
    if file is None and args.size is not None:  # that of a table of corners
        args.image_size, args.size = Wanted.of(vars(args)).size, None
    wanted = wanted_of(args, file)
    known = read_lens(file, wanted) if file else None
    found = _views(args, spec, known)
    by_name = {view.name: view for view in found}
    pairs = _paired(list(by_name), poses, args.poses)
    views = [replace(by_name[view], name=row) for view, row in pairs]
    lens = _lens(known, views, spec)
    outlier_ids = {view.name: view.outlier_ids for view in lens.views}
    views = [view.picked(np.isin(view.ids, outlier_ids.get(view.name, ()), invert=True)) for view in views]
    robot_poses = [poses[view.name] for view in views]
    readings = {words: [other[view.name] for view in views] for words, other in others.items()}
    with about(f"{args.views} by {args.poses}"):
        solution = solve_hand_eye(views, robot_poses, lens.board_shape.points_m, lens.camera, args.mount, readings)
    document = solution.to_dict() | {"camera": lens.camera.to_dict(), "board": spec.to_dict()}
    document["warnings"] += [f"the lens: {one}" for one in lens.verdict.findings]
    document["board_shape"] = lens.board_shape.to_dict()
    return solution, document, lens.exit_code


def _views(args: argparse.Namespace, spec: Board, lens: GivenLens | None) -> list[BoardView]:
    from targets.board import spec_line
    from vbaa_calib.calibrate.pose.robot_tables import read_corners
    from vbaa_calib.core.images import list_images
    from vbaa_calib.detect.board.corners import detect_folder

    if args.views.suffix.lower() not in _TABLES:
        if not spec.has_one_reading:
            what = f"the board, {spec_line(spec)}, looks the same when turned: a pose would be guessed"
            remedy = "take a board with ids or an even and an odd number of squares, or give corners with ids as a CSV"
            raise InputError(what, where=args.board, remedy=remedy)
        refuse_overwrite(args.output, args.force, list_images(args.views))
        return detect_folder(args.views, spec)
    if lens is None and (args.image_size is None or min(args.image_size) < 1):
        remedy = "give --image-size W H, or --camera"
        raise InputError("the size of the corners' pictures is missing", where=args.views, remedy=remedy)
    return read_corners(args.views, lens.camera.image_size if lens else tuple(args.image_size), spec.corner_count)


def _paired(views: Sequence[str], poses: Mapping[str, Pose], where: Path) -> list[tuple[str, str]]:
    """Views with their rows of poses, in the order of the poses, matched by name with or without suffix."""
    by_name = {view: view for view in views} | {Path(view).stem: view for view in views}
    paired = [(by_name[name], name) for name in poses if name in by_name]
    twice = {name for name in poses if by_name.get(name) == by_name.get(Path(name).stem) and Path(name).stem != name}
    if both := sorted(name for name in twice if Path(name).stem in poses):
        raise InputError(f"view {both[0]} stands twice", where=where, remedy="give each view one row")
    if not paired:
        raise InputError(
            "no row is of one of the views", where=where, remedy=f"their names are {', '.join(views[:3])}, …"
        )
    for what, names in (
        ("views without a pose", {Path(view).stem for view in views} - {Path(name).stem for name in poses}),
        ("poses without a view", set(poses) - set(by_name)),
    ):
        if names:
            say(f"{what}: {len(names)} ({', '.join(sorted(names)[:5])})")
    return paired


def _lens(robot_poses: GivenLens | None, views: list[BoardView], spec: Board) -> LensSolution:
    """The known lens, or the one from the views; the board's shape from the views."""
    from vbaa_calib.calibrate.given_lens import given_solution
    from vbaa_calib.calibrate.lens_from_views import solve_lens
    from vbaa_calib.calibrate.pose.board_pose import require_size

    if robot_poses:
        for view in views:
            require_size(view.image_size, robot_poses.camera, view.name)
        return given_solution(robot_poses, views, spec)
    solution = solve_lens(views, spec)
    say(f"lens       {solution.model}: rms {solution.rms_px:.4f} px; {solution.words}")
    return solution


def _report(solution: HandEye, document: dict[str, Any]) -> None:
    import numpy as np

    std = np.sqrt(np.diag(solution.covariance))
    holder = "tool" if solution.mount == "hand" else "base"
    place = ", ".join(
        f"{1e3 * x:.2f} ± {1e3 * s:.2f}" for x, s in zip(solution.camera_pose.translation_m, std[3:6], strict=True)
    )
    say(f"camera     in the {holder}'s frame at {place} mm; turn known to {np.degrees(std[:3].max()):.3f}° per axis")
    turn, shift = solution.robot_std
    views = len(solution.views) - len(solution.outliers)
    say(
        f"disagree   {1e3 * solution.rms[1]:.2f} mm and {np.degrees(solution.rms[0]):.3f}° rms between what the board "
        f"shows and what the robot says, over {views} views"
    )
    words = "; ".join(
        f"{name} {1e3 * part[1]:.2f} mm, {np.degrees(part[0]):.3f}°" for name, part in solution.parts.items()
    )
    say(f"expected   {words}")
    loose, share = 100.0 * solution.robot_log_std, 100.0 * solution.robot_share
    say(
        f"robot      {1e3 * shift:.2f} mm (± {loose[1]:.0f} %), {np.degrees(turn):.3f}° (± {loose[0]:.0f} %) per axis "
        f"of the tool, {share[1]:.0f} % and {share[0]:.0f} % of what is expected (squared)"
    )
    for view in solution.views:
        if view.reason:
            by = f" by {1e3 * view.distance_m:.1f} mm, {np.degrees(view.turn_rad):.2f}°"
            off = "" if np.isnan(view.distance_m) else by
            say(f"left out   {view.name}: {view.reason}{off}")
    for warning in document["warnings"]:
        say(f"warning    {warning}")
    if "T_actuator_antenna" in document:
        say("session    kinematics.T_actuator_antenna of session.yaml, the tool being the actuator frame:")
        say(f"           {document['T_actuator_antenna']}")
