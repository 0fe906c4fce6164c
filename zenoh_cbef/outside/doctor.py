"""Whether this host, and the endpoints that it shall link to, are fit for a run: the checks of `doctor`."""

from __future__ import annotations

import os
import shutil
import socket
import ssl
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from zenoh_cbef import __version__
from zenoh_cbef.errors import UserError
from zenoh_cbef.machine import (
    address_space_short,
    core_count,
    files_needed,
    files_short,
    memory_short,
    ports_short,
    threads_short,
)
from zenoh_cbef.protocol.reach import unreachable, wait_for_link
from zenoh_cbef.protocol.runtimes import MOST_LINKS
from zenoh_cbef.protocol.session import PORT, Connection, open_session
from zenoh_cbef.protocol.tls import Tls

OK, WARNING, PROBLEM = "ok", "warning", "problem"
_PYTHON = (3, 11)
_ZENOH = ((1, 10), (2, 0))
_SCOUTING = ("224.0.0.224", 7446)
_LITTLE_DISK, _TOO_LITTLE_DISK = 2e9, 1e8
_SECONDS = 2.0


@dataclass(frozen=True)
class Finding:
    """The result of one check: what it looked at, its state, and what to do if that is not in order."""

    subject: str
    level: str
    text: str


def check_host(output: Path, *, tls: Tls | None = None) -> Iterator[Finding]:
    """The host by itself, with logs in a folder."""
    yield _python()
    yield _zenoh()
    yield _cores()
    yield _room("memory", address_space_short(), "a process may map what it needs")
    yield _disk(output)
    if tls is not None:
        yield _certificates(tls)
    yield _loopback(tls)
    yield _port()
    yield _multicast()


def check_count(agents: int, most: int) -> Finding:
    """Whether a run may have so many agents as processes, of which it has at most `most`."""
    many = f"a run has at most {most} agents as processes, and {agents} are more; take fewer, or simulate them: 'sim'"
    return _room("agents", many if agents > most else "", f"{agents}, of at most {most} that a run has as processes")


def check_size(agents: int) -> Iterator[Finding]:
    """Whether this host has room for all processes of a run of so many agents: more than it needs, if it has some."""
    links, processes = agents + 1, agents + 2
    yield _room("files", files_short(links), f"with {agents} agents a process may need {files_needed(links)}")
    few = f"a process takes {MOST_LINKS} links, and with {agents} agents may need {links}"
    yield _room("links", f"{few}; take fewer agents" if links > MOST_LINKS else "", few)
    yield _room("memory", memory_short(processes), f"enough for {processes} processes on this host", WARNING)
    yield _room("threads", threads_short(processes), f"this user may have those of {processes} processes", WARNING)
    yield _room("ports", ports_short(processes), f"enough for {processes} processes that take any", WARNING)


def check_endpoints(endpoints: Sequence[str]) -> Iterator[Finding]:
    """Whether the hosts of endpoints have addresses, and something listens there."""
    for endpoint in endpoints:
        trouble = unreachable(endpoint, _SECONDS)
        yield Finding("endpoint", PROBLEM if trouble else OK, trouble or f"{endpoint} can be reached")


def _python() -> Finding:
    found = ".".join(map(str, sys.version_info[:3]))
    if sys.version_info[:2] < _PYTHON:
        return Finding("Python", PROBLEM, f"{found} is too old; install 3.11 or later")
    return Finding("Python", OK, f"{found}, zenoh-cbef {__version__}")


def _zenoh() -> Finding:
    found = version("eclipse-zenoh")
    numbers = tuple(int(part) for part in found.split(".")[:2] if part.isdecimal())
    if not _ZENOH[0] <= numbers < _ZENOH[1]:
        return Finding("Zenoh", PROBLEM, f"eclipse-zenoh {found} is not from 1.10 to below 2; install one that is")
    return Finding("Zenoh", OK, f"eclipse-zenoh {found}")


def _cores() -> Finding:
    count = core_count()
    if count == 1:
        return Finding("cores", WARNING, "one: all processes of this host share it; in realtime give them a longer dt")
    return Finding("cores", OK, f"{count}; agents on this host share them")


def _room(subject: str, why_not: str, words: str, level: str = PROBLEM) -> Finding:
    return Finding(subject, level, why_not) if why_not else Finding(subject, OK, words)


def _disk(output: Path) -> Finding:
    place = next(folder for folder in (output.absolute(), *output.absolute().parents) if folder.exists())
    if not place.is_dir() or not os.access(place, os.W_OK):
        return Finding("disk", PROBLEM, f"logs cannot be written to {output}; choose another folder with --output")
    free = shutil.disk_usage(place).free
    words = f"{free / 1e9:.1f} GB free for logs in {output}"
    if free < _LITTLE_DISK:
        return Finding("disk", PROBLEM if free < _TOO_LITTLE_DISK else WARNING, f"{words}; make room")
    return Finding("disk", OK, words)


def _certificates(tls: Tls) -> Finding:
    """The certificate and the key belong together, and the authority's can be read."""
    try:
        ssl.create_default_context(cafile=str(tls.ca)).load_cert_chain(tls.cert, tls.key)
    except (ssl.SSLError, OSError) as error:
        return Finding("TLS", PROBLEM, f"{tls.ca}, {tls.cert} and {tls.key}: {error}; make them anew with 'certs new'")
    if tls.key.stat().st_mode & 0o077:
        return Finding("TLS", WARNING, f"others on this host can read {tls.key}; chmod 600 it")
    return Finding("TLS", OK, f"{tls.cert} and its key belong together")


def _loopback(tls: Tls | None) -> Finding:
    """Two sessions of this process find each other."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    place = Connection(tls=tls).loopback(port)
    try:
        with (
            open_session(Connection(listen=[place], gossip=False, tls=tls)),
            open_session(Connection(connect=[place], gossip=False, tls=tls)) as client,
        ):
            heard = wait_for_link(client, _SECONDS)
    except UserError as error:
        return Finding("loopback", PROBLEM, str(error))
    if not heard:
        what = "certificates, or " if tls else ""
        return Finding("loopback", PROBLEM, f"two sessions on {place} do not link; check {what}this host's firewall")
    return Finding("loopback", OK, "two sessions on this host link")


def _port() -> Finding:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", PORT))
        except OSError as error:
            words = f"{PORT}, where 'target' listens unless told otherwise, cannot be had ({error.strerror})"
            return Finding("port", WARNING, f"{words}; use --listen there, or end the program that has it")
    return Finding("port", OK, f"{PORT}, where 'target' listens unless told otherwise, is free")


def _multicast() -> Finding:
    """A datagram to Zenoh's multicast group comes back on loopback."""
    group, port = _SCOUTING
    loopback = socket.inet_aton("127.0.0.1")
    try:
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
        ):
            receiver.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            receiver.bind((group, port))
            receiver.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(group) + loopback)
            receiver.settimeout(_SECONDS)
            sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, loopback)
            word = os.urandom(8)
            sender.sendto(word, (group, port))
            while receiver.recv(2048) != word:
                pass
    except OSError as error:
        words = f"does not come back on loopback ({error.strerror or error})"
        return Finding("multicast", WARNING, f"{words}; leave zenoh.multicast off and name endpoints with --connect")
    return Finding("multicast", OK, "comes back on loopback; only zenoh.multicast uses it")
