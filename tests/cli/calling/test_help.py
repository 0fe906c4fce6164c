"""Help, completion and start-up: what the command line says of itself, and what it costs."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.cli.command_line import call, leaves, loaded, names, parse
from zenoh_cbef.cli.calling import verbs
from zenoh_cbef.cli.options.joining import JoiningCommand
from zenoh_cbef.faults import KINDS
from zenoh_cbef.outside.registry import registered

LEAVES = leaves()
HEAVY = {"numpy", "zenoh", "mcap", "msgpack", "zenoh_cbef.scenario", "zenoh_cbef.log", "zenoh_cbef.cli.run"}


def test_help_names_every_verb_once_under_the_heading_of_its_group(monkeypatch, capsys):
    _, out, _ = call(monkeypatch, capsys, "--help")
    lines = [line.strip("│╭╮─ ") for line in out.splitlines()]
    for heading, group in verbs.GROUPS.items():
        at = lines.index(heading)
        assert [line.split()[0] for line in lines[at + 1 : at + 1 + len(group)]] == list(group)
        for verb, what in group.items():
            assert f"{verb} {what}" in [" ".join(line.split()) for line in lines], "one line each at 80 columns"


def test_every_file_with_a_verb_has_its_line():
    folder = Path(verbs.__file__).parents[1]
    files = {path.stem for path in folder.glob("*.py") if "\nVERB = " in path.read_text(encoding="utf-8")}
    assert {verbs.FILES.get(name, name) for name in names()} == files


def test_the_kinds_of_faults_are_those_of_scenarios(monkeypatch, capsys):
    status, out, _ = call(monkeypatch, capsys, "fault", "kinds")
    assert status == 0
    assert re.findall(r"^kind ([\w-]+)$", re.sub(r" +$", "", out, flags=re.MULTILINE), flags=re.MULTILINE) == list(
        KINDS
    )


@pytest.mark.parametrize("words", ["", *LEAVES, "fault", "experiment"])
def test_h_is_help_everywhere(monkeypatch, capsys, words):
    status, out, _ = call(monkeypatch, capsys, *words.split(), "-h")
    assert status == 0
    assert f"Usage: zenoh-cbef {words}".rstrip() in out
    assert re.search(r"--help\s+-h\b", out)


@pytest.mark.parametrize("words", dict.fromkeys([*LEAVES, *names()]))
def test_every_verb_has_an_example_that_the_command_line_takes(words):
    example = (LEAVES.get(words) or loaded(words)).epilog or ""
    assert example.startswith(f"Example: zenoh-cbef {words}")
    parse(shlex.split(example.removeprefix("Example: zenoh-cbef ")))


def test_a_word_that_no_verb_takes_is_refused_by_the_same_parser():
    with pytest.raises(Exception, match="No such option"):
        parse(["fault", "list", "--jsonn"])


def test_the_options_for_joining_are_the_same_objects_for_all_who_join():
    joins = [command for command in LEAVES.values() if isinstance(command, JoiningCommand)]
    assert len(joins) >= 13
    for command in joins:
        assert command.params[-len(JoiningCommand.shared) :] == JoiningCommand.shared


def test_y_and_n_are_the_same_option_wherever_they_are():
    for short, long in (("-y", "--include-topic-regex"), ("-n", "--exclude-topic-regex")):
        found: dict[str, Any] = {
            words: one for words, verb in LEAVES.items() for one in verb.params if short in one.opts
        }
        assert set(found) == {"cat", "filter", "replay"}
        assert {(tuple(one.opts), one.help) for one in found.values()} == {
            ((short, long), next(iter(found.values())).help)
        }


def test_what_names_no_verb_of_experiments_is_an_experiment_also_after_its_options():
    parse(["experiment", "loss"])
    parse(["experiment", "--seeds", "3", "mine.toml", "--json"])
    with pytest.raises(Exception, match="unexpected extra argument"):
        parse(["experiment", "loss", "rounds"])


def test_experiments_are_listed_and_shown_by_commands_of_their_own(monkeypatch, capsys):
    status, out, _ = call(monkeypatch, capsys, "experiment", "list")
    assert status == 0
    assert [line.split()[0] for line in out.splitlines()] == sorted(line.split()[0] for line in out.splitlines())
    assert "\nloss " in out
    status, out, _ = call(monkeypatch, capsys, "experiment", "show", "loss")
    assert status == 0
    assert "[[vary]]" in out
    assert "did you mean 'loss'" in call(monkeypatch, capsys, "experiment", "show", "los")[2]


IMPORTED = """
import sys
from zenoh_cbef.cli.calling.main import main
try:
    main()
