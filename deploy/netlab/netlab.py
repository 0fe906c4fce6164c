#!/usr/bin/env python3
"""A laboratory of virtual hosts on one Linux machine: network namespaces on a bridge, one address per host.

    netlab.py up 9                       hosts h0 to h8, at 10.77.0.10 to 10.77.0.18
    netlab.py exec h3 ping -c1 10.77.0.10
    netlab.py link h3 down               pull the cable; "up" puts it back
    netlab.py mute h3 on                 h3 receives, but what it sends is lost; "off" ends that
    netlab.py part h3 h4 on              h3 and h4 do not reach each other, but all others; "off" ends that
    netlab.py partition h0,h1,h2         these on a switch of their own; "heal" joins all again
    netlab.py delay h3 20 --loss 5       20 ms and 5 % on what h3 sends, where the kernel has netem
    netlab.py down                       end every process and remove everything

Needs root, and ip of iproute2. All of it, the bridge too, is inside namespaces of its own: the machine's network is
not touched, and nothing in the laboratory reaches it.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Sequence
from contextlib import suppress
from types import TracebackType
from typing import Self

NETWORK = "10.77"
FIRST = 10
PREFIX = "cbef"
_WHOLE, _APART = "whole", "apart"
_DEVICE = "eth0"
_NO_HOST = "02:00:00:00:00:01"


class LabError(Exception):
    """A sentence that says what the laboratory cannot do here."""


class Lab:
    """Hosts on one bridge. Use as a context manager: leaving it ends their processes and removes them."""

    def __init__(self, hosts: Iterable[str], name: str = "lab") -> None:
        self.name, self.hosts = name, list(hosts)
        self._switch = f"{PREFIX}-{name}-switch"

    @classmethod
    def standing(cls, name: str = "lab") -> Lab:
        """The laboratory that an earlier `up` made. Raises LabError where there is none."""
        prefix = f"{PREFIX}-{name}-"
        lines = [line.split() for line in _ip("netns", "list").splitlines()]
        found = [words[0].removeprefix(prefix) for words in lines if words and words[0].startswith(prefix)]
        if "switch" not in found:
            raise LabError(f"there is no laboratory {name!r}; make one with 'up'")
        return cls(sorted(set(found) - {"switch"}, key=lambda host: (len(host), host)), name)

    def __enter__(self) -> Self:
        self.up()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.down()

    def space(self, host: str) -> str:
        """The name of a host's network namespace. Raises LabError for a host that there is not."""
        if host not in self.hosts:
            raise LabError(f"there is no host {host!r}; there are {', '.join(self.hosts)}")
        return f"{PREFIX}-{self.name}-{host}"

    def address(self, host: str) -> str:
        """A host's address."""
        self.space(host)
        number = int(host[1:]) if host[1:].isdecimal() and host[0] == "h" else self.hosts.index(host)
        return f"{NETWORK}.{number // 200}.{number % 200 + FIRST}"

    def up(self) -> None:
        """Make switch and hosts. Where one of them cannot be made, remove the others again."""
        try:
            _ip("netns", "add", self._switch)
            for bridge in (_WHOLE, _APART):
                _ip("-n", self._switch, "link", "add", bridge, "type", "bridge")
                _ip("-n", self._switch, "link", "set", bridge, "up")
            for host in self.hosts:
                self._plug_in(host)
        except BaseException:
            self.down()
            raise

    def _plug_in(self, host: str) -> None:
        space, port = self.space(host), self._port(host)
        _ip("netns", "add", space)
        # Both ends are made in their own namespaces, so that none is in the machine's namespace even for a moment.
        pair = ["type", "veth", "peer", "name", port, "netns", self._switch]
        _ip("-n", space, "link", "add", _DEVICE, *pair)
        _ip("-n", space, "address", "add", f"{self.address(host)}/16", "dev", _DEVICE)
        for device in ("lo", _DEVICE):
            _ip("-n", space, "link", "set", device, "up")
        _ip("-n", self._switch, "link", "set", port, "master", _WHOLE, "up")

    def _port(self, host: str) -> str:
        self.space(host)
        return f"port{self.hosts.index(host)}"

    def command(self, host: str, words: Sequence[str]) -> list[str]:
        """The command that runs a command on a host."""
        return ["ip", "netns", "exec", self.space(host), *words]

    def link(self, host: str, *, up: bool) -> None:
        """Put a host's cable in, or pull it out."""
        _ip("-n", self._switch, "link", "set", self._port(host), "up" if up else "down")

    def mute(self, host: str, *, on: bool) -> None:
        """Lose everything that a host sends to the others, but nothing that they send to it; or end that."""
        for other in self.hosts:
            if other == host:
                continue
            self._lose(host, other, on=on)

    def part(self, first: str, second: str, *, on: bool = True) -> None:
        """Lose all that two hosts send each other, and nothing else: neither reaches the other. Or end that."""
        self._lose(first, second, on=on)
        self._lose(second, first, on=on)

    def _lose(self, host: str, other: str, *, on: bool) -> None:
        neighbour = ["neigh", "replace" if on else "del", self.address(other), "dev", _DEVICE]
        # Frames for a hardware address that no host has.
        _ip("-n", self.space(host), *neighbour, *(["lladdr", _NO_HOST, "nud", "permanent"] if on else []))

    def partition(self, apart: Iterable[str]) -> None:
        """Put these hosts on a switch of their own, and all others on the first one; no hosts: join all again."""
        chosen = set(apart)
        for host in sorted(chosen):
            self.space(host)
        for host in self.hosts:
            _ip("-n", self._switch, "link", "set", self._port(host), "master", _APART if host in chosen else _WHOLE)

    def impair(self, host: str, *, delay_ms: float = 0.0, loss_percent: float = 0.0) -> None:
        """Delay and lose what a host sends. Raises LabError where the kernel has no netem."""
        what = ["netem", "delay", f"{delay_ms}ms", "loss", f"{loss_percent}%"]
        done = _run("tc", "-n", self.space(host), "qdisc", "replace", "dev", _DEVICE, "root", *what)
        if done.returncode:
            raise LabError(f"this kernel cannot delay or lose packets ({done.stderr.strip()}); it needs sch_netem")

    def kill(self, host: str) -> None:
        """End every process of a host at once, as a power cut would."""
        for _ in range(50):
            pids = _run("ip", "netns", "pids", self.space(host)).stdout.split()
            if not pids:
                return
            for pid in pids:
                with suppress(ProcessLookupError):
                    os.kill(int(pid), signal.SIGKILL)
            time.sleep(0.02)

    def down(self) -> None:
        """End every process and remove everything; it is no error where there is nothing to remove."""
        for host in self.hosts:
            self.kill(host)
            _run("ip", "netns", "delete", self.space(host))
        _run("ip", "netns", "delete", self._switch)


