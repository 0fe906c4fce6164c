"""What joblib's own thread stumbles over as Ctrl-C takes its work away is not told; other threads' failures are."""

import threading

from zenoh_cbef.experiment.cores import let_joblib_drop_work


def test_only_work_that_was_taken_away_is_not_told(monkeypatch):
    told = []
    monkeypatch.setattr(threading, "excepthook", lambda failed: told.append((failed.thread.name, failed.exc_type)))
    let_joblib_drop_work()

    def fail(error):
        raise error

    for name in ("ExecutorManagerThread", "another"):
        for error in (KeyError(1), ValueError(1)):
            thread = threading.Thread(target=fail, args=(error,), name=name)
            thread.start()
            thread.join()
    assert told == [("ExecutorManagerThread", ValueError), ("another", KeyError), ("another", ValueError)]
