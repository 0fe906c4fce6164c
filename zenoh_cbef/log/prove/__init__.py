"""The run of a log executed again: to prove it, or with another filter."""
