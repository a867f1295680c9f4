"""YAML as people write it: no key twice, no endless aliases, 193.0e9 a number."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Hashable, Sequence
from typing import Any

import yaml

_MOST_VALUES = 1e6


def with_lines(text: str) -> tuple[Any, Callable[[Sequence[str | int]], int | None]]:
    """What a YAML text holds, parsed once, and the line of a place in it, given by its keys."""
    loader = UniqueKeyLoader(text)
    root = loader.get_single_node()
    # constructing flattens merges, but moves no key
    return loader.construct_document(root), lambda keys: _line_of(root, keys)


def _line_of(node: yaml.Node | None, keys: Sequence[str | int]) -> int | None:
    """The line where a place stands, or the last key on the way to it; None for none at all."""
    line = None
    for key in keys:
        if isinstance(node, yaml.MappingNode):
            pairs = [(name, value) for name, value in node.value if name.value == str(key)]
        else:
            items = node.value if isinstance(node, yaml.SequenceNode) else []
            pairs = [(value, value) for number, value in enumerate(items) if number == key]
        if not pairs:
            break
        line, node = pairs[0][0].start_mark.line + 1, pairs[0][1]
    return line


class UniqueKeyLoader(yaml.SafeLoader):
    """YAML without silent surprises: a key given twice is an error, not the last one wins."""

    def get_single_node(self) -> yaml.Node | None:
        """As SafeLoader's, but a small file whose aliases make it endless is refused."""
        node = super().get_single_node()
        if node is not None and _size(node, {}) > _MOST_VALUES:
            raise yaml.composer.ComposerError(None, None, "its aliases never end", node.start_mark)
        return node


def _size(node: yaml.Node, sizes: dict[int, float]) -> float:
    """How many values a node stands for with all aliases written out; infinite where it holds itself."""
    if id(node) not in sizes:
        sizes[id(node)] = math.inf  # what is found on coming back here before the sum is known
        pairs = isinstance(node, yaml.MappingNode)
        parts = [part for pair in node.value for part in pair] if pairs else node.value
        sizes[id(node)] = 1 + sum(_size(part, sizes) for part in parts if isinstance(part, yaml.Node))
    return sizes[id(node)]


def _unique_mapping(loader: UniqueKeyLoader, node: yaml.MappingNode, deep: bool = False) -> dict:
    seen: set[Hashable] = set()
    for key_node, _ in node.value:
        if key_node.tag == "tag:yaml.org,2002:merge":
            continue
        key = loader.construct_object(key_node, deep=True)
        if not isinstance(key, Hashable):
            break  # construct_mapping below refuses it
        if key in seen:
            raise yaml.constructor.ConstructorError(None, None, f"the key {key!r} stands twice", key_node.start_mark)
        seen.add(key)
    return loader.construct_mapping(node, deep)


UniqueKeyLoader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _unique_mapping)


class UniqueKeyDumper(yaml.SafeDumper):
    """Writes what `UniqueKeyLoader` reads: a text that looks like a number of ours is put in quotes."""


for _each in (UniqueKeyLoader, UniqueKeyDumper):
    # YAML 1.1 reads 193.0e9 (no sign in the exponent) as text; everyone who types a Young's modulus means a number.
    _each.add_implicit_resolver(
        "tag:yaml.org,2002:float",
        re.compile(r"^[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"),
        list("-+0123456789."),
    )
