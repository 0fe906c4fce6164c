"""Once more, with nothing beside them, the tests that failed among others: `make test` ends with this where few failed.

A test that passes only alone asks more of the machine than it says. That is a fault of the test, to
be mended, and this names it. More than a few failures are the package's, so they are not tried again.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

FAILED = Path(".pytest_cache/v/cache/lastfailed")
FEW = 3


def main() -> int:
    failed = sorted(json.loads(FAILED.read_text())) if FAILED.exists() else []
    if not 0 < len(failed) <= FEW or not all("::" in one for one in failed):
        return 1
    print(f"\n{len(failed)} failed beside other tests; now alone:", flush=True)
    status = subprocess.call([sys.executable, "-m", "pytest", *failed])
    if status == 0:
        print("unsteady, to be mended; each failed beside other tests, as told above, and passed alone:")
        print("\n".join(f"  {one}" for one in failed))
    return status


if __name__ == "__main__":
    sys.exit(main())
