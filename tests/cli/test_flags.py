"""Numbers on the command line have a range, and what is out of it starts nothing."""

import sys
import typing
import warnings
from collections.abc import Iterator
from typing import Any

import pytest
from typer.core import TyperOption

from tests.cli.command_line import call, leaves
from zenoh_cbef.cli.calling import main as command_line
from zenoh_cbef.cli.calling import verbs
from zenoh_cbef.protocol.certificates import make_certificates

GIVEN = {
    "agent": ["1", "--run", "x", "--connect", "tcp/127.0.0.1:9"],
    "record": ["--run", "x", "--connect", "tcp/127.0.0.1:9"],
    "health": ["target", "--run", "x"],
    "stop": ["--run", "x"],
    "fault add": ["loss", "--run", "x"],
    "fault list": ["--run", "x"],
    "fault clear": ["--run", "x"],
    "certs new": ["there"],
    "compare": ["nowhere"],
    "import": ["nowhere", "--output", "there"],
    "experiment run": ["loss"],
}


def numbers() -> Iterator[tuple[str, Any]]:
    """Verb and option of everything on the command line that takes a number."""
    for verb, command in leaves().items():
        yield from ((verb, one) for one in command.params if kind_of(one) in (int, float))


def kind_of(option: Any) -> type | None:
    """What an option or argument of typer's takes, or takes several of."""
    annotation = option.type_descriptor.annotation
    parts = {annotation, *typing.get_args(annotation)}
    return next((kind for kind in (int, float, bool) if kind in parts), None)


def test_every_number_has_a_range():
    found = list(numbers())
    assert len(found) > 30
    for verb, option in found:
        assert option.min is not None, (verb, option.name)
        assert option.max is not None, (verb, option.name)


OPTIONS = sorted((verb, one.opts[0], kind_of(one)) for verb, one in numbers() if isinstance(one, TyperOption))


@pytest.mark.parametrize("one", [one for one in OPTIONS if one[1] != "--lease-ms"], ids=lambda one: " ".join(one[:2]))
def test_a_number_out_of_range_is_refused_before_anything_starts(monkeypatch, capsys, tmp_path, one):
    verb, option, kind = one
    monkeypatch.chdir(tmp_path)
    for value in ("nan", "inf", "-inf", "1e300", "-1e300") if kind is float else ("1" + 30 * "0", "-1", "1.5"):
        status, out, err = call(monkeypatch, capsys, *verb.split(), *GIVEN.get(verb, ()), option, value)
        assert status == 2, (verb, value)
        assert out == ""
        assert option in err
        assert "Traceback" not in err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "host",
    ["bad host!", "", "-a", "a-", "a..b", "tcp/a", "a:7447", "ä.example", "a" * 64, "a." * 127 + "bc", "256.1.1.1/8"],
)
def test_a_host_that_is_none_gets_no_certificate(monkeypatch, capsys, tmp_path, host):
    status, _, err = call(monkeypatch, capsys, "certs", "new", str(tmp_path / "there"), f"--host={host}")
    assert status == 2
    assert "is neither a name nor an address" in err
    assert not (tmp_path / "there").exists()


def test_hosts_are_names_or_addresses(tmp_path):
    hosts = ["a", "rack-1.example.org", "*.example.org", "10.0.0.1", "fe80::1", "node_3", "xn--bcher-kva.example"]
    assert make_certificates(tmp_path, ["target"], hosts=hosts, days=1) == ["target"]


def test_warnings_reach_the_user_as_a_sentence(monkeypatch, capsys):
    def warn(**_options: object) -> None:
        for _ in range(2):
            warnings.warn("overflow encountered in multiply", RuntimeWarning, stacklevel=1)
            warnings.warn("something\n else", UserWarning, stacklevel=1)

    monkeypatch.setattr(sys, "argv", ["zenoh-cbef", "sim"])
    monkeypatch.setattr(verbs, "built", lambda: warn)
    warnings.simplefilter("always")
    with pytest.raises(SystemExit):
        command_line.main()
    err = capsys.readouterr().err.splitlines()
    assert len(err) == 2
    assert err[0].startswith("warning: some number of the scenario is far out of proportion")
    assert err[1] == "warning: something else"
