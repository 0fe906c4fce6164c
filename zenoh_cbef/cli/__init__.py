"""One thin file per verb: parse, call, print. What verbs share is in rooms below them."""
