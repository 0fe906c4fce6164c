"""The replay process: publishes a recorded run again, with its timing and byte for byte."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from math import inf, isfinite
from typing import TypeVar

from zenoh_cbef import __version__
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.common.naming import RESOLVED, SOURCE
from zenoh_cbef.log.read.parts import Log
from zenoh_cbef.log.tools.playlist import Playlist, Selection
from zenoh_cbef.nodes.common.node import Identity, Node
from zenoh_cbef.nodes.replay.player import Player, PlayerState
from zenoh_cbef.outside.keyboard import DOWN, RIGHT, SPACE, UP, Keyboard
from zenoh_cbef.protocol.keys import Keys, run_of
from zenoh_cbef.protocol.relay import Relay
from zenoh_cbef.protocol.replay_service import Orders, serve_replay
from zenoh_cbef.protocol.scenario_service import ScenarioText, serve_scenario

_FASTER = 1.1
_POLL_SECONDS = 0.05
_REPORT_SECONDS = 0.1

_Number = TypeVar("_Number", int, float)


@dataclass(frozen=True, kw_only=True)
class Playback:
    """How a log is played. start_offset, duration, delay: s; duration None: to the end, delay before the first.

    wait: for a subscriber, before anything is published. linger: s to stay after the last message while there are
    subscribers, as a session that closes takes along what is still on its way. keyboard: obey keys, on a terminal.
    """

    rate: float = 1.0
    loop: bool = False
    start_offset: float = 0.0
    duration: float | None = None
    start_paused: bool = False
    delay: float = 0.0
    wait: bool = False
    linger: float = 1.0
    keyboard: bool = True


def replay_run(run: str, selection: Selection) -> str:
    """The name under which a run is played, which a remap may change."""
    renamed = run_of(key := selection.renamed(Keys(run).replay))
    return renamed if renamed is not None and key == Keys(renamed).replay else run


def run_replay(
    identity: Identity,
    file: Log,
    selection: Selection,
    how: Playback,
    report: Callable[[PlayerState], None],
) -> tuple[PlayerState, bool]:
    """Play a log to its end or until told to stop; returns the last state, and whether it came to the end."""
    playlist = Playlist(file, selection)
    begin = playlist.start + round(1e9 * how.start_offset)
    length = (playlist.end - playlist.start) / 1e9
    if begin > playlist.end:
        raise UserError(f"--start-offset {how.start_offset:g} is beyond the log's {length:.3f} s; lower it")
    end = playlist.end if how.duration is None else min(playlist.end, begin + round(1e9 * how.duration))
    with Node(identity) as node:
        node.refuse_twin()
        relay = Relay(node.session, playlist.keys)
        player = Player(
            playlist.items,
            lambda item: relay.publish(item.key, item.data),
            origin=playlist.start,
            begin=begin,
            end=end,
            rate=how.rate,
            loop=how.loop,
            paused=how.start_paused,
        )
        node.on_stop(player.stop)
        resolved = file.attachments[RESOLVED]
        source = file.attachments.get(SOURCE, resolved)
        text = ScenarioText(source.decode(errors="replace"), resolved.decode(errors="replace"), __version__)
        services = [
            serve_replay(node.session, identity.run, lambda orders: _obey(player, orders)),
            serve_scenario(node.session, identity.run, lambda: text),
        ]
        node.presence.enter(f"replay/{identity.name}")
        with Keyboard(_actions(player) if how.keyboard else {}):
            _play(node, relay, player, how, report)
        for service in services:
            service.undeclare()
        node.presence.leave(f"replay/{identity.name}")
        return player.state(), player.ended


def _play(node: Node, relay: Relay, player: Player, how: Playback, report: Callable[[PlayerState], None]) -> None:
    over = threading.Event()

    def tick() -> None:
        while not over.wait(_REPORT_SECONDS):
            report(player.state())

    ticker = threading.Thread(target=tick, daemon=True)
    ticker.start()
    try:
        _sleep(node, inf if how.wait else 0.0, lambda: not relay.heard)
        _sleep(node, how.delay)
        player.run()
        _sleep(node, how.linger, lambda: relay.heard)
    finally:
        over.set()
        ticker.join()
        report(player.state())


def _sleep(node: Node, seconds: float, still: Callable[[], bool] = lambda: True) -> None:
    """Wait until told to stop, or a condition no longer holds."""
    until = time.monotonic() + seconds
    while not node.stopping and (left := until - time.monotonic()) > 0.0 and still():
        time.sleep(min(left, _POLL_SECONDS))


def _actions(player: Player) -> dict[str, Callable[[], None]]:
    return {
        SPACE: player.toggle,
        RIGHT: player.step,
        "n": player.next,
        UP: lambda: player.scale_rate(_FASTER),
        DOWN: lambda: player.scale_rate(1.0 / _FASTER),
    }


def _obey(player: Player, orders: Orders) -> Mapping[str, object]:
    """Carry out a query's orders, and return the replay's state after them. Raises UserError."""
    plain = {"pause": player.pause, "resume": player.resume, "toggle": player.toggle}
    numbered: dict[str, Callable[[str], None]] = {
        "next": lambda value: player.next(_number("next", value or "1", int)),
        "step": lambda value: player.step(_number("step", value or "1", int)),
        "rate": lambda value: player.set_rate(_number("rate", value, float)),
        "seek": lambda value: player.seek(_number("seek", value, float)),
    }
    for what, value in orders:
        if what in plain and not value:
            plain[what]()
        elif what in numbered:
            numbered[what](value)
        else:
            raise UserError(f"{what!r} is nothing a replay can do; it knows {', '.join((*plain, *numbered))}")
    return asdict(player.state())


def _number(what: str, value: str, kind: Callable[[str], _Number]) -> _Number:
    with suppress(ValueError):
        number = kind(value)
        if isfinite(number) and number >= 0:
            return number
    raise UserError(f"{what}={value} is not a number from 0 on; write it as in {what}=2")
