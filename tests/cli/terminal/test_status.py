"""A link that has healed looks healed: shares of the last seconds stand beside those since the start."""

import json
from io import StringIO

from rich.console import Console

from zenoh_cbef.cli.terminal.status import headline, links_table
from zenoh_cbef.outside.status import read_status
from zenoh_cbef.protocol.messages import encode
from zenoh_cbef.tracking.diagnostics import NAMES, WHOLE

SECOND = 1_000_000_000


def estimate(sent: int, received: list[int], lost: list[int], late: list[int]) -> bytes:
    """One of agent 0, whose neighbours are 1 and 2."""
    body = {"k": 1, "state": [0.0] * 6, **{name: 0 if name in WHOLE else 0.0 for name in NAMES}}
    counts = {"neighbours": [1, 2], "received": received, "lost": lost, "late": late, "latency": [0.001, 0.002]}
    return encode("r", "agent/0", 0, sent, {**body, **counts, "covariance": None})


def told(latest: bytes, earlier: list[bytes]):
    lists = dict.fromkeys(("live", "silent", "away", "truth", "cards", "events"), ())
    numbers = {"agents": 1, "steps": 100, "dt": 0.1, "step": 1, "start": 0.0, "time": 9.0}
    words = {"run": "r", "filter": "sicf", "mode": "realtime", "planar": False, "stopping": False, "target": {}}
    return {**lists, **numbers, **words, "members": [0], "faults": "[]", "estimates": [latest], "earlier": earlier}


BEFORE = estimate(10 * SECOND, [100, 500], [400, 10], [0, 5])
AFTER = estimate(15 * SECOND, [600, 850], [400, 159], [0, 4])


def test_a_healed_link_is_told_from_one_that_is_failing():
    healed, failing = read_status(told(AFTER, [BEFORE])).links
    assert (healed.received, healed.lost, healed.late) == (600, 400, 0)
    assert (healed.recent_received, healed.recent_lost, healed.recent_late) == (500, 0, 0)
    assert (failing.recent_received, failing.recent_lost, failing.recent_late) == (350, 149, 0)
    assert healed.recent_seconds == failing.recent_seconds == 5.0


def test_what_is_of_another_life_or_not_known_is_left_open():
    restarted = estimate(15 * SECOND, [3, 3], [0, 0], [0, 0])
    for latest, earlier in ((restarted, [BEFORE]), (BEFORE, [BEFORE]), (BEFORE, []), (BEFORE, [b"nonsense"])):
        assert [link.recent_lost for link in read_status(told(latest, earlier)).links] == [None, None]


def test_the_table_has_both_at_80_columns_and_what_fails_now_first():
    console = Console(width=80, record=True, file=StringIO())
    console.print(links_table(read_status(told(AFTER, [BEFORE]))))
    head, first, second, caption = console.export_text().splitlines()
    assert head.split()[:7] == ["from", "to", "received", "lost", "now", "late", "now"]
    assert first.split()[:6] == ["2", "0", "850", "159", "(15.7%)", "29.9%"]
    assert second.split()[:6] == ["1", "0", "600", "400", "(40.0%)", "0"]
    assert "last 5 s" in caption


def test_the_error_of_a_run_is_that_of_its_honest_agents():
    answer = told(AFTER, []) | {"truth": [(1, [3.0, 4.0, 0.0, 0.0, 0.0, 0.0])]}
    assert read_status(answer).error == 5.0
    for kind, error in (("byzantine", None), ("sensor-bias", 5.0), ("of.another:Package", 5.0)):
        faults = json.dumps([{"fault": 0, "kind": kind, "agents": [0]}])
        found = read_status(answer | {"faults": faults})
        assert (found.error, found.agents[0].error) == (error, 5.0)


def test_a_status_says_that_nothing_can_be_seen():
    blind = told(AFTER, []) | {"unobservable": "ranges of 2 agents fit every point of a circle"}
    assert "the position cannot be determined: ranges of 2 agents fit" in headline(read_status(blind)).plain
    assert "determined" not in headline(read_status(told(AFTER, []))).plain


def test_a_fault_that_is_on_is_told_without_the_last_bits_of_its_times():
    faults = json.dumps([{"fault": 2, "kind": "loss", "from": 0.1 * 33, "probability": 0.2}])
    said = headline(read_status(told(AFTER, []) | {"faults": faults})).plain
    assert "fault 2 is on: loss from=3.3 probability=0.2" in said
