"""`vbaa schema session|rig`."""

from __future__ import annotations

import argparse
import json
from typing import Any


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", choices=("session", "rig"), help="which file")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Print the JSON Schema of what is checked, which is the result, on stdout."""
    from vbaa_calib.core.models import json_schema
    from vbaa_calib.rig.rig_file import RigFile
    from vbaa_calib.session.settings import SessionFile

    if args.name == "session":
        schema = json_schema(SessionFile, "vbaa session.yaml")
    else:
        schema = json_schema(RigFile, "vbaa rig.json")
    if not args.json:
        print(json.dumps(schema, indent=2))
    return schema
