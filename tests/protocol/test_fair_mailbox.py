"""A flood on one key, from a real session, takes no room from the messages of other keys."""

from collections import Counter
from collections.abc import Iterator

import pytest
import zenoh

from tests.processes.conftest import unused_endpoint
from zenoh_cbef.protocol.fair_mailbox import FairMailbox
from zenoh_cbef.protocol.session import Connection, open_session

RUN = "cbef/test"
FLOODED, CALM = f"{RUN}/agent/1/round", f"{RUN}/agent/2/round"
ROOM = 100 * 612


class Post:
    """Sends in blocks, each of which the receiver has before the next is sent."""

    def __init__(self) -> None:
        endpoint = unused_endpoint()
        receiver = open_session(Connection(listen=[endpoint]))
        self.mailbox = FairMailbox(receiver, f"{RUN}/**", 1 << 12, ROOM)
        self._sent = receiver.declare_subscriber("sent", zenoh.handlers.FifoChannel(9))
        # A session that opens now knows of both from the beginning.
        self._sender = open_session(Connection([endpoint]))
        self.sessions = [self._sender, receiver]

    def send(self, *keys: str) -> None:
        # Zenoh keeps the order of a session's messages: when the last is there, all others are.
        for key in (*keys, "sent"):
            self._sender.put(key, bytes(100), congestion_control=zenoh.CongestionControl.BLOCK)
        self._sent.recv()

    def read(self, number: int) -> list[str]:
        got = (self.mailbox.poll_from() for _ in range(number))
        return [one[0] for one in got if one is not None]


@pytest.fixture
def post() -> Iterator[Post]:
    made = Post()
    yield made
    for session in made.sessions:
        session.close()


def test_a_slow_reader_gets_all_messages_of_other_keys_in_a_flood(post: Post) -> None:
    read: list[str] = []
    for _ in range(30):
        post.send(*[FLOODED] * 200, CALM)
        read += post.read(20)  # a tenth of what comes
    read += post.read(1000)
    got = Counter(read)
    assert got[CALM] == 30
    assert 30 * 20 <= got[FLOODED] < 30 * 200


def test_keys_that_a_sender_makes_up_share_one_queue(post: Post) -> None:
    post.send(*(f"{RUN}/made/up/{number}" for number in range(300)))
    post.send(*(f"{RUN}/event/receiver/{number}" for number in range(300)))
    post.send(*[CALM] * 12)
    got = Counter(key.split("/")[2] for key in post.read(1000))
    assert got == {"made": 50, "event": 25, "agent": 12}
    post.send(*[CALM] * 40)  # what was read gives its room back
    assert post.read(1000) == [CALM] * 40


def test_a_message_may_take_all_of_the_room_and_no_more_and_a_wake_up_none() -> None:
    with open_session(Connection()) as session:
        mailboxes = {room: FairMailbox(session, f"{RUN}/**", 9, room) for room in (611, 612)}
        for got in ([None, (CALM, bytes(100))], [None, (CALM, bytes(100))]):
            session.put(CALM, bytes(100))
            assert [mailbox.poll_from() for mailbox in mailboxes.values()] == got
        mailbox = mailboxes[612]
        mailbox.wake()
        assert mailbox.receive_from() is None
        session.put(CALM, b"")
        assert mailbox.receive_from() == (CALM, b""), "an empty message is no wake-up"
