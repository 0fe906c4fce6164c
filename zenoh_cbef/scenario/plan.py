"""The plan of a run: everything that follows from its scenario alone, made once and handed down."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.faults import Absences
from zenoh_cbef.scenario import bending, near_plane, network, start, trust
from zenoh_cbef.scenario.model import Scenario
from zenoh_cbef.scenario.motion import assumed_models, assumed_motion, plain_motion, switches
from zenoh_cbef.scenario.plausible import Plausible, plausible_ranges
from zenoh_cbef.scenario.scheme import chosen_scheme
from zenoh_cbef.tracking import graph
from zenoh_cbef.tracking.compact import Compact
from zenoh_cbef.tracking.filters import Abilities, Filter, FilterSettings, abilities_of, make_filter, sharing_of
from zenoh_cbef.tracking.filters.base import Belief, Sharing
from zenoh_cbef.tracking.motion import LinearMotion, Motion, begun
from zenoh_cbef.tracking.payloads import InformationPayloads, Payloads, SeveralPayloads, StatePayloads
from zenoh_cbef.tracking.ranging import Space
from zenoh_cbef.tracking.weights import spectrum_bounds, weight_matrix


@dataclass(frozen=True, eq=False)
class Plan:
    """What a scenario means: each part is made when it is first asked for. like: a plan under another seed, or None."""

    scenario: Scenario
    like: Plan | None = None

    @property
    def realtime(self) -> bool:
        """Whether rounds have deadlines."""
        return self.scenario.timing.mode == "realtime"

    @property
    def abilities(self) -> Abilities:
        """What the scenario's kind of filter can do."""
        return abilities_of(self.scenario.filter.kind)

    @cached_property
    def space(self) -> Space:
        """Three axes, or the plane at filter.planar_height."""
        return Space(self.scenario.filter.planar_height)

    @cached_property
    def motion(self) -> Motion:
        """The filter's model of the target's motion; beside several, that of the first fix."""
        return assumed_motion(self.scenario, self.range_std, self.space.axes)

    @cached_property
    def models(self) -> tuple[Motion, ...]:
        """The motions between which the target switches; none where the filter assumes one."""
        biased = trust.may_be_biased(self.scenario) and self.scenario.filter.bias != "none"
        single = self.distrusts_others or (self.scenario.filter.recovery and self.scenario.filter.defaults < 4)
        several = switches(self.scenario, alone=biased or single or not self.abilities.models)
        return assumed_models(self.scenario, self.range_std, self.space.axes) if several else ()

    @cached_property
    def plain_motion(self) -> LinearMotion:
        """What smoothing and predictions are computed with, which are of linear models in position and velocity."""
        return plain_motion((self.motion,), self.motion)

    @cached_property
    def calm_motion(self) -> LinearMotion:
        """What the bound is computed with: of several motions the calmest, as none of them may be below it."""
        return plain_motion(self.models, self.motion) if self.models else self.plain_motion

    @cached_property
    def range_std(self) -> float:
        """The range noise that the filter assumes, m; where it is learned, what it begins with."""
        assumed = self.scenario.filter.range_std
        return self.scenario.sensor.range_std if assumed is None or assumed == "auto" else assumed

    @cached_property
    def distrusts_others(self) -> bool:
        """Whether neighbours may send wrong values; agents then compare and trim the information of one filter."""
        return trust.suspects(self.scenario)

    @cached_property
    def isolates(self) -> bool:
        """Whether agents leave out neighbours whose messages their own prediction rules out."""
        return self.rounds > 0 and isinstance(self.payloads, InformationPayloads) and trust.isolates(self.scenario)

    @cached_property
    def distrusts_own(self) -> bool:
        """Whether agents distrust their own receivers while implausible."""
        return trust.distrusts(self.scenario, others=self.distrusts_others)

    @cached_property
    def bias(self) -> str:
        """What the filter does about biases: none, estimate, or auto where it can weigh them."""
        single = self.distrusts_others or (self.scenario.filter.recovery and self.scenario.filter.defaults < 2)
        unfit = single or bool(self.models) or not isinstance(self.motion, LinearMotion)
        return trust.bias(self.scenario, unfit=unfit)

    @cached_property
    def squares(self) -> bool:
        """Whether agents share squared ranges, which the network linearises after it has averaged them."""
        unfit = self.bias != "none" or self.models or self.distrusts_others or not self.abilities.biases
        return not unfit and bending.after(self.scenario, self.plain_motion, self.range_std)

    @cached_property
    def plane(self) -> near_plane.Plane | None:
        """The plane that agents are so near that they track target and mirror image until ranges tell them apart."""
        single = self.models or self.squares or self.bias != "none" or self.distrusts_others or self.distrusts_own
        fits = not single and self.abilities.biases and self.motion.size == 2 * self.space.axes
        return near_plane.plane(self.scenario, self.range_std, self.space.axes) if fits else None

    @cached_property
    def power(self) -> int:
        """The power of the saturation."""
        return trust.saturation_power(self.scenario, biased=self.bias != "none", fixed=self.first_fix_steps > 0)

    @cached_property
    def xi(self) -> float:
        """The saturation level, in the units of the filter's kind."""
        return trust.saturation_level(self.scenario, self.power)

    @cached_property
    def settings(self) -> FilterSettings:
        """The settings of the scenario's filter."""
        scenario, chosen, range_std = self.scenario, self.scenario.filter, self.range_std
        return FilterSettings(
            motion=self.motion,
            models=self.models,
            leaving=chosen.switching,
            middle=start.middle(scenario)[: self.space.axes],
            squares=self.squares,
            plane=self.plane,
            space=self.space,
            range_std=range_std,
            xi=self.xi,
            network_size=scenario.count if scenario.consensus.rounds else 1,  # Without rounds agents are alone.
            omega=chosen.omega,
            differenced=chosen.measurement == "difference",
            power=self.power,
            widens=trust.widens(scenario, power=self.power, wide=bool(self.models) or self.squares),
            recovers=chosen.recovery,
            distrusts=self.distrusts_own,
            returns=chosen.defaults > 3,
            says_status=chosen.status and self.abilities.information,
            judges_agents=chosen.status_rules > 1,
            reacquires=(window := start.window(scenario, self.settling_steps)),
            spreading=start.spreading(scenario, window),
            bends=chosen.defaults > 7,
            prompt=chosen.defaults > 8 and not trust.real(scenario),
            supposes=start.supposes(scenario, window) and bending.may_pause(scenario, self.plain_motion, range_std),
            cut_off=scenario.consensus.rounds * (self.abilities.biases and network.tells_members(scenario)),
            anywhere=start.anywhere(scenario, self.motion, self.space),
            bias=self.bias,
            joint_biases=(joint := self.bias == "estimate" and trust.shares_biases(scenario)),
            likelihoods=trust.rules(scenario) > 1,
            common_bias_std=trust.common_bias_std(scenario, range_std, joint=joint),
            own_bias_std=trust.own_bias_std(scenario, range_std),
            told_biases=self.bias != "none" and trust.tells_biases(scenario),
            learns_noise=chosen.range_std == "auto",
            lasting=trust.lasts(scenario) and not self.models and not self.squares,
            doubts_noise=trust.doubts_noise(scenario) and not self.models and not self.squares,
            first_fix=self.first_fix_steps,
            outliers=start.outliers(scenario),
            squared_fix=start.squared_steps(scenario, self.first_fix_steps),
            tries_guess=self.search is not None and start.tries_guess(scenario),
            search=self.search,
            guesses=start.guesses(scenario) if chosen.defaults > 3 else None,
            options=chosen.options or {},
        )

    @cached_property
    def filter(self) -> Filter:
        """The scenario's filter."""
        return self.like.filter if self.like else make_filter(self.scenario.filter.kind, self.settings)

    @cached_property
    def sharing(self) -> Sharing:
        """What the filter's agents exchange; no filter is made for it."""
        return self.like.sharing if self.like else sharing_of(self.scenario.filter.kind, self.settings)

    @cached_property
    def payloads(self) -> Payloads:
        """How to read the payloads of the scenario's filter."""
        axes, size, kind = self.space.axes, self.motion.size, self.scenario.filter.kind
        if not self.abilities.information:
            return StatePayloads(axes)
        if self.models or self.plane:
            sizes = [one.size for one in self.models] or [size, size]
            return SeveralPayloads(tuple(InformationPayloads(axes, one) for one in sizes))
        omega = float(self.scenario.count) if self.scenario.filter.omega is None else self.scenario.filter.omega
        # Of biases the common part is a state, or all of them are; so is a square.
        size += self.scenario.count if self.settings.joint_biases else self.bias == "estimate" or self.squares
        return InformationPayloads(axes, size, (1.0, omega) if kind == "hcmci" else (1.0,))

    @cached_property
    def rounds(self) -> int:
        """Consensus rounds per step, L; none for a filter that keeps to itself."""
        return self.scenario.consensus.rounds if self.sharing.cooperates else 0

    @cached_property
    def slot(self) -> float:
        """How long a round lasts in realtime, s: the beacon, and then each round, has to come within one."""
        given = self.scenario.timing.round_deadline_ms
        return self.scenario.dt / (self.rounds + 1) if given is None else 1e-3 * given

    @cached_property
    def scheme(self) -> tuple[str, str]:
        """The consensus scheme, average or running-sums, and one sentence on why it was chosen."""
        return chosen_scheme(self.scenario, information=self.abilities.information)

    @property
    def sums(self) -> bool:
        """Whether the consensus scheme is running sums."""
        return self.scheme[0] == "running-sums"

    @cached_property
    def smoothing_lag(self) -> int:
        """By how many steps the smoothed estimates are later than the filter's; 0: agents do not smooth."""
        return int(np.ceil(self.scenario.filter.lag_seconds / self.scenario.dt * (1.0 - 1e-9)))

    @cached_property
    def message_size(self) -> int:
        """How many numbers a consensus message holds: the payload's, and one more for running sums."""
        return self.sharing.payload_size + self.sums

    @cached_property
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
    def bounds(self) -> Floats:
        """Least and largest eigenvalue of W other than 1, the same for every agent, (n, 2); zeros where unused."""
        bounds, stage = (0.0, 0.0), self.scenario.consensus
        if stage.acceleration == "chebyshev":
            bounds = stage.bounds or spectrum_bounds(weight_matrix(self.neighbours, self.weights))
        return np.tile(bounds, (self.scenario.count, 1))

    @cached_property
    def absences(self) -> Absences:
        """When the scenario's agents are not there."""
        return start.absences(self.scenario)

    @cached_property
    def plausible(self) -> Plausible:
        """Which ranges its receivers can measure at all."""
        return plausible_ranges(self.scenario)

    @cached_property
    def settling_steps(self) -> int:
        """After how many steps a network has found its target: at least 20, and about five ranges of every agent."""
        return start.settling_steps(self.scenario)

    @cached_property
    def first_fix_steps(self) -> int:
        """How many steps the first fix takes, 0 for none: agents must add up what they know, and not lie."""
        return start.fix_steps(self.scenario, self.settling_steps, self.absences)

    @cached_property
    def search(self) -> tuple[Floats, Floats] | None:
        """Where a first fix looks for the target, (1, s) and (1, s, s); None: around the initial estimate."""
        told = start.unknown(self.scenario) or not self.first_fix_steps
        return None if told else start.anywhere(self.scenario, self.motion, self.space)

    @cached_property
    def initial_states(self) -> Floats:
        """The agents' estimates before step 1, as configured, (n, 6)."""
        return start.initial_states(self.scenario)

    @cached_property
    def initial_covariance(self) -> Floats:
        """Covariance of the initial position and velocity along the axes, (s, s). Before a first fix it is wide."""
        return np.asarray(np.diag(start.first_std(self.scenario, fixed=self.first_fix_steps > 0)[self.space.kept] ** 2))

    @cached_property
    def initial_belief(self) -> Belief:
        """The agents' initial estimates along the estimated axes: states (n, s), covariances (n, s, s)."""
        return self.belief_at(self.initial_states)

    def belief_at(self, states: Floats) -> Belief:
        """The initial belief about states (r, 6)."""
        wide = np.repeat(self.initial_covariance[None], len(states), axis=0)
        return Belief(*begun(self.motion, states[:, self.space.kept], wide))
