"""docs/boards.md, word for word, on virtual hosts with other addresses."""

import re
from pathlib import Path

from tests.netlab.test_recipes import Shell, shell
from tests.waiting import until

__all__ = ["shell"]
PAGE = (Path(__file__).resolve().parents[2] / "docs" / "boards.md").read_text(encoding="utf-8")


def blocks(chapter: int, kind: str = "") -> list[str]:
    (text,) = re.findall(rf"^## {chapter}\. .*?\n(.*?)(?=^## |\Z)", PAGE, re.DOTALL | re.MULTILINE)
    found = re.findall(r"^```(\w*)\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    return [block for named, block in found if named == kind]


def lines_until(process, wanted: str) -> str:
    """What a process says, until it says this."""
    said = ""
    while wanted not in said:
        line = process.stdout.readline()
        assert line, said
        said += line
    return said


def test_three_boards_wait_for_each_other_run_and_are_listened_to(shell: Shell, lab, tmp_path):
    first = lab.address("a0")

    def here(text: str) -> str:
        return text.replace("192.168.1.20", first).replace("python3", "python")

    (tmp_path / "boards.toml").write_text(blocks(2, "toml")[0].replace("steps = 600", "steps = 200"))
    (tmp_path / "listen.py").write_text(blocks(6, "python")[0])
    at_first, *elsewhere = map(here, blocks(4))
    boards = [shell.start(f"a{board}", text) for board, text in enumerate(elsewhere, 1)]
    for number, board in enumerate(boards, 1):
        assert f"agent/{number} waits for run boards at tcp/{first}:7447" in lines_until(board, "3600 s at most")
    boards.append(shell.start("a0", at_first))
    status, (client, peer) = here(blocks(5)[0]), map(here, blocks(6))
    asks = f"{status.strip()} || true"
    until(lambda: "running, step" in shell.start("a1", asks).communicate(timeout=100)[0])
    listening = {
        "all": shell.start("record", client),
        "one": shell.start("target", peer),
        "none": shell.start("router", peer.replace(":7450", ":7447")),
    }
    said = "".join(shell.finish(board) for board in boards)
    for agent in range(3):
        assert f"agent {agent} ended after step 200" in said
    assert "hears the target alone; to hear the agents, let it connect as a client" in said
    for host in ("record", "target", "router"):
        lab.kill(host)
    heard = {
        name: {
            line.split()[0] for line in process.communicate(timeout=100)[0].splitlines() if line.startswith("agent/")
        }
        for name, process in listening.items()
    }
    assert heard == {"all": {"agent/0", "agent/1", "agent/2"}, "one": {"agent/0"}, "none": set()}
    assert "tracking" in shell.finish(shell.start("a0", here(blocks(5)[1])))
