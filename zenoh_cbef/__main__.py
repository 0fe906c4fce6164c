"""`python -m zenoh_cbef` is `zenoh-cbef`."""

from zenoh_cbef.cli.calling.main import main

main()
