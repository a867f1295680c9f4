"""`vbaa schema session|rig`."""

from __future__ import annotations

import argparse
import json
from typing import Any

from vbaa_calib import schemas


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `vbaa schema`."""
    parser.add_argument("name", choices=schemas.NAMES, help="which file")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Print the schema, which is the result, on stdout."""
    schema = dict(schemas.schema(args.name))
    if not args.json:
        print(json.dumps(schema, indent=2))
    return schema
