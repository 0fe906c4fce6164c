"""The files of a certificate, and what Zenoh is told of them."""

from pathlib import Path

import pytest

from zenoh_cbef.errors import UserError
from zenoh_cbef.protocol.tls import Tls, common_name

FILES = ("ca.pem", "agent-3.pem", "agent-3.key")


def test_an_agent_has_a_number_in_its_name_and_other_roles_have_none() -> None:
    assert common_name("agent", "3") == "agent-3"
    assert common_name("record", "a") == "record"


@pytest.mark.parametrize("lacking", FILES)
def test_a_file_that_is_not_there_is_named(tmp_path: Path, lacking: str) -> None:
    for name in FILES:
        if name != lacking:
            (tmp_path / name).touch()
    with pytest.raises(UserError, match=lacking):
        Tls.of_folder(tmp_path, "agent-3")


def test_both_ends_of_a_link_show_the_certificate_and_check_the_others(tmp_path: Path) -> None:
    ca, cert, key = (tmp_path / name for name in FILES)
    for path in (ca, cert, key):
        path.touch()
    told = Tls.of_folder(tmp_path, "agent-3").settings()
    assert told.pop("root_ca_certificate") == str(ca)
    assert {told.pop(f"{end}_certificate") for end in ("listen", "connect")} == {str(cert)}
    assert {told.pop(f"{end}_private_key") for end in ("listen", "connect")} == {str(key)}
    assert told == {"enable_mtls": True, "verify_name_on_connect": True, "close_link_on_expiration": True}
