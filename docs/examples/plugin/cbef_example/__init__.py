"""What this package adds to zenoh-cbef."""
