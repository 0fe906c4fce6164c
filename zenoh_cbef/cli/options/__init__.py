"""What verbs take, where several take the same."""
