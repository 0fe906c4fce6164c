"""An authority that is damaged is told in a sentence."""

from __future__ import annotations

import pytest

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
