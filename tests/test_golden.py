"""Runs recorded by version 0.1.0, or the first that could, for each kind of filter and what stands around: they verify.

A change that alters a bit of lockstep on purpose records them anew, and the changelog says so.
"""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from zenoh_cbef.log.prove.verify import verify
from zenoh_cbef.tracking.filters import KINDS

LOGS = sorted((Path(__file__).parent / "golden").glob("*.mcap"))
# Processors differ in the last bits of logarithms and matrix products: those with AVX-512 from those without.
VECTORS = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
AVX512 = [name for name in VECTORS if name.startswith(("X86_V4", "AVX512"))]
FROM_AVX2 = {"supposing"}  # all other runs come from a processor with AVX-512
# What NumPy and OpenBLAS read as they start: a processor with AVX-512 then computes as one without.
AS_AVX2 = {"NPY_DISABLE_CPU_FEATURES": " ".join(AVX512), "OPENBLAS_CORETYPE": "Haswell"}


def as_case(log):
    """What needs a process of its own is no fast test."""
    return pytest.param(log, id=log.stem, marks=pytest.mark.processes if AVX512 and log.stem in FROM_AVX2 else ())


@pytest.mark.parametrize("log", [as_case(log) for log in LOGS])
def test_a_run_of_before_comes_out_the_same(log):
    if AVX512 and log.stem in FROM_AVX2:
        command = [sys.executable, "-m", "zenoh_cbef", "verify", str(log)]
        done = subprocess.run(command, env={**os.environ, **AS_AVX2}, capture_output=True, text=True, check=False)
        assert done.stdout.startswith("equal bit for bit: 600 messages"), done.stdout + done.stderr
        return
    # No setting gives a processor without AVX-512 the other's last bits.
    alike = bool(AVX512) or log.stem in FROM_AVX2
    verdict = verify(log, tolerance=0.0 if alike else 1e-9)
    assert verdict.result == "equal", verdict.text
    assert verdict.compared >= 24


@pytest.mark.skipif(not AVX512, reason="the test above compares these runs here, bit for bit")
@pytest.mark.parametrize("name", sorted(FROM_AVX2))
def test_a_run_of_another_processor_comes_out_nearly_the_same(name):
    verdict = verify(Path(__file__).parent / "golden" / f"{name}.mcap", tolerance=1e-7)
    assert verdict.result == "equal", verdict.text


def test_every_filter_kind_has_one():
    assert KINDS.keys() <= {log.stem for log in LOGS}
