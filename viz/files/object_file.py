"""The reconstructed object as a file: .vtp with everything that is known of it; .ply and .glb with its shape, coloured
by its uncertainty."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyvista as pv
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkObject
from vtkmodules.vtkIOPLY import vtkPLYReader
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader, vtkXMLPolyDataWriter

from estimator.object.surface import Surface
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_bytes, replacing
from viz.scene.scene import ObjectMesh

from .glb import glb_bytes, read_glb
from .ply import is_whole, ply_bytes, read_ply

SUFFIXES = (".vtp", ".ply", ".glb")
REMEDY = "write it again with vbaa reconstruct"


def check_suffix(path: Path) -> None:
    """Raises InputError for a name that is neither .vtp, .ply nor .glb."""
    if path.suffix.lower() not in SUFFIXES:
        raise InputError("is not a .vtp, .ply or .glb", where=path, remedy="the suffix chooses the format")


def to_mesh(surface: Surface) -> pv.PolyData:
    """Triangles, lines, and loose points as vertices, with the point arrays Normals, std_m, std_across_m and patch.

    What is known of each contact, of the stiffness, and the notes, are field arrays: contact_*, compliance_*, notes.
    """
    used = np.union1d(surface.triangles, surface.lines)
    loose = np.setdiff1d(np.arange(len(surface.points_m)), used)
    mesh = pv.PolyData(
        surface.points_m,
        verts=_cells(loose[:, None]),
        lines=_cells(surface.lines),
        faces=_cells(surface.triangles),
    )
    mesh.point_data["Normals"] = surface.normals.astype(np.float32)
    for name in ("std_m", "std_across_m", "patch"):
        mesh.point_data[name] = getattr(surface, name)
    of_contacts = {
        "contact_point_m": surface.touched_m,
        "contact_normal": surface.touched_normal,
        "contact_normal_covariance_rad2": surface.touched_normal_covariance.reshape(-1, 9),
        "contact_std_m": surface.touched_std_m,
        "contact_force_N": surface.touched_force_N,
        "contact_frame": surface.touched_frame,
        "contact_patch": surface.touched_patch,
        "contact_left_out": surface.outlier.astype(np.uint8),
    }
    soft = surface.compliance
    of_object = {
        "compliance_m_N": np.array([soft.compliance_m_N, soft.std_m_N]),
        "stiffness_interval_N_m": soft.interval_N_m,
        "stiffness_in_words": np.array([soft.reason]),
    }
    for name, values in {**of_contacts, **of_object}.items():
        mesh.field_data[name] = values
    if surface.notes:
        mesh.field_data["notes"] = np.array(surface.notes)
    return mesh


def _cells(indices: np.ndarray) -> np.ndarray | None:
    """VTK's cell array of equal cells (C, K); None for none."""
    size = indices.shape[1]
    return np.column_stack([np.full(len(indices), size), indices]).ravel() if len(indices) else None


def write_object(surface: Surface, path: Path, *, force: bool = False) -> None:
    """Write the surface, whole or not at all, in the format of the suffix; all in metres, world frame.

    Raises InputError for another suffix, or when the file exists and `force` is off.
    """
    check_suffix(path)
    suffix, mesh = path.suffix.lower(), ObjectMesh.of(surface)
    with replacing(path, force) as temporary:
        if suffix == ".vtp":
            temporary.write_text(vtp_text(to_mesh(surface)), encoding="utf-8")
        else:
            temporary.write_bytes(ply_bytes(mesh) if suffix == ".ply" else glb_bytes(mesh))


def vtp_text(mesh: pv.PolyData) -> str:
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
    check_suffix(path)
    data = read_bytes(path)
    suffix = path.suffix.lower()
    ours = {".glb": read_glb, ".ply": read_ply}.get(suffix, lambda _: None)(data)
    if ours is not None and len(ours.points_m):
        return ours
    if suffix == ".glb":
        raise InputError("holds no mesh of ours", where=path, remedy=REMEDY)
    if suffix == ".vtp":
        mesh = _read(vtkXMLPolyDataReader(), path)
    else:
        mesh = _read(vtkPLYReader(), path) if is_whole(data) else pv.PolyData()
    if not mesh.n_points or not np.isfinite(mesh.points).all() or not _cells_have_points(mesh):
        raise InputError("holds no mesh", where=path, remedy=REMEDY)
    faces = mesh.triangulate().regular_faces if mesh.faces.size else np.empty((0, 3), int)
    if "Normals" not in mesh.point_data and len(faces):
        mesh = mesh.compute_normals(cell_normals=False, split_vertices=False, consistent_normals=False)
    normals = mesh.point_data["Normals"] if "Normals" in mesh.point_data else np.zeros((mesh.n_points, 3))
    segments = [np.stack([line[:-1], line[1:]], axis=1) for line in _split(np.asarray(mesh.lines))]
    std = np.asarray(mesh.point_data["std_m"], float) if "std_m" in mesh.point_data else None
    return ObjectMesh(
        np.asarray(mesh.points, float),
        np.asarray(normals, float),
        np.asarray(faces, int).reshape(-1, 3),
        np.concatenate([np.empty((0, 2), int), *segments]),
        std if std is not None and std.shape == (mesh.n_points,) else None,
    )


def _cells_have_points(mesh: pv.PolyData) -> bool:
    """Whether every cell's indices are of points that there are; VTK would follow them anywhere."""
    kinds = (mesh.GetVerts(), mesh.GetLines(), mesh.GetPolys(), mesh.GetStrips())
    indices = np.concatenate([vtk_to_numpy(cells.GetConnectivityArray()) for cells in kinds])
    return bool(((indices >= 0) & (indices < mesh.n_points)).all())


def _split(cells: np.ndarray) -> list[np.ndarray]:
    """The point indices of each cell in VTK's flat cell array."""
    parts, start = [], 0
    while start < len(cells):
        parts.append(cells[start + 1 : start + 1 + cells[start]])
        start += cells[start] + 1
    return parts


def _read(reader: vtkXMLPolyDataReader | vtkPLYReader, path: Path) -> pv.PolyData:
    """VTK's mesh, without the pages that it prints about a file it cannot read: an empty mesh says the same."""
    reader.SetFileName(str(path))
    before = vtkObject.GetGlobalWarningDisplay()
    vtkObject.SetGlobalWarningDisplay(0)
    try:
        reader.Update()
    finally:
        vtkObject.SetGlobalWarningDisplay(before)
    return pv.wrap(reader.GetOutput())
