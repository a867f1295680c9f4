"""The reconstructed object as glTF 2.0 in one binary file (.glb): no screen and no OpenGL are needed to write it.

Triangles, lines and loose points share their vertices, which are coloured by their deviation and also carry it as the
number `_STD_M`. A node turns the world's z up into glTF's y up.
"""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np

from viz.render.gltf import Y_UP, linear, packed
from viz.scene.colours import surface_scale
from viz.scene.scene import ObjectMesh

FLOAT, UINT = 5126, 5125
TRIANGLES, LINES, POINTS = 4, 1, 0
ARRAY_BUFFER, ELEMENT_BUFFER = 34962, 34963
SHAPES = {"SCALAR": 1, "VEC3": 3}
NAME = "reconstructed object"
UNKNOWN_STD_M = -1.0
"""Stands for NaN, which glTF does not allow."""


def glb_bytes(mesh: ObjectMesh) -> bytes:
    """The file's contents; lengths in metres."""
    made: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "vbaa reconstruct"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": "world", "matrix": Y_UP, "children": [1]}, {"name": NAME, "mesh": 0}],
        "materials": [
            {"doubleSided": True, "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.7}},
        ],
        "accessors": [],
        "bufferViews": [],
    }
    blob = bytearray()
    count = len(mesh.points_m)
    std = np.full(count, np.nan) if mesh.std_m is None else mesh.std_m
    scale = surface_scale(std)
    size = np.linalg.norm(mesh.normals, axis=1, keepdims=True)
    normals = np.where(size > 1e-6, mesh.normals / np.maximum(size, 1e-6), [0.0, 0.0, 1.0])
    attributes = {
        "POSITION": _add(made, blob, mesh.points_m, "VEC3"),
        "NORMAL": _add(made, blob, normals, "VEC3"),
        "COLOR_0": _add(made, blob, linear(scale.rgb / 255.0), "VEC3"),
        "_STD_M": _add(made, blob, np.where(np.isfinite(std), std, UNKNOWN_STD_M), "SCALAR"),
    }
    loose = np.setdiff1d(np.arange(count), np.union1d(mesh.triangles, mesh.lines))
    primitives = [
        {"attributes": attributes, "material": 0, "mode": mode, "indices": _add_indices(made, blob, indices)}
        for mode, indices in ((TRIANGLES, mesh.triangles), (LINES, mesh.lines), (POINTS, loose))
        if len(indices)
    ]
    legend = {"colour": scale.title, "unit": scale.unit, "low": scale.low, "high": scale.high}
    made["meshes"] = [{"name": NAME, "primitives": primitives, "extras": legend}]
    return packed(made, bytes(blob), ".glb")


def _add(made: dict[str, Any], blob: bytearray, values: np.ndarray, kind: str) -> int:
    """One float for each vertex, or three; the number of the accessor."""
    data = np.ascontiguousarray(values, "<f4")
    rows = data.reshape(len(data), -1)
    ends = {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
    return _accessor(made, blob, data, {"componentType": FLOAT, "type": kind, "count": len(data), **ends}, ARRAY_BUFFER)


def _add_indices(made: dict[str, Any], blob: bytearray, indices: np.ndarray) -> int:
    data = np.ascontiguousarray(indices, "<u4").ravel()
    return _accessor(made, blob, data, {"componentType": UINT, "type": "SCALAR", "count": len(data)}, ELEMENT_BUFFER)


def _accessor(made: dict[str, Any], blob: bytearray, data: np.ndarray, about: dict[str, Any], target: int) -> int:
    made["bufferViews"].append({"buffer": 0, "byteOffset": len(blob), "byteLength": data.nbytes, "target": target})
    blob += data.tobytes()
    made["accessors"].append({"bufferView": len(made["bufferViews"]) - 1, **about})
    return len(made["accessors"]) - 1


def read_glb(data: bytes) -> ObjectMesh | None:
    """The object in a file that `glb_bytes` made; None for anything else."""
    try:
        magic, version, length = struct.unpack_from("<4sII", data)
        text_size, text_kind = struct.unpack_from("<I4s", data, 12)
        made = json.loads(data[20 : 20 + text_size])
        size, kind = struct.unpack_from("<I4s", data, 20 + text_size)
        blob = data[28 + text_size : 28 + text_size + size]
        if (magic, version, text_kind, kind) != (b"glTF", 2, b"JSON", b"BIN\0") or length > len(data):
            return None
        (mesh,) = made["meshes"]
        if mesh["name"] != NAME:
            return None
        parts = {part["mode"]: part for part in mesh["primitives"]}
        names = next(iter(parts.values()))["attributes"]
        points, normals = (_values(made, blob, names[name]) for name in ("POSITION", "NORMAL"))
        std = _values(made, blob, names["_STD_M"])
        found = {mode: _values(made, blob, part["indices"]).astype(int) for mode, part in parts.items()}
        triangles = found.get(TRIANGLES, np.empty(0, int)).reshape(-1, 3)
        lines = found.get(LINES, np.empty(0, int)).reshape(-1, 2)
    except (struct.error, ValueError, KeyError, IndexError, TypeError, StopIteration, AttributeError):
        return None
    indices = np.concatenate([triangles.ravel(), lines.ravel()])
    if len(normals) != len(points) or len(std) != len(points) or (indices >= len(points)).any():
        return None
    if not np.isfinite(points).all() or not np.isfinite(normals).all():
        return None
    return ObjectMesh(points, normals, triangles, lines, np.where(std >= 0, std, np.nan))


def _values(made: dict[str, Any], blob: bytes, number: int) -> np.ndarray:
    """An accessor's numbers. Raises ValueError where the data end before them."""
    about = made["accessors"][number]
    view = made["bufferViews"][about["bufferView"]]
    kind = np.dtype({FLOAT: "<f4", UINT: "<u4"}[about["componentType"]])
    width = SHAPES[about["type"]]
    values = np.frombuffer(blob, kind, about["count"] * width, view["byteOffset"]).astype(float)
    return values.reshape(-1, width) if width > 1 else values