def why_not() -> str | None:
    """Why no laboratory can be made here; None where one can."""
    if sys.platform != "linux":
        return "network namespaces are Linux's"
    if os.geteuid() != 0:
        return "network namespaces need root"
    probe = Lab(["probe"], f"probe{os.getpid()}")
    try:
        with probe:
            return None
    except (LabError, OSError) as error:
        return f"no network namespaces with a bridge here: {error}"


def _run(*words: str) -> subprocess.CompletedProcess[str]:
    try:
        return subprocess.run(words, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        raise LabError(f"there is no program '{words[0]}' on the PATH; install iproute2, or add /sbin to it") from None


def _ip(*words: str) -> str:
    done = _run("ip", *words)
    if done.returncode:
        raise LabError(f"ip {' '.join(words)}: {done.stderr.strip()}")
    return done.stdout


def _arguments() -> argparse.Namespace:
    described = __doc__ or ""
    parser = argparse.ArgumentParser(description=described, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--name", default="lab", help="which laboratory, where there are several")
    verbs = parser.add_subparsers(dest="verb", required=True)
    verbs.add_parser("up").add_argument("count", type=int, metavar="N")
    verbs.add_parser("down")
    verbs.add_parser("hosts")
    verbs.add_parser("heal")
    run = verbs.add_parser("exec")
    run.add_argument("host")
    run.add_argument("command", nargs=argparse.REMAINDER)
    link = verbs.add_parser("link")
    link.add_argument("host")
    link.add_argument("state", choices=("up", "down"))
    mute = verbs.add_parser("mute")
    mute.add_argument("host")
    mute.add_argument("state", choices=("on", "off"))
    part = verbs.add_parser("part")
    part.add_argument("host")
    part.add_argument("other")
    part.add_argument("state", choices=("on", "off"))
    verbs.add_parser("partition").add_argument("apart", metavar="HOST,HOST,...")
    delay = verbs.add_parser("delay")
    delay.add_argument("host")
    delay.add_argument("milliseconds", type=float)
    delay.add_argument("--loss", type=float, default=0.0, metavar="PERCENT")
    return parser.parse_args()


def _obey(wanted: argparse.Namespace) -> int:
    if wanted.verb == "up":
        lab = Lab([f"h{number}" for number in range(wanted.count)], wanted.name)
        lab.up()
    else:
        lab = Lab.standing(wanted.name)
    match wanted.verb:
        case "up" | "hosts":
            print("\n".join(f"{host} {lab.address(host)}" for host in lab.hosts))
        case "exec":
            return subprocess.run(lab.command(wanted.host, wanted.command), check=False).returncode
        case "link":
            lab.link(wanted.host, up=wanted.state == "up")
        case "mute":
            lab.mute(wanted.host, on=wanted.state == "on")
        case "part":
            lab.part(wanted.host, wanted.other, on=wanted.state == "on")
        case "partition" | "heal":
            lab.partition(wanted.apart.split(",") if wanted.verb == "partition" else ())
        case "delay":
            lab.impair(wanted.host, delay_ms=wanted.milliseconds, loss_percent=wanted.loss)
        case "down":
            lab.down()
    return 0


if __name__ == "__main__":
    try:
        sys.exit(_obey(_arguments()))
    except LabError as problem:
        sys.exit(f"netlab: {problem}")
