"""What every process of a run has: its place on the network, inboxes, what it is told at the start."""
