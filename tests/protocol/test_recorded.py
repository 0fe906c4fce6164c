"""Which keys a recorder takes: those that are named, and events and signals always, each once."""

import pytest
import zenoh

from zenoh_cbef.errors import UserError
from zenoh_cbef.protocol.recorded import apart, belongs, covering, recorded_keys

EVENTS, SIGNALS = "cbef/mine/event/**", "cbef/mine/beacon/*/signal"


@pytest.mark.parametrize(
    ("wanted", "expected"),
    [
        ([], ["cbef/mine/**"]),
        (["**"], ["cbef/mine/**"]),
        (["agent/0/**"], ["cbef/mine/agent/0/**", EVENTS, SIGNALS]),
        (["cbef/mine/agent/*/round", "beacon/*"], ["cbef/mine/agent/*/round", "cbef/mine/beacon/*", EVENTS, SIGNALS]),
        (["beacon/**"], ["cbef/mine/beacon/**", EVENTS]),
        (["event/target", "faults"], ["cbef/mine/faults", EVENTS, SIGNALS]),
        (["agent/**/**"], ["cbef/mine/agent/**", EVENTS, SIGNALS]),
    ],
)
def test_events_and_signals_are_recorded_whatever_is_wanted(wanted: list[str], expected: list[str]) -> None:
    assert recorded_keys("mine", wanted) == expected


@pytest.mark.parametrize(
    ("wanted", "words"),
    [
        (["agent/#"], "is no key expression"),
        (["cbef/other/**"], "is not of run 'mine'"),
        (["agent/0/**", "**/round"], "overlaps 'cbef/mine/agent/0/\\*\\*'"),
    ],
)
def test_keys_that_cannot_be_recorded_are_refused(wanted: list[str], words: str) -> None:
    with pytest.raises(UserError, match=words):
        recorded_keys("mine", wanted)


def test_an_event_or_signal_is_recorded_under_its_own_expression_alone() -> None:
    several = ["cbef/mine/beacon/**", EVENTS]
    assert belongs("cbef/mine/event/target", EVENTS, several)
    assert not belongs("cbef/mine/event/target", "cbef/mine/**", ["cbef/mine/**", EVENTS])
    assert belongs("cbef/mine/event/target", "cbef/mine/**", ["cbef/mine/**"])
    assert not belongs("cbef/mine/beacon/1/signal", "cbef/mine/beacon/**", ["cbef/mine/beacon/**", SIGNALS])
    assert belongs("cbef/mine/beacon/1/signal", SIGNALS, [SIGNALS])
    assert belongs("cbef/mine/beacon/1/signal", "cbef/mine/beacon/**", several)
    assert belongs("cbef/mine/beacon/1", "cbef/mine/beacon/**", [*several, SIGNALS])
    assert belongs("cbef/mine/no/such/key", "cbef/mine/**", ["cbef/mine/**", EVENTS])


def test_a_key_is_covered_by_any_expression_that_includes_it() -> None:
    covers = covering(["cbef/mine/agent/*/round", "cbef/mine/faults"])
    assert covers("cbef/mine/agent/3/round") is True
    assert covers("cbef/mine/faults") is True
    assert covers("cbef/mine/agent/3/range") is False
    assert covers("//") is False
    with pytest.raises(zenoh.ZError):
        covering(["//"])


@pytest.mark.parametrize(
    ("wanted", "parts"),
    [
        ([], (["agent/**"], ["target/**", "beacon/*"], ["beacon/*/signal", "event/**", "faults"])),
        (["agent/0/**", "target/**"], (["agent/0/**"], ["target/**"], ["event/**", "beacon/*/signal"])),
        (["*/7/**"], (["agent/7/**"], ["beacon/7"], ["event/**", "beacon/*/signal"])),
        (["beacon/7"], ([], ["beacon/7"], ["event/**", "beacon/*/signal"])),
        (["beacon/7/**"], ([], [], ["beacon/7/**", "event/**", "beacon/*/signal"])),
        (["*/*/round"], ([], [], ["*/*/round", "event/**", "beacon/*/signal"])),
    ],
)
def test_what_agents_and_the_target_publish_is_told_apart(wanted: list[str], parts: tuple[list[str], ...]) -> None:
    found = apart("mine", recorded_keys("mine", wanted))
    assert found == tuple([f"cbef/mine/{one}" for one in part] for part in parts)
