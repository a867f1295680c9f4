"""`vbaa report`, and the report that `vbaa estimate` ends with."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from vbaa_calib.core.errors import InputError
from viz.cli import estimate as estimate_cli
from viz.cli import report as report_cli
from viz.report import pictures as report_pictures
from viz.report.make import beside
from viz.report.pictures import Picture

Verb = Callable[..., dict[str, Any]]


def verb(module: Any) -> Verb:
    """Calls a verb with the arguments of its command line."""

    def call(*argv: object, force: bool = False) -> dict[str, Any]:
        parser = argparse.ArgumentParser(exit_on_error=False)
        module.configure(parser)
        args = parser.parse_args([str(part) for part in argv])
        args.argv, args.force = ["vbaa", "verb", *map(str, argv)], force
        result: dict[str, Any] = module.run(args)
        return result

    return call


report, estimate = verb(report_cli), verb(estimate_cli)


@pytest.fixture(autouse=True)
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """The scene has its own tests; drawing it takes seconds."""
    monkeypatch.setattr(report_pictures, "scene_picture", lambda *_: Picture(b"", "No picture: not drawn here."))


def test_a_report_of_files(files: SimpleNamespace) -> None:
    said = report(files.contacts, "--rig", files.rig, "--truth", files.truth, "--title", "<mine>")
    assert said == {"report": str(files.folder / "report.html")}
    html = (files.folder / "report.html").read_text()
    assert "&lt;mine&gt;" in html
    assert "Contact located in 90 of 92 frames" in html
    assert "No picture: not drawn here." in html
    assert "sha256" in html
    assert ">truth<" in html


def test_without_a_contact_it_says_why_the_object_is_undetermined(files: SimpleNamespace) -> None:
    report(files.free, "-o", files.folder / "free.html")
    html = (files.folder / "free.html").read_text()
    assert "Nothing was touched" in html
    assert "Nothing can be said of it: no frame has a located contact" in html


def test_another_rigs_contacts_are_refused(files: SimpleNamespace) -> None:
    elsewhere = json.loads(files.rig.read_text())
    elsewhere["kinematics"]["position_world_m"] = [0.3, 0.0, 0.0]
    (files.folder / "other.json").write_text(json.dumps(elsewhere))
    with pytest.raises(InputError, match="do not fit the rig's kinematics"):
        report(files.contacts, "--rig", files.folder / "other.json", "-o", files.folder / "foreign.html")
    assert not (files.folder / "foreign.html").exists()


def test_files_in_the_way_are_refused(files: SimpleNamespace) -> None:
    (files.folder / "report.html").write_text("mine")
    with pytest.raises(InputError, match="exists already"):
        report(files.free, "-o", files.folder / "report.html")
    assert (files.folder / "report.html").read_text() == "mine"
    report(files.free, "-o", files.folder / "report.html", force=True)
    assert "<html" in (files.folder / "report.html").read_text()
    with pytest.raises(InputError, match=r"is not a \.html"):
        report(files.contacts, "-o", files.folder / "report.pdf")
    with pytest.raises(InputError, match="--session needs --rig"):
        report(files.contacts, "-o", files.folder / "other.html", "--session", files.folder)
    assert not (files.folder / "other.html").exists()


@pytest.mark.parametrize(
    ("contacts", "expected"),
    [("contacts.csv", "report.html"), ("contacts.parquet", "report.html"), ("a.csv", "a_report.html")],
)
def test_where_the_report_goes(contacts: str, expected: str) -> None:
    assert beside(Path("out") / contacts) == Path("out") / expected


@pytest.fixture
def estimated(monkeypatch: pytest.MonkeyPatch, files: SimpleNamespace) -> list[Path]:
    """Stands for the estimator, whose work is tested elsewhere: writes what was found before. The outputs so far."""
    done: list[Path] = []

    def run(args: argparse.Namespace) -> dict[str, Any]:
        args.output.write_bytes(files.free.read_bytes())
        done.append(args.output)
        return {"contacts": str(args.output)}

    monkeypatch.setattr(estimate_cli.cli, "run", run)
    return done


def test_an_estimate_ends_with_a_report(files: SimpleNamespace, estimated: list[Path]) -> None:
    out = files.folder / "out"
    out.mkdir()
    call = (files.folder, "--rig", files.rig, "-o", out / "contacts.csv")
    assert estimate(*call) == {"contacts": str(out / "contacts.csv"), "report": str(out / "report.html")}
    html = (out / "report.html").read_text()
    assert "Nothing was touched" in html
    assert "vbaa verb" in html
    with pytest.raises(InputError, match=r"contacts\.csv: exists already"):
        estimate(*call)
    (out / "contacts.csv").unlink()
    with pytest.raises(InputError, match=r"report\.html: exists already"):
        estimate(*call)
    assert len(estimated) == 1, "refused before any work"
    estimate(*call[:-1], out / "other.csv", "--report", out / "named.html")
    assert (out / "named.html").is_file()


def test_the_report_can_be_left_out(files: SimpleNamespace, estimated: list[Path]) -> None:
    out = files.folder / "bare.csv"
    call = (files.folder, "--rig", files.rig, "-o", out, "--no-report")
    assert estimate(*call) == {"contacts": str(out), "report": None}
    assert not beside(out).exists()
    with pytest.raises(InputError, match="--report and --no-report"):
        estimate(*call, "--report", files.folder / "x.html", force=True)
    assert len(estimated) == 1
