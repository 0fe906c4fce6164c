"""The plan of a run: everything that follows from its scenario alone, made once and handed down."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.scenario import network, start, trust
from zenoh_cbef.scenario.alike import alike
from zenoh_cbef.scenario.filtering import Filtering
from zenoh_cbef.scenario.motion import plain_motion
from zenoh_cbef.scenario.plausible import Plausible, plausible_ranges
from zenoh_cbef.scenario.scheme import chosen_scheme
from zenoh_cbef.tracking import graph
from zenoh_cbef.tracking.compact import Compact
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters import Filter, make_filter, payloads_of, sharing_of
from zenoh_cbef.tracking.filters.base import Belief, Sharing
from zenoh_cbef.tracking.motion import LinearMotion, begun
from zenoh_cbef.tracking.payloads import InformationPayloads, Payloads

_BEACON_ROUNDS = 3.0
"""As many rounds as the beacon, and what a filter makes of it, may last: `benchmarks round` tells what each costs."""


@dataclass(frozen=True, eq=False)
class Plan(Filtering):
    """What a scenario means: each part is made when it is first asked for. like: a plan under another seed, or None."""

    @property
    def realtime(self) -> bool:
        """Whether rounds have deadlines."""
        return self.scenario.timing.mode == "realtime"

    @property
    def closed_steps(self) -> int:
        """In how many of the first steps no agent may begin anew: those of a first fix that it could not join."""
        return 0 if self.settings.joins_fix and self.search is not None else self.first_fix_steps

    @alike
    def isolates(self) -> bool:
        """Whether agents leave out neighbours whose messages their own prediction rules out."""
        return self.rounds > 0 and isinstance(self.payloads, InformationPayloads) and trust.isolates(self.scenario)

    @alike
    def calm_motion(self) -> LinearMotion:
        """What the bound is computed with: of several motions the calmest, as none of them may be below it."""
        return plain_motion(self.models, self.motion) if self.models else self.plain_motion

    @alike
    def filter(self) -> Filter:
        """The scenario's filter."""
        return make_filter(self.scenario.filter.kind, self.settings)

    @alike
    def sharing(self) -> Sharing:
        """What the filter's agents exchange; no filter is made for it."""
        return sharing_of(self.scenario.filter.kind, self.settings)

    @alike
    def payloads(self) -> Payloads:
        """How to read the payloads of the scenario's filter."""
        return payloads_of(self.scenario.filter.kind, self.settings)

    @alike
    def rounds(self) -> int:
        """Consensus rounds per step, L; none for a filter that keeps to itself."""
        return self.scenario.consensus.rounds if self.sharing.cooperates else 0

    @alike
    def slot(self) -> float:
        """How long a round lasts in realtime, s."""
        given = self.scenario.timing.round_deadline_ms
        return self.scenario.dt / (_BEACON_ROUNDS + self.rounds) if given is None else 1e-3 * given

    def deadline(self, round_: int) -> float:
        """When a round is over in realtime, s after its step began; round 0 is the wait for the step's beacon.

        No agent waits for a deadline if its messages are there, so time that is given to the beacon, and not needed,
        serves all rounds.
        """
        first = _BEACON_ROUNDS if self.scenario.timing.round_deadline_ms is None else 1.0
        return self.slot * (first + round_)

    @alike
    def scheme(self) -> tuple[str, str]:
        """The consensus scheme, average or running-sums, and one sentence on why it was chosen."""
        return chosen_scheme(self.scenario, information=self.abilities.information)

    @property
    def sums(self) -> bool:
        """Whether the consensus scheme is running sums."""
        return self.scheme[0] == "running-sums"

    @alike
    def smoothing_lag(self) -> int:
        """By how many steps the smoothed estimates are later than the filter's; 0: agents do not smooth."""
        return int(np.ceil(self.scenario.filter.lag_seconds / self.scenario.dt * (1.0 - 1e-9)))

    @alike
    def message_size(self) -> int:
        """How many numbers a consensus message holds: the payload's, and one more for running sums."""
        return self.sharing.payload_size + self.sums

    @alike
    def compact(self) -> Compact | None:
        """How payloads travel in few bits; None: in all 64."""
        return self.scenario.consensus.compact(self.message_size, self.sharing.blocks)

    @cached_property
    def edges(self) -> graph.Edges:
        """The undirected communication graph, (m, 2)."""
        return network.edges(self.scenario)

    @cached_property
    def neighbours(self) -> graph.Neighbours:
        """The neighbours of every agent, in ascending order."""
        return graph.neighbours(self.scenario.count, self.edges)

    @cached_property
    def weights(self) -> Floats:
        """Consensus weights of every agent's neighbours, (n, m)."""
        return network.consensus_weights(self.scenario, self.neighbours)

    @cached_property
    def overcounted(self) -> Floats:
        """How often agents count a range that the network has once, as n times an average stands for it, (n,)."""
        if not self.abilities.biases or self.settings.tells_ranges:
            return np.ones(self.scenario.count)
        return network.overcounted(self.scenario, self.neighbours, self.weights)

    @cached_property
    def bounds(self) -> Floats:
        """Least and largest eigenvalue of W other than 1, the same for every agent, (n, 2); zeros where unused."""
        return np.tile(network.bounds(self.scenario, self.neighbours), (self.scenario.count, 1))

    @cached_property
    def plausible(self) -> Plausible:
        """Which ranges its receivers can measure at all."""
        return plausible_ranges(self.scenario)

    @cached_property
    def initial_states(self) -> Floats:
        """The agents' estimates before step 1, as configured, (n, 6)."""
        return start.initial_states(self.known.scenario)

    @cached_property
    def initial_covariance(self) -> Floats:
        """Covariance of the initial position and velocity along the axes, (s, s). Before a first fix it is wide."""
        std = start.first_std(self.known.scenario, fixed=self.first_fix_steps > 0)
        return np.asarray(np.diag(std[self.space.kept] ** 2))

    @cached_property
    def initial_belief(self) -> Belief:
        """The agents' initial estimates along the estimated axes: states (n, s), covariances (n, s, s)."""
        return self.belief_at(self.initial_states)

    def belief_at(self, states: Floats) -> Belief:
        """The initial belief about states (r, 6)."""
        wide = np.repeat(self.initial_covariance[None], len(states), axis=0)
        return Belief(*begun(self.motion, states[:, self.space.kept], wide))

    def guessed_at(self, guess: Belief, steps: int) -> Belief:
        """What an agent still knows of its guess so many steps later, if it has nothing else: what motion leaves of it.

        By rules of before, as if the target had not moved.
        """
        state, covariance = guess.state, guess.known_covariance
        for _ in range(steps * (self.scenario.filter.defaults > 17)):
            covariance = self.motion.predict_covariance(covariance, state)
            state = self.motion.predict_state(state)
        return replace(guess, state=state, covariance=covariance)
