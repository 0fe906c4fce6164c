"""What the lab has open, for viewers that speak Foxglove's WebSocket protocol: Foxglove, Lichtblick, PlotJuggler."""

from __future__ import annotations

import json
import threading
from contextlib import suppress
from typing import TYPE_CHECKING, Self

from zenoh_cbef.errors import UserError
from zenoh_cbef.extras import from_extra
from zenoh_cbef.lab.answers import Page
from zenoh_cbef.lab.bench import Bench
from zenoh_cbef.lab.guard import Guard
from zenoh_cbef.lab.sources import LIVE, Source
from zenoh_cbef.plain import read_json
from zenoh_cbef.viewers.colours import TRAIL
from zenoh_cbef.viewers.drawing import Drawing
from zenoh_cbef.viewers.growing import GrowingScene

if TYPE_CHECKING:
    import foxglove
    import foxglove.websocket

ORDERS = frozenset({"fault", "undo", "clear", "stop", "hold"})
_LOOK_SECONDS = 0.03
_AT_ONCE = 200
"""Steps that the centralised filter takes while the page waits."""
_WORDS = "what viewers hear live"


class Foxglove:
    """A server of its own beside the page's. Use as a context manager.

    Steps of a run that goes on are sent as they are concluded; a log is played at its own pace from the moment when a
    viewer subscribes, and from its beginning again when all have left. orders: with what orders of viewers are checked;
    None refuses all. Raises UserError where the port is taken, MissingExtra without the extra `foxglove`.
    """

    def __init__(self, bench: Bench, host: str, port: int, orders: Guard | None) -> None:
        self._bench, self._page, self._orders = bench, Page(bench), orders
        self._foxglove = from_extra("foxglove", _WORDS)
        self._context = self._foxglove.Context()
        self._over = threading.Event()
        try:
            self._server: foxglove.websocket.WebSocketServer = self._foxglove.start_server(
                name="zenoh-cbef lab", host=host, port=port, context=self._context, **self._offered()
            )
        except RuntimeError as error:
            raise UserError(f"viewers cannot be served on port {port}: {error}; choose another port") from None
        self.port = self._server.port
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
        self._server.stop()

    def _offered(self) -> dict[str, object]:
        """What viewers may do: nothing, unless orders are taken."""
        if self._orders is None:
            return {}
        websocket = from_extra("foxglove.websocket", _WORDS)
        schema = websocket.ServiceSchema(name="/lab/order")
        service = websocket.Service(name="/lab/order", schema=schema, handler=self._answer)
        return {
            "capabilities": [websocket.Capability.Services],
            "supported_encodings": ["json"],
            "services": [service],
        }

    def _answer(self, request: foxglove.ServiceRequest) -> bytes:
        """An order of a viewer: the table that the page sends, and the token of the lab's address."""
        try:
            asked = read_json(request.payload.decode())
        except (ValueError, KeyError):
            asked = None
        try:
            if not isinstance(asked, dict) or asked.get("ask") not in ORDERS:
                raise UserError(f"an order is a JSON table whose 'ask' is one of {', '.join(sorted(ORDERS))}")
            token = asked.get("token")
            if self._orders is None or not self._orders.knows(token if isinstance(token, str) else None):
                raise UserError("the order lacks the token of the lab's address")
            told = self._page.order(asked)
        except UserError as error:
            told = {"error": str(error)}
        return json.dumps(told).encode()

    def _run(self) -> None:
        number = 0
        while not self._over.wait(_LOOK_SECONDS):
            source = self._bench.source
            if source is None or number == self._bench.number:
                continue
            number = self._bench.number
            # A source that is closed meanwhile has nothing more to show.
            with suppress(UserError):
                self._show(source, number)

    def _gone(self, number: int, seconds: float) -> bool:
        """Wait; whether the lab ends, or has opened something else."""
        return self._over.wait(seconds) or self._bench.number != number

    def _show(self, source: Source, number: int) -> None:
        while not source.scene.newest or source.state == "is read":
            if self._gone(number, _LOOK_SECONDS):
                return
        growing = GrowingScene(source.scene.recording)
        with source.lock:
            shown = source.scene.newest - 1 if source.live else 0
            drawing = Drawing(growing.stretch(shown, shown + 1))
        shower = _Shower(self._channels(drawing), growing, drawing, source)
        self._server.clear_session()
        pace = _LOOK_SECONDS if source.live else source.scene.plan.scenario.dt
        try:
            while not self._gone(number, pace):
                shower.go_on()
        finally:
            for channel in shower.channels.values():
                channel.close()

    def _channels(self, drawing: Drawing) -> dict[str, foxglove.Channel]:
        made = {}
        for topic, kind in drawing.topics.items():
            schema = self._foxglove.Schema(
                name=kind.DESCRIPTOR.full_name, encoding="protobuf", data=drawing.schema_of(kind)
            )
            made[topic] = self._foxglove.Channel(
                topic, schema=schema, message_encoding="protobuf", context=self._context
            )
        return made


class _Shower:
    """Sends the steps of one source. shown: the last one that was sent, or passed over as no viewer was there."""

    def __init__(
        self, channels: dict[str, foxglove.Channel], growing: GrowingScene, drawing: Drawing, source: Source
    ) -> None:
        self.channels, self._growing, self._drawing, self._source = channels, growing, drawing, source
        self.shown, self._seen = 0, False

    def go_on(self) -> None:
        """Send what is new of a run, or the next step of a log."""
        scene, live = self._source.scene, self._source.live
        with self._source.lock:
            ended = self._source.state not in LIVE
            newest = scene.newest if ended else self._growing.settled(min(self.shown, scene.newest), scene.newest)
        wanted = {topic for topic, channel in self.channels.items() if channel.has_sinks()}
        if not wanted:
            self.shown, self._seen = (newest if live else 0), False
            return
        if not self._seen:
            # Further channels of the same viewer may still be on their way.
            self._seen = True
            self._begin(max(newest - 1, 0) if live else 0)
            return
        until = newest if live else min(self.shown + 1, newest)
        if until > self.shown:
            with self._source.lock:
                part = self._growing.stretch(self.shown, until, whole=ended and until == newest)
            for time, topic, make in self._drawing.messages(part):
                if topic in wanted:
                    self.channels[topic].log(make().SerializeToString(), log_time=time)
            self.shown = until

    def _begin(self, step: int) -> None:
        """Go on after a step, with the paths that lead there."""
        while self._growing.reached < step:
            with self._source.lock:
                self._growing.reach(min(self._growing.reached + _AT_ONCE, step))
        with self._source.lock:
            self._drawing.remember(self._growing.stretch(max(step - TRAIL, 0), step))
        self.shown = step
