"""What writer and reader of a log agree on: names in its files, and the numbers of its messages."""
