"""The lab joins a run that this host does not know of, by its endpoint."""

import json
import re

import pytest

from zenoh_cbef.outside.registry import known_runs

client = pytest.importorskip("websockets.sync.client", reason="the extra 'lab' is not installed")
pytest.importorskip("uvicorn", reason="the extra 'lab' is not installed")


def test_a_run_of_another_host_is_joined_by_its_endpoint(world, monkeypatch, tmp_path):
    world.start_run("steps=100000")
    world.wait_for_messages()
    [endpoint] = known_runs()[world.run].endpoints[:1]
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))  # as on another host
    lab = world.start("lab", world.run, "--connect", endpoint, "--no-browser")
    assert lab.stderr is not None
    url = next(found[1] for line in lab.stderr if (found := re.search(r"http:(//\S+)", line)))
    with client.connect("ws:" + url.replace("/?", "/talk?")) as socket:
        socket.send(json.dumps({"ask": "scene"}))
        data = socket.recv(timeout=100)
        told = json.loads(data[4 : 4 + int.from_bytes(data[:4], "little")])
    assert (told["run"], told["live"], told["state"]) == (world.run, True, "goes on")
    assert told["agents"] == 4
