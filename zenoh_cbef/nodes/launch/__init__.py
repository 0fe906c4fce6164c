"""All processes of a run, started and watched from one place."""
