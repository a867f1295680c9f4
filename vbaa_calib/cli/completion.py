"""`vbaa completion bash|zsh|fish`: a script for the shell, made of the parsers."""

from __future__ import annotations

import argparse
import importlib
from typing import Any

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
    """Arguments of `vbaa completion`."""
    parser.add_argument("shell", choices=("bash", "zsh", "fish"), help="the shell that the script is for")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Print the script."""
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
