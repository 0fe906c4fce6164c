"""What the tracker reaches, measured: run `python -m benchmarks --list`, then `python -m benchmarks NAME`."""
