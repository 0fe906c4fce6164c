"""What the tracker reaches, measured: run `python -m benchmarks --list`, then `python -m benchmarks NAME`."""

import os

# As in every verb, and before NumPy is imported: idle threads wait at full speed, and that CPU would be measured, too.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
