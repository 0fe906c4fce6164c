"""What a link carries: told before a run, found after it, and the settings for one of a few kbit/s."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from tests.log.made import made_log
from zenoh_cbef.analysis.demand import ENVELOPE, demand
from zenoh_cbef.analysis.design import design
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.cli.info import _payloads
from zenoh_cbef.cli.terminal.design import design_lines
from zenoh_cbef.cli.terminal.results import metrics_table
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate

SHORT = ("consensus.precision='int12'", "consensus.trigger=0.1")
LOSS = "fault=[{kind='loss', probability=0.3}]"


@pytest.mark.slow
def test_the_bytes_of_a_step_are_those_of_the_messages_that_agents_send(tmp_path):
    path = made_log(tmp_path / "run.mcap", "steps=40", "agents.count=5", *SHORT)
    [run] = analyze([read_trace(path)])
    log = open_log(path)
    sent = [len(one.data) + ENVELOPE for one in log.messages() if one.channel.topic.endswith("/round")]
    # In the first steps messages are longer.
    assert run.metrics.link_bytes_per_step == pytest.approx(sum(sent) / (40 * 5), rel=0.08)
    assert run.metrics.silent is not None
    assert 0.2 < run.metrics.silent < 0.8
    assert _payloads(open_log(path)) == "int12, agents silent within 0.1 deviations"


def test_metrics_tell_what_a_link_carries_also_of_simulations():
    def told(*overrides):
        loaded = load("tracking", ["steps=30", *overrides])
        [run] = analyze(simulate([loaded.scenario]))
        return run.metrics, demand(loaded.plan).link * loaded.scenario.dt / 8.0

    plain, expected = told()
    assert plain.link_bytes_per_step == expected == 3400.0
    assert plain.silent is None
    alone, _ = told("filter.kind='local'")
    assert alone.link_bytes_per_step is None
    ranges, expected = told("filter.kind='ci'", "filter.measurement='difference'")
    assert ranges.link_bytes_per_step == expected > 3240.0


@pytest.mark.parametrize("more", [SHORT, SHORT[:1], SHORT[1:], ()])
def test_the_table_has_a_row_of_it_that_fits_eighty_columns_and_none_for_the_usual_messages(more):
    def shown(*overrides):
        [run] = analyze(simulate([load("tracking", ["steps=10", *overrides]).scenario]))
        console = Console(width=80, file=io.StringIO())
        with console.capture() as capture:
            console.print(metrics_table(run.metrics))
        return capture.get().splitlines()

    told = shown(*more)
    assert len([line for line in told if "on a link, a step" in line]) == bool(more)
    assert max(map(len, told)) <= 80


@pytest.mark.slow
def test_settings_are_recommended_that_a_link_carries():
    plan = load("tracking").plan
    told = design(plan, kbits=40.0).recommended
    assert told is not None
    assert (told.precision, told.trigger, told.fits, told.dt) == ("int12", 0.1, True, 0.1)
    assert told.link <= 40.0
    assert told.ratio is not None
    assert told.ratio <= 1.01
    chosen = ["consensus.precision='int12'", f"consensus.rounds={told.rounds}", f"dt={told.dt}"]
    assert demand(load("tracking", chosen).plan).link == pytest.approx(1e3 * told.link)
    slow = design(plan, search=False, kbits=5.0)
    assert slow.recommended is not None
    assert not slow.recommended.fits
    assert slow.recommended.dt > 0.1
    assert slow.recommended.link <= 5.0
    said = "\n".join(line for line in design_lines(slow) if isinstance(line, str))
    assert f"--set dt={slow.recommended.dt:g}" in said


@pytest.mark.slow
@pytest.mark.parametrize(
    ("keys", "precision", "trigger"),
    [
        ([LOSS], "float32", 0.0),
        (["filter.kind='kcf'"], "float32", 0.0),
        ([LOSS, "consensus.scheme='average'"], "int12", 0.1),
    ],
)
def test_what_is_recommended_is_sound_for_the_filter_and_the_links(keys, precision, trigger):
    told = design(load("tracking", keys).plan, search=False, kbits=100.0).recommended
    assert told is not None
    assert (told.precision, told.trigger) == (precision, trigger)
