"""Sentences name who acts: an agent, a receiver, a caller, a reader, a user, a process."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PLACES = ("*.md", "benchmarks/*.py", "deploy/**/*", "docs/**/*", "zenoh_cbef/**/*")
SUFFIXES = {".css", ".html", ".js", ".json5", ".md", ".py", ".service", ".svg", ".toml", ".yaml"}
UNREAD = ("docs/images/", "docs/figures/")
FILES = sorted(
    path
    for place in PLACES
    for path in ROOT.glob(place)
    if path.suffix in SUFFIXES and not path.relative_to(ROOT).as_posix().startswith(UNREAD)
)
NO_ACTOR = re.compile(
    r"\b(?i:(?:some|any|no|every)(?:body|one)|no one|whom?ever)\b"
    r"|(?:^|[.:;(|\"#>])\s*Who [a-z][^?\n]*$",  # "Who comes back begins with ..." for "An agent that comes back ..."
    re.MULTILINE,
)


def test_sentences_name_who_acts():
    found = [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()}"
        for path in FILES
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if NO_ACTOR.search(line)
    ]
    assert not found, "\n".join(["name the agent, receiver, caller, reader, user or process instead:", *found])


def test_the_words_are_found_where_they_stand():
    assert len(FILES) > 200
    assert NO_ACTOR.search("Whoever asks is told.")
    assert NO_ACTOR.search("nobody = 0")
    assert NO_ACTOR.search("It waits. Who comes back begins with the estimates of the others.")
    assert not NO_ACTOR.search("Who sent it? The agent that owns the key.")
    assert not NO_ACTOR.search("No agent asks; one of them waits.")
