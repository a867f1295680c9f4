"""The reconstructed object as a file: .vtp with everything known about it; .ply and .glb with its shape, coloured by
its uncertainty. Neither screen nor OpenGL is needed.

.ply is read and written by our own code: VTK's writer has neither normals with colours nor lines, and its reader
crashes on a truncated file. In .glb, glTF 2.0 in one binary file, vertices also have their standard deviation as the
attribute `_STD_M`, and a node rotates the world's z up into glTF's y up.
"""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkAbstractArray, vtkObject, vtkPoints, vtkStringArray
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkFiltersCore import vtkTriangleFilter
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader, vtkXMLPolyDataWriter

from estimator.object.surface import Surface
from vbaa_calib.convert.child import read_in_child
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_bytes, replacing
from viz.scene.readable import surface_scale
from viz.scene.scene import ObjectMesh

from .outputs import refuse_output


def _read_vtp(path: Path) -> dict[str, np.ndarray]:
    """points_m (N, 3), triangles (T, 3), lines (L, 2), and normals (N, 3) and std_m (N,) where the file has them.

    Polygons are cut into triangles. Raises ValueError for cells that refer to missing points; a file that VTK cannot
    read gives an empty mesh.
    """
    reader = vtkXMLPolyDataReader()
    reader.SetFileName(str(path))
    vtkObject.GlobalWarningDisplayOff()  # pages about a file that it cannot read
    reader.Update()
    mesh = reader.GetOutput()
    kinds = (mesh.GetVerts(), mesh.GetLines(), mesh.GetPolys(), mesh.GetStrips())
    indices = np.concatenate([vtk_to_numpy(cells.GetConnectivityArray()) for cells in kinds])
    if not ((indices >= 0) & (indices < mesh.GetNumberOfPoints())).all():
        raise ValueError("cells of points that there are not")
    if mesh.GetPoints() is None:
        raise ValueError("no points")
    lines = mesh.GetLines()
    starts, ends = vtk_to_numpy(lines.GetOffsetsArray()), vtk_to_numpy(lines.GetConnectivityArray())
    cut = vtkTriangleFilter()
    cut.SetInputData(mesh)
    cut.PassVertsOff()
    cut.PassLinesOff()
    cut.Update()
    found = {
        "points_m": vtk_to_numpy(mesh.GetPoints().GetData()).astype(float),
        "triangles": vtk_to_numpy(cut.GetOutput().GetPolys().GetConnectivityArray()).reshape(-1, 3),
        "lines": np.delete(np.stack([ends[:-1], ends[1:]], axis=1), starts[1:-1] - 1, axis=0),
    }
    for name, key in (("Normals", "normals"), ("std_m", "std_m")):
        array = mesh.GetPointData().GetArray(name)
        if array is not None:
            found[key] = vtk_to_numpy(array)
    return found


SUFFIXES = (".vtp", ".ply", ".glb")


def write_object(surface: Surface, path: Path, *, force: bool = False) -> None:
    """Write the surface, completely or not at all, in the format of the suffix; all in metres, world frame.

    Raises InputError for another suffix, or when the file exists and `force` is off.
    """
    refuse_output(path, SUFFIXES, force)
    suffix, mesh = path.suffix.lower(), ObjectMesh.of(surface)
    with replacing(path, force) as temporary:
        if suffix == ".vtp":
            # VTK's own writing says nothing when the disk is full, and leaves half a file
            writer = vtkXMLPolyDataWriter()
            writer.SetInputData(_to_mesh(surface))
            writer.SetDataModeToBinary()
            writer.WriteToOutputStringOn()
            writer.Write()
            temporary.write_text(str(writer.GetOutputString()), encoding="utf-8")
        else:
            temporary.write_bytes(_ply_bytes(mesh) if suffix == ".ply" else _glb_bytes(mesh))


