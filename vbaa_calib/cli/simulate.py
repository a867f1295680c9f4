"""`vbaa simulate`: a synthetic session from a scene file."""

from __future__ import annotations

import argparse
import tempfile
import time
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vbaa_calib.core.console import say
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_yaml

if TYPE_CHECKING:
    from vbaa_calib.simulate.plan import Plan
    from vbaa_calib.simulate.scene.scene import SceneSpec


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scene", help="a scene file, or the name of a bundled scene such as demo")
    parser.add_argument("-o", "--output", type=Path, metavar="SESSION", help="folder to write")
    parser.add_argument(
        "--bag",
        type=Path,
        metavar="FILE",
        help="the recording as ROS messages: .mcap, .bag (ROS 1), or a name without suffix (the folder of a ROS 2 bag)",
    )
    parser.add_argument("--seed", type=int, help="random seed in place of the scene's")
    parser.add_argument(
        "--pictures",
        choices=("all", "none"),
        default="all",
        help="none: recording/centrelines.csv in place of the recording's pictures (boards, loads and no-load stay)",
    )
    parser.add_argument(
        "--render",
        choices=("drawn", "mitsuba"),
        default="drawn",
        help="mitsuba: path-traced pictures with materials, lights, shadows and clutter as the scene's `traced` says",
    )
    parser.add_argument("--no-moment", action="store_true", help="a rig without a moment sensor")
    parser.add_argument(
        "--sensor",
        choices=("two-axis", "wrench"),
        help="in place of the scene's: moments about y and z, or all six components of a wrench",
    )
    parser.add_argument("--samples", type=int, help="light paths for each path-traced pixel in place of the scene's")
    parser.add_argument(
        "--labels", action="store_true", help="labels/: masks, centrelines and contacts in the pictures"
    )
    parser.set_defaults(run=_run)


def _written(args: argparse.Namespace, scene: SceneSpec, folder: Path) -> Plan:
    from vbaa_calib.simulate.write import write_session

    return write_session(
        scene,
        folder,
        force=args.force,
        recording_pictures=args.pictures == "all",
        traced=args.render == "mitsuba",
        labels=args.labels,
    )


def _whiskers(args: argparse.Namespace, path: Path) -> dict[str, Any]:
    """Write a recording of whiskers. Raises InputError for options that do not apply to it."""
    from vbaa_calib.simulate.whiskers import write_whiskers

    if args.output is None or args.bag is not None or args.labels or args.render != "drawn":
        remedy = "give -o FOLDER and nothing about pictures: whiskers are written as lines"
        raise InputError("a scene of whiskers has no pictures", where=path, remedy=remedy)
    frames = write_whiskers(path, args.output, force=args.force, seed=args.seed)["frames"]
    touching = sum(frame["in_contact"] for frame in frames)
    say(f"{args.output}: scene {path.stem}, {len(frames)} lines of which {touching} in contact")
    return {"session": str(args.output), "scene": path.stem, "frames": len(frames), "frames_in_contact": touching}


def _run(args: argparse.Namespace) -> dict[str, Any]:
    """Write the session, and its recording as a bag if asked. Returns names and counts.

    Raises InputError for a wrong scene, or a file or folder in the way.
    """
    from vbaa_calib.simulate.scene.scene import WrenchSpec, bundled_scene
    from vbaa_calib.simulate.scene.scene_file import load_scene
    from vbaa_calib.streams.bag_of_session import refuse_bag, write_recording

    started = time.perf_counter()
    named = Path(args.scene)
    path = named if named.is_file() or named.suffix else bundled_scene(args.scene)
    if read_yaml(path).get("schema") == "vbaa.whisking/1":
        return _whiskers(args, path)
    scene = load_scene(path)
    if args.seed is not None:
        if args.seed < 0:
            raise InputError(f"--seed is {args.seed}", where="vbaa simulate", remedy="give a whole number from 0")
        scene = replace(scene, seed=args.seed)
    if args.no_moment:
        if args.sensor:
            raise InputError("--no-moment contradicts --sensor", where="vbaa simulate", remedy="give one of them")
        scene = replace(scene, moment=None, wrench=None)
    if args.sensor:
        scene = replace(
            scene, moment=None, wrench=WrenchSpec(("my", "mz")) if args.sensor == "two-axis" else WrenchSpec()
        )
    if args.samples is not None:
        if not 1 <= args.samples <= 65536:
            what = f"--samples is {args.samples}"
            raise InputError(what, where="vbaa simulate", remedy="give a whole number from 1 to 65536")
        scene = replace(scene, traced=replace(scene.traced, samples=args.samples))
    if args.output is None and args.bag is None:
        raise InputError("no output is named", where="vbaa simulate", remedy="give -o SESSION, --bag FILE, or both")
    if args.bag is not None:
        refuse_bag(args.bag, args.force)
        if args.pictures == "none":
            raise InputError(
                "--bag needs the pictures that --pictures none leaves out",
                where="vbaa simulate",
                remedy="leave one out",
            )
    with ExitStack() as stack:
        folder = args.output or Path(stack.enter_context(tempfile.TemporaryDirectory())) / "session"
        planned = _written(args, scene, folder)
        if args.bag is not None:
            cameras = scene.cameras or {"camera": (scene.lens, scene.T_antenna_camera)}
            write_recording(args.bag, folder, {name: lens for name, (lens, _) in cameras.items()})
            say(f"wrote {args.bag}")
    frames = planned.truth["frames"]
    touching = sum(frame["in_contact"] for frame in frames)
    seconds = time.perf_counter() - started
    counts = f"{len(frames)} frames of which {touching} in contact"
    say(f"{args.output or args.bag}: scene {scene.name}, {counts}, {seconds:.1f} s")
    return {
        "session": None if args.output is None else str(args.output),
        "bag": None if args.bag is None else str(args.bag),
        "scene": scene.name,
        "seed": scene.seed,
        "intrinsics": scene.intrinsics.pictures,
        "noload": len(scene.noload),
        "loads": len(scene.loads),
        "frames": len(frames),
        "frames_in_contact": touching,
        "seconds": round(seconds, 3),
    }
