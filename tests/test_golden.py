"""Runs recorded by version 0.1.0, or the first that could, for each kind of filter and what stands around: they verify.

A change that alters a bit of lockstep on purpose records them anew, and the changelog says so.
"""

from pathlib import Path

import numpy as np
import pytest

from zenoh_cbef.log.prove.verify import verify
from zenoh_cbef.tracking.filters import KINDS

LOGS = sorted((Path(__file__).parent / "golden").glob("*.mcap"))
# Processors differ in the last bits of logarithms and matrix products: those with AVX-512 from those without.
VECTORS = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
HAS_AVX512 = not {"X86_V4", "AVX512_SKX"}.isdisjoint(VECTORS)
FROM_AVX2 = {"supposing"}  # all other runs come from a processor with AVX-512


@pytest.mark.parametrize("log", LOGS, ids=lambda path: path.stem)
def test_a_run_of_before_comes_out_the_same(log):
    alike = (log.stem not in FROM_AVX2) == HAS_AVX512
    verdict = verify(log, tolerance=0.0 if alike else 1e-9)
    assert verdict.result == "equal", verdict.text
    assert verdict.compared >= 24


def test_every_filter_kind_has_one():
    assert KINDS.keys() <= {log.stem for log in LOGS}
