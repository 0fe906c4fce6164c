"""One step of one batch of agents, without clocks, sockets or threads.

Every array has a leading agent axis: an agent process runs a batch of one, the simulator a batch of all agents
(of many runs, where many are simulated). The arithmetic of a row does not depend on the batch it stands in.
"""
