"""`vbaa batch SESSIONS… --rig rig.json -o results/`: many recordings on dask, to a data set."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vbaa_calib.cli.options import usable_rig
from vbaa_calib.core.console import say
from vbaa_calib.core.errors import Disconnected, InputError, clipped, require_extra
from vbaa_calib.core.files import read_json, require_file
from vbaa_calib.core.threads import cores
from viz.cli import streams
from viz.cli.estimate import add_estimator_options

if TYPE_CHECKING:
    from viz.batch.cluster import Where
    from viz.batch.work import Outcome


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "recordings",
        nargs="+",
        metavar="SESSION",
        help="session folders, patterns of them in quotes ('runs/*'), or a CSV with the columns recording and, where "
        "they differ, rig, and name",
    )
    parser.add_argument("--rig", type=Path, help="rig.json of all that have none of their own in the CSV")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="RESULTS", help="folder of the data set")
    parser.add_argument(
        "--jobs", type=int, metavar="N", help="processes on this machine (default: one a core or recording)"
    )
    parser.add_argument("--memory", default="auto", metavar="SIZE", help="of each of them at most, such as 2GB")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="use the dask cluster at tls://HOST:PORT")
    parser.add_argument("--scheduler-file", type=Path, metavar="FILE", help="the same, by its scheduler file")
    tls = "of its TLS, as of `dask scheduler` (default: as dask's configuration says)"
    parser.add_argument("--tls-ca-file", type=Path, metavar="PEM", help=f"certificate authority {tls}")
    parser.add_argument("--tls-cert", type=Path, metavar="PEM", help="this command's certificate, the same way")
    parser.add_argument("--tls-key", type=Path, metavar="PEM", help="its key, the same way")
    parser.add_argument(
        "--insecure-scheduler",
        action="store_true",
        help="also without TLS: whoever reaches that scheduler can run code as you and as its workers",
    )
    parser.add_argument("--reconstruct", action="store_true", help="each recording's object, too: objects/NAME.vtp")
    add_estimator_options(parser)
    streams.configure(parser, readings=False)
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> dict[str, Any]:
    """Estimate every recording that is not done yet; the exit code is 1 where one failed or has a wrong verdict."""
    from estimator.contact.estimate import ContactEstimator
    from estimator.contact.source import is_stream
    from estimator.table.contacts import STATUSES
    from estimator.table.overview import Overview, overview_in_words
    from viz.batch.cluster import client_of, run
    from viz.batch.recordings import recordings_of
    from viz.batch.results import Results
    from viz.batch.work import BatchSettings

    recordings = recordings_of(args.recordings, args.rig)
    where = _where(args, len(recordings))
    for rig in {each.rig for each in recordings}:
        # refuses what is wrong before any work
        ContactEstimator(usable_rig(rig, args.accept_rig), args.model, friction=args.friction)
    background = args.background
    if background is not None and str(background) != "auto":
        require_file(background, "picture")
        background = background.resolve()
    results = Results(args.output.resolve())
    results.prepare(args.argv)
    if not any(is_stream(each.path) for each in recordings) and (wrong := _changed_options(args)):
        remedy = "leave it out: a session's readings are in recording/recording.csv"
        raise InputError("belongs to bags and videos, of which there are none", where=wrong[0], remedy=remedy)
    settings = BatchSettings(
        model=args.model,
        friction=args.friction,
        drift=args.drift,
        track_zero=args.track_zero,
        no_moment=args.no_moment,
        background=background,
        **streams.options_of(args),
        reconstruct=args.reconstruct,
        threads=where.threads,
        again=args.force,
    )
    outcomes, lost = [], None
    with results.locked():
        try:
            with client_of(where) as client:
                say(f"{len(recordings)} recording{'s' * (len(recordings) != 1)} on {_described(client, where)}")
                ended = run(client, recordings, settings, results)
                for outcome, line in _with_progress(ended, len(recordings)):
                    say(line)
                    outcomes.append(outcome)
        except Disconnected as error:
            lost = str(error)
            say(f"warning: {lost}")
        finally:
            rows = results.write_summary([each.row for each in outcomes if each.state == "failed"])
    states = {
        state: sorted(each.name for each in outcomes if each.state == state)
        for state in ("done", "unchanged", "failed")
    }
    missing = sorted({each.name for each in recordings} - set(states["done"]) - set(states["unchanged"]))
    own = [row for row in rows if row["recording"] in {each.name for each in recordings} - set(missing)]
    verdicts = {row["recording"]: row["verdict"] for row in own if row.get("verdict", {}).get("findings")}
    bad, doubted = (
        sorted(name for name, verdict in verdicts.items() if verdict["severity"] == severity)
        for severity in ("wrong", "doubt")
    )
    most = 20
    for label, names in (("wrong", bad), ("look at", doubted)):
        for name in names[:most]:
            worst = verdicts[name]["findings"][0]
            say(f"{label}: {name}: {worst['words']}; {worst['remedy']}")
    counts = {"done": len(states["done"]), "unchanged": len(states["unchanged"]), "missing": len(missing)}
    counts |= {name: len(names) for name, names in (("wrong", bad), ("to look at", doubted)) if names}
    say(f"wrote {args.output}: {', '.join(f'{count} {name}' for name, count in counts.items())}")
    outside = {row["recording"]: int(row["outside_points"]) for row in own if row.get("outside_points")}
    if outside:
        say(
            f"centreline points outside the picture left out: {sum(outside.values())}, of recordings: {len(outside)} "
            "(warnings in summary.csv)"
        )
    overview = Overview()
    for row in own:
        if "readings" in row:
            statuses = {status: row[status] for status in STATUSES if row[status]}
            overview.join({"status": statuses, **row}, recording=row["recording"])
    for words in overview_in_words(overview.numbers()) if overview.frames else ():
        say(words)
    for name in missing[:most]:
        say(f"  missing: {name}")
    return {
        "results": str(args.output),
        "recordings": len(recordings),
        **{state: len(names) for state, names in states.items()},
        "missing": missing,
        "wrong": bad,
        "verdicts": dict(sorted(verdicts.items())),
        "scheduler_lost": lost is not None,
        "frames": sum(int(row["frames"]) for row in own),
        "ok": sum(int(row["ok"]) for row in own),
        "outside_points": sum(outside.values()),
        **overview.numbers(),
        "exit_code": int(bool(missing or bad)),
    }


def _where(args: argparse.Namespace, count: int) -> Where:
    """The workers that the options ask for, here or on a cluster. Raises InputError where they contradict."""
    from viz.batch.cluster import Where

    elsewhere = args.scheduler is not None or args.scheduler_file is not None
    tls = {"ca_file": args.tls_ca_file, "client_cert": args.tls_cert, "client_key": args.tls_key}
    if args.scheduler is not None and args.scheduler_file is not None:
        raise InputError("--scheduler and --scheduler-file both name it", where="vbaa batch", remedy="give one of them")
    if elsewhere and (args.jobs is not None or args.memory != "auto"):
        remedy = "leave out --jobs and --memory: the cluster says how many workers it has, and how large they are"
        raise InputError("--jobs and --memory are for a cluster on this machine", where="vbaa batch", remedy=remedy)
    if not elsewhere and (args.insecure_scheduler or any(tls.values())):
        remedy = "leave them out: keys of a cluster on this machine are made for it"
        raise InputError("--tls-… and --insecure-scheduler belong to --scheduler", where="vbaa batch", remedy=remedy)
    if args.jobs is not None and not 1 <= args.jobs <= 1024:
        raise InputError(f"--jobs is {args.jobs}", remedy="give a number of processes, 1 or more")
    if args.memory != "auto":
        _check_memory(args.memory)
    if elsewhere:
        address = args.scheduler if args.scheduler_file is None else _address_in(args.scheduler_file)
        return _at_scheduler(address, tls, args.insecure_scheduler)
    return Where(min(cores(), count) if args.jobs is None else args.jobs, args.memory)


def _address_in(file: Path) -> str:
    """The scheduler's address in the file that it wrote. Raises InputError."""

    address = read_json(file).get("address")
    if not isinstance(address, str):
        raise InputError("has no address", where=file, remedy="name what `dask scheduler --scheduler-file` wrote")
    return address


