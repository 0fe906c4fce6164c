"""A viewer that speaks Foxglove's WebSocket protocol, and what the export for viewers holds."""

import json
import struct
from base64 import b64decode
from collections import defaultdict
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from zenoh_cbef.viewers.scene import read_scene
from zenoh_cbef.viewers.viz import write_viz

client = pytest.importorskip("websockets.sync.client", reason="the extra 'lab' is not installed")
factory = pytest.importorskip("mcap_protobuf.decoder", reason="the extra 'viz' is not installed")


class Viewer:
    """A viewer that is connected. info: what the server says of itself."""

    def __init__(self, port: int) -> None:
        self._held = ExitStack()
        connection = client.connect(f"ws://127.0.0.1:{port}", subprotocols=["foxglove.sdk.v1"], max_size=None)
        self._socket = self._held.enter_context(connection)
        self.info = self.told("serverInfo")

    def told(self, operation: str) -> dict[str, Any]:
        """The next words of the server of this kind."""
        while True:
            data = self._socket.recv(timeout=100)
            if isinstance(data, str) and (words := json.loads(data))["op"] == operation:
                return dict(words)

    def say(self, **words: object) -> None:
        self._socket.send(json.dumps(words))

    def channels(self, count: int) -> dict[str, dict[str, Any]]:
        """Channels by topic, when there are so many."""
        found: dict[str, dict[str, Any]] = {}
        while len(found) < count:
            found |= {one["topic"]: one for one in self.told("advertise")["channels"]}
        return found

    def message(self) -> tuple[int, int, bytes]:
        """Subscription, time and content of the next message."""
        while True:
            data = self._socket.recv(timeout=100)
            if isinstance(data, bytes) and data[0] == 1:
                at, time = struct.unpack("<IQ", data[1:13])
                return at, time, data[13:]

    def ordered(self, service: int, **order: object) -> dict[str, Any]:
        """What a service answers to an order."""
        self._socket.send(b"\x02" + struct.pack("<III", service, 1, 4) + b"json" + json.dumps(order).encode())
        while True:
            data = self._socket.recv(timeout=100)
            if isinstance(data, bytes) and data[0] == 3:
                return dict(json.loads(data[13 + struct.unpack("<I", data[9:13])[0] :]))

    def close(self) -> None:
        self._held.close()


def decoded(channel: dict[str, Any], data: bytes) -> Any:
    """A message of a channel."""

    class Schema:
        id, name, encoding, data = channel["id"], channel["schemaName"], "protobuf", b64decode(channel["schema"])

    return factory.DecoderFactory().decoder_for("protobuf", Schema)(data)


def exported(log: Path, output: Path) -> dict[tuple[str, str, bytes], dict[int, list[bytes]]]:
    """Of each topic of the export: its schema and its description, and messages by time."""
    found: dict[tuple[str, str, bytes], dict[int, list[bytes]]] = defaultdict(lambda: defaultdict(list))
    write_viz(read_scene(log), output)
    with output.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            assert schema is not None
            found[channel.topic, schema.name, schema.data][message.log_time].append(message.data)
    return dict(found)


def exported_messages(log: Path, output: Path) -> dict[str, list[Any]]:
    """The messages of each topic of the export."""
    found = defaultdict(list)
    write_viz(read_scene(log), output)
    with output.open("rb") as stream:
        for _, channel, _, message in make_reader(
            stream, decoder_factories=[factory.DecoderFactory()]
        ).iter_decoded_messages():
            found[channel.topic].append(message)
    return dict(found)
