"""An authority that is damaged is told in a sentence."""

from __future__ import annotations

import stat
from datetime import UTC, datetime, timedelta

import pytest
from cryptography import x509

from zenoh_cbef.errors import UserError
from zenoh_cbef.protocol.certificates import make_certificates
from zenoh_cbef.protocol.tls import Tls


@pytest.mark.parametrize("damaged", ["ca.pem", "ca.key"])
@pytest.mark.parametrize(
    "content", [b"", b"x", bytes(100), b"-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n"]
)
def test_an_authority_that_is_damaged_is_told_in_a_sentence(tmp_path, damaged, content):
    make_certificates(tmp_path, [], hosts=["localhost"], days=1)
    (tmp_path / damaged).write_bytes(content)
    with pytest.raises(UserError, match="choose another folder"):
        make_certificates(tmp_path, ["agent-0"], hosts=["localhost"], days=1)


def test_an_authority_signs_certificates_and_a_process_signs_only_handshakes(tmp_path):
    make_certificates(tmp_path, ["agent-0"], hosts=["localhost"], days=1)
    signing = {"key_cert_sign", "crl_sign"}
    for name, may in (("ca", signing), ("agent-0", {"digital_signature"})):
        certificate = x509.load_pem_x509_certificate((tmp_path / f"{name}.pem").read_bytes())
        usage = certificate.extensions.get_extension_for_class(x509.KeyUsage).value
        others = {"content_commitment", "key_encipherment", "data_encipherment", "key_agreement"}
        assert {one for one in signing | others | {"digital_signature"} if getattr(usage, one)} == may
        assert certificate.extensions.get_extension_for_class(x509.BasicConstraints).value.ca == (name == "ca")
        assert stat.S_IMODE((tmp_path / f"{name}.key").stat().st_mode) == 0o600


def test_the_dates_of_a_certificate_are_looked_at_before_the_first_link(tmp_path):
    make_certificates(tmp_path, ["agent-0"], hosts=["localhost"], days=1)
    tls, now = Tls.of_folder(tmp_path, "agent-0"), datetime.now(UTC)
    assert tls.check_dates(now) == ""
    found = x509.load_pem_x509_certificate(tls.cert.read_bytes())
    begin, end, moment = found.not_valid_before_utc, found.not_valid_after_utc, timedelta(seconds=1)
    assert tls.check_dates(begin) == tls.check_dates(end - timedelta(hours=1)) == ""
    assert "ends at" in tls.check_dates(end - timedelta(hours=1) + moment)
    for at in (begin - moment, end):
        with pytest.raises(UserError, match=r"begins at|ended at"):
            tls.check_dates(at)
    assert "the links of this process with it" in tls.check_dates(now + timedelta(hours=23.5))
    for hours, told in (
        (25.0, r"ended at \S+ \S+ UTC; make another one"),
        (-2.0, r"begins at \S+ \S+ UTC; set the clock"),
    ):
        with pytest.raises(UserError, match=told):
            tls.check_dates(now + timedelta(hours=hours))


def test_a_certificate_that_cannot_be_read_is_left_to_zenoh(tmp_path):
    for name in ("ca.pem", "agent-0.pem", "agent-0.key"):
        (tmp_path / name).touch()
    assert Tls.of_folder(tmp_path, "agent-0").check_dates(datetime.now(UTC)) == ""