def read_object(path: Path) -> ObjectMesh:
    """Read the drawn parts of a .vtp or .ply, ours or another's, or of a .glb of ours.

    Raises InputError when there is nothing in it.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError("is not a .vtp, .ply or .glb", where=path, remedy="the suffix chooses the format")
    data = read_bytes(path)
    try:
        with np.errstate(invalid="raise", over="raise"):
            if suffix == ".vtp":
                found = read_in_child(_read_vtp, path)
            else:
                found = _read_ply(data) if suffix == ".ply" else _read_glb(data)
            return _checked(**found)
    except (
        struct.error,
        ArithmeticError,
        ValueError,
        KeyError,
        IndexError,
        TypeError,
        StopIteration,
        RecursionError,
        AttributeError,
    ):
        what = f"holds no mesh{' of ours' if suffix == '.glb' else ''}"
        raise InputError(what, where=path, remedy="write it again with vbaa reconstruct") from None


def _vertex_normals(points_m: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(N, 3) unit normals: area-weighted means over each point's triangles; zero without any."""
    first, second, third = points_m[triangles].transpose(1, 0, 2)
    across, total = np.cross(second - first, third - first), np.zeros_like(points_m)
    for corner in triangles.T:
        np.add.at(total, corner, across)
    size = np.linalg.norm(total, axis=1, keepdims=True)
    return np.divide(total, size, out=np.zeros_like(total), where=size > 0)


def _checked(
    points_m: np.ndarray,
    triangles: np.ndarray,
    lines: np.ndarray,
    normals: np.ndarray | None = None,
    std_m: np.ndarray | None = None,
) -> ObjectMesh:
    """The mesh, with normals computed where the file has none. Raises ValueError for indices of missing points."""
    indices = np.concatenate([triangles.ravel(), lines.ravel()])
    # m: no antenna touches anything that far off
    near = len(points_m) and np.abs(points_m).max() < 1e6  # false for NaN, too
    if not near or not ((indices >= 0) & (indices < len(points_m))).all():
        raise ValueError
    triangles, lines = triangles.astype(int), lines.astype(int)
    if normals is None:
        normals = _vertex_normals(points_m, triangles)
    normals = np.asarray(normals, float)
    if normals.shape != points_m.shape or not np.isfinite(normals).all():
        raise ValueError
    if std_m is None or np.shape(std_m) != (len(points_m),):
        std_m = np.full(len(points_m), np.nan)
    return ObjectMesh(points_m, normals, triangles, lines, np.asarray(std_m, float))


# --- .vtp


def _to_mesh(surface: Surface) -> vtkPolyData:
    """Triangles, lines, and isolated points as vertices, with the point arrays Normals, std_m, std_across_m and
    patch.

    What is known of each contact, of the stiffness, and the notes, are field arrays: contact_*, compliance_*, notes.
    """
    used = np.union1d(surface.triangles, surface.lines)
    loose = np.setdiff1d(np.arange(len(surface.points_m)), used)
    mesh, points = vtkPolyData(), vtkPoints()
    points.SetData(numpy_to_vtk(np.asarray(surface.points_m, float), deep=True))
    mesh.SetPoints(points)
    mesh.SetVerts(_cells(loose[:, None]))
    mesh.SetLines(_cells(surface.lines))
    mesh.SetPolys(_cells(surface.triangles))
    known = mesh.GetPointData()
    known.AddArray(_array("Normals", surface.normals.astype(np.float32)))
    known.SetActiveScalars("Normals")
    for name in ("std_m", "std_across_m", "patch"):
        known.AddArray(_array(name, getattr(surface, name)))
    soft = surface.compliance
    fields = {
        "contact_point_m": surface.touched_m,
        "contact_normal": surface.touched_normal,
        "contact_normal_covariance_rad2": surface.touched_normal_covariance.reshape(-1, 9),
        "contact_std_m": surface.touched_std_m,
        "contact_force_N": surface.touched_force_N,
        "contact_frame": surface.touched_frame,
        "contact_patch": surface.touched_patch,
        "contact_left_out": surface.outlier.astype(np.uint8),
        "compliance_m_N": np.array([soft.compliance_m_N, soft.std_m_N]),
        "stiffness_interval_N_m": soft.interval_N_m,
        "stiffness_in_words": np.array([soft.reason]),
    }
    fields |= {"notes": np.array(surface.notes)} if surface.notes else {}
    for name, values in fields.items():
        mesh.GetFieldData().AddArray(_array(name, values))
    return mesh


