"""A .vtp as VTK reads it. `object_file` runs this in a process of its own: a forged file can crash or hang VTK."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkObject
from vtkmodules.vtkFiltersCore import vtkTriangleFilter
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader


def read_vtp(path: Path) -> dict[str, np.ndarray]:
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
