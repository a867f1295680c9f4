"""EI from tables of measured deflections: synthetic rods, sampled intervals, a real rod, and tables that are wrong."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from vbaa_calib.antenna import linear
from vbaa_calib.antenna.rod import Rod, solve_rod
from vbaa_calib.calibrate.antenna.deflection_fit import (
    beam,
    elastica,
    error_models,
    gauss_newton,
    outlying,
)
from vbaa_calib.calibrate.antenna.deflection_table import DeflectionTable
from vbaa_calib.calibrate.antenna.stiffness import solve_stiffness
from vbaa_calib.cli.main import main

ROD1 = Path(__file__).parents[3] / "shared/data/rod_deflection/rod1_square_steel.txt"
FORCE_N, LENGTH_m, EI = 5.18, 0.54, 167.0
X_m = np.linspace(0.02, 0.5, 28)


def rod_deflections(x_m: np.ndarray, force_N: float, length_m: float, stiffness: float, weight_kg_m: float = 0.0):
    """(unloaded, loaded) heights (N,) at the places x of a hanging weight's rod, by integration of Kirchhoff's rod."""
    rod = Rod(length_m, stiffness, stiffness, weight_kg_m)
    forces = np.array([[0.0, 0.0, 0.0], [0.0, force_N, 0.0]])
    gravity = np.array([[0.0, 9.81, 0.0]] * 2)
    shape = solve_rod(rod, gravity, np.full(2, length_m), forces)
    return [np.interp(x_m, points[:, 0], points[:, 1]) for points in shape.points_m]


def noise(rng: np.random.Generator, x_m: np.ndarray, std_m: float, length_m: float) -> np.ndarray:
    if length_m == 0.0:
        return rng.normal(0.0, std_m, len(x_m))
    covariance = std_m**2 * np.exp(-np.abs(x_m[:, None] - x_m) / length_m)
    return np.linalg.cholesky(covariance) @ rng.normal(size=len(x_m))


def stiff_table(rng: np.random.Generator, std_m: float = 3e-5, length_m: float = 0.0) -> DeflectionTable:
    """A rod like the real one, small deflections, with an offset of the gauge."""
    y = linear.deflection(X_m, LENGTH_m, FORCE_N, EI) + 7e-5 + noise(rng, X_m, std_m, length_m)
    return DeflectionTable(X_m, np.zeros_like(X_m), y)


def write_table(path: Path, table: DeflectionTable) -> Path:
    rows = np.stack([table.x_m, table.unloaded_y_m, table.loaded_y_m], axis=1)
    lines = [",".join(f"{value:.7f}" for value in row) for row in rows]
    path.write_text("\n".join(["x_m,unloaded_y_m,loaded_y_m", *lines]) + "\n")
    return path


def test_a_table_without_noise_gives_the_rod_back_to_the_last_digits() -> None:
    table = stiff_table(np.random.default_rng(0), std_m=0.0)
    solution = solve_stiffness(table, FORCE_N, LENGTH_m, clamp_share_std=0.0)
    assert solution.fit.stiffness_Nm2 == pytest.approx(EI, rel=1e-9)
    assert solution.fit.offset_m == pytest.approx(7e-5, rel=1e-6)
    assert solution.outliers == ()


def test_the_weight_of_a_sagging_rod_cancels() -> None:
    unloaded, loaded = rod_deflections(X_m, FORCE_N, LENGTH_m, EI, weight_kg_m=0.8)
    solution = solve_stiffness(DeflectionTable(X_m, unloaded, loaded), FORCE_N, LENGTH_m)
    assert unloaded[-1] > 1e-4
    assert solution.fit.stiffness_Nm2 == pytest.approx(EI, rel=1e-3)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_whisker_bent_far_is_fitted_as_an_elastica(sign: float) -> None:
    """The rod's own integration and the closed form agree, and the small-angle formula would not do."""
    length, stiffness, force = 0.24, 0.0039, 0.12 * sign
    x = np.linspace(0.01, 0.17, 20)
    _, loaded = rod_deflections(x, force, length, stiffness)
    unloaded = np.zeros_like(x)
    fine = solve_stiffness(DeflectionTable(x, unloaded, loaded), force, length)
    assert fine.model == "elastica"
    assert fine.fit.stiffness_Nm2 == pytest.approx(stiffness, rel=1e-3)
    assert abs(fine.linear_bias) > 0.01


