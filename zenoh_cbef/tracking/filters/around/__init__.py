"""What may stand around a filter of any kind: one file each."""
