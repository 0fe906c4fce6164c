"""What `import zenoh_cbef` offers, without processes."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import zenoh_cbef as zc
from tests.within import within
from zenoh_cbef.log.read.trace import read_trace

_GOLDEN = Path(__file__).parents[1] / "golden" / "sicf.mcap"
SMALL: dict[str, object] = {"steps": 30, "agents.count": 4, "network.graph": "ring", "consensus.rounds": 3}


@pytest.fixture(scope="module")
def run() -> zc.Run:
    return zc.simulate("tracking", seed=7, **SMALL)


@pytest.mark.processes
def test_importing_the_package_imports_neither_zenoh_nor_numpy() -> None:
    code = "import sys, zenoh_cbef; print(sorted({'zenoh', 'numpy', 'pydantic', 'matplotlib'} & sys.modules.keys()))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


@pytest.mark.processes
def test_simulating_needs_no_zenoh() -> None:
    code = "import sys, zenoh_cbef as zc; zc.simulate('tracking', steps=3).estimates; print('zenoh' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


def test_every_name_of_the_front_door_can_be_had() -> None:
    assert {name for name in zc.__all__ if not callable(getattr(zc, name))} == set()
    assert not hasattr(zc, "simulat")


def test_a_run_has_the_numbers_that_sim_writes(run: zc.Run, tmp_path: Path) -> None:
    options = [part for key, value in {"seed": 7, **SMALL}.items() for part in ("--set", f"{key}={value}")]
    assert within(tmp_path, "sim", "tracking", *options, "-o", "run.npz").returncode == 0
    with np.load(tmp_path / "run.npz") as written:
        assert set(written) == set(run.arrays)
        for name, values in run.arrays.items():
            assert np.array_equal(written[name], values, equal_nan=True), name
    assert run.truth.shape == (30, 6)
    assert run.estimates.shape == (4, 30, 6)
    assert run.covariances.shape == (4, 30, 6, 6)
    assert run.ranges.shape == run.position_error.shape == (4, 30)
    assert run.metrics.position_rmse is not None


def test_a_scenario_can_be_changed_again_also_with_arrays_and_faults() -> None:
    first = zc.scenario("tracking", fault=[{"kind": "loss", "probability": 0.25}], **SMALL)
    second = zc.scenario(first, **{"fault.loss.probability": np.float64(0.5), "target.position": np.array([1, 2, 3])})
    assert [fault.model_dump()["probability"] for fault in (*first.fault, *second.fault)] == [0.25, 0.5]
    assert second.target.position == (1.0, 2.0, 3.0)
    assert second.network.graph == "ring"


@pytest.mark.parametrize(
    ("what", "values", "said"),
    [
        ("trakcing", {}, "did you mean 'tracking'"),
        ("tracking", {"consensus.round": 5}, "rounds"),
        ("tracking", {"seed.more": 5}, "not a table"),
        (Path(__file__).parents[2] / "docs", {}, "docs is a folder; name the file of the scenario"),
    ],
)
def test_a_mistake_is_one_sentence_with_the_remedy(what, values, said) -> None:
    with pytest.raises(zc.UserError, match=said):
        zc.simulate(what, **values)


def test_tables_and_named_axes_have_the_arrays(run: zc.Run) -> None:
    table, named = run.to_pandas(), run.to_xarray()
    assert np.array_equal(table[["x", "y", "z"]].to_numpy(), run.estimates[:, :, :3].reshape(-1, 3))
    assert table["agent"].dtype == np.int64
    assert named.sizes["agent"] == 4
    assert np.array_equal(named["estimates"].sel(agent=2, state="vx").to_numpy(), run.estimates[2, :, 3])
    assert np.array_equal(named["time"].to_numpy(), run.time)
    with pytest.raises(zc.UserError, match="estimates"):
        run.to_pandas("estimate")


def test_plots_are_what_the_report_shows(run: zc.Run) -> None:
    errors = run.plot.errors().axes[0]
    drawn = [line for line in errors.lines if line.get_linewidth() < 1.0]
    shown = np.where(run.position_error > 0.0, run.position_error, np.nan)
    for line, expected in zip(drawn, shown, strict=False):
        assert np.allclose(np.asarray(line.get_ydata(), dtype=np.float64), expected, rtol=1e-6, equal_nan=True)
    assert run.plot.map().axes[0].get_xlabel() == "x (m)"
    assert run.plot.links().axes
    assert {"msee", "nees", "space"} <= set(run.plot.names)
    with pytest.raises(zc.UserError, match="position-error"):
        run.plot.named("error")


def test_a_report_is_written(run: zc.Run, tmp_path: Path) -> None:
    assert "tracking" in run.report(tmp_path / "page.html").read_text()
    with pytest.raises(zc.UserError, match="choose another path"):
        run.report("/proc/nothing.html")
    with pytest.raises(zc.UserError, match="make its folder, or choose another path"):
        run.report(tmp_path / "none" / "page.html")
    assert not (tmp_path / "none").exists()


def _any(value: Any) -> Any:
    return value


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda _: zc.load(_any(3)), "3 is no path of a log; give a text"),
        (lambda _: zc.reestimate(_any(None)), "None is no path of a log"),
        (lambda run: run.report(3), "3 is no path of a page"),
        (lambda run: run.scored(1.5), "skip must be a share of steps from 0 to 0.99, not 1.5"),
        (lambda run: run.scored("half"), "not 'half'"),
        (lambda _: zc.load(_GOLDEN, skip=2), "skip must be a share"),
    ],
)
def test_a_wrong_argument_is_one_sentence(run: zc.Run, call: Callable[[Any], object], said: str) -> None:
    with pytest.raises(zc.UserError, match=said):
        call(run)


def test_metrics_are_printed_in_a_line(run: zc.Run) -> None:
    assert str(run.metrics).startswith(f"<Metrics of tracking: sicf, {run.metrics.agents} agents, ")
    assert f"position RMSE {run.metrics.position_rmse:.4g} m" in str(run.metrics)
    assert len(str(run.metrics)) < 200


def test_a_log_is_read_and_estimated_again(tmp_path: Path) -> None:
    log = next(iter(sorted((Path(__file__).parents[2] / "tests/golden").rglob("*.mcap"))))
    read = zc.load(log)
    assert np.array_equal(read.estimates, read_trace(log).estimates, equal_nan=True)
    again = zc.reestimate(read, output=tmp_path / "again.mcap", filter={"kind": "local"})
    assert again.scenario.filter.kind == "local"
    assert again.log == tmp_path / "again.mcap"
    assert np.array_equal(again.ranges, read.ranges[:, : len(again.time)], equal_nan=True)
    with pytest.raises(zc.UserError, match="no log"):
        zc.reestimate(zc.simulate("tracking", **SMALL))
