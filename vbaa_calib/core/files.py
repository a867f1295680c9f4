"""Reading and writing files: invalid input is refused in one line, and files are written completely or not at all."""

from __future__ import annotations

import errno
import io
import json
import math
import os
import re
import signal
import stat
import tempfile
import threading
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from yaml._yaml import CParser
from yaml.composer import Composer, ComposerError
from yaml.constructor import ConstructorError, SafeConstructor
from yaml.resolver import Resolver

from .errors import InputError, SolveError, reason_of


@dataclass(frozen=True)
class _FileSettings:
    """Limits of reading, so that a wrong or hostile file costs neither memory nor minutes."""

    most_bytes: int = 2_000_000_000  # of any file
    most_yaml_bytes: int = 1_000_000  # of what people write by hand; PyYAML takes seconds for it
    most_json_bytes: int = 256_000_000
    longest_number: int = 400  # characters of a number in YAML
    most_digits: int = 300  # of a whole number in JSON
    deepest: int = 64  # lists and mappings in each other
    most_values: int = 100_000  # of a YAML file, its aliases written out


FILE_LIMITS = _FileSettings()


_TEXT = "tag:yaml.org,2002:str"


def most_memory(size: int) -> int:
    """Limit of memory, bytes, for reading a file of this size."""
    return 50 * size + 200_000_000


def read_bytes(path: Path, kind: str = "file", most: int = FILE_LIMITS.most_bytes) -> bytes:
    """The contents of a file. Raises InputError as `require_file`, and when it cannot be read."""
    require_file(path, kind, most)
    try:
        return Path(path).read_bytes()
    except OSError as error:
        what = f"cannot be read ({error.strerror})"
        raise InputError(what, where=path, remedy="check the path and its permissions") from None


def require_file(path: Path, kind: str = "file", most: float = math.inf) -> None:
    """Raises InputError for a path that is missing, a folder, a pipe or device (which may never end), or a file over
    `most` bytes.

    `kind` is what the error calls it.
    """
    try:
        status = Path(path).stat()
    except FileNotFoundError:
        raise InputError(f"no such {kind}", where=path, remedy="check the path") from None
    except (OSError, ValueError) as error:
        raise InputError(
            f"cannot be read ({reason_of(error)})", where=path, remedy="check the path and its permissions"
        ) from None
    if stat.S_ISDIR(status.st_mode):
        raise InputError(f"is a folder, not a {kind}", where=path, remedy=f"name the {kind} inside it")
    if not stat.S_ISREG(status.st_mode):
        raise InputError("is a pipe or a device", where=path, remedy="write its contents to a file first")
    if status.st_size > most:
        what = f"holds {status.st_size / 1e6:.0f} MB, more than {most / 1e6:.0f} MB"
        raise InputError(what, where=path, remedy=f"is this the {kind} that is meant?")


def is_bag(path: Path) -> bool:
    """Whether a path is a bag: by its suffix, or a folder with a bag's metadata or only with a bag's files."""
    suffixes = (".mcap", ".bag", ".db3")
    if path.suffix.lower() in suffixes or os.path.isfile(path / "metadata.yaml"):
        return True
    names = [Path(name) for name in os.listdir(path)] if os.path.isdir(path) else []
    bags = [name for name in names if name.suffix.lower() in suffixes]
    # as ROS 2 numbers the parts of one; several others are recordings of their own
    parts = all(re.fullmatch(re.escape(path.resolve().name) + r"_\d+", name.stem) for name in bags)
    alone = {name.suffix.lower() for name in names} <= {*suffixes, ".db3-shm", ".db3-wal", ".txt", ".log"}
    return bool(bags) and alone and (parts or len(bags) == 1)


def is_recorded(path: Path) -> bool:
    """Whether a path is a recorded stream: a bag, a video, a table of pictures."""
    videos = (".mp4", ".avi", ".mkv", ".mov", ".webm", ".m4v", ".mpg", ".ts")
    return is_bag(path) or path.suffix.lower() in (*videos, ".csv")


def read_text(path: Path, most: int = FILE_LIMITS.most_bytes) -> str:
    """The file's text, UTF-8. Raises InputError as `read_bytes`, and when it is not text."""
    try:
        text = read_bytes(path, most=most).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError("is not UTF-8 text", where=path, remedy="save it as UTF-8") from None
    return io.IncrementalNewlineDecoder(None, translate=True).decode(text, final=True)


