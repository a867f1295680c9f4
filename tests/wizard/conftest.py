"""The wizard's page served, for the tests of who may ask it and of what it answers."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from vbaa_calib.wizard.server import PageServer


@pytest.fixture(scope="module")
def server() -> Iterator[PageServer]:
    """One for all that is refused: it leaves no trace."""
    server = PageServer()
    yield server
    server.close()


@pytest.fixture
def fresh() -> Iterator[PageServer]:
    server = PageServer()
    yield server
    server.close()
