"""Runs are found as long as their targets live, however these end."""

import json
import os
import shutil
import signal
import subprocess
import sys

import pytest

from tests.terminal import Terminal
from zenoh_cbef.errors import UserError
from zenoh_cbef.outside.registry import find_run, known_runs, registered

HOLD = """
import sys
from zenoh_cbef.outside.registry import registered
with registered("elsewhere", ["tcp/127.0.0.1:1"], launched="launched" in sys.argv):
    print("registered", flush=True)
    sys.stdin.read()
"""


@pytest.fixture(autouse=True)
def own_folder(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))


def test_a_run_is_known_by_name_or_as_the_only_one_while_it_lasts():
    with registered("here", ["tcp/127.0.0.1:1", "tcp/127.0.0.1:2"]):
        assert find_run(None) == find_run("here")
        assert (find_run(None).name, find_run(None).endpoints) == ("here", ["tcp/127.0.0.1:1", "tcp/127.0.0.1:2"])
        with registered("other", []), pytest.raises(UserError, match="here, other"):
            find_run(None)
        with pytest.raises(UserError, match="goes on on this host already"), registered("here", []):
            pass
        assert known_runs().keys() == {"here"}
    assert known_runs() == {}
    with pytest.raises(UserError, match="there is none"):
        find_run("here")
    with pytest.raises(UserError, match=r"^no run goes on on this host; start one, or reach one of another host"):
        find_run(None)


def test_a_run_whose_target_was_killed_is_forgotten_and_its_name_is_free(tmp_path):
    with subprocess.Popen([sys.executable, "-c", HOLD], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stdout.readline() == b"registered\n"
        assert known_runs().keys() == {"elsewhere"}
        process.send_signal(signal.SIGKILL)
    assert known_runs() == {}
    assert not list(tmp_path.rglob("*.json"))
    with registered("elsewhere", []):
        assert known_runs().keys() == {"elsewhere"}


@pytest.mark.parametrize("fails", [True, False])
def test_a_run_whose_target_died_alone_says_so_until_its_starter_ends(fails):
    between = "import subprocess, sys; subprocess.run(sys.argv[1:]); print('over', flush=True); sys.stdin.read()"
    dies = "raise ValueError" if fails else "import os; os.kill(os.getpid(), 9)"
    command = [sys.executable, "-c", between, sys.executable, "-c", HOLD.replace("sys.stdin.read()", dies), "launched"]
    pipe, nowhere = subprocess.PIPE, subprocess.DEVNULL
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=nowhere) as starter:
        assert starter.stdin is not None
        assert starter.stdout is not None
        assert [starter.stdout.readline() for _ in range(2)] == [b"registered\n", b"over\n"]
        assert known_runs() == {}
        for name in (None, "elsewhere"):
            with pytest.raises(UserError, match=r"the target of run 'elsewhere' has died.*with Ctrl-C"):
                find_run(name)
        starter.stdin.close()
    with pytest.raises(UserError, match="there is none"):
        find_run("elsewhere")


OWN = "from zenoh_cbef.outside.registry import find_run; print(find_run(None).own)"


def typed(code: str, *, terminal: bool = False, new_session: bool = False) -> bool:
    """What a program says that is started from another terminal, or in a session of its own, or as here."""
    if not terminal:
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, start_new_session=new_session, check=True
        )
        return done.stdout.strip() == "True"
    with Terminal([sys.executable, "-c", code]) as screen:
        assert screen.leave() == 0
        return screen.seen.strip() == "True"


@pytest.mark.parametrize("how", ["", "new session", "launched"])
def test_a_run_is_its_scripts_own_and_not_another_terminals(how):
    command = [sys.executable, "-c", HOLD]
    if how == "launched":  # as `run` does: a new session below one of its own
        between = "import subprocess, sys; subprocess.run(sys.argv[1:], start_new_session=True, check=True)"
        command = [sys.executable, "-c", between, *command, how]
    new = how != ""
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=new) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stdout.readline() == b"registered\n"
        assert typed(OWN)
        assert typed(OWN, new_session=True)
        assert not typed(OWN, terminal=True)
        process.stdin.close()