def with_lines(text: str) -> tuple[Any, Callable[[Sequence[str | int]], int | None]]:
    """The data in a YAML text, parsed once, and a function from the keys of a value to its line."""
    loader = _UniqueKeyLoader(text)
    root = loader.get_single_node()

    def line_of(keys: Sequence[str | int]) -> int | None:
        """The line of the value at these keys, or of the last key that exists; None without any."""
        node, line = root, None
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

    # constructing flattens merges, but moves no key
    return loader.construct_document(root), line_of


class _UniqueKeyLoader(Composer, CParser, SafeConstructor, Resolver):
    """A YAML loader for which a repeated key is an error, instead of the last one counting.

    libyaml reads the text; the tree is built in Python, where nesting raises RecursionError: PyYAML's CSafeLoader
    ends the process.
    """

    def __init__(self, text: str) -> None:
        CParser.__init__(self, text)
        for base in (Composer, SafeConstructor, Resolver):
            base.__init__(self)
        self._count = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        """Composer's method, with a bound on the depth."""
        self._count += 1
        if self._count > FILE_LIMITS.most_values:
            here: Any = self.peek_event()
            raise ComposerError(None, None, f"more than {FILE_LIMITS.most_values} values", here.start_mark)
        return super().compose_node(parent, index)

    def resolve(self, kind: Any, value: Any, implicit: Any) -> str:
        """SafeLoader's method, except that a long word is text: PyYAML's patterns of numbers take quadratic time."""
        if kind is yaml.ScalarNode and implicit[0] and len(value) > FILE_LIMITS.longest_number:
            return _TEXT
        return str(super().resolve(kind, value, implicit))

    def construct_scalar(self, node: Any) -> Any:
        """SafeLoader's method, except that a long number is refused: its digits take quadratic time, too."""
        if isinstance(node, yaml.ScalarNode) and node.tag != _TEXT and len(node.value) > FILE_LIMITS.longest_number:
            raise ConstructorError(None, None, "no number is that long", node.start_mark)
        return super().construct_scalar(node)

    def get_single_node(self) -> yaml.Node | None:
        """The document's node by SafeLoader's method; a small file that its aliases expand without end is refused."""
        node = super().get_single_node()
        if node is not None and _size(node, {}) > FILE_LIMITS.most_values:
            raise ComposerError(None, None, "its aliases never end", node.start_mark)
        return node


def _size(node: yaml.Node, sizes: dict[int, float]) -> float:
    """Number of values of a node with all aliases expanded; infinite where it contains itself."""
    if id(node) not in sizes:
        sizes[id(node)] = math.inf  # what is found on coming back here before the sum is known
        pairs = isinstance(node, yaml.MappingNode)
        parts = [part for pair in node.value for part in pair] if pairs else node.value
        sizes[id(node)] = 1 + sum(_size(part, sizes) for part in parts if isinstance(part, yaml.Node))
    return sizes[id(node)]


def _unique_mapping(loader: _UniqueKeyLoader, node: yaml.MappingNode, deep: bool = False) -> dict:
    seen: set[Hashable] = set()
    for key_node, _ in node.value:
        if key_node.tag == "tag:yaml.org,2002:merge":
            continue
        key = loader.construct_object(key_node, deep=True)
        if not isinstance(key, Hashable):
            break  # construct_mapping below refuses it
        if key in seen:
            raise ConstructorError(None, None, f"the key {key!r} stands twice", key_node.start_mark)
        seen.add(key)
    return loader.construct_mapping(node, deep)


_UniqueKeyLoader.add_constructor(Resolver.DEFAULT_MAPPING_TAG, _unique_mapping)  # type: ignore[type-var]


class UniqueKeyDumper(yaml.SafeDumper):
    """A YAML dumper for `_UniqueKeyLoader`: text that looks like a number is quoted."""


for _each in (_UniqueKeyLoader, UniqueKeyDumper):
    # YAML 1.1 reads 193.0e9 (no sign in the exponent) as text; everyone who types a Young's modulus means a number.
    _each.add_implicit_resolver(
        "tag:yaml.org,2002:float", re.compile(r"^[-+]?(\d+(\.\d*)?|\.\d+)[eE][-+]?\d+$"), list("-+0123456789.")
    )


