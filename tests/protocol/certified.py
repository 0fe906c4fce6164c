"""A network of processes with certificates, in one process, and what each of them hears."""

from pathlib import Path

import zenoh

from tests.processes.conftest import unused_port
from zenoh_cbef.protocol.session import Connection, open_session
from zenoh_cbef.protocol.tls import Tls

RUN = "cbef/secret"


NAMES = ("target", "record", "router", "receiver", "operator", "agent-0", "agent-1")


class Ear:
    """What a session hears on a key."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self._subscriber = session.declare_subscriber(key, zenoh.handlers.FifoChannel(1000))
        self._heard: list[tuple[str, str]] = []

    def heard(self) -> list[tuple[str, str]]:
        while (sample := self._subscriber.handler.try_recv()) is not None:
            self._heard.append((str(sample.key_expr).removeprefix(f"{RUN}/"), sample.payload.to_string()))
        return sorted(self._heard)


class Net:
    """Sessions with certificates: peers that are linked to one another, or clients of one router."""

    def __init__(self, certificates: Path, way: str) -> None:
        self._certificates, self._way = certificates, way
        self.endpoints: list[str] = []
        self.sessions: list[zenoh.Session] = []
        if way == "router":
            self._open("router", mode="router")

    def join(self, name: str) -> zenoh.Session:
        return self._open(name, mode="client" if self._way == "router" else "peer")

    def _open(self, name: str, mode: str) -> zenoh.Session:
        listen = [] if mode == "client" else [f"tls/127.0.0.1:{unused_port()}"]
        tls = Tls.of_folder(self._certificates, name)
        session = open_session(Connection(list(self.endpoints), listen, mode, gossip=False, tls=tls), patience=60.0)
        self.endpoints += listen
        self.sessions.append(session)
        return session

    def close(self) -> None:
        for session in reversed(self.sessions):
            session.close()