def test_the_elastica_is_chosen_by_bias_against_scatter() -> None:
    """The same gentle bend: told apart from a straight formula only where the readings are good enough for it."""
    length, stiffness, force = 0.24, 0.0039, 0.012
    x = np.linspace(0.02, 0.23, 30)
    unloaded, loaded = np.zeros_like(x), elastica(x, force, length)(stiffness)
    rng = np.random.default_rng(1)
    models = [
        solve_stiffness(
            DeflectionTable(x, unloaded, loaded + rng.normal(0.0, std, 30)), force, length, clamp_share_std=0.0
        ).model
        for std in (1e-7, 1e-3)
    ]
    assert models == ["elastica", "linear"]


@pytest.mark.parametrize("forward", [beam, elastica])
def test_the_fit_is_the_least_squares_one(forward) -> None:
    """No neighbouring EI or offset leaves a smaller sum of squares."""
    x, force, length = np.linspace(0.02, 0.2, 15), 0.06, 0.24
    y = elastica(x, force, length)(0.004) + np.random.default_rng(2).normal(0.0, 1e-3, 15)
    model = forward(x, force, length)
    found = gauss_newton(model, x, y, 0.01, offset=True)

    def cost(stiffness: float, offset: float) -> float:
        return float(np.sum((y - model(stiffness) - offset) ** 2))

    best = cost(found.stiffness_Nm2, found.offset_m)
    assert all(cost(found.stiffness_Nm2 * (1 + step), found.offset_m) > best for step in (-1e-3, 1e-3))
    assert all(cost(found.stiffness_Nm2, found.offset_m + step) > best for step in (-1e-5, 1e-5))


@pytest.mark.parametrize("correlation_length_m", [0.0, 0.03, 0.06])
def test_the_95_percent_interval_covers(correlation_length_m: float) -> None:
    """200 tables each, plain scatter and errors shared by neighbours."""
    rng = np.random.default_rng(11)
    inside = 0
    for _ in range(200):
        table = stiff_table(rng, length_m=correlation_length_m)
        low, high = solve_stiffness(table, FORCE_N, LENGTH_m, clamp_share_std=0.0).interval_Nm2
        inside += low <= EI <= high
    assert 180 <= inside <= 198


def test_the_interval_covers_elasticas_and_clamps_that_turn() -> None:
    """100 whiskers bent far, their clamps drawn from the prior that the interval assumes."""
    rng = np.random.default_rng(12)
    force, length, stiffness = 0.05, 0.24, 0.0039
    x = np.linspace(0.01, 0.2, 25)
    truth = elastica(x, force, length)(stiffness)
    slope = 0.36
    inside = 0
    for _ in range(100):
        turned = 0.02 * slope * rng.normal() * x
        table = DeflectionTable(x, np.zeros_like(x), truth + turned + noise(rng, x, 2e-4, 0.02))
        solution = solve_stiffness(table, force, length)
        assert solution.model == "elastica"
        assert solution.slope_at_load == pytest.approx(slope, rel=0.1)
        inside += solution.interval_Nm2[0] <= stiffness <= solution.interval_Nm2[1]
    assert 90 <= inside <= 100


def test_the_predicted_std_is_the_sampled_one_where_the_noise_is_known_to_be_plain() -> None:
    """With one error model only, its covariance is the textbook's."""
    x = np.linspace(0.0, 1.0, 12)
    design = np.stack([x**2, np.ones_like(x)], axis=1)
    y = np.random.default_rng(3).normal(size=12)
    residuals = y - design @ np.linalg.lstsq(design, y, rcond=None)[0]
    models = error_models(x, design, residuals, 0.0)
    textbook = residuals @ residuals / 10 * np.linalg.inv(design.T @ design)
    assert models.lengths_m[0] == 0.0
    assert np.allclose(models.covariances[0], textbook)
    assert models.weights.sum() == pytest.approx(1.0)


