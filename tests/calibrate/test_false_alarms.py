"""What is said of sessions without a fault: nothing. benchmarks/limits.md has the counts that the slow test prints."""

from __future__ import annotations

from dataclasses import replace

import pytest

from .clean_sessions import again, checked, clean_session, said


def alarms(seed: int) -> list[str]:
    """What `vbaa calibrate` doubts, and `vbaa check` does not find to hold, with this session and a new one."""
    drawn = clean_session(seed)
    found, rig = said(drawn)
    return [*found, *checked(rig, again(drawn, seed)), *checked(rig, drawn.observations)]


@pytest.mark.parametrize("seed", [3, 10, 38])
def test_a_clean_session_raises_no_alarm(seed: int) -> None:
    """Rows along the line of sight, a line that light moves, and a clamp whose turn does not show."""
    assert alarms(seed) == []


def test_a_thread_over_the_antenna_raises_no_alarm() -> None:
    """Sharp pictures, in which the points on a stretch of the loaded antenna are known twenty times less well."""
    drawn = clean_session(3)
    drawn = replace(drawn, errors=replace(drawn.errors, sigma_px=0.012, line_px=0.0, light_px=0.0))
    crossed = []
    for one in again(drawn, 3):
        sigma_px = one.sigma_px.copy()
        if one.loaded:
            sigma_px[int(0.7 * len(sigma_px)) :][: len(sigma_px) // 12] *= 20.0
        crossed.append(replace(one, sigma_px=sigma_px))
    assert said(replace(drawn, observations=crossed))[0] == []


@pytest.mark.slow
def test_two_hundred_clean_sessions_raise_no_alarm() -> None:
    found = {seed: lines for seed in range(200) if (lines := alarms(seed))}
    assert found == {}
