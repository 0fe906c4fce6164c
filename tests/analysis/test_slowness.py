"""Who cannot keep up with real time says so, and the analysis tells; a hiccup of the host does not count."""

from dataclasses import replace
from itertools import pairwise

import pytest

from tests.cli.terminal.test_status import AFTER, SECOND, told
from zenoh_cbef.analysis.metrics import analyze, notes
from zenoh_cbef.analysis.results import Slowness
from zenoh_cbef.nodes.common.pace import Pace
from zenoh_cbef.outside.status import read_status
from zenoh_cbef.protocol.messages import encode
from zenoh_cbef.protocol.slow import AGAIN_SECONDS, REMEDY, WINDOW_SECONDS
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate

SLOT = 0.01


class Said:
    """What a Pace said, and when."""

    def __init__(self):
        self.pace = Pace("agent 3", "rounds", self)
        self.now, self.heard = 100.0, []

    def __call__(self, text, /, *, late, due):
        self.heard.append((self.now, text, late, due))

    def go(self, seconds, late):
        """Come to a round in each slot; late(n) tells of which."""
        for n in range(round(seconds / SLOT)):
            self.now += SLOT
            self.pace.arrive(self.now, self.now - 1e-4 if late(n) else self.now + 1e-4)


def always(_n):
    return True


def never(_n):
    return False


def tenth(n):
    return n % 10 == 0


def test_who_is_always_late_says_so_after_a_window_and_then_each_minute():
    said = Said()
    said.go(4.9, always)
    assert said.heard == []
    said.go(2 * AGAIN_SECONDS, always)
    times = [at for at, *_ in said.heard]
    assert len(times) == 2
    assert times[0] == pytest.approx(100.0 + WINDOW_SECONDS, abs=2 * SLOT)
    assert times[1] - times[0] >= AGAIN_SECONDS
    assert "agent 3" in said.heard[0][1]
    assert REMEDY in said.heard[0][1]
    assert said.heard[0][2:] == (501, 501)
    assert said.pace.finish() == {"late": 12490, "due": 12490}
    assert len(said.heard) == 2


@pytest.mark.parametrize(
    ("seconds", "late", "says"),
    [
        (60.0, never, False),
        (60.0, lambda n: n % 11 == 0, False),
        (60.0, tenth, True),
        (1.0, tenth, True),
        (0.9, tenth, False),  # nine are a hiccup
        (60.0, lambda n: n < 30, False),  # so is a third of a second
    ],
)
def test_a_tenth_and_ten_of_a_window_or_of_a_short_run_count(seconds, late, says):
    said = Said()
    said.go(seconds, late)
    said.pace.finish()
    assert bool(said.heard) == says


def test_on_and_off_is_said_no_more_often_than_every_window():
    said = Said()
    for _ in range(100):
        said.go(1.3, always)
        said.go(3.9, never)
        said.go(5.2, never)
    times = [at for at, *_ in said.heard]
    assert len(times) > 10
    assert min(after - before for before, after in pairwise(times)) >= WINDOW_SECONDS


def test_a_deadline_itself_is_in_time():
    said = Said()
    said.pace.arrive(5.0, 5.0)
    assert said.pace.finish() == {"late": 0, "due": 1}


@pytest.fixture(scope="module")
def trace():
    return simulate([load("tracking", ["steps=12", "agents.count=4", "network.graph=ring"]).scenario])[0]


def event(sender, kind="finished", **data):
    return {"kind": kind, "from": sender, "text": "", "sent": 0, "data": data}


def test_the_metric_is_what_each_process_told_last(trace):
    events = [
        event("agent/0", "slow", late=50, due=60),
        event("agent/0", late=60, due=100),
        event("agent/1", late=3, due=100),
        event("agent/2", late="many", due=100),
        event("agent/2", late=101, due=100),
        event("agent/3", late=0, due=0),
        event("agent/99", late=90, due=100),
        event("record", late=90, due=100),
        event("target", late=20, due=100),
    ]
    metrics = analyze([replace(trace, events=events)])[0].metrics
    assert metrics.slow == Slowness([0.6, 0.03, None, None], target=0.2, too_slow=["agent 0", "target"])
    assert REMEDY in "".join(notes(metrics))
    assert "agent 0 came too late to 60%" in "".join(notes(metrics))


def test_who_kept_up_has_shares_and_no_note_and_a_simulation_has_neither(trace):
    assert analyze([trace])[0].metrics.slow is None
    metrics = analyze([replace(trace, events=[event("agent/1", late=9, due=12)])])[0].metrics
    assert metrics.slow == Slowness([None, 0.75, None, None], target=None, too_slow=[])
    assert not any("too late" in said for said in notes(metrics))


def test_a_status_names_who_said_so_lately():
    def slow(sender, sent):
        body = {"kind": "slow", "text": "", "data": {}}
        return encode("r", sender, 0, round(sent * SECOND), body)

    state = told(AFTER, [])
    state["time"] = 1000.0
    state["events"] = [slow("agent/3", 990.0), slow("agent/5", 800.0), slow("target", 995.0), slow("agent/x", 999.0)]
    assert read_status(state).slow == ["agent/3", "target"]
