"""What finds the target, at first and again, and says what an estimate is worth: one file each."""
