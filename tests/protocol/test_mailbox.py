"""A mailbox between real sessions: order, wake-ups, and empty messages, which senders may send, too."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor

import pytest
import zenoh

from tests.protocol.conftest import Pair
from tests.waiting import until
from zenoh_cbef.protocol.mailbox import CAPACITY, Mailbox

KEY = "cbef/test/agent/3/round"


def meet(there: zenoh.Session, mailbox: Mailbox) -> None:
    """Wait until what one session sends gets to the other's mailbox."""

    def comes() -> bool:
        there.put(KEY, b"hello")
        return mailbox.poll() == b"hello"

    until(comes)
    time.sleep(0.05)
    while mailbox.poll() is not None:
        pass


def test_messages_come_in_order_and_an_empty_one_is_a_message(pair: Pair) -> None:
    here, there = pair
    mailbox = Mailbox(here, "cbef/test/agent/*/round")
    meet(there, mailbox)
    for data in (b"1", b"", b"3", b"", b"5"):
        there.put(KEY, data, congestion_control=zenoh.CongestionControl.BLOCK)
    assert [mailbox.receive() for _ in range(2)] == [b"1", b""]
    assert until(mailbox.poll) == b"3"
    assert mailbox.receive_from() == (KEY, b"")
    assert until(mailbox.poll_from) == (KEY, b"5")
    assert mailbox.poll() is None
    assert mailbox.poll_from() is None


@pytest.mark.parametrize("key", [KEY, "cbef/test/agent/*/round", "cbef/test/**", "cbef/test/agent/3/r$*"])
def test_a_wake_up_ends_the_waiting_of_another_thread(pair: Pair, key: str) -> None:
    here, _ = pair
    mailbox = Mailbox(here, key)
    for waits in (mailbox.receive, mailbox.receive_from):
        with ThreadPoolExecutor(1) as pool:
            waiting = pool.submit(waits)
            mailbox.wake()
            assert waiting.result(20) is None
    mailbox.wake()
    mailbox.wake()
    here.put(KEY, b"after")
    assert mailbox.poll_from() == (KEY, b"after"), "wake-ups are for those that wait"
    mailbox.wake()
    here.put(KEY, b"later")
    assert mailbox.poll() is None
    assert mailbox.poll() == b"later"


def test_a_full_mailbox_drops_its_oldest_messages(pair: Pair) -> None:
    here, _ = pair
    small, usual = Mailbox(here, KEY, 3), Mailbox(here, KEY)
    for number in range(CAPACITY + 5):
        here.put(KEY, b"%d" % number)
    assert [small.poll() for _ in range(4)] == [*(b"%d" % (CAPACITY + n) for n in (2, 3, 4)), None]
    assert usual.poll() == b"5"


def test_what_is_followed_is_handed_on_until_the_session_closes(pair: Pair) -> None:
    here, _ = pair
    mailbox, taken = Mailbox(here, KEY), list[bytes]()
    with ThreadPoolExecutor(1) as pool:
        follows = pool.submit(mailbox.follow, taken.append)
        for data in (b"a", b"", b"c"):
            here.put(KEY, data)
        until(lambda: len(taken) == 3)
        mailbox.wake()
        here.put(KEY, b"d")
        until(lambda: len(taken) == 4)
        here.close()
        assert follows.result(20) is None
    assert taken == [b"a", b"", b"c", b"d"]
    mailbox.wake()  # of a closed session: nothing to wake
