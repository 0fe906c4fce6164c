"""What certificates say: whose they are, for how long, by whom, and for which hosts."""

from __future__ import annotations

import stat
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from zenoh_cbef.errors import UserError
from zenoh_cbef.protocol.certificates import make_certificates

HOSTS = ["localhost", "127.0.0.1", "::1", "*.example.org", "a_b-c"]


def certificate(path: Path) -> x509.Certificate:
    return x509.load_pem_x509_certificate(path.read_bytes())


def test_a_certificate_names_its_process_its_hosts_and_its_days(tmp_path: Path) -> None:
    folder = tmp_path / "deep" / "er"
    before = datetime.now(UTC) - timedelta(seconds=1)
    assert make_certificates(folder, ["agent-0", "target"], hosts=HOSTS, days=3) == ["agent-0", "target"]
    after = datetime.now(UTC)
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    authority, agent = certificate(folder / "ca.pem"), certificate(folder / "agent-0.pem")
    for one, name in ((authority, "zenoh-cbef test authority"), (agent, "agent-0")):
        [common] = one.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
        assert common.value == name
        assert one.issuer == authority.subject
        one.verify_directly_issued_by(authority)
        assert before - timedelta(hours=1) <= one.not_valid_before_utc <= after - timedelta(hours=1)
        assert before + timedelta(days=3) <= one.not_valid_after_utc <= after + timedelta(days=3)
    constraints = {one: one.extensions.get_extension_for_class(x509.BasicConstraints) for one in (authority, agent)}
    assert [(one.critical, one.value.ca, one.value.path_length) for one in constraints.values()] == [
        (True, True, 0),
        (True, False, None),
    ]
    usages = [one.extensions.get_extension_for_class(x509.KeyUsage).critical for one in (authority, agent)]
    assert usages == [True, True]
    both = agent.extensions.get_extension_for_class(x509.ExtendedKeyUsage)
    assert set(both.value) == {ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH}
    hosts = agent.extensions.get_extension_for_class(x509.SubjectAlternativeName)
    assert (both.critical, hosts.critical) == (False, False)
    assert [str(one.value) for one in hosts.value] == HOSTS
    assert hosts.value.get_values_for_type(x509.DNSName) == ["localhost", "*.example.org", "a_b-c"]
    key = agent.public_key()
    assert isinstance(key, ec.EllipticCurvePublicKey)
    assert key.curve.name == "secp256r1"
    assert authority.public_key() != key


def test_what_is_there_stays_and_what_is_missing_is_added_by_the_same_authority(tmp_path: Path) -> None:
    make_certificates(tmp_path, ["agent-0"], hosts=["localhost"], days=1)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert make_certificates(tmp_path, ["agent-0", "agent-1"], hosts=["localhost"], days=1) == ["agent-1"]
    assert {name: (tmp_path / name).read_bytes() for name in before} == before
    certificate(tmp_path / "agent-1.pem").verify_directly_issued_by(certificate(tmp_path / "ca.pem"))
    (tmp_path / "ca.key").unlink()
    with pytest.raises(UserError, match=r"is there but not .*ca\.key"):
        make_certificates(tmp_path, ["agent-2"], hosts=["localhost"], days=1)


@pytest.mark.parametrize("host", ["", "a b", "-a", "a-", "a..b", "a.-b", "*", "a.*", "127.0.0.1:80", "x" * 64, "ä"])
def test_what_is_no_host_is_refused_before_anything_is_made(tmp_path: Path, host: str) -> None:
    with pytest.raises(UserError, match="is neither a name nor an address"):
        make_certificates(tmp_path / "new", ["agent-0"], hosts=["localhost", host], days=1)
    assert not (tmp_path / "new").exists()


def test_the_longest_name_of_a_host_is_one_and_a_longer_one_is_not(tmp_path: Path) -> None:
    longest = ".".join(["x" * 63] * 3 + ["y" * 61])
    assert len(longest) == 253
    assert make_certificates(tmp_path, ["a"], hosts=[longest], days=1) == ["a"]
    with pytest.raises(UserError, match="is neither a name"):
        make_certificates(tmp_path, ["b"], hosts=[longest + "y"], days=1)


def test_a_folder_that_cannot_be_made_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(UserError, match=r"cannot write .*file.*; choose another folder"):
        make_certificates(tmp_path / "file", ["a"], hosts=["localhost"], days=1)


def test_without_the_authoritys_key_nothing_is_signed(tmp_path: Path) -> None:
    make_certificates(tmp_path, ["agent-0"], hosts=[], days=1)
    (tmp_path / "ca.key").unlink()
    with pytest.raises(UserError, match="nothing can be signed"):
        make_certificates(tmp_path, ["target"], hosts=[], days=1)
