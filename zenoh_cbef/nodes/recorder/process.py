"""The recorder process, from its start to its end."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from zenoh_cbef.log.write.run_log import RunLog
from zenoh_cbef.machine import require
from zenoh_cbef.nodes.common.briefing import Briefing, brief, introduce
from zenoh_cbef.nodes.common.links import Links
from zenoh_cbef.nodes.common.node import Identity, Node
from zenoh_cbef.nodes.common.recording import Status
from zenoh_cbef.nodes.recorder.at_source import at_source
from zenoh_cbef.nodes.recorder.attendance import led_by_a_target
from zenoh_cbef.nodes.recorder.described import as_text, described
from zenoh_cbef.nodes.recorder.handover import hand_over
from zenoh_cbef.nodes.recorder.overview import Overview
from zenoh_cbef.nodes.recorder.recorder import CAPACITY, Recorder
from zenoh_cbef.protocol.fair_mailbox import FairMailbox
from zenoh_cbef.protocol.keys import agent_named
from zenoh_cbef.protocol.reached import serve_reached
from zenoh_cbef.protocol.recorded import covering, recorded_keys
from zenoh_cbef.scenario.injected import liars


def run_recorder(
    identity: Identity,
    path: Path,
    *,
    keys: Sequence[str] = (),
    sync: bool,
    report: Callable[[Status], None],
    stay: float = 0.0,
    say: Callable[[str], None] = lambda _: None,
) -> Status:
    """Run the recorder process until the run ends or it is told to stop; returns the last status.

    keys: key expressions of what is recorded, whole or relative to the run; everything where there are none. stay: how
    long (s) the log can be fetched afterwards; say: gets sentences on that.
    """
    expressions = recorded_keys(identity.run, keys)
    with Node(identity) as node:
        # Subscribe before any process can see us: none sends before we listen. A full mailbox must not slow agents.
        mailboxes = [FairMailbox(node.session, one, CAPACITY) for one in expressions]
        briefing = brief(node)
        scenario = briefing.scenario
        require(links=scenario.count + 1)
        led = led_by_a_target(node)
        if led:
            node.claim_name()
            Links(node).keep()
        log = _begun(path, identity, briefing, expressions)
        overview = _overview(node, Status(identity.run, str(path), scenario.length), briefing, expressions)
        source, mailboxes = at_source(node, log, scenario, mailboxes, CAPACITY)
        recorder = Recorder(node, log, overview, mailboxes, briefing.plan, source=source)
        serve_reached(node.session, node.keys, f"record/{identity.name}", recorder.reached)
        node.presence.announce(f"record/{identity.name}")
        if led:  # a replay's subscribers get the recorded messages only
            introduce(identity, briefing.clock, recorder.say)
        try:
            recorder.run(sync=sync, report=report)
        finally:
            status = recorder.status()
            finished = recorder.target_ended == scenario.length
            log.close({"status": "finished" if finished else "stopped", **as_text(status)})
            if source is not None:
                source.close()
        status = recorder.status()
        status.state = "done"
        report(status)
        node.presence.withdraw()
        if stay:
            hand_over(node, path, stay, say)
    return status


def _begun(path: Path, identity: Identity, briefing: Briefing, expressions: Sequence[str]) -> RunLog:
    """A new log that says which run it is of."""
    text, scenario = briefing.text, briefing.scenario
    log = RunLog(path, scenario.record)
    log.describe(source=text.source, resolved=text.resolved, run=described(identity, scenario, expressions))
    return log


def _overview(node: Node, status: Status, briefing: Briefing, expressions: Sequence[str]) -> Overview:
    """What the recorder sees of the run."""

    def present() -> int:
        return sum(agent_named(name) is not None for name in node.presence.names())

    axes = 3 if briefing.scenario.filter.planar_height is None else 2
    overview = Overview(status, present, liars(briefing.plan, briefing.text.faults), axes)
    if briefing.text.step is None:
        # Of one that comes later the target learns which agents it hears.
        covers, agents = covering(expressions), range(briefing.scenario.count)
        overview.heard = dict.fromkeys((agent for agent in agents if covers(node.keys.estimate(agent))), 0)
    return overview
