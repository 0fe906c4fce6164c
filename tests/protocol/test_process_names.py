"""Names of processes and their tokens: each is told again as it was made, and none is taken for another."""

import pytest

from zenoh_cbef.protocol.tokens import (
    claim_token,
    heard_token,
    in_words,
    is_expected,
    is_recorder,
    is_token,
    leads,
    life_token,
    life_told,
    over_token,
    over_told,
    ready_token,
)


@pytest.mark.parametrize("process", ["agent/3", "target/target", "replay/replay"])
def test_every_token_that_a_process_declares_is_one_that_a_run_can_have(process):
    assert is_token(process, chosen=False)
    assert is_token(over_token(process), chosen=False)
    assert is_token(life_token(process, "ab12"), chosen=True)
    assert is_token(claim_token(process, "ab12"), chosen=True)


def test_ready_agents_and_heard_words_are_tokens():
    assert is_token(ready_token(3), chosen=False)
    assert not is_token(ready_token(1000), chosen=False)
    assert is_token(heard_token("agent/3", 17), chosen=True)
    assert not is_token(heard_token("agent/3", "*"), chosen=True)


def test_a_token_tells_what_was_put_into_it_and_nothing_else():
    assert life_told(life_token("record/host-b", "ab12")) == ("record/host-b", "ab12")
    assert over_told(over_token("agent/3")) == "agent/3"
    for other in ("agent/3", claim_token("agent/3", "ab12"), ready_token(3)):
        assert life_told(other) is None
        assert over_told(other) is None
    assert life_told(over_token("agent/3")) is None
    assert over_told(life_token("agent/3", "ab12")) is None


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("agent/3", "agent 3"),
        ("target/target", "target"),
        ("target", "target"),
        ("record/record", "record"),
        ("record/host-b", "record host-b"),
    ],
)
def test_names_are_read_by_people(name, words):
    assert in_words(name) == words


def test_a_recorder_waits_for_those_that_send_and_for_no_other_recorder():
    names = ["agent/0", "target/target", "replay/replay", "record/a", over_token("agent/0"), ready_token(0)]
    assert [is_expected(name) for name in names] == [True] * 3 + [False] * 3
    assert [leads(name) for name in names] == [False, True, True, False, False, False]
    assert [is_recorder(name) for name in names] == [False] * 3 + [True, False, False]
