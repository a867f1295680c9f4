"""Reading and writing files: hostile input is refused in one line, and nothing is ever left half-written."""

from __future__ import annotations

import csv
import hashlib
import json
import os
import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from .errors import InputError


def read_text(path: Path) -> str:
    """The file's text, UTF-8. Raises InputError when it is missing, a folder, unreadable or not text."""
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputError("no such file", where=path, remedy="check the path") from None
    except IsADirectoryError:
        raise InputError("is a folder, not a file", where=path, remedy="name the file inside it") from None
    except UnicodeDecodeError:
        raise InputError("is not UTF-8 text", where=path, remedy="save it as UTF-8") from None
    except (OSError, ValueError) as error:
        raise InputError(f"cannot be read ({error})", where=path, remedy="check the path and its permissions") from None


class _UniqueKeyLoader(yaml.SafeLoader):
    """YAML without silent surprises: a key given twice is an error, not the last one wins."""


def _unique_mapping(loader: _UniqueKeyLoader, node: yaml.MappingNode, deep: bool = False) -> dict:
    keys = [loader.construct_object(key, deep=True) for key, _ in node.value]
    for key in keys:
        if keys.count(key) > 1:
            raise yaml.constructor.ConstructorError(None, None, f"the key {key!r} stands twice", node.start_mark)
    return loader.construct_mapping(node, deep)


_UniqueKeyLoader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _unique_mapping)
# YAML 1.1 reads 193.0e9 (no sign in the exponent) as text; everyone who types a Young's modulus means a number.
_UniqueKeyLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"),
    list("-+0123456789."),
)


def read_yaml(path: Path) -> dict[str, Any]:
    """A YAML mapping. Raises InputError naming line and column of what is wrong."""
    try:
        data = yaml.load(read_text(path), Loader=_UniqueKeyLoader)
    except (yaml.YAMLError, TypeError, ValueError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        place = f"{path}:{mark.line + 1}" if mark else path
        problem = getattr(error, "problem", None) or str(error).splitlines()[0]
        raise InputError(f"is not valid YAML ({problem})", where=place, remedy="mend that line") from None
    if not isinstance(data, dict):
        raise InputError("must be a mapping of keys to values", where=path, remedy="see docs/formats.md")
    return data


def read_json(path: Path) -> dict[str, Any]:
    """A JSON object. Raises InputError naming line and column of what is wrong."""
    try:
        data = json.loads(read_text(path))
    except (json.JSONDecodeError, RecursionError) as error:
        place = f"{path}:{error.lineno}" if isinstance(error, json.JSONDecodeError) else path
        problem = error.msg if isinstance(error, json.JSONDecodeError) else "nested too deeply"
        raise InputError(f"is not valid JSON ({problem})", where=place, remedy="write it again") from None
    if not isinstance(data, dict):
        raise InputError("must be a JSON object", where=path, remedy="see docs/formats.md")
    return data


def read_csv(path: Path, columns: Sequence[str], optional: Sequence[str] = ()) -> list[dict[str, str]]:
    """Rows of a CSV with a header, as text; row i of the result stands in line i + 2 of the file.

    Raises InputError for a missing file, header, column or cell. Columns beyond those named are ignored.
    """
    lines = read_text(path).splitlines()
    try:
        rows = [[cell.strip() for cell in row] for row in csv.reader(lines, strict=True)]
    except csv.Error as error:
        raise InputError(f"is not a valid CSV ({error})", where=path, remedy="write it again") from None
    if not rows or not any(rows[0]):
        raise InputError("is empty", where=path, remedy=f"the first line must name the columns {','.join(columns)}")
    header = rows[0]
    for name in columns:
        if header.count(name) != 1:
            problem = "is missing" if name not in header else "stands twice"
            raise InputError(
                f"column {name} {problem}", where=path, remedy=f"the columns {','.join(columns)} are needed"
            )
    known = [name for name in (*columns, *optional) if name in header]
    table = []
    for number, row in enumerate(rows[1:], start=2):
        if not any(row):
            continue
        if len(row) != len(header):
            raise InputError(
                f"has {len(row)} cells, the header {len(header)}", where=f"{path} line {number}", remedy="mend the row"
            )
        record = dict(zip(header, row, strict=True))
        table.append({name: record[name] for name in known} | {"line": str(number)})
    if not table:
        raise InputError("has a header but no rows", where=path, remedy="add at least one row")
    return table


def number(row: Mapping[str, str], column: str, path: Path) -> float:
    """One finite number out of a CSV row. Raises InputError naming file, line and column."""
    place = f"{path} line {row['line']}"
    try:
        value = float(row[column])
    except ValueError:
        raise InputError(f"{column} is {row[column]!r}", where=place, remedy="a number in SI units is needed") from None
    if value != value or value in (float("inf"), float("-inf")):
        raise InputError(f"{column} is {row[column]}", where=place, remedy="a finite number in SI units is needed")
    return value


def sha256(path: Path) -> str:
    """Hex digest of a file's bytes."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def refuse_overwrite(path: Path, force: bool) -> None:
    """Raises InputError when path exists and force is off; to be called before the work, not after it."""
    path = Path(path)
    if path.exists() and not force:
        raise InputError("exists already", where=path, remedy="give --force to replace it, or another name")
    if not path.resolve().parent.is_dir():
        raise InputError("its folder does not exist", where=path, remedy=f"create {path.parent} first")


@contextmanager
def replacing(path: Path, force: bool = True) -> Iterator[Path]:
    """A temporary path beside `path` that takes its place only when the block ends well (write, fsync, rename)."""
    path = Path(path)
    refuse_overwrite(path, force)
    # the suffix stays: writers like VTK's choose the format by it
    handle, name = tempfile.mkstemp(prefix=f".{path.stem}-", suffix=path.suffix, dir=path.resolve().parent)
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        with temporary.open("rb+") as stream:
            os.fsync(stream.fileno())
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str, force: bool = True) -> None:
    """Write a text file, whole or not at all."""
    with replacing(path, force) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: Path, data: Mapping[str, Any], force: bool = True) -> None:
    """Write a JSON object, whole or not at all. NaN is refused: it is not JSON."""
    write_text(path, json.dumps(data, indent=2, allow_nan=False) + "\n", force)
