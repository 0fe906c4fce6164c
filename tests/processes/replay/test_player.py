"""The player's clock and steps, without network: times are counted from the last change on, so nothing adds up."""

import threading
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from zenoh_cbef.log.tools.playlist import Item
from zenoh_cbef.nodes.replay import player as module
from zenoh_cbef.nodes.replay.player import Player, Timeline

SECOND = 1_000_000_000
CHANGES = st.lists(
    st.tuples(st.floats(0.0, 100.0), st.sampled_from(["pause", "resume", "rate", "seek"]), st.floats(0.1, 50.0)),
    max_size=20,
)


class Clock:
    """A monotonic clock that is set by hand."""

    def __init__(self) -> None:
        self.now = 1000.0

    def monotonic(self) -> float:
        return self.now


@given(CHANGES)
def test_the_log_time_is_the_integral_of_the_rate(changes):
    clock = Clock()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "time", clock)
        line = Timeline(5 * SECOND, 1.0, runs=True)
        position, rate, runs = 5.0, 1.0, True
        for passed, change, value in changes:
            clock.now += passed
            position += passed * rate * runs
            if change in ("pause", "resume"):
                runs = change == "resume"
                line.change(runs=runs)
            elif change == "rate":
                rate = value
                line.change(rate=value)
            else:
                position = value
                line.change(position=round(value * SECOND))
            assert abs(line.now() / SECOND - position) < 1e-6
            if runs:
                assert abs(line.left(round((position + 3.0) * SECOND)) - 3.0 / rate) < 1e-6


def played(steps: list[int], orders, *, loop: bool = False) -> list[int]:
    """The places of the messages that were played; orders(player) is called at each one, before the next."""
    items = [Item("key", place, b"", step) for place, step in enumerate(steps)]
    heard: list[int] = []

    def publish(item: Item) -> None:
        heard.append(item.log_time)
        orders(player, heard)

    player = Player(
        lambda since, until: (item for item in items if since <= item.log_time <= until),
        publish,
        origin=0,
        begin=0,
        end=len(items),
        loop=loop,
    )
    runner = threading.Thread(target=player.run, daemon=True)
    runner.start()
    runner.join(timeout=100)
    assert not runner.is_alive()
    return heard


@given(st.lists(st.integers(0, 3), min_size=1, max_size=30))
def test_everything_is_played_once_in_order(growth):
    steps = [sum(growth[: place + 1]) for place in range(len(growth))]
    assert played(steps, lambda _player, _heard: None) == list(range(len(steps)))


@given(st.lists(st.integers(0, 2), min_size=1, max_size=20))
def test_single_steps_and_messages_leave_nothing_out(growth):
    steps = [sum(growth[: place + 1]) for place in range(len(growth))]

    def orders(player: Player, heard: list[int]) -> None:
        # Another order before the last one is used up: they add up.
        (player.step if len(heard) % 3 else player.next)()

    assert played(steps, orders) == list(range(len(steps)))


def test_a_step_ends_where_a_message_begins_the_next():
    steps = [0, 0, 1, 0, 1, 2, 0, 2, 3, 0]
    stops = []

    def orders(player: Player, heard: list[int]) -> None:
        if len(heard) == 1:
            player.pause()
            threading.Thread(target=press, args=(player, heard), daemon=True).start()

    def press(player: Player, heard: list[int]) -> None:
        for _ in range(4):
            player.step()
            while player.state().state == "stepping":
                time.sleep(0.001)
            stops.append(len(heard))

    assert played(steps, orders) == list(range(len(steps)))
    assert stops[:3] == [2, 5, 8]


def test_seeking_goes_back_and_forth_and_a_loop_begins_again():
    def orders(player: Player, heard: list[int]) -> None:
        if len(heard) == 4:
            player.seek(1 / SECOND)
        elif len(heard) == 6:
            player.seek(8 / SECOND)
        elif len(heard) == 11:
            player.stop()

    assert played([0] * 10, orders, loop=True) == [0, 1, 2, 3, 1, 2, 8, 9, 0, 1, 2]
