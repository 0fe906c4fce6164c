"""`python -m zenoh_cbef` is `zenoh-cbef`."""

from zenoh_cbef.cli.main import main

main()
