"""A verb without a process of its own: for what it does and says, where its start would take longer than its work."""

from __future__ import annotations

import io
import signal
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest

from zenoh_cbef.cli.calling.main import main


def within(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """What a verb does and says in a folder, as if it had been a process."""
    streams = [io.TextIOWrapper(io.BytesIO(), encoding="utf-8", write_through=True) for _ in range(2)]
    heeds = signal.getsignal(signal.SIGINT)
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(streams[0]), redirect_stderr(streams[1]):
        patch.chdir(folder)
        patch.setattr(sys, "argv", ["zenoh-cbef", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
    signal.signal(signal.SIGINT, heeds)
    out, err = (stream.buffer.getvalue().decode() for stream in streams)
    assert isinstance(ended.value.code, int), err
    return subprocess.CompletedProcess(arguments, ended.value.code, out, err)
