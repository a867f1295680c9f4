"""`make sbom`: sbom.json, the installed packages that vbaa-calib needs with versions and licences, as CycloneDX 1.6."""

from __future__ import annotations

import json
import sys
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = "vbaa-calib"
_UNNAMED = "not stated"


def needed(name: str, extras: frozenset[str] = frozenset()) -> list[tuple[str, frozenset[str]]]:
    """What an installed package requires here, with the extras asked of each."""
    wanted = []
    for line in distribution(name).requires or ():
        one = Requirement(line)
        if one.marker is None or any(one.marker.evaluate({"extra": extra}) for extra in ("", *extras)):
            wanted.append((canonicalize_name(one.name), frozenset(one.extras)))
    return wanted


def closure(extras: frozenset[str] = frozenset()) -> dict[str, list[str]]:
    """Every package → those that it requires, from ours on; what is not installed is left out."""
    found: dict[str, list[str]] = {}
    waiting, seen = [(ROOT, extras)], set()
    while waiting:
        name, more = waiting.pop()
        if (name, more) in seen:
            continue
        seen.add((name, more))
        try:
            below = needed(name, more)
        except PackageNotFoundError:
            continue
        found[name] = sorted({*found.get(name, ()), *(each for each, _ in below)})
        waiting += below
    return {name: [each for each in below if each in found] for name, below in sorted(found.items())}


def licence(one: Distribution) -> str:
    """As the package states it: SPDX expression, classifier, or the first line of its text."""
    about = one.metadata
    if about.get("License-Expression"):
        return str(about["License-Expression"])
    stated = [line.rpartition(" :: ")[2] for line in about.get_all("Classifier") or () if line.startswith("License ::")]
    stated = [words for words in stated if words != "OSI Approved"]
    text = (about.get("License") or "").strip()
    return " OR ".join(stated) or text.partition("\n")[0][:100] or _UNNAMED


def sbom(extras: frozenset[str] = frozenset()) -> dict[str, Any]:
    """The bill of materials as plain data."""

    def component(name: str) -> dict[str, Any]:
        one = distribution(name)
        reference = f"pkg:pypi/{name}@{one.version}"
        kind = "application" if name == ROOT else "library"
        stated = [{"license": {"name": licence(one)}}]
        return {
            "type": kind,
            "bom-ref": reference,
            "name": name,
            "version": one.version,
            "purl": reference,
            "licenses": stated,
        }

    packages = closure(extras)
    whole = {name: component(name) for name in packages}
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {"component": whole[ROOT]},
        "components": [each for name, each in whole.items() if name != ROOT],
        "dependencies": [
            {"ref": whole[name]["bom-ref"], "dependsOn": [whole[each]["bom-ref"] for each in below]}
            for name, below in packages.items()
        ],
    }


if __name__ == "__main__":
    output, *asked = sys.argv[1:] or ["sbom.json"]
    bill = sbom(frozenset(asked))
    Path(output).write_text(json.dumps(bill, indent=2) + "\n", encoding="utf-8")
    for each in bill["components"]:
        print(f"{each['name']:<36}{each['version']:<16}{each['licenses'][0]['license']['name']}")
    print(f"wrote {output}: {len(bill['components'])} packages")
