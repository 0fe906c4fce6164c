"""What processes and the target tell each other of places is taken as it was meant, or refused."""

from __future__ import annotations

from typing import Any

import msgpack
import pytest

from zenoh_cbef.protocol.addresses import with_ports
from zenoh_cbef.protocol.directory import MOST_ENDPOINTS, Place, _packed, _read_answer, _read_question
from zenoh_cbef.protocol.lives import connects, is_life, new_life, router_life
from zenoh_cbef.protocol.messages import VERSION, BadMessage
from zenoh_cbef.protocol.session import Connection

PLACE = Place("agent/3", "c0ffee", "host", ("tcp/10.0.0.1:7", "tls/[::1]:8"), "51")
ENDPOINT = "tcp/10.0.0.1:7"


def question(place: object = None, **more: object) -> bytes:
    whole = {"v": VERSION, "place": place or _packed(PLACE), "unlinked": ["agent/1"], "heard": ["agent/2"]}
    return msgpack.packb({**whole, **more})


def changed(number: int, value: object) -> list[object]:
    return [value if place == number else one for place, one in enumerate(_packed(PLACE))]


def test_a_question_is_read_as_it_was_asked() -> None:
    assert _read_question("agent/3", question()) == (PLACE, ("agent/1",), ("agent/2",))
    nowhere = Place("agent/3", "c0ffee", "host", (ENDPOINT,) * MOST_ENDPOINTS)
    assert _read_question("agent/3", question(_packed(nowhere)))[0] == nowhere


@pytest.mark.parametrize(
    "data",
    [
        question(changed(0, "agent/4")),
        question(changed(1, "life!")),
        question(changed(1, "c" * 41)),
        question(changed(2, "h" * 201)),
        question(changed(2, 5)),
        question(changed(3, ["tcp/10.0.0.1"])),
        question(changed(3, [ENDPOINT, "udp/10.0.0.1:7"])),
        question(changed(3, [ENDPOINT] * (MOST_ENDPOINTS + 1))),
        question(changed(3, ENDPOINT)),
        question(changed(4, "no site")),
        question(_packed(PLACE)[:4]),
        question({"name": "agent/3"}),
        question(unlinked="agent/1"),
        question(heard=[1]),
        question(v=VERSION + 1),
        msgpack.packb([1]),
    ],
)
def test_a_question_that_is_not_as_promised_is_refused(data: bytes) -> None:
    with pytest.raises(BadMessage):
        _read_question("agent/3", data)


def test_an_answer_is_read_as_it_was_given() -> None:
    told = _read_answer(
        msgpack.packb({"v": VERSION, "places": [_packed(PLACE)], "detours": {"agent/1": True, "agent/2": 1}})
    )
    assert (told.places, told.detours) == ([PLACE], {"agent/1": True, "agent/2": False})


@pytest.mark.parametrize(
    "change", [{"places": {}}, {"detours": []}, {"detours": {1: True}}, {"places": [[]]}, {"v": 0}]
)
def test_an_answer_that_is_not_as_promised_is_refused(change: dict[str, Any]) -> None:
    with pytest.raises(BadMessage):
        _read_answer(msgpack.packb({"v": VERSION, "places": [], "detours": {}, **change}))


def test_places_share_a_site_where_no_router_parts_them() -> None:
    here, there, none = (Place("a", "1", "h", (), site) for site in ("51", "52", ""))
    assert [one.shares_site(other) for one, other in ((here, here), (here, there), (here, none), (none, none))] == [
        *(True, False, True, True)
    ]


def test_an_id_tells_that_it_was_made_here_and_how_far_a_process_is_reached() -> None:
    ranks = {
        "tcp/127.0.0.1:1": "03",
        "tcp/10.0.0.1:1": "02",
        "tcp/[fd00::1]:1": "02",
        "tcp/8.8.8.8:1": "01",
        "tcp/example.org:1": "01",
    }
    for endpoint, rank in ranks.items():
        life = new_life([endpoint])
        assert (len(life), life[-2:]) == (32, rank)
        assert is_life(life)
        # Zenoh writes no leading zero.
        assert is_life("0" + life[1:])
        assert is_life(life[1:])
        assert not is_life(life[2:])
        assert not is_life(life[:-2] + "04")
        assert not is_life(life[:-4] + "0c" + rank)
    assert not is_life(router_life(carries=True))
    assert [router_life(carries=carries)[-4:] for carries in (True, False)] == ["ffff", "0000"]


def test_a_process_that_nothing_was_said_to_listens_on_loopback_and_knows_that_it_chose_so() -> None:
    chosen, asked = with_ports(Connection()), with_ports(Connection(listen=["tcp/127.0.0.1:0"]))
    assert (chosen.unasked, asked.unasked) == (True, False)
    for one in (chosen, asked):
        [endpoint] = one.listen
        assert endpoint.startswith("tcp/127.0.0.1:")
        assert not endpoint.endswith(":0")


def test_a_detour_is_a_client_of_the_target_alone() -> None:
    detour = Connection(["tcp/10.0.0.2:1"], [ENDPOINT], life="c0").detour_by("tcp/10.0.0.1:1")
    assert detour == Connection(["tcp/10.0.0.1:1"], mode="client", gossip=False, detour=True)


@pytest.mark.parametrize(("chosen", "first"), [(lambda most: most - 1, "f"), (lambda _: 0, "1")])
def test_an_id_begins_with_no_zero_and_has_its_length_however_it_is_drawn(
    monkeypatch: pytest.MonkeyPatch, chosen: Any, first: str
) -> None:
    monkeypatch.setattr("secrets.randbelow", chosen)
    for life in (new_life([ENDPOINT]), router_life(carries=True), router_life(carries=False)):
        assert (len(life), life[0]) == (32, first)


def test_ids_are_compared_as_numbers_whose_least_byte_comes_first() -> None:
    assert connects("01ff", "ff01") is True
    assert connects("1ff", "ff01") is True  # Zenoh writes no leading zero
    assert connects("ff01", "1ff") is False
    assert connects("1ff", "01ff") is False
    assert connects("2", "1") is True


def test_the_longest_text_of_a_place_has_200_characters() -> None:
    assert _read_question("agent/3", question(changed(2, "h" * 200)))[0].host == "h" * 200
