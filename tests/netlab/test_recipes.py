"""The recipes of docs/hosts.md, word for word, on virtual hosts with other addresses."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.netlab.conftest import AGENTS
from tests.netlab.forking import forking_commands

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "hosts.md").read_text(encoding="utf-8")
PATH = f"{Path(sys.executable).parent}:{os.environ['PATH']}"


def blocks(heading: str) -> list[str]:
    (section,) = re.findall(rf"^## {heading}\n(.*?)^## ", PAGE, re.DOTALL | re.MULTILINE)
    return [text.replace("target tracking", "target tracking --set steps=60") for text in section.split("```\n")[1::2]]


class Shell:
    """Runs lines on hosts and leaves nothing behind."""

    def __init__(self, lab, folder: Path, commands: Path) -> None:
        self._lab, self._folder = lab, folder
        self._path = f"{commands}:{PATH}"
        self.started: list[subprocess.Popen[str]] = []

    def start(self, host: str, script: str) -> subprocess.Popen[str]:
        words = self._lab.command(host, ["bash", "-euc", script])
        process = subprocess.Popen(
            words, cwd=self._folder, env=os.environ | {"PATH": self._path}, text=True, stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        self.started.append(process)
        return process

    def finish(self, process: subprocess.Popen[str]) -> str:
        out, _ = process.communicate(timeout=100)
        assert process.returncode == 0, out
        return out


@pytest.fixture
def shell(lab, tmp_path):
    with forking_commands(tmp_path / "bin") as commands:
        one = Shell(lab, tmp_path, commands)
        yield one
        for host in lab.hosts:
            lab.kill(host)
        for process in one.started:
            process.communicate(timeout=100)


def test_two_laptops(shell, lab):
    first, second = lab.address("a0"), lab.address("a1")
    here, there, after, *_ = [
        text.replace("192.168.1.10", first).replace("192.168.1.11", second) for text in blocks("Two laptops")
    ]
    running = [shell.start("a0", here), shell.start("a1", there)]
    said = "".join(shell.finish(process) for process in running)
    for agents in ("0-2", "3-5"):
        assert f"agents {agents} ended after step 60" in said
    assert "equal bit for bit" in shell.finish(shell.start("a0", after.splitlines()[0]))


def test_a_rack_with_a_router(shell, lab):
    at_router, elsewhere, *_ = [
        text.replace("rack-router", lab.address("router")) for text in blocks("A rack with a router")
    ]
    certificates, router = at_router.splitlines()
    shell.finish(shell.start("router", certificates))
    join, target, record, agent = elsewhere.splitlines()
    running = [shell.start("target", f"{join}\n{target}"), shell.start("record", f"{join}\n{record}")]
    agents = [agent.replace("agent 3", f"agent {number}") for number in range(AGENTS)]
    running += [shell.start(f"a{number}", f"{join}\n{words}") for number, words in enumerate(agents)]
    shell.start("router", router)
    for process in running:
        shell.finish(process)
    assert "equal bit for bit" in shell.finish(shell.start("record", "zenoh-cbef verify rack.mcap"))


def test_two_sites_with_a_router_each(shell, lab):
    first, second = lab.address("a0"), lab.address("a1")
    routers, here, there, *_ = [
        text.replace("192.168.1.10", first).replace("192.168.2.10", second).replace("--patience 60", "--patience 100")
        for text in blocks("Two sites with a router each")
    ]
    here = here.replace("--client", "--client --patience 100", 1)
    for host, router in zip(("a0", "a1"), routers.splitlines(), strict=True):
        shell.start(host, router)
    running = [shell.start("a0", here), shell.start("a1", there)]
    said = "".join(shell.finish(process) for process in running)
    for agents in ("0-2", "3-5"):
        assert f"agents {agents} ended after step 60" in said
    assert "equal bit for bit" in shell.finish(shell.start("a0", "zenoh-cbef verify sites.mcap"))
