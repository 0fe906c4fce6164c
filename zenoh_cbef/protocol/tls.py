"""Mutual TLS: the files that prove a process's role, and Zenoh's settings for them."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

from zenoh_cbef.errors import UserError

_SOON = timedelta(hours=1)
SCHEMES = ("tls", "quic")
"""Protocols of endpoints that check certificates."""


def common_name(role: str, name: str) -> str:
    """The common name of a process's certificate: "agent-3", or the bare role where there is only one."""
    return f"{role}-{name}" if role == "agent" else role


@dataclass(frozen=True)
class Tls:
    """The certificate of the authority that all processes trust, and a process's own certificate and private key."""

    ca: Path
    cert: Path
    key: Path

    def __post_init__(self) -> None:
        for what, path in (("authority's certificate", self.ca), ("certificate", self.cert), ("key", self.key)):
            if not path.is_file():
                raise UserError(f"there is no {what} {path}; make it with 'zenoh-cbef certs new', or check --tls")

    @classmethod
    def of_folder(cls, folder: Path, name: str) -> Tls:
        """The files that `certs new` put into a folder for the process with this common name."""
        return cls(folder / "ca.pem", folder / f"{name}.pem", folder / f"{name}.key")

    def check_dates(self, now: datetime) -> str:
        """What to warn of where the certificate ends soon, else "". Raises UserError where it is not valid now."""
        from cryptography import x509  # noqa: PLC0415 - time that only processes with certificates should take

        try:
            found = x509.load_pem_x509_certificate(self.cert.read_bytes())
        except (OSError, ValueError):
            return ""  # Zenoh says what is wrong with it
        begin, end = found.not_valid_before_utc, found.not_valid_after_utc
        if now >= end:
            raise UserError(f"the certificate {self.cert} ended at {end:%Y-%m-%d %H:%M} UTC; make another one")
        if now < begin:
            raise UserError(f"the certificate {self.cert} begins at {begin:%Y-%m-%d %H:%M} UTC; set the clock")
        if end - now < _SOON:
            return f"the certificate {self.cert} ends at {end:%H:%M} UTC, and the links of this process with it"
        return ""

    def settings(self) -> dict[str, str | bool]:
        """Zenoh's transport/link/tls: both ends of every link show a certificate."""
        return {
            "root_ca_certificate": str(self.ca),
            "listen_certificate": str(self.cert),
            "listen_private_key": str(self.key),
            "connect_certificate": str(self.cert),
            "connect_private_key": str(self.key),
            "enable_mtls": True,
            "verify_name_on_connect": True,
            "close_link_on_expiration": True,
        }
