"""The reconstructed object as .ply, and any .ply as an object.

VTK's writer knows neither normals with colours nor lines, and its reader runs past the end of a file that is cut short,
and dies.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from viz.scene.colours import surface_scale
from viz.scene.scene import ObjectMesh

_HEADER = re.compile(rb"ply\r?\n(.*?)\bend_header\r?\n", re.DOTALL)
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
}
_Property = tuple[str, str | None, str]
"""Name, type of a list's length (None for a single number), type of the number or numbers."""


def ply_bytes(mesh: ObjectMesh) -> bytes:
    """A little-endian .ply: vertices with normals, deviation std_m and a colour by it; triangles; lines as edges."""
    std = np.full(len(mesh.points_m), np.nan) if mesh.std_m is None else mesh.std_m
    columns = [*zip(("x", "y", "z"), mesh.points_m.T, ["double"] * 3, strict=True)]
    columns += zip(("nx", "ny", "nz", "std_m"), [*mesh.normals.T, std], ["float"] * 4, strict=True)
    columns += zip(("red", "green", "blue"), surface_scale(std).rgb.T, ["uchar"] * 3, strict=True)
    vertices = np.zeros(len(std), [(name, f"<{_TYPES[word]}") for name, _, word in columns])
    for name, values, _ in columns:
        vertices[name] = values
    faces = np.zeros(len(mesh.triangles), [("size", "u1"), ("corners", "<i4", 3)])
    faces["size"], faces["corners"] = 3, mesh.triangles
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment reconstructed object, metres, world frame",
        f"element vertex {len(vertices)}",
        *(f"property {word} {name}" for name, _, word in columns),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        f"element edge {len(mesh.lines)}",
        "property int vertex1",
        "property int vertex2",
        "end_header\n",
    ]
    return "\n".join(header).encode() + vertices.tobytes() + faces.tobytes() + mesh.lines.astype("<i4").tobytes()


def read_ply(data: bytes) -> dict[str, Any]:
    """Points, triangles, lines, normals and deviations, None for those it has not; polygons are cut into triangles.

    Raises KeyError, IndexError, ValueError or StopIteration where the header makes no sense or rows are missing.
    """
    header = _HEADER.match(data)
    if header is None:
        raise ValueError
    lines = [line.split() for line in header[1].decode("ascii").splitlines()]
    order = next(_ORDERS[words[1]] for words in lines if words[:1] == ["format"])
    # numbers in words are read as if they were doubles
    body = data[header.end() :] if order else np.array(data[header.end() :].split(), float).tobytes()
    found, position = {}, 0
    for name, (rows, properties) in _elements(lines, order).items():
        found[name], position = _rows(body, position, rows, properties)
    vertex, face, edge = (found.get(name, {}) for name in ("vertex", "face", "edge"))
    polygons = face.get("vertex_indices", face.get("vertex_index", []))
    fans = [
        np.asarray(one)[..., [0, corner, corner + 1]].reshape(-1, 3)
        for one in ([polygons] if isinstance(polygons, np.ndarray) else polygons)
        for corner in range(1, one.shape[-1] - 1)
    ]
    return {
        "points_m": _stacked(vertex, "x", "y", "z"),
        "triangles": np.concatenate([np.empty((0, 3)), *fans]),
        "lines": _stacked(edge, "vertex1", "vertex2") if edge else np.empty((0, 2)),
        "normals": _stacked(vertex, "nx", "ny", "nz") if "nx" in vertex else None,
        "std_m": vertex.get("std_m"),
    }


def _stacked(columns: Mapping[str, Any], *names: str) -> np.ndarray:
    return np.stack([np.asarray(columns[name], float) for name in names], axis=1)


def _elements(lines: list[list[str]], order: str) -> dict[str, tuple[int, list[_Property]]]:
    """What the header announces: name → number of rows and their properties."""
    elements: dict[str, tuple[int, list[_Property]]] = {}
    for words in lines:
        if words[:1] == ["element"]:
            properties: list[_Property] = []
            elements[words[1]] = int(words[2]), properties
        elif words[:1] == ["property"]:
            kinds = [order + _TYPES[word] if order else "<f8" for word in words[1:-1] if word != "list"]
            properties.append((words[-1], kinds[0] if words[1] == "list" else None, kinds[-1]))
    return elements


def _rows(body: bytes, position: int, rows: int, properties: list[_Property]) -> tuple[dict[str, Any], int]:
    """Each property's values, (rows,), (rows, K) or a list of lists, and where they end. Raises ValueError."""
    if rows <= 0:
        if rows < 0:
            raise ValueError
        return {}, position
    kind, lengths = _row_kind(body, position, properties), [f"{name}#" for name, count, _ in properties if count]
    if position + rows * kind.itemsize <= len(body):
        values = np.frombuffer(body, kind, rows, position)
        if all((values[name] == values[name][0]).all() for name in lengths):
            return {name: values[name] for name, *_ in properties}, position + rows * kind.itemsize
    if not lengths:
        raise ValueError
    each = []
    for _ in range(rows):
        kind = _row_kind(body, position, properties)
        each.append(np.frombuffer(body, kind, 1, position)[0])
        position += kind.itemsize
    return {name: [row[name] for row in each] for name, *_ in properties}, position


def _row_kind(body: bytes, position: int, properties: list[_Property]) -> np.dtype:
    """One row, its lists as long as they are at this position."""
    fields: list[Any] = []
    for name, count, kind in properties:
        if count is not None:
            (length,) = np.frombuffer(body, count, 1, position + np.dtype(fields).itemsize)
            fields += [(f"{name}#", count), (name, kind, (int(length),))]
        else:
            fields.append((name, kind))
    return np.dtype(fields)
