"""A run whose agents are fleets on three virtual hosts: links and bits, as the benchmark `hosts` measures them."""

from benchmarks.hosts import observe, settings_of
from zenoh_cbef.log.prove.verify import verify
from zenoh_cbef.scenario.load import load

AGENTS, STEPS = 12, 120


def test_fleets_on_three_hosts_link_along_the_graph_and_give_the_same_bits(tmp_path):
    overrides = settings_of(AGENTS, f"steps={STEPS}", "network.probability=0.3")
    seen = observe(AGENTS, overrides, tmp_path, hosts=3)
    edges = load("tracking", overrides).plan.edges.ravel().tolist()
    assert seen.links == {agent: edges.count(agent) + 2 for agent in range(AGENTS)}
    assert verify(seen.log).text.startswith("equal bit for bit")