def test_slips_are_left_out_and_shared_errors_are_not() -> None:
    rng = np.random.default_rng(4)
    table = stiff_table(rng)
    loaded = table.loaded_y_m.copy()
    loaded[[5, 6, 20]] += [1e-3, 8e-4, -6e-4]
    solution = solve_stiffness(DeflectionTable(X_m, table.unloaded_y_m, loaded), FORCE_N, LENGTH_m)
    assert solution.outliers == (5, 6, 20)
    assert solution.fit.stiffness_Nm2 == pytest.approx(EI, rel=0.05)
    hump = 2e-4 * np.exp(-(((X_m - 0.3) / 0.06) ** 2)) + rng.normal(0.0, 1e-5, len(X_m))
    assert not outlying(hump, 0.0).any()


def test_more_correlation_gives_a_wider_interval() -> None:
    """The same scatter, once alternating and once in one wave along the rod."""
    wave = 4e-5 * np.sin(2.0 * np.pi * 3.0 * X_m / np.ptp(X_m))
    order = np.random.default_rng(5).permutation(len(X_m))
    y = linear.deflection(X_m, LENGTH_m, FORCE_N, EI)
    smooth, shuffled = (
        solve_stiffness(DeflectionTable(X_m, np.zeros_like(X_m), y + errors), FORCE_N, LENGTH_m, clamp_share_std=0.0)
        for errors in (wave, wave[order])
    )
    assert smooth.correlation > 0.7 > 0.3 > shuffled.correlation
    assert smooth.fit.std_Nm2 > 1.7 * shuffled.fit.std_Nm2
    assert smooth.effective_readings < 0.5 * shuffled.effective_readings


@pytest.fixture
def real_rod(tmp_path: Path) -> Path:
    """The student laboratory's steel rod, from centimetres and millimetres to metres."""
    if not ROD1.is_file():
        pytest.skip("the measured rod is not at hand: ../shared/data/rod_deflection")
    x, unloaded, loaded = np.loadtxt(ROD1).T
    return write_table(tmp_path / "rod1.csv", DeflectionTable(x / 100, unloaded / 1000, loaded / 1000))


