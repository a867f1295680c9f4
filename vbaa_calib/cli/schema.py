"""`vbaa schema session|rig|whiskers`."""

from __future__ import annotations

import argparse
import json
from typing import Any


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", choices=("session", "rig", "whiskers"), help="which file")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> dict[str, Any]:
    """Print the JSON Schema of one kind of file on stdout."""
    from vbaa_calib.core.models import json_schema
    from vbaa_calib.rig.rig_file import RigFile
    from vbaa_calib.session.settings import SessionFile
    from vbaa_calib.session.whiskers import StatedFile

    if args.name == "session":
        schema = json_schema(SessionFile, "vbaa session.yaml")
    elif args.name == "rig":
        schema = json_schema(RigFile, "vbaa rig.json")
    else:
        schema = json_schema(StatedFile, "vbaa whiskers.yaml")
    if not args.json:
        print(json.dumps(schema, indent=2))
    return schema
