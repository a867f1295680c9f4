"""The directive `verbs`: every verb of the command line with its arguments, taken from the parsers themselves."""

from __future__ import annotations

import argparse
from typing import Any, ClassVar

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from vbaa_calib.cli.main import VERBS, _verb_parser


class VerbReference(SphinxDirective):
    """One section a verb: what it does, how it is called, and the arguments and options that are its own."""

    has_content: ClassVar[bool] = False

    def run(self) -> list[nodes.Node]:
        """The sections, in the order of `vbaa --help`."""
        return [self._section(name) for name in VERBS]

    def _section(self, name: str) -> nodes.section:
        parser = _verb_parser(name)
        section = nodes.section(ids=[f"vbaa-{name}"], names=[f"vbaa {name}"])
        section += nodes.title("", "", nodes.literal("", f"vbaa {name}"))
        section += nodes.paragraph("", parser.description or "")
        usage = parser.format_usage().removeprefix("usage: ")
        section += nodes.literal_block(usage, usage, language="none")
        options = nodes.definition_list(classes=["verb-options"])
        options += [_option(parser, action) for action in parser._actions if not _known(action)]
        if len(options):
            section += options
        return section


def _known(action: argparse.Action) -> bool:
    """Whether it is an option that every verb has, or one that is not to be shown."""
    return action.help == argparse.SUPPRESS or (action.nargs == 0 and action.dest in ("help", "json", "force", "debug"))


def _option(parser: argparse.ArgumentParser, action: argparse.Action) -> nodes.definition_list_item:
    formatter = parser._get_formatter()
    words = formatter._expand_help(action) if action.help else ""
    return nodes.definition_list_item(
        "",
        nodes.term("", "", nodes.literal("", formatter._format_action_invocation(action))),
        nodes.definition("", nodes.paragraph("", words)),
    )


def setup(app: Sphinx) -> dict[str, Any]:
    """Declare the directive."""
    app.add_directive("verbs", VerbReference)
    return {"parallel_read_safe": True}
