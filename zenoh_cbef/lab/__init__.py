"""The lab: one page on which a reader sees a run, touches it, and winds it back."""
