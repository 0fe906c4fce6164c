"""Who is not there when, and what of it is forgotten."""

import numpy as np
import pytest

from zenoh_cbef.errors import UserError
from zenoh_cbef.faults import Absences, Crash, Pause
from zenoh_cbef.faults.absence import _lasting
from zenoh_cbef.scenario.checks import check
from zenoh_cbef.scenario.load import parse
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate


def steps_where(of, count: int) -> list[list[int]]:
    return [np.flatnonzero(of(step)).tolist() for step in range(1, count + 1)]


def test_absences_begin_end_and_forget():
    crash = Crash.model_validate({"kind": "crash", "agents": (1,), "from": 0.25, "until": 0.45})
    pause = Pause.model_validate({"kind": "pause", "agents": (1, 2), "from": 0.4, "until": 0.65})
    absences = Absences([crash, pause], agents=3, dt=0.1, steps=8)
    assert steps_where(absences.at, 8) == [[], [], [1], [1, 2], [1, 2], [1, 2], [], []]
    assert steps_where(absences.begun, 8) == [[], [], [1], [2], [], [], [], []]
    assert steps_where(absences.ended, 8) == [[], [], [], [], [], [], [1, 2], []]
    assert steps_where(absences.reborn, 8) == [[], [], [], [], [], [], [1], []]
    assert absences.return_of(1, 4) == 7
    brief = Crash.model_validate({"kind": "crash", "agents": (1,), "from": 0.25, "until": 0.35})
    assert steps_where(Absences([brief], agents=2, dt=0.1, steps=5).reborn, 5) == [[], [], [], [1], []]
    forever = Absences([Crash(kind="crash", agents=(0,))], agents=2, dt=0.1, steps=4)
    assert steps_where(forever.at, 4) == [[0]] * 4
    assert forever.return_of(0, 2) is None
    assert [of(1).tolist() for of in (forever.begun, forever.ended, forever.crashed)] == [
        [True, False],
        [False, False],
        [True, False],
    ]
    assert forever.stretches() == [(1, 4)]


def test_a_run_without_agents_begins_where_the_last_one_goes():
    def absences(*agents):
        away = [
            Crash.model_validate({"kind": "crash", "agents": (agent,), "from": 0.1 + 0.2 * agent}) for agent in agents
        ]
        return Absences(away, agents=2, dt=0.1, steps=6)

    assert (absences(0, 1).empty, absences(0).empty, absences().empty) == (3, None, None)
    assert (absences(0).any, absences().any) == (True, False)
    assert not absences().at(3).any()


@pytest.mark.parametrize("kind", ["sicf", "icf", "hcmci", "ci", "kcf", "diffusion", "cbef-scaled"])
def test_after_a_crash_an_agent_is_back_among_its_neighbours(kind):
    fault = {"kind": "crash", "agents": [2], "from": 5.0, "until": 8.0}
    [trace] = simulate([parse({"filter": {"kind": kind}, "steps": 120, "fault": [fault]}, "test")])
    assert np.isnan(trace.estimates[2, 49:79]).all()
    assert np.isnan(trace.ranges[2, 49:79]).all()
    error = np.linalg.norm(trace.estimates[:, :, :3] - trace.truth[:, :3], axis=2)
    others = np.delete(error, 2, axis=0)[:, 99]
    assert error[2, 99] <= 1.1 * others.max()
    # A message that was not sent, or whose receiver was away, is not lost.
    links = trace.links
    touched = (links.source == 2) | (links.destination == 2)
    messages = links.sent[~touched].max() // 120
    assert not links.lost.any()
    assert (links.sent[touched] == 90 * messages).all()
    assert (links.sent[~touched] == 120 * messages).all()


def test_a_paused_agent_goes_on_from_what_it_knew():
    fault = {"kind": "pause", "agents": [2], "from": 5.0, "until": 6.0}
    data = {"filter": {"kind": "local"}, "steps": 70}
    [stopped], [whole] = (simulate([parse({**data, **more}, "test")]) for more in ({"fault": [fault]}, {}))
    assert np.isnan(stopped.estimates[2, 49:59]).all()
    assert stopped.estimates[2, :49].tobytes() == whole.estimates[2, :49].tobytes()
    # Nothing was measured meanwhile, so it knows less than had it gone on.
    spread = [np.trace(one.covariances[2, 59]) for one in (stopped, whole)]
    assert spread[0] > spread[1]
    assert stopped.estimates[3].tobytes() == whole.estimates[3].tobytes()


def test_what_cannot_work_is_refused():
    faults = [{"kind": "crash", "agents": [0, 1], "from": 1.0}, {"kind": "pause", "agents": [2], "until": 2.0}]
    with pytest.raises(UserError, match="none of the 3 agents is there"):
        check(Plan(parse({"agents": {"count": 3}, "fault": faults}, "test")))
    replay = {"kind": "byzantine", "mode": "replay", "agents": [1]}
    with pytest.raises(UserError, match="remembers nothing"):
        check(Plan(parse({"fault": [replay, {"kind": "crash", "agents": [1], "from": 1.0, "until": 2.0}]}, "test")))
    with pytest.raises(UserError, match="a pause ends"):
        parse({"fault": [{"kind": "pause", "agents": [1]}]}, "test")


def test_what_began_later_does_not_reach_back_to_the_first_step():
    outage = Pause.model_validate({"kind": "pause", "agents": (0,), "from": 0.0, "until": 0.45})
    crash = Crash.model_validate({"kind": "crash", "agents": (0,), "from": 0.25, "until": 0.45})
    absences = Absences([outage, crash], agents=1, dt=0.1, steps=6)
    assert steps_where(absences.at, 6) == [[0]] * 4 + [[]] * 2
    assert steps_where(absences.reborn, 6) == [[], [], [], [], [0], []]
    late = _lasting(np.array([[False, False, True, False, False]]), np.array([[True, True, True, True, False]]))
    assert late.tolist() == [[False, False, True, True, False]]
