"""glTF 2.0 of a scene: as VTK writes it, with our names and frame; .gltf is one text file, .glb one binary file."""

from __future__ import annotations

import base64
import json
import struct
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv
from vtkmodules.vtkIOExport import vtkGLTFExporter

from vbaa_calib.core.files import replacing
from viz.parts.assemble import all_parts
from viz.scene.scene import Scene

from .stage import Stage, quiet

Y_UP = [1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1]
"""glTF's y is up, the world's z: a turn about x by −90°, by columns."""


@quiet()
def write_gltf(scene: Scene, path: Path, *, mode: str = "force", force: bool = False) -> None:
    """Write a .gltf or .glb with all contacts, and the rig at the greatest force; y is up. OpenGL is not needed.

    Raises InputError when the file exists and `force` is off.
    """
    stage = Stage(scene, [part for part in all_parts(scene) if part.name != "now"], mode)
    stage.look_at_all()
    visible = [part.name for part, actor in zip(stage.parts, stage.actors, strict=True) if actor.visibility]
    made = packed(*_document(stage.plotter, visible), path.suffix.lower())
    stage.plotter.close()
    with replacing(path, force) as temporary:
        temporary.write_bytes(made)


def _document(plotter: pv.Plotter, names: list[str]) -> tuple[dict[str, Any], bytes]:
    """The active view as a glTF document and its one buffer; `names` are those of the actors, in order."""
    for actor in plotter.actors.values():
        mesh = actor.mapper.dataset
        # by this name the exporter looks for them
        mesh.point_data["NORMAL"] = mesh.point_data["Normals"]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.gltf"
        exporter = vtkGLTFExporter()
        exporter.SetFileName(str(path))
        exporter.SetRenderWindow(plotter.render_window)
        exporter.InlineDataOn()
        exporter.SaveNormalOn()
        exporter.Write()
        made = json.loads(path.read_text(encoding="utf-8"))
    # VTK writes a buffer per array; a .glb has only one
    blob, starts = bytearray(), []
    for buffer in made["buffers"]:
        starts.append(len(blob))
        blob += base64.b64decode(buffer["uri"].partition(",")[2])
        blob += b"\0" * (-len(blob) % 4)
    for view in made["bufferViews"]:
        view["byteOffset"] = view.get("byteOffset", 0) + starts[view["buffer"]]
        view["buffer"] = 0
    # the colours of vertices from sRGB, as screens and VTK have them, to linear light
    for primitive in (each for mesh in made["meshes"] for each in mesh["primitives"]):
        if "COLOR_0" in primitive["attributes"]:
            accessor = made["accessors"][primitive["attributes"]["COLOR_0"]]
            offset = made["bufferViews"][accessor["bufferView"]]["byteOffset"]
            colours = np.frombuffer(blob, np.uint8, 4 * accessor["count"], offset).reshape(-1, 4)
            colours[:, :3] = (255 * linear(colours[:, :3] / 255)).round()
    meshes = [node for node in made["nodes"] if "mesh" in node]
    for node, name in zip(meshes, names, strict=True):
        node["name"] = name
    for material in made["materials"]:
        material["doubleSided"] = True
        surface = material["pbrMetallicRoughness"]
        surface |= {"metallicFactor": 0.0, "roughnessFactor": 0.7}
        red, green, blue, alpha = surface.get("baseColorFactor", (1.0, 1.0, 1.0, 1.0))
        surface["baseColorFactor"] = [*linear(np.array([red, green, blue])).tolist(), alpha]
        if alpha < 1:
            material["alphaMode"] = "BLEND"
    for scene in made["scenes"]:
        made["nodes"].append({"name": "world", "matrix": Y_UP, "children": scene["nodes"]})
        scene["nodes"] = [len(made["nodes"]) - 1]
    return made, bytes(blob)


def packed(made: dict[str, Any], blob: bytes, suffix: str) -> bytes:
    """The file's content, by its suffix."""
    if suffix == ".gltf":
        uri = "data:application/octet-stream;base64," + base64.b64encode(blob).decode()
        return json.dumps(made | {"buffers": [{"byteLength": len(blob), "uri": uri}]}).encode()
    text = json.dumps(made | {"buffers": [{"byteLength": len(blob)}]}).encode()
    text += b" " * (-len(text) % 4)
    blob += b"\0" * (-len(blob) % 4)
    head = struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + len(blob))
    return head + struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(blob), b"BIN\0") + blob


def linear(rgb: np.ndarray) -> np.ndarray:
    """sRGB (..., 3) from 0 to 1 converted to linear light, as in glTF's factors and vertex colours."""
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
