"""Which requests the lab answers: those of its own page, with the token of its address."""

from __future__ import annotations

import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field
from urllib.parse import urlsplit

LOOPBACK = ("127.0.0.1", "localhost", "[::1]")

HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
        "form-action 'none'; frame-ancestors 'none'; base-uri 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
"""Of every answer: a page loads nothing from outside, stands in no frame, and tells its address to no other site."""


@dataclass(frozen=True)
class Guard:
    """What a request has to show.

    hosts: under which names the server is reached. The Host is checked because another site can let its own name point
    here (DNS rebinding), and the Origin because any page may open a WebSocket to this host.
    """

    hosts: tuple[str, ...] = LOOPBACK
    token: str = field(default_factory=lambda: secrets.token_urlsafe(24))

    def refuses_host(self, headers: Mapping[str, str]) -> str:
        """Why a request for anything is refused; empty where it is not."""
        host = headers.get("host", "")
        name = host if host.endswith("]") or ":" not in host else host.rpartition(":")[0]
        return "" if name in self.hosts else "the address is another host's"

    def refuses(self, headers: Mapping[str, str], token: str | None) -> str:
        """Why a request for data, or an order, is refused; empty where it is not."""
        if why := self.refuses_host(headers):
            return why
        origin = headers.get("origin")
        if origin is not None and urlsplit(origin).netloc != headers.get("host"):
            return "the request comes from another site's page"
        if not self.knows(token):
            return "the address lacks its token; open the one that the lab printed"
        return ""

    def knows(self, token: str | None) -> bool:
        """Whether this is the token of the lab's address."""
        return token is not None and secrets.compare_digest(token.encode(), self.token.encode())
