"""The reconstructed object as .ply, and whether a .ply holds what it announces.

VTK's writer knows neither normals with colours nor lines, and its reader runs past the end of a file that is cut short,
and dies.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from viz.scene.colours import surface_scale
from viz.scene.scene import ObjectMesh

_HEADER = re.compile(rb"ply\r?\n.*?\bend_header\r?\n", re.DOTALL)
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
}


_VERTEX = [*((name, "<f8") for name in ("x", "y", "z")), *((name, "<f4") for name in ("nx", "ny", "nz", "std_m"))]
_FACE = [("size", "u1"), ("corners", "<i4", 3)]
_COLOUR = [(name, "u1") for name in ("red", "green", "blue")]
_WORDS = {"<f8": "double", "<f4": "float", "u1": "uchar"}


def ply_bytes(mesh: ObjectMesh) -> bytes:
    """A little-endian .ply: vertices with normals, deviation std_m and a colour by it; triangles; lines as edges."""
    std = np.full(len(mesh.points_m), np.nan) if mesh.std_m is None else mesh.std_m
    vertices = np.zeros(len(mesh.points_m), [*_VERTEX, *_COLOUR])
    columns = np.column_stack([mesh.points_m, mesh.normals, std])
    for (name, _), column in zip(_VERTEX, columns.T, strict=True):
        vertices[name] = column
    for (name, _), column in zip(_COLOUR, surface_scale(std).rgb.T, strict=True):
        vertices[name] = column
    faces = np.zeros(len(mesh.triangles), _FACE)
    faces["size"], faces["corners"] = 3, mesh.triangles
    header = _header(len(vertices), len(faces), len(mesh.lines))
    rows = vertices.tobytes() + faces.tobytes() + mesh.lines.astype("<i4").tobytes()
    return header + rows


def _header(vertices: int, faces: int, edges: int) -> bytes:
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        "comment reconstructed object, metres, world frame",
        f"element vertex {vertices}",
        *(f"property {_WORDS[kind]} {name}" for name, kind in [*_VERTEX, *_COLOUR]),
        f"element face {faces}",
        "property list uchar int vertex_indices",
        f"element edge {edges}",
        "property int vertex1",
        "property int vertex2",
        "end_header",
    ]
    return "".join(line + "\n" for line in lines).encode("ascii")


def read_ply(data: bytes) -> ObjectMesh | None:
    """What `ply_bytes` wrote, with its lines, deviations and all digits, which VTK's reader leaves out; else None."""
    counts = [int(count) for count in re.findall(rb"^element \w+ (\d{1,9})$", data[:2000], re.MULTILINE)]
    if len(counts) != 3 or not data.startswith(_header(*counts)):
        return None
    kinds = [np.dtype([*_VERTEX, *_COLOUR]), np.dtype(_FACE), np.dtype(("<i4", 2))]
    sizes = [count * kind.itemsize for count, kind in zip(counts, kinds, strict=True)]
    start = len(_header(*counts))
    if len(data) != start + sum(sizes):
        return None
    vertices = np.frombuffer(data, kinds[0], counts[0], start)
    faces = np.frombuffer(data, kinds[1], counts[1], start + sizes[0])
    edges = np.frombuffer(data, "<i4", 2 * counts[2], start + sizes[0] + sizes[1]).reshape(-1, 2)
    columns = {name: np.asarray(vertices[name], float) for name, _ in _VERTEX}
    points = np.stack([columns[name] for name in "xyz"], axis=1)
    normals = np.stack([columns[name] for name in ("nx", "ny", "nz")], axis=1)
    indices = np.concatenate([faces["corners"].ravel(), edges.ravel()])
    whole = np.isfinite(points).all() and (faces["size"] == 3).all()
    if not whole or (indices.size and not 0 <= indices.min() <= indices.max() < len(points)):
        return None
    std = columns["std_m"]
    return ObjectMesh(
        points, normals, faces["corners"].astype(int), edges.astype(int), None if np.isnan(std).all() else std
    )


@dataclass(frozen=True)
class _Element:
    """So many rows of the same properties: of each, the type of its length (None: one number) and of its numbers."""

    rows: int
    properties: list[tuple[np.dtype | None, np.dtype]]


def is_whole(data: bytes) -> bool:
    """Whether the header can be read and every row that it announces follows."""
    header = _HEADER.match(data)
    if header is None:
        return False
    lines = [line.split() for line in header.group().decode("ascii", "replace").splitlines()]
    try:
        order = next(_ORDERS[words[1]] for words in lines if words[:1] == ["format"])
        elements = _elements(lines, order)
        if not order:
            return data[header.end() :].count(b"\n") >= sum(element.rows for element in elements) - 1
        position = header.end()
        for element in elements:
            position = _behind(data, position, element)
        return position <= len(data)
    except (KeyError, IndexError, ValueError, StopIteration):
        return False


def _elements(lines: list[list[str]], order: str) -> list[_Element]:
    """What the header announces. Raises KeyError, IndexError or ValueError for one that makes no sense."""
    elements: list[_Element] = []
    for words in lines:
        if words[:1] == ["element"]:
            elements.append(_Element(int(words[2]), []))
        elif words[:1] == ["property"]:
            listed = words[1] == "list"
            count = np.dtype(order + _TYPES[words[2]]) if listed else None
            elements[-1].properties.append((count, np.dtype(order + _TYPES[words[3 if listed else 1]])))
    if any(element.rows < 0 for element in elements):
        raise ValueError
    return elements


def _behind(data: bytes, position: int, element: _Element) -> int:
    """Where the element's rows end. Raises ValueError where the data end before a list's length."""
    if all(count is None for count, _ in element.properties):
        return position + element.rows * sum(number.itemsize for _, number in element.properties)
    for _ in range(element.rows):
        for count, number in element.properties:
            length = 1
            if count is not None:
                length = int(np.frombuffer(data, count, 1, position)[0])
                position += count.itemsize
            if length < 0:
                raise ValueError
            position += length * number.itemsize
    return position