def _check_memory(size: str) -> None:

    try:
        from dask.utils import parse_bytes

        enough = parse_bytes(size) >= 300_000_000
    except ImportError:
        return  # told later
    except ValueError:
        enough = False
    if not enough:
        raise InputError(f"--memory is {size!r}", remedy="give a size such as 2GB; a worker needs 0.3 GB for itself")


def _described(client: Any, where: Where) -> str:
    """The workers in words: how many there are, how large, and where one can watch them."""
    from importlib.util import find_spec

    workers = client.scheduler_info(n_workers=-1)["workers"].values()
    limits = [worker["memory_limit"] for worker in workers if worker["memory_limit"]]
    each = f", each of {max(limits) / 1e9:.1f} GB at most" if limits else ""
    kernels = f" of {where.threads} threads" if where.threads > 1 else ""
    dashboard = f"; dashboard: {client.dashboard_link}" if where.address and find_spec("bokeh") else ""
    return f"{len(workers)} workers{kernels}{each}{dashboard}"


def _changed_options(args: argparse.Namespace) -> list[str]:
    """The options about streams that are not at their defaults."""
    usual = {"clock_offset": "0", "gap": 0.1, "wait": 0.25, "moment_axis": "y", "pan_joint": "", "tilt_joint": ""}
    usual |= {"topic": [], "pan": None, "tilt": None, "degrees": False, "together": 0.01}
    return ["--" + name.replace("_", "-") for name, value in usual.items() if getattr(args, name) != value]


