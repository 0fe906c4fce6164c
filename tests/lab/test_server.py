"""The lab's server, over real sockets: what it gives, and to whom."""

import json
import threading
from http.client import HTTPConnection

import pytest

from tests.log.made import made_log
from zenoh_cbef.errors import UserError
from zenoh_cbef.lab.bench import Bench
from zenoh_cbef.lab.guard import Guard
from zenoh_cbef.lab.server import Serving, address, bound

websockets = pytest.importorskip("websockets.sync.client", reason="the extra 'lab' is not installed")
pytest.importorskip("uvicorn", reason="the extra 'lab' is not installed")


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """A server's port, and the token."""
    bench, guard = Bench({}), Guard()
    bench.open_log(str(made_log(tmp_path_factory.mktemp("lab") / "run.mcap", "steps=5", "agents.count=4")))
    listening, there = bound("127.0.0.1", 0), threading.Event()
    serving = Serving(bench, guard, there.set)
    thread = threading.Thread(target=serving.run, args=(listening,))
    thread.start()
    assert there.wait(100)
    yield listening.getsockname()[1], guard.token
    serving.stop()
    thread.join(100)
    assert not thread.is_alive()


def get(port: int, path: str, **headers: str) -> tuple[int, dict[str, str], bytes]:
    connection = HTTPConnection("127.0.0.1", port, timeout=100)
    connection.request("GET", path, headers=headers)
    answer = connection.getresponse()
    found = answer.status, {name.lower(): value for name, value in answer.getheaders()}, answer.read()
    connection.close()
    return found


def test_the_page_needs_its_token_and_loads_nothing_from_outside(lab):
    port, token = lab
    status, headers, page = get(port, f"/?token={token}")
    assert status == 200
    assert b"zenoh-cbef lab" in page
    assert "default-src 'none'" in headers["content-security-policy"]
    assert "frame-ancestors 'none'" in headers["content-security-policy"]
    assert headers["referrer-policy"] == "no-referrer"
    for text in (b"http://", b"https://", b"//cdn"):
        assert text not in page
    for path in ("/", "/?token=", "/?token=wrong"):
        status, _, words = get(port, path)
        assert status == 403
        assert b"token" in words


@pytest.mark.parametrize("name", ["lab.js", "map.js", "uplot.js", "lab.css", "style.css"])
def test_modules_and_styles_are_there(lab, name):
    status, headers, data = get(lab[0], f"/{name}")
    assert status == 200
    assert len(data) > 500
    assert headers["content-type"].startswith("text/javascript" if name.endswith("js") else "text/css")


@pytest.mark.parametrize("path", ["/nosuch", "/uplot.LICENSE", "/..%2f..%2fetc%2fpasswd", "/index.html/x", "/%2e%2e/x"])
def test_nothing_else_is_there(lab, path):
    assert get(lab[0], path)[0] == 404


def test_another_host_name_is_refused_everywhere(lab):
    port, token = lab
    for path in (f"/?token={token}", "/lab.js", f"/scenario.toml?token={token}"):
        assert get(port, path, Host="evil.example")[0] == 403
        assert get(port, path, Host=f"localhost:{port}")[0] == 200


def test_a_foreign_page_gets_no_scenario(lab):
    port, token = lab
    assert get(port, "/scenario.toml")[0] == 403
    assert get(port, f"/scenario.toml?token={token}", Origin="http://evil.example")[0] == 403
    status, headers, text = get(port, f"/scenario.toml?token={token}", Origin=f"http://127.0.0.1:{port}")
    assert status == 200
    assert "attachment" in headers["content-disposition"]
    assert b"count = 4" in text


def ask(socket, table: object) -> dict:
    socket.send(table if isinstance(table, str) else json.dumps(table))
    data = socket.recv(timeout=100)
    return json.loads(data[4 : 4 + int.from_bytes(data[:4], "little")])


def test_a_socket_needs_token_and_own_origin(lab):
    port, token = lab
    url = f"ws://127.0.0.1:{port}/talk?token="
    with websockets.connect(url + token, origin=f"http://127.0.0.1:{port}") as socket:
        assert ask(socket, {"ask": "scene"})["agents"] == 4
        assert ask(socket, {"ask": "frame", "step": 3})["step"] == 3
    for token_, origin in ((token, "http://evil.example"), ("wrong", None), ("", None), (token, "null")):
        with pytest.raises(Exception, match=r"403|rejected"):
            websockets.connect(url + token_, origin=origin).__enter__()


ODD = ("", "{", "[]", "3", '"x"', '{"ask": {}}', '{"ask": "frame", "step": 1e400}', "[" * 5000)


@pytest.mark.parametrize("words", ODD)
def test_words_that_are_no_question_are_answered_and_the_socket_stays(lab, words):
    port, token = lab
    with websockets.connect(f"ws://127.0.0.1:{port}/talk?token={token}") as socket:
        ask(socket, words)
        assert ask(socket, {"ask": "frame"})["step"] == 5


def test_a_port_that_is_taken_is_named(lab):
    with pytest.raises(UserError, match="choose another with --port"):
        bound("127.0.0.1", lab[0])


def test_the_address_is_one_to_open():
    listening, guard = bound("127.0.0.1", 0), Guard()
    with listening:
        url = address(listening, "127.0.0.1", guard)
    assert url == f"http://127.0.0.1:{url.split(':')[2].split('/')[0]}/?token={guard.token}"
