"""Where a receiver's bytes come from: a serial port, UDP, or a file. Each goes on after its line was unplugged."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Iterator, Mapping
from enum import Enum, auto
from pathlib import Path

from zenoh_cbef.errors import UserError
from zenoh_cbef.extras import from_extra

_AGAIN = 0.2
"""How long to wait before a port is opened again, or before a source says that it is silent, s."""
_LONGEST = 1 << 16

Stop = Callable[[], bool]


class Mark(Enum):
    """What a source says beside bytes. WHOLE: a datagram or file ends. BROKEN: bytes were lost. SILENT: none come."""

    WHOLE = auto()
    BROKEN = auto()
    SILENT = auto()


Heard = Iterator[bytes | Mark]


def serial_bytes(place: str, stop: Stop) -> Heard:
    """What comes from a serial port, as /dev/ttyUSB0 or /dev/ttyUSB0@921600; opened again where it went."""
    serial = from_extra("serial", "a serial port")
    path, _, rate = place.partition("@")
    if rate and not rate.isdigit():
        raise UserError(f"serial:{place}: {rate} is no rate; write it as in serial:/dev/ttyUSB0@115200")

    def heard() -> Heard:
        while not stop():
            try:
                with serial.Serial(path, int(rate or 115200), timeout=_AGAIN) as port:
                    while not stop():
                        yield port.read(max(1, port.in_waiting)) or Mark.SILENT
            except (serial.SerialException, OSError):
                yield Mark.BROKEN
                time.sleep(_AGAIN)

    return heard()


def udp_bytes(place: str, stop: Stop) -> Heard:
    """The datagrams that come to HOST:PORT."""
    host, _, port = place.rpartition(":")
    if not port.isdigit() or int(port) > 65535:
        raise UserError(f"udp:{place} is not udp:HOST:PORT, as in udp:127.0.0.1:5005")
    receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        receiver.bind((host, int(port)))
    except OSError as error:
        receiver.close()
        raise UserError(f"cannot listen on udp:{place}: {error.strerror}; choose another port") from None

    def heard() -> Heard:
        with receiver:
            receiver.settimeout(_AGAIN)
            while not stop():
                try:
                    yield receiver.recv(_LONGEST)
                    yield Mark.WHOLE
                except TimeoutError:
                    yield Mark.SILENT

    return heard()


def file_bytes(place: str, stop: Stop) -> Heard:
    """What a file holds."""
    try:
        stream = Path(place).open("rb")  # noqa: SIM115 - closed by the caller that reads it to its end
    except OSError as error:
        raise UserError(f"cannot read {place}: {error.strerror}; name a file") from None

    def heard() -> Heard:
        with stream:
            while not stop() and (found := stream.read(_LONGEST)):
                yield found
        yield Mark.WHOLE

    return heard()


SOURCES: Mapping[str, Callable[[str, Stop], Heard]] = {"serial": serial_bytes, "udp": udp_bytes, "file": file_bytes}


def bytes_of(source: str, stop: Stop) -> Heard:
    """What a source such as udp:0.0.0.0:5005 tells. Raises UserError where it is none, before anything is read."""
    kind, separator, place = source.partition(":")
    if kind not in SOURCES or not separator or not place:
        raise UserError(f"{source} is no source; name one as serial:/dev/ttyUSB0, udp:HOST:PORT or file:PATH")
    return SOURCES[kind](place, stop)
