"""The kinds of filters: one file each, with the name that `filter.kind` has for it."""
