"""Where a receiver's lines come from: a serial port, UDP, or a file. Each goes on after its line was unplugged."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from zenoh_cbef.errors import UserError
from zenoh_cbef.extras import from_extra

_AGAIN = 0.2
"""How long to wait before a port is opened again, s."""
_LONGEST = 1 << 16

Stop = Callable[[], bool]


def serial_lines(place: str, stop: Stop) -> Iterator[str]:
    """The lines of a serial port, as /dev/ttyUSB0 or /dev/ttyUSB0@921600; opened again where it went."""
    serial = from_extra("serial", "a serial port")
    path, _, rate = place.partition("@")
    if rate and not rate.isdigit():
        raise UserError(f"serial:{place}: {rate} is no rate; write it as in serial:/dev/ttyUSB0@115200")
    while not stop():
        try:
            with serial.Serial(path, int(rate or 115200), timeout=_AGAIN) as port:
                rest = b""
                while not stop():
                    *whole, rest = (rest + port.read(max(1, port.in_waiting)))[-_LONGEST:].split(b"\n")
                    yield from (line.decode(errors="replace") for line in whole)
        except (serial.SerialException, OSError):
            time.sleep(_AGAIN)


def udp_lines(place: str, stop: Stop) -> Iterator[str]:
    """The lines of datagrams that come to HOST:PORT."""
    host, _, port = place.rpartition(":")
    if not port.isdigit():
        raise UserError(f"udp:{place} is not udp:HOST:PORT, as in udp:127.0.0.1:5005")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        try:
            receiver.bind((host, int(port)))
        except OSError as error:
            raise UserError(f"cannot listen on udp:{place}: {error.strerror}; choose another port") from None
        receiver.settimeout(_AGAIN)
        while not stop():
            try:
                yield from receiver.recv(_LONGEST).decode(errors="replace").splitlines()
            except TimeoutError:
                continue


def file_lines(place: str, stop: Stop) -> Iterator[str]:
    """The lines of a file."""
    try:
        with Path(place).open(encoding="utf-8-sig", errors="replace") as stream:
            for line in stream:
                if stop():
                    return
                yield line
    except OSError as error:
        raise UserError(f"cannot read {place}: {error.strerror}; name a file") from None


SOURCES: Mapping[str, Callable[[str, Stop], Iterator[str]]] = {
    "serial": serial_lines,
    "udp": udp_lines,
    "file": file_lines,
}


def lines_of(source: str, stop: Stop) -> Iterator[str]:
    """The lines of a source such as udp:0.0.0.0:5005. Raises UserError where it is none."""
    kind, separator, place = source.partition(":")
    if kind not in SOURCES or not separator or not place:
        raise UserError(f"{source} is no source; name one as serial:/dev/ttyUSB0, udp:HOST:PORT or file:PATH")
    return SOURCES[kind](place, stop)