def _with_progress(outcomes: Iterable[Outcome], count: int) -> Iterator[tuple[Outcome, str]]:
    """The outcomes, printing a line for each: how many are done, frames per second, time left."""
    begun, frames = time.monotonic(), 0
    for done, outcome in enumerate(outcomes, 1):
        seconds = time.monotonic() - begun
        frames += int(outcome.row["frames"]) if outcome.state == "done" else 0
        rate = f", {frames / seconds:.0f} frames/s" if frames else ""
        counts = f"{outcome.row['frames']} frames, {outcome.row['ok']} ok" if outcome.state != "failed" else ""
        what = {"done": counts, "unchanged": f"unchanged ({counts})"}.get(
            outcome.state, str(outcome.row.get("sentence"))
        )
        yield outcome, f"[{done}/{count}{rate}, {(count - done) * seconds / done:.0f} s left] {outcome.name}: {what}"


def _at_scheduler(address: str, tls: Mapping[str, Path | None], insecure: bool = False) -> Where:
    """A scheduler with TLS, or any if `insecure`.

    tls : files by dask's names, ca_file, client_cert and client_key; where one is None, dask's configuration has it.
    Raises InputError without dask, for a scheduler without TLS, and for certificates that are missing or not valid.
    """
    from viz.batch.cluster import Where

    distributed = require_extra("distributed", "batch")
    secure = address.startswith("tls://")
    if not (secure or insecure):
        what = "without TLS, all who reach it can run code as its workers and as you"
        remedy = "give tls://HOST:PORT and certificates, or --insecure-scheduler where nobody else reaches it"
        raise InputError(what, where=address, remedy=remedy)
    for path in tls.values():
        if path is not None:
            require_file(path, "certificate")
    named = {f"tls_{name}": str(path) for name, path in tls.items() if path is not None}
    security = distributed.Security(require_encryption=not insecure, **named)
    if secure and not (security.tls_ca_file and security.tls_client_cert):
        remedy = "give --tls-ca-file, --tls-cert and --tls-key, or set distributed.comm.tls in dask's configuration"
        raise InputError("no certificates for its TLS", where=address, remedy=remedy)
    try:
        security.get_connection_args("client")
    except (OSError, ValueError) as error:
        what = f"its certificates are not valid ({clipped(str(error))})"
        raise InputError(what, where=address, remedy="give PEM files that belong together") from None
    return Where(address=address, security=security)
