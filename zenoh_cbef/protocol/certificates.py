"""A test certificate authority, and a certificate for every process of a run."""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from zenoh_cbef.errors import UserError

_LONGEST_HOST = 253
_HOST = re.compile(r"(\*\.)?(?!-)[A-Za-z0-9_-]{1,63}(?<!-)(\.(?!-)[A-Za-z0-9_-]{1,63}(?<!-))*", re.ASCII)
_CLOCKS_MAY_DIFFER = timedelta(hours=1)


def make_certificates(folder: Path, names: Iterable[str], *, hosts: Sequence[str], days: int) -> list[str]:
    """Make what a folder lacks: an authority, and a certificate and key for every common name. Returns the new ones.

    hosts: names and addresses at which the processes are reached, in every certificate. Keys (EC, P-256) are readable
    by their owner only. Raises UserError where the folder cannot be written, has a
    certificate but not its key, or a host is none.
    """
    reached = [_host(host) for host in hosts]
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        authority = _Authority(folder, days)
        missing = [name for name in names if not (folder / f"{name}.pem").exists()]
        for name in missing:
            authority.issue(name, reached)
    except OSError as error:
        raise UserError(f"cannot write {error.filename or folder}: {error.strerror}; choose another folder") from None
    return missing


class _Authority:
    """The authority of a folder, made where there is none."""

    def __init__(self, folder: Path, days: int) -> None:
        self._folder, self._days = folder, days
        certificate, key = folder / "ca.pem", folder / "ca.key"
        if certificate.exists() and not key.exists():
            raise UserError(f"{certificate} is there but not {key}, so nothing can be signed; choose another folder")
        if certificate.exists():
            self._key = _read_key(key)
            self._name = _read_subject(certificate)
            return
        self._key = ec.generate_private_key(ec.SECP256R1())
        self._name = _name("zenoh-cbef test authority")
        builder = (
            self._builder(self._name, self._key)
            .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
            .add_extension(_usage(signs=True), critical=True)
        )
        self._write("ca", self._key, builder)

    def issue(self, name: str, hosts: Sequence[x509.GeneralName]) -> None:
        """Sign a certificate with a fresh key for both ends of a link."""
        key = ec.generate_private_key(ec.SECP256R1())
        both = x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH])
        builder = (
            self._builder(_name(name), key)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(_usage(signs=False), critical=True)
            .add_extension(both, critical=False)
            .add_extension(x509.SubjectAlternativeName(hosts), critical=False)
        )
        self._write(name, key, builder)

    def _builder(self, subject: x509.Name, key: ec.EllipticCurvePrivateKey) -> x509.CertificateBuilder:
        now = datetime.now(UTC)
        return x509.CertificateBuilder(
            issuer_name=self._name,
            subject_name=subject,
            public_key=key.public_key(),
            serial_number=x509.random_serial_number(),
            not_valid_before=now - _CLOCKS_MAY_DIFFER,
            not_valid_after=now + timedelta(days=self._days),
        )

    def _write(self, name: str, key: ec.EllipticCurvePrivateKey, builder: x509.CertificateBuilder) -> None:
        # The key first: a later call would take a certificate without a key for complete.
        path = self._folder / f"{name}.key"
        path.touch(mode=0o600)
        path.write_bytes(
            key.private_bytes(
                serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
            )
        )
        certificate = builder.sign(self._key, hashes.SHA256())
        (self._folder / f"{name}.pem").write_bytes(certificate.public_bytes(serialization.Encoding.PEM))


def _read_key(path: Path) -> ec.EllipticCurvePrivateKey:
    try:
        key = serialization.load_pem_private_key(path.read_bytes(), password=None)
    except (ValueError, TypeError):
        key = None
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise UserError(f"{path} is no key that 'zenoh-cbef certs new' made; choose another folder")
    return key


def _read_subject(path: Path) -> x509.Name:
    try:
        return x509.load_pem_x509_certificate(path.read_bytes()).subject
    except ValueError:
        raise UserError(f"{path} is no certificate that 'zenoh-cbef certs new' made; choose another folder") from None


def _name(common: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common)])


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        pass
    # The names of hosts (RFC 1123), of which a certificate may replace the first label by * (RFC 6125).
    if len(host) > _LONGEST_HOST or not _HOST.fullmatch(host):
        raise UserError(
            f"--host {host!r:.80} is neither a name nor an address; write a name of letters, digits, dashes and dots "
            "(others in their form xn--...), or an address without port"
        )
    return x509.DNSName(host)


def _usage(*, signs: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=signs,
        crl_sign=signs,
        encipher_only=False,
        decipher_only=False,
    )
