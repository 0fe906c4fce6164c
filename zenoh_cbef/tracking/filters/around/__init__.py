"""What may stand around a filter of any kind, and judges its ranges, or who is there: one file each."""
