"""Sources of receivers: opened again where they went, and refused where they are none."""

import os
import pty
import socket
import threading
import time
import tty

import pytest

from tests.processes.conftest import unused_port
from zenoh_cbef.errors import UserError
from zenoh_cbef.nodes.receiver.sources import Mark, bytes_of


def talk(tag, line, over):
    while not over.wait(0.05):
        os.write(tag, line)


def test_a_serial_port_that_was_unplugged_is_opened_again(tmp_path):
    port = tmp_path / "ttyUSB0"
    heard = bytes_of(f"serial:{port}", lambda: False)
    for number in range(2):
        tag, end = pty.openpty()
        tty.setraw(end)
        port.unlink(missing_ok=True)
        port.symlink_to(os.ttyname(end))
        over = threading.Event()
        # What is written before a port is opened is lost, so the tag says it again and again.
        talking = threading.Thread(target=talk, args=(tag, bytes([65 + number]), over))
        talking.start()
        marks = []
        try:
            while isinstance(piece := next(heard), Mark) or bytes([65 + number]) not in piece:
                marks.append(piece)
        finally:
            over.set()
            talking.join()
        assert number == 0 or Mark.BROKEN in marks, "what was begun is known to be lost"
        os.close(end)
        os.close(tag)


def test_a_datagram_is_whole_and_silence_is_told():
    port = unused_port(socket.SOCK_DGRAM)
    heard = bytes_of(f"udp:127.0.0.1:{port}", lambda: False)
    assert next(heard) is Mark.SILENT
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as tag:
        tag.sendto(b"1,a,2", ("127.0.0.1", port))
        until = time.monotonic() + 60
        while (piece := next(heard)) is Mark.SILENT:
            assert time.monotonic() < until
    assert piece == b"1,a,2"
    assert next(heard) is Mark.WHOLE


@pytest.mark.parametrize("source", ["usb", "tcp:a:1", "udp:nowhere", "udp:a:99999", "serial:/dev/x@fast", "file:"])
def test_what_is_no_source_is_told(source):
    with pytest.raises(UserError, match="as "):
        bytes_of(source, lambda: False)


def test_a_file_that_is_not_there_is_told(tmp_path):
    with pytest.raises(UserError, match="name a file"):
        bytes_of(f"file:{tmp_path / 'gone.csv'}", lambda: False)
