"""What `import zenoh_cbef` offers of processes."""

from __future__ import annotations

import threading
from pathlib import Path
from uuid import uuid4

import numpy as np
import pytest

import zenoh_cbef as zc

SMALL: dict[str, object] = {"agents.count": 3, "network.graph": "ring", "consensus.rounds": 2}


def test_a_run_of_processes_gives_the_bits_of_the_simulator(tmp_path: Path) -> None:
    told: list[tuple[float, int]] = []
    what = zc.scenario("tracking", steps=20, **SMALL)
    run = zc.run(what, log=tmp_path / "run.mcap", progress=lambda *one: told.append(one))
    assert run.metrics.complete
    assert run.log == tmp_path / "run.mcap"
    assert told[-1] == (20, 20)
    assert np.array_equal(run.estimates, zc.simulate(what).estimates)
    with pytest.raises(zc.UserError, match="never overwritten"):
        zc.run(what, log=tmp_path / "run.mcap")


def test_a_run_that_goes_on_is_heard_to_its_end(tmp_path: Path) -> None:
    name, log, runs = f"live-{uuid4().hex[:8]}", tmp_path / "run.mcap", list[zc.Run]()
    what = zc.scenario("tracking", **{"steps": 60, "timing.mode": "realtime", **SMALL})

    worker = threading.Thread(target=lambda: runs.append(zc.run(what, run=name, log=log)))
    worker.start()
    try:
        heard = list(zc.live(name, patience=120.0))
    finally:
        worker.join(120.0)
    logged = runs[0].estimates
    assert {one.agent for one in heard} == {0, 1, 2}
    for one in heard:
        assert np.array_equal(one.state, logged[one.agent, one.step - 1])
        assert one.covariance.shape == (6, 6)


@pytest.mark.parametrize("wrong", [False, True, 3])
def test_a_progress_that_is_no_function_is_a_sentence(tmp_path: Path, wrong: object) -> None:
    with pytest.raises(zc.UserError, match=rf"progress = {wrong} is to be a function of the step"):
        zc.run("tracking", log=tmp_path / "run.mcap", progress=wrong)  # type: ignore[arg-type]
    assert not list(tmp_path.iterdir())


def test_a_run_that_is_not_there_is_a_sentence() -> None:
    with pytest.raises(zc.UserError, match="nothing-such"):
        next(zc.live("nothing-such", patience=0.2))