def read_yaml(path: Path, *, first: bool = False) -> dict[str, Any]:
    """The mapping in a YAML file; first : in the first of several documents. Raises InputError naming the line of
    what is wrong."""
    text = read_text(path, FILE_LIMITS.most_yaml_bytes)
    if first:
        text = re.split(r"(?m)(?<=\S)\s*^---\s*$", text, maxsplit=1)[0]
    try:
        data = _UniqueKeyLoader(text).get_single_data()
        _refuse_deep(data)
    except RecursionError:
        raise InputError("is not valid YAML (nested too deeply)", where=path, remedy="write it again") from None
    except (yaml.YAMLError, ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        # PyYAML lets the bare errors of int(), datetime() and its own tables through, e.g. for `!!bool maybe`
        mark = getattr(error, "problem_mark", None)
        place = f"{path} line {mark.line + 1}" if mark else path
        problem = getattr(error, "problem", None) or str(error).partition("\n")[0]
        raise InputError(f"is not valid YAML ({problem})", where=place, remedy="mend that line") from None
    if not isinstance(data, dict):
        raise InputError("must be a mapping of keys to values", where=path, remedy="see docs/formats.md")
    return data


def at(data: Any, *keys: str) -> Any:
    """The value at a path of keys in nested mappings; None where a key is missing."""
    for key in keys:
        data = data.get(key) if isinstance(data, Mapping) else None
    return data


def read_json(path: Path) -> dict[str, Any]:
    """The object in a JSON file. Raises InputError naming the line of what is wrong."""
    try:
        data = json.loads(
            read_text(path, FILE_LIMITS.most_json_bytes), object_pairs_hook=_unique_object, parse_int=_whole_number
        )
        _refuse_deep(data)
    except json.JSONDecodeError as error:
        where, problem = f"{path} line {error.lineno}", error.msg
    except RecursionError:
        where, problem = str(path), "nested too deeply"
    except ValueError as error:
        where, problem = str(path), str(error)
    else:
        if not isinstance(data, dict):
            raise InputError("must be a JSON object", where=path, remedy="see docs/formats.md")
        return data
    raise InputError(f"is not valid JSON ({problem})", where=where, remedy="write it again")


def _whole_number(text: str) -> float:
    """int(text), but infinite where no float can represent it, so that it is refused with its key as other such
    numbers are."""
    return int(text) if len(text) <= FILE_LIMITS.most_digits else -math.inf if text[0] == "-" else math.inf


def _refuse_deep(data: Any) -> None:
    """Raises RecursionError for data nested deeper than any of our files, before recursive code meets it."""
    level: list[Any] = [[data]]
    for _ in range(FILE_LIMITS.deepest + 1):
        items = (item for each in level for item in (each.values() if isinstance(each, dict) else each))
        level = [item for item in items if isinstance(item, dict | list)]
    if level:
        raise RecursionError


def _unique_object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    data: dict[str, Any] = {}
    for key, value in pairs:
        if key in data:
            raise ValueError(f"the key {key!r} stands twice")
        data[key] = value
    return data


def sha256(path: Path) -> str:
    """Hex digest of a file's bytes. Raises InputError when it cannot be read."""
    import hashlib  # loads OpenSSL

    require_file(path)
    try:
        with Path(path).open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", where=path, remedy="check the path") from None


def refuse_overwrite(path: Path, force: bool, inputs: Iterable[Path | None] = ()) -> None:
    """Raises InputError when a file may not be written to `path`; to be called before the work, not after it.

    A file in the way is refused unless `force` is on; a folder or a device always, and one of the command's own
    `inputs`. A folder that is not there is made when the file is written.
    """
    path, mode = Path(path), None
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        pass
    except (OSError, ValueError) as error:
        raise InputError(f"cannot be written ({reason_of(error)})", where=path, remedy="take another name") from None
    if mode is not None:
        if stat.S_ISDIR(mode):
            raise InputError("is a folder", where=path, remedy="name a file inside it")
        if not stat.S_ISREG(mode):
            raise InputError("is not a regular file", where=path, remedy="take another name")
        refuse_input(path, inputs)
    if (mode is not None or path.is_symlink()) and not force:
        raise InputError("exists already", where=path, remedy="give --force to replace it, or another name")
    refuse_folder_of(path)


def refuse_input(path: Path, inputs: Iterable[Path | None]) -> None:
    """Raises InputError when an output would be one of the command's own inputs, by whatever name."""
    known = [each for each in inputs if each is not None and os.path.exists(each)]
    if os.path.exists(path) and any(os.path.samefile(path, each) for each in known):
        raise InputError("is an input of this command", where=path, remedy="take another name")


def refuse_outputs(paths: Iterable[Path | None], force: bool, inputs: Iterable[Path | None] = ()) -> None:
    """`refuse_overwrite` for each requested output; no two may be the same file."""
    known, inputs = set[Path](), list(inputs)
    for path in filter(None, paths):
        refuse_overwrite(path, force, inputs)
        if path.resolve() in known:
            raise InputError("is another output of this command, too", where=path, remedy="take another name")
        known.add(path.resolve())


def refuse_folder_of(path: Path) -> None:
    """Raises InputError where the folder of `path` is neither writable nor can be made."""
    folder = Path(os.path.realpath(path)).parent
    while not os.path.lexists(folder):
        folder = folder.parent
    if not folder.is_dir():
        raise InputError(f"{folder} is not a folder", where=path, remedy="take another name")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InputError("its folder is read-only", where=path, remedy="write somewhere else")


@contextmanager
def replacing(path: Path, force: bool = True) -> Iterator[Path]:
    """Context with a temporary path next to `path` that replaces it only if the block succeeds (write, fsync,
    rename).

    A link is followed: the file it leads to is replaced. Raises InputError as `refuse_overwrite` does.
    """
    refuse_overwrite(path, force)
    target, temporary = Path(path).resolve(), None
    try:
        with signals_deferred():
            try:
                target.parent.mkdir(parents=True, exist_ok=True)
                # the suffix stays: writers like VTK's choose the format by it
                handle, name = tempfile.mkstemp(prefix=f".{target.stem[:40]}-", suffix=target.suffix, dir=target.parent)
            except OSError as error:
                what = f"cannot be written ({error.strerror})"
                raise InputError(what, where=path, remedy="write somewhere else") from None
            os.close(handle)
            temporary = Path(name)
        with disk_errors_named(path):
            yield temporary
            with temporary.open("rb+") as stream:
                os.fsync(stream.fileno())
            temporary.chmod(0o666 & ~umask())
            temporary.replace(target)
            _sync_folder(target.parent)
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)


