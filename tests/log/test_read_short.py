"""The example that reads short messages reads what the package reads."""

from __future__ import annotations

import re
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.log.made import made_log
from zenoh_cbef.log.read.header import read_header
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.log.read.recording import read_recording
from zenoh_cbef.tracking.linalg import unpack_upper

DOCS = Path(__file__).parents[2] / "docs"
EXAMPLE = DOCS / "examples" / "read_short.py"


def test_the_example_is_short_needs_mcap_alone_and_is_what_the_page_shows():
    code = EXAMPLE.read_text(encoding="utf-8")
    assert f"```python\n{code}```" in (DOCS / "bytes.md").read_text(encoding="utf-8")
    assert len(code.splitlines()) <= 30
    assert set(re.findall(r"^(?:from|import) (\w+)", code, re.MULTILINE)) - sys.stdlib_module_names == {"mcap"}


@pytest.mark.slow
@pytest.mark.parametrize("bits", [8, 12, 16])
def test_it_reads_states_certainties_and_silence(tmp_path, monkeypatch, capsys, bits):
    keys = f"consensus.precision='int{bits}'", "consensus.trigger=0.1", "steps=25", "agents.count=5"
    log = open_log(made_log(tmp_path / "run.mcap", *keys))
    monkeypatch.setattr(sys, "argv", [str(EXAMPLE), str(log.path)])
    runpy.run_path(str(EXAMPLE))
    told = {tuple(line.split()[:5]): line.split()[5:] for line in capsys.readouterr().out.splitlines()}
    assert len(told) == 25 * 5 * 10
    payloads = read_recording(log, read_header(log), rounds="payloads").rounds.numbers("payload", 25)
    kinds = set()
    for row in range(50):
        at = f"cbef/made/agent/{row // 10}/round", "step", "25", "round", f"{row % 10 + 1}:"
        payload, said = payloads[row, 24], told[at]
        kinds.add(said[0])
        if np.isnan(payload[0]):
            assert said == ["silence"]
            continue
        matrix = unpack_upper(payload[None, 6:27], 6)[0]
        state = np.linalg.solve(matrix, payload[:6])
        np.testing.assert_allclose([*map(float, said[2:8])], state, rtol=0, atol=6e-4)
        assert float(said[10]) == pytest.approx(matrix[0, 0], rel=1e-3)
    assert kinds == {"x", "silence"}