def _array(name: str, values: np.ndarray) -> vtkAbstractArray:
    """Numbers (N,) or (N, K), or words (N,), as VTK's array of this name."""
    made: vtkAbstractArray
    if values.dtype.kind == "U":
        made = vtkStringArray()
        for word in values:
            made.InsertNextValue(str(word))
    else:
        made = numpy_to_vtk(np.ascontiguousarray(values), deep=True)
    made.SetName(name)
    return made


def _cells(indices: np.ndarray) -> vtkCellArray:
    """VTK's array of equal cells (C, K)."""
    count, size = indices.shape
    made = vtkCellArray()
    made.SetData(*(numpy_to_vtk(one, deep=True) for one in (size * np.arange(count + 1), indices.ravel().astype(int))))
    return made


# --- .ply


_PLY_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
}
_Property = tuple[str, str | None, str]
"""Name, type of a list's length (None for a single number), type of the number or numbers."""


def _ply_bytes(mesh: ObjectMesh) -> bytes:
    """A little-endian .ply: vertices with normals, deviation std_m and a colour by it; triangles; lines as edges."""
    columns = [*zip(("x", "y", "z"), mesh.points_m.T, ["double"] * 3, strict=True)]
    columns += zip(("nx", "ny", "nz", "std_m"), [*mesh.normals.T, mesh.std_m], ["float"] * 4, strict=True)
    columns += zip(("red", "green", "blue"), surface_scale(mesh.std_m).rgb.T, ["uchar"] * 3, strict=True)
    vertices = np.zeros(len(mesh.std_m), [(name, f"<{_PLY_TYPES[word]}") for name, _, word in columns])
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


def _read_ply(data: bytes) -> dict[str, Any]:
    """Points, triangles, lines, normals and deviations, None for those it lacks; polygons are cut into triangles.

    Raises KeyError, IndexError, ValueError or StopIteration where the header makes no sense or rows are missing.
    """
    header = re.match(rb"(?s)ply\r?\n(.*?)\bend_header\r?\n", data)
    if header is None:
        raise ValueError
    lines = [line.split() for line in header[1].decode("ascii").splitlines()]
    orders = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
    order = next(orders[words[1]] for words in lines if words[:1] == ["format"])
    # numbers in words are read as if they were doubles
    body = data[header.end() :] if order else np.array(data[header.end() :].split(), float).tobytes()
    found, position = {}, 0
    properties: list[_Property] = []
    elements: dict[str, tuple[int, list[_Property]]] = {}  # what the header announces
    for words in lines:
        if words[:1] == ["element"]:
            properties = []
            elements[words[1]] = int(words[2]), properties
        elif words[:1] == ["property"]:
            kinds = [order + _PLY_TYPES[word] if order else "<f8" for word in words[1:-1] if word != "list"]
            properties.append((words[-1], kinds[0] if words[1] == "list" else None, kinds[-1]))
    for name, (rows, properties) in elements.items():
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


def _rows(body: bytes, position: int, rows: int, properties: list[_Property]) -> tuple[dict[str, Any], int]:
    """The values of each property, (rows,), (rows, K) or a list of lists, and the position after them. Raises
    ValueError."""
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
    """The type of one row, with lists as long as at this position."""
    fields: list[Any] = []
    for name, count, kind in properties:
        if count is not None:
            (length,) = np.frombuffer(body, count, 1, position + np.dtype(fields).itemsize)
            fields += [(f"{name}#", count), (name, kind, (int(length),))]
        else:
            fields.append((name, kind))
    return np.dtype(fields)