def test_the_real_rod(real_rod: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """10 mm square steel: E within 200–222 GPa, and an interval that knows what the readings cannot separate."""
    output = tmp_path / "stiffness.json"
    call = ["stiffness", str(real_rod), "--force", "5.18", "--distance", "0.54", "--second-moment", "833.3e-12"]
    assert main([*call, "-o", str(output), "--json"]) == 0
    said = capsys.readouterr()
    result = json.loads(said.out)
    assert result == {"output": str(output), **json.loads(output.read_text())}
    assert result["schema"] == "vbaa.stiffness/1"
    assert 200e9 < result["youngs_modulus_Pa"] < 222e9
    low, high = result["youngs_modulus_interval_95_Pa"]
    assert low < 200e9, "steel's 205 GPa, the fit through the origin, must be inside"
    assert 235e9 < high < 290e9, "wider than the ± 7 GPa of uncorrelated scatter, and not without bounds"
    assert result["residual_correlation"] == pytest.approx(0.685, abs=0.01)
    assert result["effective_readings"] < 5
    assert result["offset_m"] == pytest.approx(75e-6, abs=1e-6)
    assert result["model"] == "linear"
    assert not any(row["outlier"] for row in result["rows"])
    held, free = result["alternatives"]
    assert held["youngs_modulus_Pa"] == pytest.approx(205e9, rel=0.005)
    assert free["youngs_modulus_Pa"] > 280e9
    assert any("err together" in warning for warning in result["warnings"])
    assert "clamp may turn as it likes" in said.err


def good_rows() -> list[list[str]]:
    x = np.linspace(0.05, 0.5, 10)
    y = linear.deflection(x, LENGTH_m, FORCE_N, EI)
    return [[f"{a:.6f}", "0.000000", f"{b:.6f}"] for a, b in zip(x, y, strict=True)]


def changed(line: int, column: int, value: str) -> list[list[str]]:
    rows = good_rows()
    rows[line - 2][column] = value
    return rows


WRONG_TABLES = {
    "repeated x": (changed(4, 0, good_rows()[1][0]), ["line 4", "second time"]),
    "unsorted x": (changed(5, 0, "0.01"), ["line 5", "falls"]),
    "x beyond the load": (changed(11, 0, "0.55"), ["line 11", "beyond the load"]),
    "x before the clamp": (changed(2, 0, "-0.05"), ["line 2", "from the clamp"]),
    "NaN": (changed(6, 2, "nan"), ["line 6", "loaded_y_m", "finite"]),
    "text": (changed(6, 1, "0.1 mm"), ["line 6", "unloaded_y_m"]),
    "too few rows": (good_rows()[:3], ["3 readings", "at least 4"]),
    "no deflection": ([[x, "0.001", "0.001"] for x, _, _ in good_rows()], ["every row", "without and with"]),
    "columns swapped": ([[x, y, zero] for x, zero, y in good_rows()], ["against the force", "swap"]),
    "millimetres": (
        [[x, zero, f"{1000 * float(y):.4f}"] for x, zero, y in good_rows()],
        ["more than its length", "0.001"],
    ),
    "scatter only": (
        [[x, "0", f"{1e-6 + 3e-5 * (-1) ** (i + 1):.7f}"] for i, (x, _, _) in enumerate(good_rows())],
        ["scatter", "load the rod more"],
    ),
}


@pytest.mark.parametrize("name", WRONG_TABLES)
def test_wrong_tables_are_refused_in_one_line(name: str, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    rows, words = WRONG_TABLES[name]
    path, output = tmp_path / "table.csv", tmp_path / "out.json"
    with path.open("w", newline="") as stream:
        csv.writer(stream).writerows([["x_m", "unloaded_y_m", "loaded_y_m"], *rows])
    assert main(["stiffness", str(path), "--force", "5.18", "--distance", "0.54", "-o", str(output)]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert str(path) in said.err
    assert all(word in said.err for word in words), said.err
    assert not output.exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--force", "0"], "newtons"),
        (["--force", "nan"], "newtons"),
        (["--force", "inf"], "newtons"),
        (["--distance", "540"], "metres"),
        (["--distance", "-0.54"], "metres"),
        (["--distance", "nan"], "metres"),
        (["--distance", "0.3"], "beyond the load"),
        (["--force", "-5.18"], "against the force"),
        (["--diameter", "10"], "metres"),
        (["--diameter", "nan"], "metres"),
        (["--second-moment", "833.3"], "m^4"),
        (["--second-moment", "0"], "m^4"),
        (["--diameter", "0.01", "--second-moment", "1e-9"], "not allowed"),
        (["--clamp-share", "nan"], "share"),
    ],
)
def test_wrong_options_are_refused(
    options: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    path = write_table(tmp_path / "rod.csv", stiff_table(np.random.default_rng(7)))
    call = ["stiffness", str(path), "--force", "5.18", "--distance", "0.54", *options]
    assert main(call) == 2
    assert words in capsys.readouterr().err


def test_outputs_are_not_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    path, output = write_table(tmp_path / "rod.csv", stiff_table(np.random.default_rng(8))), tmp_path / "out.json"
    output.write_text("mine")
    call = ["stiffness", str(path), "--force", "5.18", "--distance", "0.54", "-o", str(output)]
    assert main(call) == 2
    assert output.read_text() == "mine"
    assert "--overwrite" in capsys.readouterr().err
    assert main([*call, "--overwrite"]) == 0
    assert json.loads(output.read_text())["schema"] == "vbaa.stiffness/1"
