"""An agent and processes that are not what they say: with another's address, no neighbours, or without a name."""

import zenoh

from tests.processes.conftest import World, outsider, settings, unused_endpoint
from tests.waiting import until
from zenoh_cbef.protocol.addresses import own_host, with_ports
from zenoh_cbef.protocol.claims import claim
from zenoh_cbef.protocol.directory import Place, ask_directory
from zenoh_cbef.protocol.introducing import introduce, life_at
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.lives import new_life
from zenoh_cbef.protocol.presence import Presence
from zenoh_cbef.protocol.session import Connection, open_session


def linked(session: zenoh.Session, life: str) -> bool:
    return any(str(one.zid) == life for one in session.info.links())


def test_a_wrong_address_is_told_and_a_stranger_is_cut_off(world: World) -> None:
    target, agent = (unused_endpoint() for _ in range(2))
    keys, join = Keys(world.run), ["--run", world.run, "--patience", "100"]
    world.start("target", "tracking", *settings(), *join, "--listen", target)
    world.start("agent", "0", *join, "--connect", target, "--listen", agent)
    # Of two processes that are reached everywhere and on loopback alone, the second connects: the agent.
    liar, stranger = (with_ports(Connection([target], life=new_life(["tcp/8.8.8.8:1"]))) for _ in range(2))
    events: list[bytes] = []
    with outsider(target) as listener, open_session(liar) as first, open_session(stranger) as second:
        listener.declare_subscriber(keys.event("agent/0"), lambda sample: events.append(sample.payload.to_bytes()))
        presence = Presence(first, keys.all_live)
        assert claim(first, keys.claims, presence, "agent/1", 100.0, connection=liar)
        lie = Place("agent/1", str(first.zid()), own_host(), (target,))

        def told() -> bool:
            ask_directory(first, keys.links("agent/1"), lie)
            return any(f"at {target} another process answers".encode() in one for one in events)

        until(told, events)
        life = life_at(agent, stranger)
        assert not linked(first, life)
        assert introduce(stranger.listen[0], agent, stranger, lambda: linked(second, life))
        Presence(second, keys.all_live).enter("agent/2")  # which is no neighbour of agent 0
        until(lambda: not linked(second, life))


def test_a_link_over_which_no_name_comes_is_made_again(world: World) -> None:
    target, agent = (unused_endpoint() for _ in range(2))
    keys, join = Keys(world.run), ["--run", world.run, "--patience", "100"]
    world.start("target", "tracking", *settings(), *join, "--listen", target)
    world.start("agent", "0", *join, "--connect", target, "--listen", agent)
    mute = with_ports(Connection([target], life=new_life(["tcp/8.8.8.8:1"])))  # so the agent connects
    made: list[str] = []
    with open_session(mute) as session:
        session.info.declare_link_events_listener(
            lambda event: made.append(str(event.link.zid)) if event.kind == zenoh.SampleKind.PUT else None
        )
        presence = Presence(session, keys.all_live)
        assert claim(session, keys.claims, presence, "agent/1", 100.0, connection=mute)
        own = Place("agent/1", str(session.zid()), own_host(), tuple(mute.listen))
        # The target may have let in agent 1 before agent 0 listens.
        life = until(lambda: life_at(agent, mute))

        def linked_twice() -> bool:
            ask_directory(session, keys.links("agent/1"), own)
            return made.count(life) > 1

        until(linked_twice, made)
        presence.enter("agent/1")
        until(lambda: linked(session, life))
