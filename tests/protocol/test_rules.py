"""The rules of access control as Zenoh reads them, without any link: who may do what on which key."""

from __future__ import annotations

import re
from functools import cache
from typing import Any

import pytest
import zenoh

from zenoh_cbef.protocol.access import access_control
from zenoh_cbef.quantities import MOST_AGENTS

RULES: dict[str, Any] = access_control()
RUN = "cbef/mine"
PUTS = ("put", "declare_queryable", "reply")
HEARS = ("declare_subscriber",)
ASKS = ("query", "liveliness_query", "declare_liveliness_subscriber")
LIVES = ("liveliness_token",)
MESSAGES = (*PUTS, *HEARS, *ASKS, *LIVES, "delete")


@cache
def keys_of(name: str, message: str) -> list[zenoh.KeyExpr]:
    """The keys on which a process of this name may send such a message."""
    [policy] = [one for one in RULES["policies"] if one["subjects"] == [name]]
    rules = [one for one in RULES["rules"] if one["id"] in policy["rules"] and "ingress" in one["flows"]]
    assert all(one["permission"] == "allow" for one in rules)
    return [zenoh.KeyExpr(of) for one in rules if message in one["messages"] for of in one["key_exprs"]]


def allowed(name: str, message: str, key: str) -> bool:
    asked = zenoh.KeyExpr(key)
    return any(of.includes(asked) for of in keys_of(name, message))


AGENT = ["agent/7/range", "agent/7/round", "agent/7/estimate", "event/agent/7"]
OTHERS = ["agent/8/range", "agent/8/round", "agent/8/estimate"]
TARGET = ["target/truth", "faults", "beacon/0", "beacon/0/signal", "event/target"]
EVERYTHING: dict[tuple[str, ...], list[str]] = {MESSAGES: ["**"]}
MAY: dict[str, dict[tuple[str, ...], list[str]]] = {
    "agent-7": {
        PUTS: AGENT,
        HEARS: [*OTHERS, "beacon/7", "beacon/7/signal", "faults"],
        ASKS: ["scenario", "claims", "links/agent/7", "live/**", *OTHERS, "beacon/7", "beacon/7/signal", "faults"],
        LIVES: ["live/agent/7", "live/over/agent/7", "live/ready/7", "live/life/agent/7/1", "live/claim/agent/7/1"],
    },
    "target": {
        PUTS: TARGET,
        PUTS[1:]: ["scenario", "claims", "links/agent/7", "links/agent/8", "links/record/a", "control"],
        HEARS: ["**"],
        ASKS: ["scenario", "live/**", *OTHERS, "event/**", *TARGET],
        LIVES: ["live/target/target", "live/over/target/target", "live/life/target/target/1"],
    },
    "record": {
        PUTS: ["event/record", "event/record/a"],
        HEARS: ["**"],
        ASKS: ["scenario", "claims", "links/record/a", "live/**", *OTHERS, "event/**", *TARGET],
        LIVES: ["live/record/a", "live/claim/record/a/1", "live/heard/target/1"],
    },
    "receiver": {
        PUTS[:1]: ["beacon/3", "event/receiver/3"],
        HEARS: ["beacon/*/signal"],
        ASKS: ["scenario", "live/**"],
    },
    "operator": {HEARS: ["**"], ASKS: ["scenario", "control", "replay", "live/**", *OTHERS, "event/**", *TARGET]},
    "router": EVERYTHING,
    "replay": EVERYTHING,
}
KEYS = sorted({key for may in MAY.values() for keys in may.values() for key in keys} | {"agent/8/more", "live/agent/8"})


def likes(name: str, key: str) -> zenoh.KeyExpr:
    """The keys of which this is an example: an agent has a number, and others deal with all agents alike."""
    if key in OTHERS or (name == "agent-7" and key == "agent/7/range"):
        return zenoh.KeyExpr("agent/*/*" if key in OTHERS else "agent/7/*")
    return zenoh.KeyExpr(key if name == "agent-7" else re.sub(r"\b(\d+|a)\b", "*", key))


@pytest.mark.parametrize("name", MAY)
def test_each_role_may_do_what_is_its_own_and_nothing_else(name: str) -> None:
    for messages, keys in MAY[name].items():
        for message, key in ((message, key) for message in messages for key in keys):
            assert allowed(name, message, f"{RUN}/{key}"), (message, key)
    for message in MESSAGES:
        mine = [likes(name, key) for messages, keys in MAY[name].items() if message in messages for key in keys]
        for key in KEYS:
            if not any(one.intersects(zenoh.KeyExpr(key)) for one in mine):
                assert not allowed(name, message, f"{RUN}/{key}"), (message, key)


def test_publications_go_out_only_to_processes_that_may_hear_them_and_all_else_is_free() -> None:
    assert (RULES["enabled"], RULES["default_permission"]) == (True, "deny")
    out, *hears = [one for one in RULES["rules"] if one["flows"] == ["egress"]]
    assert set(out["messages"]) == set(MESSAGES) - {"put"}
    assert (out["permission"], out["key_exprs"]) == ("allow", ["cbef/*/**"])
    assert all(one["messages"] == ["put"] for one in hears)
    keys = {one["id"].removesuffix(" hears"): one["key_exprs"] for one in hears}
    assert keys["agent-3"] == ["cbef/*/beacon/3", "cbef/*/beacon/3/signal", "cbef/*/faults", "cbef/*/agent/*/*"]
    assert keys["receiver"] == ["cbef/*/beacon/*/signal"]
    assert keys["record"] == keys["target"] == keys["router"] == ["cbef/*/**"]
    assert all(one["rules"][-1] == f"{one['id']} hears" for one in RULES["policies"])
    assert all(one["rules"][0] == out["id"] for one in RULES["policies"])
    ids = [one["id"] for one in RULES["rules"]]
    assert len(ids) == len(set(ids))


def test_every_agent_of_the_largest_scenario_has_rules_and_a_subject_of_its_name() -> None:
    names = {f"agent-{agent}" for agent in range(1000)} | set(MAY) - {"agent-7"}
    assert MOST_AGENTS == 1000
    assert {one["id"]: one["cert_common_names"] for one in RULES["subjects"]} == {name: [name] for name in names}
    assert {one["id"] for one in RULES["policies"]} == names
    assert allowed("agent-999", "put", f"{RUN}/agent/999/round")
    assert not allowed("agent-999", "put", f"{RUN}/agent/998/round")


def test_what_no_rule_allows_is_denied() -> None:
    assert access_control()["default_permission"] == "deny"