@contextmanager
def signals_deferred() -> Iterator[None]:
    """Context in which Ctrl-C and terminating signals wait until the block is over. Other threads never get them."""
    delayed, before = [], {}
    try:
        if threading.current_thread() is threading.main_thread():
            for number in filter(None, (getattr(signal, name, None) for name in ("SIGINT", "SIGTERM", "SIGHUP"))):
                if signal.getsignal(number) not in (signal.SIG_IGN, None):
                    before[number] = signal.signal(number, lambda sent, _: delayed.append(sent))
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if delayed:
            signal.raise_signal(delayed[0])


def umask() -> int:
    """The process's umask: permissions that new files do not get."""
    mask = os.umask(0)
    os.umask(mask)
    return mask


@contextmanager
def disk_errors_named(path: Path) -> Iterator[None]:
    """Context that raises InputError naming `path` in place of a disk error: full, over a quota or limit, read-only."""
    causes = {errno.ENOSPC: "free", errno.EDQUOT: "free", errno.EFBIG: "allow", errno.EROFS: ""}
    try:
        yield
    except OSError as error:
        if error.errno not in causes:
            raise
        do = causes[error.errno]
        remedy = f"{do} more space, or write somewhere else" if do else "write somewhere else"
        raise InputError(f"cannot be written ({error.strerror})", where=path, remedy=remedy) from None


def _sync_folder(folder: Path) -> None:
    """Flush a folder to the disk so that a new name in it survives a power cut; on POSIX systems only."""
    if os.name != "posix":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError:  # some network drives refuse it for folders
        pass
    finally:
        os.close(handle)


def write_text(path: Path, text: str, force: bool = True) -> None:
    """Write a text file, completely or not at all."""
    with replacing(path, force) as temporary:
        temporary.write_text(text, encoding="utf-8")


def json_text(data: Mapping[str, Any], indent: int | None = None) -> str:
    """Data as JSON that every reader accepts: the bytes of file names that are not UTF-8 are replaced by �. Raises
    ValueError for NaN."""
    text = json.dumps(data, indent=indent, allow_nan=False)
    if "\\ud" in text:  # halves of pairs, which Python makes of such bytes, or whole pairs
        plain = json.dumps(data, ensure_ascii=False).encode("utf-8", "surrogateescape").decode("utf-8", "replace")
        text = json.dumps(json.loads(plain), indent=indent)
    return text


def write_json(
    path: Path, data: Mapping[str, Any], force: bool = True, readable_as: Callable[[dict], object] | None = None
) -> None:
    """Write a JSON object, completely or not at all. NaN is refused, because it is not JSON.

    readable_as : its reader, if it has one. Raises SolveError, and writes nothing, where that refuses it.
    """
    text = json_text(data, indent=2)
    if readable_as is not None:
        try:
            readable_as(json.loads(text))
        except InputError as error:
            raise SolveError(
                f"{path} is not written, since it could not be read again ({error.what}): the pictures do not "
                "determine that; add some, or choose another --lens-model"
            ) from error
    write_text(path, text + "\n", force)