def test_in_a_container_whose_session_began_outside_a_run_is_its_scripts_own():
    inside = ["unshare", "--map-root-user", "--fork", "--pid", "--mount-proc"]
    if (
        shutil.which("unshare") is None
        or subprocess.run([*inside, "true"], capture_output=True, check=False).returncode
    ):
        pytest.skip("this machine lets no test make a process namespace")
    program = f"import os; assert os.getsid(0) == 0\n{HOLD.replace('sys.stdin.read()', '')}    {OWN}"
    done = subprocess.run([*inside, sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["registered", "True"]


def test_a_run_of_a_terminal_is_not_that_of_a_script():
    code = f"{HOLD.replace('sys.stdin.read()', '')}    exec({OWN!r})\n    import subprocess\n"
    code += f"    print(subprocess.run([sys.executable, '-c', {OWN!r}], start_new_session=True, text=True, "
    code += "capture_output=True).stdout)\n    sys.stdin.readline()"
    with Terminal([sys.executable, "-c", code]) as screen:
        screen.read_until(lambda seen: seen.count("True") == 2 or "False" in seen or "Error" in seen)
        assert screen.seen.count("True") == 2, "what is typed in the terminal of the run is its own"
        assert not typed(OWN)
        assert not typed(OWN, terminal=True)


@pytest.mark.parametrize("words", ["", "{", "7", "[1", '{"endpoints": 3, "sessions": []}', '{"sessions": []}'])
def test_a_file_that_says_nothing_is_passed_over(tmp_path, words):
    with registered("here", ["tcp/127.0.0.1:1"]):
        [path] = tmp_path.rglob("here.json")
        path.write_text(words)
        assert known_runs() == {}


def test_the_file_of_an_earlier_version_is_read_and_its_run_is_not_our_own(tmp_path):
    with registered("here", []):
        [path] = tmp_path.rglob("here.json")
        path.write_text(json.dumps(["tcp/127.0.0.1:5"]))
        found = find_run("here")
        assert (found.endpoints, found.own, str(found)) == (["tcp/127.0.0.1:5"], False, "'here'")


@pytest.mark.parametrize("order", [["stop"], ["fault", "add", "loss", "probability=0.5"], ["fault", "clear"]])
def test_a_run_of_another_terminal_gets_no_order_that_does_not_name_it(order):
    command = [sys.executable, "-m", "zenoh_cbef", *order]
    with Terminal([sys.executable, "-c", HOLD]) as screen:
        screen.read_until(lambda seen: "registered" in seen)
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
        with Terminal(command) as other:
            other.read_until(lambda seen: "[y/N]" in seen)
            other.write("n\n")
            assert other.leave() == 1
        assert "nothing was done" in other.seen
    assert done.returncode == 2
    assert "'elsewhere', started at" in done.stderr
    assert "say so with --run elsewhere" in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_several_runs_are_named():
    with (
        registered("one", []),
        subprocess.Popen([sys.executable, "-c", HOLD], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process,
    ):
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stdout.readline() == b"registered\n"
        with pytest.raises(UserError, match="there are the runs elsewhere, one; say which"):
            find_run(None)
        process.stdin.close()


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can act as another user")
def test_the_run_of_another_user_is_named_and_not_taken(monkeypatch, tmp_path):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    with registered("theirs", ["tcp/127.0.0.1:1"]):
        (place,) = tmp_path.glob("zenoh-cbef-*/theirs.json")
        os.chown(place, 65534, -1)
        assert known_runs() == {}
        for name in (None, "theirs"):
            with pytest.raises(UserError, match="'theirs' of user nobody, not yours"):
                find_run(name)
        with pytest.raises(UserError, match="no run 'mine' goes on"):
            find_run("mine")
        with registered("mine", []):
            assert find_run(None).name == "mine"


def test_a_wrong_name_is_answered_with_those_that_there_are():
    with registered("here", []), pytest.raises(UserError, match=r"there is run here\); name one of these, or give --c"):
        find_run("gone")
    with pytest.raises(UserError, match=r"there is none\); start it, or give --connect"):
        find_run("gone")
