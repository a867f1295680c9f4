"""The reconstructed object as a file: .vtp with everything known about it; .ply and .glb with its shape, coloured by
its uncertainty. Neither screen nor OpenGL is needed.

.ply is written by our own code: VTK's writer has neither normals with colours nor lines. In .glb, glTF 2.0 in one
binary file, vertices also have their standard deviation as the attribute `_STD_M`, and a node rotates the world's z up
into glTF's y up.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import vtkAbstractArray, vtkPoints, vtkStringArray
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

from estimator.object.surface import Surface
from vbaa_calib.core.files import replacing
from viz.scene.readable import surface_scale
from viz.scene.scene import ObjectMesh

from .outputs import refuse_output

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


def _ply_bytes(mesh: ObjectMesh) -> bytes:
    """A little-endian .ply: vertices with normals, deviation std_m and a colour by it; triangles; lines as edges."""
    types = {"double": "<f8", "float": "<f4", "uchar": "u1"}
    columns = [*zip(("x", "y", "z"), mesh.points_m.T, ["double"] * 3, strict=True)]
    columns += zip(("nx", "ny", "nz", "std_m"), [*mesh.normals.T, mesh.std_m], ["float"] * 4, strict=True)
    columns += zip(("red", "green", "blue"), surface_scale(mesh.std_m).rgb.T, ["uchar"] * 3, strict=True)
    vertices = np.zeros(len(mesh.std_m), [(name, types[word]) for name, _, word in columns])
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
