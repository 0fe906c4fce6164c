"""An authority that is damaged is told in a sentence."""

from __future__ import annotations

import stat

import pytest
from cryptography import x509

from zenoh_cbef.errors import UserError
from zenoh_cbef.protocol.certificates import make_certificates


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