# --- .glb


_NAME = "reconstructed object"


def _glb_bytes(mesh: ObjectMesh) -> bytes:
    """The content of a .glb; lengths in metres."""
    from viz.render.gltf import Y_UP, linear, packed  # with pyvista, which is slow to load

    made: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "vbaa reconstruct"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": "world", "matrix": Y_UP, "children": [1]}, {"name": _NAME, "mesh": 0}],
        "materials": [{"doubleSided": True, "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.7}}],
        "accessors": [],
        "bufferViews": [],
    }
    blob, std = bytearray(), mesh.std_m
    scale = surface_scale(std)
    size = np.linalg.norm(mesh.normals, axis=1, keepdims=True)
    # -1 stands for NaN, which glTF does not allow
    attributes = {
        "POSITION": mesh.points_m,
        "NORMAL": np.where(size > 1e-6, mesh.normals / np.maximum(size, 1e-6), [0.0, 0.0, 1.0]),
        "COLOR_0": linear(scale.rgb / 255.0),
        "_STD_M": np.where(np.isfinite(std), std, -1.0),
    }
    numbers = {name: _add(made, blob, np.asarray(values, "<f4"), 5126) for name, values in attributes.items()}
    loose = np.setdiff1d(np.arange(len(std)), np.union1d(mesh.triangles, mesh.lines))
    primitives = []
    # modes of glTF: triangles 4, lines 1, points 0
    for mode, indices in ((4, mesh.triangles), (1, mesh.lines), (0, loose)):
        if len(indices):
            added = _add(made, blob, indices.astype("<u4").ravel(), 5125)
            primitives.append({"attributes": numbers, "material": 0, "mode": mode, "indices": added})
    legend = {"colour": scale.title, "unit": scale.unit, "low": scale.ticks[0], "high": scale.ticks[-1]}
    made["meshes"] = [{"name": _NAME, "primitives": primitives, "extras": legend}]
    return packed(made, bytes(blob), ".glb")


def _add(made: dict[str, Any], blob: bytearray, data: np.ndarray, kind: int) -> int:
    """Append numbers (N,) or (N, 3) to the buffer; returns the index of their accessor."""
    rows = data.reshape(len(data), -1)
    about = {"componentType": kind, "type": "SCALAR" if data.ndim == 1 else "VEC3", "count": len(data)}
    ends = {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
    target = 34962 if kind == 5126 else 34963  # vertices, indices
    view = {"buffer": 0, "byteOffset": len(blob), "byteLength": data.nbytes, "target": target}
    made["bufferViews"].append(view)
    made["accessors"].append({"bufferView": len(made["accessors"]), **about, **ends})
    blob += data.tobytes()
    return len(made["accessors"]) - 1


def _read_glb(data: bytes) -> dict[str, Any]:
    """Points, triangles, lines, normals and deviations in a file that `_glb_bytes` made.

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
        for mode, corners in ((4, 3), (1, 2))
    )
    std = np.where(std >= 0, std, np.nan)
    return {"points_m": points, "triangles": triangles, "lines": lines, "normals": normals, "std_m": std}


def _values(made: dict[str, Any], blob: bytes, number: int) -> np.ndarray:
    """An accessor's numbers. Raises ValueError where the data end before them."""
    about = made["accessors"][number]
    start, width = made["bufferViews"][about["bufferView"]]["byteOffset"], {"SCALAR": 1, "VEC3": 3}[about["type"]]
    types = {5126: "<f4", 5125: "<u4"}
    values = np.frombuffer(blob, types[about["componentType"]], about["count"] * width, start).astype(float)
    return values.reshape(-1, width) if width > 1 else values
