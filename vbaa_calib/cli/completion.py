"""`vbaa completion bash|zsh|fish`: a completion script, generated from the parsers."""

from __future__ import annotations

import argparse
import importlib
from typing import Any

EXAMPLES = {
    "board": ("vbaa board -o print/board.pdf", "vbaa board --squares 9x6 -o small/board.svg"),
    "wizard": ("vbaa wizard my_rig/", "vbaa wizard my_rig/ --answers answers.yaml --json"),
    "intrinsics": (
        "vbaa intrinsics session/intrinsics --board board.yaml -o new/camera.json",
        "vbaa intrinsics session/intrinsics --board board.yaml --lens-model opencv4 -o lens.json --html lens.html",
    ),
    "calibrate": ("vbaa calibrate session -o new/rig.json", "vbaa calibrate session --lens-model opencv4 -o rig4.json"),
    "handeye": (
        "vbaa handeye session/intrinsics --board board.yaml --poses poses.csv --camera camera.json -o handeye.json",
        "vbaa handeye corners.csv --board board.yaml --poses poses.csv --camera camera.json -o arm.json",
    ),
    "stiffness": (
        "vbaa stiffness stiffness.csv --load 0.01 --distance 0.2",
        "vbaa stiffness stiffness.csv --load 0.01 --distance 0.2 --diameter 0.0008 -o stiffness.json",
    ),
    "simulate": (
        "vbaa simulate scene.yaml -o synthetic/session",
        "vbaa simulate scene.yaml --pictures none -o without_pictures",
    ),
    "bench": ("vbaa bench vision --quick", "vbaa bench vision --quick --out new/"),
    "convert": (
        "vbaa convert rig.json --to ros -o camera_info.yaml",
        "vbaa convert rig.json --to opencv -o camera.yml",
    ),
    "export": ("vbaa export rig.json --to mujoco -o antenna.xml", "vbaa export rig.json --to pyelastica -o antenna.py"),
    "schema": ("vbaa schema session", "vbaa schema rig"),
    "budget": ("vbaa budget rig.json", "vbaa budget rig.json --distance 0.14 --force-y 0.06 --force-z -0.04"),
    "track": ("vbaa track contacts.csv -o track.csv", "vbaa track contacts.csv --rig rig.json -o slips.csv"),
    "check": ("vbaa check rig.json session", "vbaa check rig.json session --html check.html"),
    "estimate": (
        "vbaa estimate session --rig rig.json -o results/contacts.csv",
        "vbaa estimate session --rig rig.json --no-report -o plain.parquet",
    ),
    "live": (
        "vbaa live rig.json session/recording/recording.csv -o live/contacts.csv",
        "vbaa live rig.json session/recording/recording.csv --no-final --lines",
    ),
    "batch": (
        "vbaa batch session --rig rig.json -o results/",
        "vbaa batch 'recordings/*' --rig rig.json --jobs 2 -o results/",
    ),
    "compare": ("vbaa compare contacts.csv contacts.csv", "vbaa compare rig.json rig.json --html compared.html"),
    "next": (
        "vbaa next contacts.csv --rig rig.json",
        "vbaa next contacts.csv --rig rig.json --goal friction --tilt -40 40 --degrees",
    ),
    "refine": (
        "vbaa refine contacts.csv --rig rig.json --session session -o refined.csv",
        "vbaa refine contacts.csv --rig rig.json --session session -o refined.parquet",
    ),
    "look": ("vbaa look free.png --rig rig.json", "vbaa look free.png --rig rig.json -o seen.png"),
    "reconstruct": (
        "vbaa reconstruct contacts.csv --rig rig.json -o surface.vtp",
        "vbaa reconstruct contacts.csv --rig rig.json -o surface.ply",
    ),
    "report": (
        "vbaa report contacts.csv -o report.html",
        "vbaa report contacts.csv --rig rig.json --session session -o with_rig.html",
    ),
    "view": (
        "vbaa view contacts.csv --rig rig.json --html scene.html",
        "vbaa view contacts.csv --rig rig.json --screenshot scene.png",
    ),
    "doctor": ("vbaa doctor", "vbaa doctor --json"),
    "completion": ("vbaa completion bash", "vbaa completion fish"),
    "demo": ("vbaa demo", "vbaa demo --out my_demo/"),
}
"""Two examples for each verb's --help; tests run them."""

_BASH = """_vbaa() {{
  local word="${{COMP_WORDS[COMP_CWORD]}}" words=""
  if [ "$COMP_CWORD" -eq 1 ]; then words="{verbs}"; else
    case "${{COMP_WORDS[1]}}" in
{cases}
    esac
  fi
  case "$word" in -*) ;; *) [ "$COMP_CWORD" -eq 1 ] || words="" ;; esac
  COMPREPLY=($(compgen -W "$words" -- "$word"))
}}
complete -o default -F _vbaa vbaa
"""


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("shell", choices=("bash", "zsh", "fish"), help="the shell that the script is for")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> dict[str, Any]:
    """Print the completion script."""
    front = importlib.import_module("vbaa_calib.cli.main")  # which imports the verbs by name, too

    options = {
        verb: sorted(o for o in front._verb_parser(verb)._option_string_actions if o.startswith("--"))
        for verb in front.VERBS
    }
    if args.shell == "fish":
        lines = ["complete -c vbaa -n __fish_use_subcommand -f"]
        for verb, names in options.items():
            lines.append(f"complete -c vbaa -n __fish_use_subcommand -f -a {verb}")
            lines += [f"complete -c vbaa -n '__fish_seen_subcommand_from {verb}' -l {one[2:]}" for one in names]
        script = "\n".join(lines) + "\n"
    else:
        cases = "\n".join(f'      {verb}) words="{" ".join(names)}" ;;' for verb, names in options.items())
        script = _BASH.format(verbs=" ".join(front.VERBS), cases=cases)
    if args.shell == "zsh":
        script = f"autoload -U +X bashcompinit && bashcompinit\n{script}"
    if not args.json:
        print(script, end="")
    return {"shell": args.shell, "script": script}
