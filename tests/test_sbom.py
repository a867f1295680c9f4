"""The bill of materials names what is needed, each once, with where it comes from and its licence."""

from __future__ import annotations

import importlib.util
from pathlib import Path


def test_what_is_needed_is_named() -> None:
    spec = importlib.util.spec_from_file_location("sbom", Path(__file__).parents[1] / "docs" / "sbom.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    plain, whole = (module.sbom(extras) for extras in (frozenset(), frozenset({"dev"})))
    names = [each["name"] for each in plain["components"]]
    assert len(set(names)) == len(names)
    assert {"numpy", "torch", "opencv-contrib-python-headless"} <= set(names)
    assert "dask" not in names
    assert {*names, "dask", "rosbags", "pytest"} <= {each["name"] for each in whole["components"]}
    for each in plain["components"]:
        assert each["purl"] == f"pkg:pypi/{each['name']}@{each['version']}"
        assert each["licenses"][0]["license"]["name"]
    known = {each["bom-ref"] for each in (*plain["components"], plain["metadata"]["component"])}
    assert known == {each["ref"] for each in plain["dependencies"]}
    assert all(known.issuperset(each["dependsOn"]) for each in plain["dependencies"])