finally:
    print(*sys.modules, file=sys.stderr)
"""


@pytest.mark.processes
@pytest.mark.parametrize("words", ["--help", "--version"])
def test_help_imports_no_verb_and_nothing_that_takes_long(words):
    done = subprocess.run([sys.executable, "-c", IMPORTED, *words.split()], capture_output=True, text=True, check=False)
    assert "zenoh-cbef" in done.stdout
    assert HEAVY.isdisjoint(done.stderr.split())
    assert "zenoh_cbef.cli.calling.verbs" in done.stderr.split()


@pytest.mark.processes
def test_a_verb_imports_no_other():
    script = "from zenoh_cbef.cli.calling import verbs; verbs.load('check'); import sys; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    there = {name.rpartition(".")[2] for name in done.stdout.split() if name.startswith("zenoh_cbef.cli.")}
    assert set(names()) & there == {"check"}


@pytest.fixture
def complete(tmp_path, monkeypatch, capsys):
    """What a shell is told for a line up to its end, in a folder with the logs `one` and `other`."""
    for run in ("one", "other"):
        (tmp_path / "logs" / run).mkdir(parents=True)
        (tmp_path / "logs" / run / "run.mcap").touch()
    (tmp_path / "logs" / "empty").mkdir()
    monkeypatch.chdir(tmp_path)

    def told(line: str) -> list[str]:
        # As bash splits a line: an = or a : is a word of its own.
        words = [word for part in line.split(" ") for word in re.split("([=:])", part) if word or not part]
        monkeypatch.setenv("_ZENOH_CBEF_COMPLETE", "complete_bash")
        monkeypatch.setenv("COMP_WORDS", "\n".join(words))
        monkeypatch.setenv("COMP_CWORD", str(len(words) - 1))
        status, out, _ = call(monkeypatch, capsys)
        assert status == 0
        return out.split()

    return told


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("zenoh-cbef exp", ["export", "experiment"]),
        ("zenoh-cbef run pa", ["paper"]),
        ("zenoh-cbef run --no-r", ["--no-report"]),
        ("zenoh-cbef scenario new x --from sc", ["scale24"]),
        ("zenoh-cbef verify ", ["one", "other"]),
        ("zenoh-cbef compare one ot", ["other"]),
        ("zenoh-cbef cat ./", []),
        ("zenoh-cbef experiment l", ["list", "loss"]),
        ("zenoh-cbef experiment show lo", ["loss"]),
        ("zenoh-cbef experiment loss --se", ["--seeds"]),
        ("zenoh-cbef fault add burst", ["burst-loss"]),
        ("zenoh-cbef status --run nothing-is-called-so", []),
        ("zenoh-cbef agent 0 --run x --conn", ["--connect"]),
        ("zenoh-cbef run --set consensus.rounds=5 pa", ["paper"]),
        ("zenoh-cbef run --set steps=", []),
        ("zenoh-cbef agent 0 --connect tcp/127.0.0.1:7447 --cl", ["--client"]),
    ],
)
def test_a_shell_completes(complete, line, expected):
    assert complete(line) == expected


def test_the_name_of_a_run_that_goes_on_is_completed(complete, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    with registered("mine-1", []):
        assert complete("zenoh-cbef status --run mi") == ["mine-1"]
    assert complete("zenoh-cbef status --run mi") == []


@pytest.mark.processes
@pytest.mark.skipif(not Path("/bin/bash").exists(), reason="this system has no bash there")
def test_bash_completes_with_the_script_that_it_is_given(tmp_path):
    program = tmp_path / "zenoh-cbef"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m zenoh_cbef "$@"\n')
    program.chmod(0o755)
    environment = os.environ | {
        "PATH": f"{tmp_path}:{os.environ['PATH']}",
        "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1",
    }
    script = subprocess.run(
        [program, "--show-completion", "bash"], env=environment, capture_output=True, text=True, check=True
    ).stdout
    asks = 'COMP_WORDS=(zenoh-cbef run pa); COMP_CWORD=2; _zenoh_cbef_completion zenoh-cbef; echo "${COMPREPLY[@]}"'
    done = subprocess.run(
        ["bash", "-c", f"{script}\n{asks}"], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout == "paper\n"


@pytest.mark.parametrize("words", [[], ["certs"]])
def test_no_words_are_answered_with_help_and_nothing_else(monkeypatch, capsys, words):
    status, out, err = call(monkeypatch, capsys, *words)
    assert (status, err) == (2, "")
    assert out.strip().startswith("Usage:")
