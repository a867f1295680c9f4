"""`vbaa board` called wrongly: exit 2, one line with a remedy, and no sheet."""

from __future__ import annotations

from pathlib import Path

import pytest

from vbaa_calib.cli.main import main

CALLS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "paper that is none": (("--paper", "A99"), ("A99", "A4")),
    "paper of no size": (("--paper", "0x200"), ("0x200",)),
    "paper that is endless": (("--paper", "infx200"), ("infx200",)),
    "squares by one number": (("--squares", "11"), ("11",)),
    "one square": (("--squares", "1x1"), ("1",)),
    "too many squares": (("--squares", "900x900"), ("900",)),
    "negative squares": (("--squares=-3x4",), ("-3",)),
    "square with a unit": (("--square-mm", "15mm"), ("15mm",)),
    "square by decimal comma": (("--square-mm", "15,5"), ("15,5",)),
    "square is NaN": (("--square-mm", "nan"), ("nan",)),
    "square is endless": (("--square-mm", "1e400"), ()),
    "square is zero": (("--square-mm", "0"), ("0",)),
    "square is negative": (
        ("--square-mm=-15",),
        (
            "-15",
            "millimetres",
        ),
    ),
    "square larger than the paper": (("--square-mm", "150"), ("does not fit on A4", "the largest square that fits is")),
    "marker as large as its square": (("--square-mm", "15", "--marker-mm", "15"), ("marker",)),
    "marker without square": (("--marker-mm", "0"), ("marker",)),
    "dictionary that is none": (("--dictionary", "DICT_9X9"), ("DICT_9X9",)),
    "margin is all of it": (("--margin-mm", "200"), ("take fewer squares or more paper",)),
    "margin is negative": (("--margin-mm=-8",), ("-8",)),
    "thickness is NaN": (("--thickness-mm", "nan"), ("nan",)),
    "screen without pixels": (("--px-per-mm", "0"), ("0",)),
    "spec that is not there": (("--spec", "none.yaml"), ("none.yaml", "no such file")),
    "spec and flags": (("--spec", "none.yaml", "--squares", "11x7"), ()),
    "unknown flag": (("--margins", "3"), ("--margins",)),
}

SAYS_WHAT_TO_DO = ("; ", " needed", "at most")


@pytest.mark.parametrize("name", CALLS)
def test_a_call(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    argv, words = CALLS[name]
    sheet = "sheet.png" if "--px-per-mm" in argv else "sheet.pdf"
    code = main(["board", "-o", sheet, *argv])
    said = capfd.readouterr().err
    assert code == 2, said
    assert said.count("\n") == 1
    assert said.startswith("vbaa: ")
    assert any(sign in said for sign in SAYS_WHAT_TO_DO)
    for word in words:
        assert word in said
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("sheet", ["sheet.doc", "sheet", "none/sheet.pdf", ".", "a\0b.pdf", "s" * 300 + ".pdf"])
def test_a_sheet(
    sheet: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    code = main(["board", "-o", sheet])
    said = capfd.readouterr().err
    assert (code, said.count("\n")) == (2, 1), said
    assert "; " in said
    assert list(tmp_path.iterdir()) == []
