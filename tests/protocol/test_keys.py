"""Keys are read by one pattern, which takes what a run has and nothing else, and raises for no text at all."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from zenoh_cbef.protocol.keys import Address, Keys, address, agent_named, matches, run_of
from zenoh_cbef.protocol.tokens import can_be_claimed

RUNS = st.text(st.characters(exclude_characters="/", codec="utf-8"), min_size=1, max_size=20)
AGENTS = st.integers(0, 999)
OF_AGENTS = ("beacon", "signal", "range", "round", "estimate", "smoothed")
PARTS = st.one_of(
    st.sampled_from(["cbef", "run", "agent", "target", "truth", "faults", "event", "record", *OF_AGENTS, ""]),
    st.integers().map(str),
    st.text(max_size=5),
    st.integers(4000, 6000).map("9".__mul__),
)


@pytest.mark.slow
@given(RUNS, AGENTS)
def test_every_key_of_a_run_is_read_as_what_it_was_made_of(run, agent):
    keys = Keys(run)
    owner = f"agent/{agent}"
    assert address(keys.truth) == Address(run, "truth", "target")
    assert address(keys.faults) == Address(run, "faults", "target")
    for sender in ("target", owner, "record", "record/host-b", "replay", "receiver/3"):
        assert address(keys.event(sender)) == Address(run, "event", sender)
    assert address(f"{keys.root}/event") == Address(run, "event", "")
    assert address(keys.signal(agent)) == Address(run, "signal", "target", agent)
    assert address(keys.beacon(agent)) == Address(run, "beacon", "", agent)
    assert address(keys.range(agent)) == Address(run, "range", owner, agent)
    assert address(keys.round(agent)) == Address(run, "round", owner, agent)
    assert address(keys.estimate(agent)) == Address(run, "estimate", owner, agent)
    assert address(keys.smoothed(agent)) == Address(run, "smoothed", owner, agent)
    assert {run_of(key) for key in (keys.truth, keys.scenario, keys.control, keys.target_live)} == {run}
    assert agent_named(owner) == agent


@given(st.one_of(st.text(), st.lists(PARTS, max_size=6).map("/".join), PARTS.map("cbef/run/agent/{}/round".format)))
def test_any_text_is_a_key_of_a_run_or_none(text):
    found = address(text)
    if found is not None:
        assert run_of(text) == found.run
        assert text in {
            *(getattr(Keys(found.run), name) for name in ("truth", "faults")),
            *(getattr(Keys(found.run), name)(found.agent) for name in OF_AGENTS),
            *(f"{Keys(found.run).root}/event", Keys(found.run).event(found.owner)),
        }
    named = agent_named(text)
    assert named is None or text == f"agent/{named}"


@pytest.mark.parametrize("number", ["9" * 5000, "01", "٣", "²", "+1", "-1", " 1", "1_0", "", "1\n", "1000"])
def test_no_agent_has_a_number_written_otherwise(number):
    for key in (f"cbef/run/agent/{number}/round", f"cbef/run/beacon/{number}"):
        assert address(key) is None
        assert run_of(key) == "run"
    assert agent_named(f"agent/{number}") is None


@pytest.mark.parametrize(
    "text",
    [
        *("", "/", "cbef", "cbef/run", "cbef//event", "cbef/run/", "other/run/event", "cbef/run/event/"),
        *("cbef/run/event/x", "cbef/run/event/record/a/b", "cbef/run/event/receiver/*"),
    ],
)
def test_what_is_no_key_of_a_run_has_no_address(text):
    assert address(text) is None


def test_a_key_is_of_its_owner_and_beacons_are_of_all_but_agents():
    keys = Keys("run")
    for key, may, may_not in (
        (keys.round(3), ["agent/3"], ["agent/4", "target", None, 3]),
        (keys.truth, ["target"], ["agent/3"]),
        (keys.beacon(3), ["target", "receiver/3"], ["agent/3", None, 3]),
        (f"{keys.root}/event", ["agent/3", "target", "record/a"], [None, 3]),
    ):
        found = address(key)
        assert found is not None
        assert [found.is_of(sender) for sender in (*may, *may_not)] == [True] * len(may) + [False] * len(may_not)


def test_a_name_is_chosen_by_who_is_neither_an_agent_nor_the_target():
    def at(key):
        found = address(f"cbef/run/{key}")
        assert found is not None
        return found

    chosen = ["event/record/a", "event/replay"]
    given = ["event/target", "event/agent/3", "beacon/3", "event", "agent/3/round"]
    assert [at(key).chosen for key in (*chosen, *given)] == [True] * 2 + [False] * 5
    assert Address("run", "event", "").agent == at("event").agent == -1


def test_agents_and_recorders_claim_their_names():
    names = ["agent/0", "agent/999", "record/a", "record", "agent/1000", "target", "receiver/a", "record/*"]
    assert [can_be_claimed(name) for name in names] == [True] * 3 + [False] * 5


@pytest.mark.parametrize(
    ("expression", "inside", "outside"),
    [
        ("a/b", ["a/b"], ["a", "a/b/c", "a/c", "xa/b"]),
        ("a/*", ["a/b"], ["a", "a/b/c", "a/"]),
        ("a/**", ["a", "a/b", "a/b/c"], ["b", "ab"]),
        ("**/c", ["c", "a/c", "a/b/c"], ["a/b", "xc"]),
        ("a/x$*y", ["a/xy", "a/xzzy"], ["a/x/y", "a/xz"]),
        ("a/b.c", ["a/b.c"], ["a/bxc"]),
    ],
)
def test_an_expression_stands_for_keys_as_zenoh_says(expression, inside, outside):
    assert all(matches(expression, key) for key in inside)
    assert not any(matches(expression, key) for key in outside)


def test_what_all_agents_say_has_a_key_expression_of_each_kind():
    keys = Keys("test")
    for every, one, other in (
        (keys.all_estimates, keys.estimate(3), keys.range(3)),
        (keys.all_ranges, keys.range(3), keys.estimate(3)),
    ):
        assert (matches(every, one), matches(every, other)) == (True, False)
