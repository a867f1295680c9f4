"""The reconstructed object as a file: .vtp with everything that is known of it; .ply and .glb with its shape, coloured
by its uncertainty."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkObject
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader, vtkXMLPolyDataWriter

from estimator.object.surface import Surface
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_bytes, replacing
from viz.scene.scene import ObjectMesh

from .glb import glb_bytes, read_glb
from .outputs import refuse_output
from .ply import ply_bytes, read_ply

SUFFIXES = (".vtp", ".ply", ".glb")
_UNREADABLE = (struct.error, ValueError, KeyError, IndexError, TypeError, StopIteration, AttributeError)


def _to_mesh(surface: Surface) -> pv.PolyData:
    """Triangles, lines, and loose points as vertices, with the point arrays Normals, std_m, std_across_m and patch.

    What is known of each contact, of the stiffness, and the notes, are field arrays: contact_*, compliance_*, notes.
    """
    used = np.union1d(surface.triangles, surface.lines)
    loose = np.setdiff1d(np.arange(len(surface.points_m)), used)
    vertices, lines, faces = map(_cells, (loose[:, None], surface.lines, surface.triangles))
    mesh = pv.PolyData(surface.points_m, verts=vertices, lines=lines, faces=faces)
    mesh.point_data["Normals"] = surface.normals.astype(np.float32)
    for name in ("std_m", "std_across_m", "patch"):
        mesh.point_data[name] = getattr(surface, name)
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
        mesh.field_data[name] = values
    return mesh


def _cells(indices: np.ndarray) -> np.ndarray | None:
    """VTK's cell array of equal cells (C, K); None for none."""
    size = indices.shape[1]
    return np.column_stack([np.full(len(indices), size), indices]).ravel() if len(indices) else None


def write_object(surface: Surface, path: Path, *, force: bool = False) -> None:
    """Write the surface, whole or not at all, in the format of the suffix; all in metres, world frame.

    Raises InputError for another suffix, or when the file exists and `force` is off.
    """
    refuse_output(path, SUFFIXES, force)
    suffix, mesh = path.suffix.lower(), ObjectMesh.of(surface)
    with replacing(path, force) as temporary:
        if suffix == ".vtp":
            temporary.write_text(_vtp_text(_to_mesh(surface)), encoding="utf-8")
        else:
            temporary.write_bytes(ply_bytes(mesh) if suffix == ".ply" else glb_bytes(mesh))


def _vtp_text(mesh: pv.PolyData) -> str:
    """The file's contents. VTK's own writing says nothing when the disk is full, and leaves half a file."""
    writer = vtkXMLPolyDataWriter()
    writer.SetInputData(mesh)
    writer.SetDataModeToBinary()
    writer.WriteToOutputStringOn()
    writer.Write()
    return str(writer.GetOutputString())


def read_object(path: Path) -> ObjectMesh:
    """Read back what is drawn of a .vtp or .ply, ours or another's, or of a .glb of ours.

    Raises InputError when there is nothing in it.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError("is not a .vtp, .ply or .glb", where=path, remedy="the suffix chooses the format")
    data = read_bytes(path)
    try:
        return _checked(**(_read_vtp(path) if suffix == ".vtp" else (read_ply if suffix == ".ply" else read_glb)(data)))
    except _UNREADABLE:
        what = f"holds no mesh{' of ours' if suffix == '.glb' else ''}"
        raise InputError(what, where=path, remedy="write it again with vbaa reconstruct") from None


def _checked(
    points_m: np.ndarray,
    triangles: np.ndarray,
    lines: np.ndarray,
    normals: np.ndarray | None,
    std_m: np.ndarray | None,
) -> ObjectMesh:
    """The mesh; normals of its triangles where it has none. Raises ValueError for points that are not there."""
    indices = np.concatenate([triangles.ravel(), lines.ravel()])
    if not len(points_m) or not np.isfinite(points_m).all() or not ((indices >= 0) & (indices < len(points_m))).all():
        raise ValueError
    triangles, lines = triangles.astype(int), lines.astype(int)
    if normals is None:
        mesh = pv.PolyData.from_regular_faces(points_m, triangles)
        mesh = mesh.compute_normals(cell_normals=False, split_vertices=False, consistent_normals=False)
        normals = mesh.point_data["Normals"] if len(triangles) else np.zeros_like(points_m)
    normals = np.asarray(normals, float)
    if normals.shape != points_m.shape or not np.isfinite(normals).all():
        raise ValueError
    if std_m is not None and (np.shape(std_m) != (len(points_m),) or np.isnan(std_m).all()):
        std_m = None
    return ObjectMesh(points_m, normals, triangles, lines, None if std_m is None else np.asarray(std_m, float))


def _read_vtp(path: Path) -> dict[str, Any]:
    """What VTK reads, without the pages that it prints about a file that it cannot read: that is an empty mesh."""
    reader = vtkXMLPolyDataReader()
    reader.SetFileName(str(path))
    before = vtkObject.GetGlobalWarningDisplay()
    vtkObject.SetGlobalWarningDisplay(0)
    try:
        reader.Update()
    finally:
        vtkObject.SetGlobalWarningDisplay(before)
    mesh = pv.wrap(reader.GetOutput())
    # VTK would follow indices of points that there are not anywhere
    kinds = (mesh.GetVerts(), mesh.GetLines(), mesh.GetPolys(), mesh.GetStrips())
    indices = np.concatenate([vtk_to_numpy(cells.GetConnectivityArray()) for cells in kinds])
    if not ((indices >= 0) & (indices < mesh.n_points)).all():
        raise ValueError
    lines = mesh.GetLines()
    starts, ends = vtk_to_numpy(lines.GetOffsetsArray()), vtk_to_numpy(lines.GetConnectivityArray())
    segments = np.delete(np.stack([ends[:-1], ends[1:]], axis=1), starts[1:-1] - 1, axis=0)
    return {
        "points_m": np.asarray(mesh.points, float),
        "triangles": mesh.triangulate().regular_faces if mesh.faces.size else np.empty((0, 3), int),
        "lines": segments,
        "normals": mesh.point_data.get("Normals"),
        "std_m": np.asarray(mesh.point_data["std_m"], float) if "std_m" in mesh.point_data else None,
    }
