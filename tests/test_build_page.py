"""docs/build.md: the table of losses is the budget's, its lines reach `vbaa live`, its jig is what is written."""

from __future__ import annotations

import re
import runpy
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from tests.estimator.budget_draws import correlated_rig
from vbaa_calib.streams import Reading
from vbaa_calib.streams.messages import line_messages

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "build.md").read_text(encoding="utf-8")


def cells(table: str) -> list[list[str]]:
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in table.strip().splitlines()]


def test_the_table_of_losses_is_the_budgets() -> None:
    """As of any rig: of the same rows, and nothing is gained by what is missing."""
    script = runpy.run_path(str(ROOT / "docs" / "quote_losses.py"))
    own = cells(script["table"](correlated_rig()))
    found = re.search(r"\| without \| distance.*?\n(?!\|)", PAGE, re.DOTALL)
    assert found is not None
    page = cells(found[0])
    assert [row[0] for row in page] == [row[0] for row in own]
    assert [row[0] for row in page[2:]] == list(script["LOSSES"])
    for rows in (page[2:], own[2:]):
        whole = [float(cell) for cell in rows[0][1:4]]
        for row in rows[1:]:
            assert all(float(cell) >= 0.999 * best for cell, best in zip(row[1:4], whole, strict=True))
            assert int(row[4]) <= int(rows[0][4]) <= 144


@pytest.mark.skipif(shutil.which("bash") is None, reason="the loop is one of bash")
def test_the_sketchs_lines_reach_vbaa_live(tmp_path: Path) -> None:
    """What the microcontroller prints, through the page's loop, as the readings of a socket."""
    printed = re.search(r'Serial\.print\("(.*)"\); .*Serial\.println\("(.*)"\)', PAGE)
    loop = re.search(r"^while read .*; done", PAGE, re.MULTILINE)
    assert printed is not None
    assert loop is not None
    begin, end = (text.replace('\\"', '"') for text in printed.groups())
    (tmp_path / "tty").write_text(f"{begin}0.004200001{end}\r\n{begin}-0.000100000{end}\r\n")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listening:
        listening.bind(("127.0.0.1", 0))
        listening.settimeout(30.0)
        command = loop[0].replace("5005", str(listening.getsockname()[1]))
        subprocess.run(["bash", "-c", f"{command} < tty"], cwd=tmp_path, check=True)
        messages = [each for _ in range(2) for each in line_messages(listening.recv(4096), None, 1.0)]
    assert [(each.channel, each.value) for each in messages if isinstance(each, Reading)] == [
        ("moment_Nm", 0.004200001),
        ("moment_Nm", -0.0001),
    ]


def test_the_jig_of_the_page_is_written(tmp_path: Path) -> None:
    command = re.search(r"^    python (targets/jig\.py .*)", PAGE, re.MULTILINE)
    assert command is not None
    words = [word.replace("printed/", str(tmp_path)) for word in command[1].split()]
    done = subprocess.run([sys.executable, *words], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == (tmp_path / "jig.yaml").read_text(encoding="utf-8")
    assert done.stdout.strip() in PAGE
