"""What writer and reader of a log share: names in its files, and the numbers of its messages."""
