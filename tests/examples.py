"""How many random examples a test tries: few whenever the tests run, and ten times as many in `make thorough`."""

from __future__ import annotations

import os
from typing import Any

from hypothesis import settings

TIMES = int(os.environ.get("EXAMPLES", "1"))
settings.register_profile("project", max_examples=30 * TIMES, deadline=None)
settings.load_profile("project")  # for tests that do not say how many; conftest.py imports this file first


def examples(count: int, **how: Any) -> settings:
    """Hypothesis's settings for so many examples, without a limit of time."""
    return settings(max_examples=count * TIMES, deadline=None, **how)
