"""The conformance kit for faults: our own kinds pass, and every way of breaking it is told in a sentence."""

# ruff: noqa: ARG002 - what is broken has the arguments of what is not

import numpy as np
import pytest
from pydantic import BaseModel, Field

from zenoh_cbef.extending import Absence, Effect, LinkFault, MessageFault, SenderFault, SensorFault, stream, uniform
from zenoh_cbef.faults import KINDS
from zenoh_cbef.testing import Nonconforming, check_fault

DICE = np.random.default_rng(1)
NEEDED: dict[str, dict[str, object]] = {
    "loss": {"probability": 0.3},
    "burst-loss": {"good_to_bad": 0.2, "bad_to_good": 0.3},
    "delay": {"milliseconds": 3.0, "jitter_ms": 2.0},
    "duplicate": {"probability": 0.3},
    "reorder": {"probability": 0.3},
    "corrupt": {"probability": 0.3},
    "rate-limit": {"messages_per_second": 10.0},
    "partition": {"links": {"between": [[0, 1], [2, 3]]}},
    "pause": {"until": 1.0},
    "clock": {"offset": 1e-8, "drift": 1e-9},
    "sensor-bias": {"bias": 1.0},
    "sensor-spikes": {"probability": 0.3},
    "sensor-dropout": {"probability": 0.4},
}


@pytest.mark.parametrize("name", KINDS)
def test_our_own_kinds_pass(name):
    check_fault(KINDS[name], kind=name, **NEEDED.get(name, {}))


def test_a_replay_passes():
    check_fault(KINDS["byzantine"], kind="byzantine", mode="replay", steps=3)


class Gambling(LinkFault):
    def effect(self, messages, index):
        return Effect(lost=DICE.random(len(messages.source)) < 0.5)


class Together(LinkFault):
    """All links of a batch share one fate."""

    def effect(self, messages, index):
        mean = messages.uniform(f"together/{index}").mean()
        return Effect(delay=np.full(len(messages.source), mean))


class Twins(LinkFault):
    def effect(self, messages, index):
        return Effect(lost=messages.uniform("twins") < 0.5)


class Early(LinkFault):
    def effect(self, messages, index):
        return Effect(delay=np.full(len(messages.source), -1.0))


class Whole(LinkFault):
    def effect(self, messages, index):
        return Effect(lost=np.ones((), dtype=bool))


class Silent(LinkFault):
    def effect(self, messages, index):
        return None


class Writing(SensorFault):
    def measured(self, readings, index):
        readings.ranges[:] += 1.0
        return readings.ranges


class Endless(SensorFault):
    def measured(self, readings, index):
        return np.full(readings.ranges.shape, np.inf)


class Alike(SensorFault):
    def measured(self, readings, index):
        return readings.ranges + uniform(stream(readings.seed, "alike", readings.agent), readings.step)


class Short(SenderFault):
    def sent(self, honest, index):
        return honest.message[:, :3]


class Nowhere(SenderFault):
    def sent(self, honest, index):
        return honest.message * np.nan


class Everywhere(MessageFault):
    def selects(self, source, destination):
        return [True] * len(source)

    def effect(self, messages, index):
        return Effect()


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        (Gambling, "the second time; draw from streams"),
        (Together, "alone meets another fate than among others"),
        (Twins, "put `index` into the purpose"),
        (Alike, "put `index` into the purpose"),
        (Early, "below zero or not finite"),
        (Whole, r"effect\(\).lost is bool \(\), not bool \(20,\)"),
        (Silent, "gives no Effect"),
        (Writing, "changes the arrays that it is given"),
        (Endless, "infinite range"),
        (Short, r"no float64 array \(5, 9\)"),
        (Nowhere, "not finite; receivers would refuse"),
        (Everywhere, r"selects\(\) is list"),
    ],
)
def test_a_broken_fault_is_told_what_is_wrong(kind, said):
    with pytest.raises(Nonconforming, match=said):
        check_fault(kind)


class Depth(BaseModel):
    depth: float = Field(default=0.5, le=1.0)


class Deep(LinkFault):
    options: Depth = Depth()

    def effect(self, messages, index):
        return Effect(lost=messages.uniform(f"deep/{index}") < self.options.depth)


class Unmade(LinkFault):
    pass


class Holiday(Absence):
    pass


def test_options_are_the_faults_own():
    check_fault(Deep, options={"depth": 0.2})
    check_fault(Holiday)
    with pytest.raises(ValueError, match=r"fault.options.dept is no option of Depth; did you mean 'depth'\?"):
        check_fault(Deep, options={"dept": 0.2})
    with pytest.raises(ValueError, match=r"fault.depth is an option of 'Deep'; write it as fault.options.depth"):
        check_fault(Deep, depth=0.2)
    with pytest.raises(ValueError, match=r"fault.links\."):
        check_fault(Deep, links=3)
    with pytest.raises(ValueError, match=r"which is no fault: it lacks effect\(\)"):
        check_fault(Unmade)
    with pytest.raises(ValueError, match="which is no fault: derive it from LinkFault"):
        check_fault(Depth)
