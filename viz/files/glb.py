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

_NAME = "reconstructed object"
_TRIANGLES, _LINES, _POINTS = 4, 1, 0
_TYPES = {5126: "<f4", 5125: "<u4"}
_UNKNOWN_STD_M = -1.0
"""Stands for NaN, which glTF does not allow."""


def glb_bytes(mesh: ObjectMesh) -> bytes:
    """The file's contents; lengths in metres."""
    made: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "vbaa reconstruct"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": "world", "matrix": Y_UP, "children": [1]}, {"name": _NAME, "mesh": 0}],
        "materials": [{"doubleSided": True, "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.7}}],
        "accessors": [],
        "bufferViews": [],
    }
    blob = bytearray()
    count = len(mesh.points_m)
    std = np.full(count, np.nan) if mesh.std_m is None else mesh.std_m
    scale = surface_scale(std)
    size = np.linalg.norm(mesh.normals, axis=1, keepdims=True)
    attributes = {
        "POSITION": mesh.points_m,
        "NORMAL": np.where(size > 1e-6, mesh.normals / np.maximum(size, 1e-6), [0.0, 0.0, 1.0]),
        "COLOR_0": linear(scale.rgb / 255.0),
        "_STD_M": np.where(np.isfinite(std), std, _UNKNOWN_STD_M),
    }
    numbers = {name: _add(made, blob, np.asarray(values, "<f4"), 5126) for name, values in attributes.items()}
    loose = np.setdiff1d(np.arange(count), np.union1d(mesh.triangles, mesh.lines))
    primitives = []
    for mode, indices in ((_TRIANGLES, mesh.triangles), (_LINES, mesh.lines), (_POINTS, loose)):
        if len(indices):
            added = _add(made, blob, indices.astype("<u4").ravel(), 5125)
            primitives.append({"attributes": numbers, "material": 0, "mode": mode, "indices": added})
    legend = {"colour": scale.title, "unit": scale.unit, "low": scale.ticks[0], "high": scale.ticks[-1]}
    made["meshes"] = [{"name": _NAME, "primitives": primitives, "extras": legend}]
    return packed(made, bytes(blob), ".glb")


def _add(made: dict[str, Any], blob: bytearray, data: np.ndarray, kind: int) -> int:
    """Numbers (N,) or (N, 3) into the buffer; the number of their accessor."""
    rows = data.reshape(len(data), -1)
    about = {"componentType": kind, "type": "SCALAR" if data.ndim == 1 else "VEC3", "count": len(data)}
    ends = {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
    target = 34962 if kind == 5126 else 34963  # vertices, indices
    view = {"buffer": 0, "byteOffset": len(blob), "byteLength": data.nbytes, "target": target}
    made["bufferViews"].append(view)
    made["accessors"].append({"bufferView": len(made["accessors"]), **about, **ends})
    blob += data.tobytes()
    return len(made["accessors"]) - 1


def read_glb(data: bytes) -> dict[str, Any]:
    """Points, triangles, lines, normals and deviations in a file that `glb_bytes` made.

    Raises struct.error, ValueError, KeyError, IndexError, TypeError, StopIteration or AttributeError for anything else.
    """
    magic, version, length = struct.unpack_from("<4sII", data)
    text_size, text_kind = struct.unpack_from("<I4s", data, 12)
    made = json.loads(data[20 : 20 + text_size])
    size, kind = struct.unpack_from("<I4s", data, 20 + text_size)
    blob = data[28 + text_size : 28 + text_size + size]
    (mesh,) = made["meshes"]
    expected = (b"glTF", 2, b"JSON", b"BIN\0", _NAME)
    if (magic, version, text_kind, kind, mesh["name"]) != expected or length > len(data):
        raise ValueError
    parts = {part["mode"]: part for part in mesh["primitives"]}
    names = next(iter(parts.values()))["attributes"]
    points, normals, std = (_values(made, blob, names[name]) for name in ("POSITION", "NORMAL", "_STD_M"))
    triangles, lines = (
        _values(made, blob, parts[mode]["indices"]).reshape(-1, corners) if mode in parts else np.empty((0, corners))
        for mode, corners in ((_TRIANGLES, 3), (_LINES, 2))
    )
    std = np.where(std >= 0, std, np.nan)
    return {"points_m": points, "triangles": triangles, "lines": lines, "normals": normals, "std_m": std}


def _values(made: dict[str, Any], blob: bytes, number: int) -> np.ndarray:
    """An accessor's numbers. Raises ValueError where the data end before them."""
    about = made["accessors"][number]
    start, width = made["bufferViews"][about["bufferView"]]["byteOffset"], {"SCALAR": 1, "VEC3": 3}[about["type"]]
    values = np.frombuffer(blob, _TYPES[about["componentType"]], about["count"] * width, start).astype(float)
    return values.reshape(-1, width) if width > 1 else values
