"""`vbaa budget rig.json`: what limits the accuracy of this rig's contacts, and what to improve first."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vbaa_calib.cli.options import add_joints, pan_tilt_rad, usable_rig
from vbaa_calib.core.console import say
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import at, read_json, refuse_outputs, write_json, write_text

if TYPE_CHECKING:
    import numpy as np

    from estimator.budget.budget import Budget, BudgetContacts
    from vbaa_calib.rig import Rig

from .estimate import FRICTION_RAD


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("rig", type=Path, help="rig.json of `vbaa calibrate`")
    parser.add_argument("-o", "--output", type=Path, metavar="BUDGET", help="budget.json to write, contact by contact")
    parser.add_argument("--figure", type=Path, metavar="IMAGE", help="figure to write, .svg")
    parser.add_argument(
        "--friction",
        type=float,
        default=FRICTION_RAD,
        metavar="RAD",
        help=f"deviation of the friction angle, as for `vbaa estimate` (default: {FRICTION_RAD}); 0: no friction",
    )
    parser.add_argument("--no-moment", action="store_true", help="vision alone: leave the moment reading aside")
    one = parser.add_argument_group("one contact", "all three together; without them ordinary contacts all over")
    one.add_argument("--distance", type=float, metavar="M", help="of the contact from the clamp, along the antenna")
    one.add_argument("--force-y", type=float, metavar="N", help="force on the antenna along its y, in plane C")
    one.add_argument("--force-z", type=float, metavar="N", help="along its z, out of plane C")
    add_joints(parser)
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> dict[str, Any]:
    """Make and print the budget, and write the files that are asked for."""
    from estimator.budget.budget import error_budget
    from estimator.budget.report import SCHEMA, advice, as_data, table

    outputs = {"budget": args.output, "figure": args.figure}
    refuse_outputs(outputs.values(), args.force, (args.rig,))
    if args.output is not None and args.output.suffix.lower() != ".json":
        raise InputError("is not a .json", where=args.output, remedy="name it budget.json")
    if args.figure is not None and args.figure.suffix.lower() != ".svg":
        raise InputError("is not a .svg", where=args.figure, remedy="name it budget.svg")
    numbers = {"--distance": args.distance, "--force-y": args.force_y, "--force-z": args.force_z}
    missing = [name for name, value in numbers.items() if value is None]
    if 0 < len(missing) < len(numbers):
        raise InputError("one contact needs --distance, --force-y and --force-z", remedy=f"add {', '.join(missing)}")
    for name, value in {**numbers, "--friction": args.friction}.items():
        if value is not None and not math.isfinite(value):
            raise InputError(f"{name} is {value}", remedy="give a finite number")
    if not 0.0 <= args.friction <= 1.0:
        raise InputError(f"--friction is {args.friction}", remedy="give the angle's deviation in rad, 0 to 1")
    rig = usable_rig(args.rig)
    touches = _touches(args, rig)
    budget = error_budget(rig, touches, friction=args.friction, with_moment=not args.no_moment)
    inputs = {
        "rig": str(args.rig),
        "friction_rad": args.friction,
        "with_moment": not args.no_moment,
        "pan_rad": touches.pan_rad,
        "tilt_rad": touches.tilt_rad,
    }
    guide = at(read_json(args.rig), "quality", "guide")
    guide = guide if isinstance(at(guide, "words"), str) else {}
    result = inputs | as_data(budget) | {"guide": guide}
    say(table(budget))
    say("")
    for line in [*budget.notes, *advice(budget), *([guide["words"]] if guide else [])]:
        say(line)
    if args.figure is not None:
        from viz.figures.budget import budget_figure

        write_text(args.figure, budget_figure(budget), args.force)
    if args.output is not None:
        whole = {"schema": SCHEMA, **result, "by_contact": _contacts_as_data(budget)}
        write_json(args.output, whole, args.force)
    written = {name: None if path is None else str(path) for name, path in outputs.items()}
    if any(written.values()):
        say("wrote " + " and ".join(filter(None, written.values())))
    return {**result, **written}


def _touches(args: argparse.Namespace, rig: Rig) -> BudgetContacts:
    """The contacts of the budget. Raises InputError for one that is not on the antenna, or bends it too far."""
    import numpy as np

    from estimator.budget.budget import ordinary_touches, touch_of_force
    from estimator.solver.rig_arrays import RigArrays
    from vbaa_calib.native import core

    pan, tilt = pan_tilt_rad(args)
    if args.distance is None:
        return ordinary_touches(rig, pan, tilt)
    distance, length = args.distance, rig.antenna.length_m
    nearest = core.solver.NEAREST * length
    if not nearest < distance <= length:
        raise InputError(
            f"--distance {args.distance:g} m is not on the antenna", remedy=f"give {nearest:.3g} to {length:.4g} m"
        )
    force = np.array([args.force_y, args.force_z])
    touch = touch_of_force(RigArrays.from_rig(rig, args.friction, drift=False), distance, force, pan, tilt)
    if not np.isfinite(touch.push_N).all():
        raise InputError(
            f"a force of {float(np.hypot(*force)):.3g} N bends the antenna further than is modelled",
            remedy="give a smaller force: slopes are ordinary below 35°",
        )
    return touch


def _contacts_as_data(budget: Budget) -> list[dict[str, Any]]:
    """Each contact's standard deviations, m and N, and their contributions by cause."""
    import numpy as np

    from estimator.budget.budget import per_result

    def deviations(row: np.ndarray) -> dict[str, float]:
        return {name: float(np.sqrt(values[0])) for name, values in per_result(row[None]).items()}

    whole = np.sum(list(budget.variances.values()), axis=0)
    return [
        {
            "distance_m": float(budget.touches.distance_m[i]),
            "push_N": budget.touches.push_N[i].tolist(),
            "std": deviations(whole[i]),
            "by_cause": {cause: deviations(rows[i]) for cause, rows in budget.variances.items()},
        }
        for i in range(len(budget.touches))
    ]
