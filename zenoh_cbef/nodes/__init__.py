"""The processes: agent, target, recorder and their launcher. The only place with threads, signals and clocks."""
