"""What a scenario's filter is: everything that decides it, from its keys alone."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from zenoh_cbef.arrays import Floats
from zenoh_cbef.faults import Absences
from zenoh_cbef.scenario import bending, near_plane, network, start, telling, trust, weighing
from zenoh_cbef.scenario.alike import Meant, alike
from zenoh_cbef.scenario.motion import assumed_models, assumed_motion, doubted_noises, leaving, plain_motion, switches
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.elimination import BY_ELIMINATION
from zenoh_cbef.tracking.filters import Abilities, abilities_of
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.linalg import BY_LIBRARY
from zenoh_cbef.tracking.mirroring import Plane
from zenoh_cbef.tracking.motion import Jump, LinearMotion, Motion
from zenoh_cbef.tracking.ranging import Space


@dataclass(frozen=True, eq=False)
class Filtering(Meant):
    """What agents estimate, and how, made when first asked for; on seed and injected faults absences alone depend."""

    @property
    def abilities(self) -> Abilities:
        """What the scenario's kind of filter can do."""
        return abilities_of(self.scenario.filter.kind)

    @alike
    def space(self) -> Space:
        """Three axes, or the plane at filter.planar_height."""
        return Space(self.scenario.filter.planar_height)

    @alike
    def motion(self) -> Motion:
        """The filter's model of the target's motion; beside several, that of the first fix."""
        return assumed_motion(self.scenario, self.range_std, self.space.axes, leaps=self._leaps)

    @alike
    def models(self) -> tuple[Motion, ...]:
        """The motions between which the target switches; none where the filter assumes one."""
        if self._leaps or not self._switches:
            return ()
        told, leaps = self.tells_ranges, self._may_leap
        return assumed_models(self.scenario, self.range_std, self.space.axes, told=told, leaps=leaps)

    @alike
    def _may_leap(self) -> bool:
        """Whether steps are so long that a target which turns may be anywhere after one, and ranges tell where."""
        scenario, chosen = self.scenario, self.scenario.filter
        turns = chosen.motion == "auto" and switches(scenario, alone=False) and self.abilities.models
        told = scenario.count > self.space.axes and scenario.consensus.rounds > 0 and chosen.linearise != "before"
        return turns and told and start.leaps(scenario, self.range_std)

    @alike
    def _leaps(self) -> bool:
        """Whether one motion that leaps in this way stands for several.

        Where biases leave room for one, or agents do not tell each other their ranges: each would linearise its own at
        an agile prior, over which it bends. There no agent alone tells a wrong range, nor all the side of a plane.
        """
        if self.tells_ranges:
            return self._may_leap and not self._switches
        flat = near_plane.flat(self.scenario, self.range_std, self.space.axes)
        return self._may_leap and not (self.distrusts_others or flat or trust.may_be_wrong(self.scenario))

    @alike
    def _switches(self) -> bool:
        """Whether the filter assumes that the target switches between motions."""
        single = self.distrusts_others or telling.needs_biases(self.scenario, self.range_std, self.space.axes)
        return switches(self.scenario, alone=single or not self.abilities.models)

    @alike
    def noises(self) -> tuple[Motion, ...]:
        """The filter's motion with the noises of which ranges decide; none where the noise is not in doubt.

        Ranges that are often wrong first have to tell where the target is.
        """
        single = self.bias != "none" or self.distrusts_others or self.models or self.plane
        mistaken = self.tells_ranges and telling.may_mistake(self.scenario, self.range_std, self.space.axes)
        unfit = single or mistaken or not self.abilities.models or trust.recovers(self.scenario)
        return () if unfit else doubted_noises(self.scenario, self.motion, told=self.tells_ranges, leaps=self._leaps)

    @alike
    def tells_ranges(self) -> bool:
        """Whether agents tell each other their ranges, of which each takes in all."""
        assumed, leaps = (self.scenario, self.range_std, self.space.axes), self._may_leap
        motions = assumed_models(*assumed) if self._switches else (assumed_motion(*assumed, leaps=leaps),)
        return telling.tells_ranges(self.scenario, motions, self.range_std, self.settling_steps, leaps=leaps)

    @property
    def seeks(self) -> bool:
        """Whether they look for a target that those deny to be where it is thought to be, without another fix."""
        chosen, several = self.scenario.filter, self.models or self.noises
        return self.tells_ranges and not several and chosen.reacquire and chosen.defaults > 12

    @alike
    def plain_motion(self) -> LinearMotion:
        """What smoothing and predictions are computed with: linear, in position and velocity."""
        return plain_motion((self.motion,), self.motion)

    @alike
    def range_std(self) -> float:
        """The range noise that the filter assumes, m; where it is learned, what it begins with."""
        assumed = self.scenario.filter.range_std
        return self.scenario.sensor.range_std if assumed is None or assumed == "auto" else assumed

    @alike
    def distrusts_others(self) -> bool:
        """Whether neighbours may send wrong values; agents then compare and trim the information of one filter."""
        return trust.suspects(self.scenario)

    @alike
    def distrusts_own(self) -> bool:
        """Whether agents distrust their own receivers while implausible."""
        return trust.distrusts(self.scenario, others=self.distrusts_others)

    @alike
    def bias(self) -> str:
        """What the filter does about biases: none, estimate, or auto where it can weigh them."""
        chosen = self.scenario.filter
        fits = trust.shares_biases(self.scenario) if self.tells_ranges else not self.models
        single = self.distrusts_others or (chosen.recovery is True and chosen.defaults < 2)
        return trust.bias(self.scenario, unfit=single or not (fits and isinstance(self.motion, LinearMotion)))

    @alike
    def squares(self) -> bool:
        """Whether agents share squared ranges, which the network linearises after it has averaged them."""
        unfit = self.tells_ranges or self.bias != "none" or self.models or self.distrusts_others
        return self.abilities.biases and not unfit and bending.after(self.scenario, self.plain_motion, self.range_std)

    @alike
    def plane(self) -> Plane | None:
        """The plane that agents are so near that they track target and mirror image until ranges tell them apart."""
        several, single = self.tells_ranges or bool(self.models), self.squares or self.distrusts_others
        single |= not trust.real(self.scenario) and (self.bias != "none" or self.distrusts_own)
        usual = several or self.motion.size == 2 * self.space.axes
        known = self.tells_ranges or (usual and not single and self.abilities.biases)
        return near_plane.plane(self.scenario, self.range_std, self.space.axes, several=several) if known else None

    @alike
    def power(self) -> int:
        """The power of the saturation."""
        fixed, several = self.first_fix_steps > 0, bool(self.models)
        return weighing.saturation_power(self.scenario, biased=self.bias != "none", fixed=fixed, several=several)

    @alike
    def xi(self) -> float:
        """The saturation level, in the units of the filter's kind."""
        return weighing.saturation_level(self.scenario, self.power)

    @alike
    def settings(self) -> FilterSettings:
        """The settings of the scenario's filter."""
        return self._finding(self._measuring(self._filtering()))

    def _filtering(self) -> FilterSettings:
        """What the filter estimates, and how."""
        scenario, chosen = self.scenario, self.scenario.filter
        return FilterSettings(
            motion=self.motion,
            models=self.models,
            leaving=leaving(scenario, doubted=bool(self.noises), told=self.tells_ranges),
            noises=self.noises,
            nearer=chosen.defaults > 15 and bool(self.noises) and scenario.target.motion == "ncv",
            unseen=chosen.defaults > 15 and isinstance((self.models or (None,))[-1], Jump),
            middle=start.middle(scenario)[: self.space.axes],
            squares=self.squares,
            tells_ranges=self.tells_ranges,
            seeks=self.seeks,
            splits=telling.splits(scenario, self.models or (self.motion,), self.range_std) if self.tells_ranges else 0,
            settled=chosen.defaults > 22,
            ties=self._may_leap,
            exact=chosen.defaults > 16 and bool(self.models),
            adds=chosen.defaults > 26,
            persists=chosen.defaults > 24 and bool(self.models) and start.outliers(scenario) is None,
            agrees=chosen.defaults > 15,
            fits=chosen.defaults > 15 and self.squares and self._leaps,
            plane=self.plane,
            crosses=chosen.defaults > 25,
            blends=trust.real(scenario),
            space=self.space,
            range_std=self.range_std,
            xi=self.xi,
            network_size=scenario.count if scenario.consensus.rounds else 1,  # Without rounds agents are alone.
            omega=chosen.omega,
            differenced=chosen.measurement == "difference",
            power=self.power,
            widens=weighing.widens(scenario, power=self.power, wide=bool(self.models) or self.squares),
            least=0.0 if chosen.defaults > 14 else float("-inf"),
            options=chosen.options or {},
            inversion=BY_ELIMINATION if chosen.defaults > 14 else BY_LIBRARY,
        )

    def _measuring(self, settings: FilterSettings) -> FilterSettings:
        """With what it does about errors of ranges."""
        scenario, chosen, biased = self.scenario, self.scenario.filter, self.bias != "none"
        joint = biased and trust.shares_biases(scenario)
        single = not (self.models or self.squares or self.tells_ranges)
        able = single or not (self.tells_ranges or chosen.defaults < 15 or trust.real(scenario))
        doubts = able and trust.doubts_noise(scenario, several=bool(self.models))
        return replace(
            settings,
            recovers=start.implausible_share(scenario) * trust.recovers(scenario),
            sudden=trust.notices(scenario),
            distrusts=self.distrusts_own,
            bias=self.bias,
            joint_biases=joint,
            likelihoods=trust.rules(scenario) > 1,
            weighs_lasting=chosen.defaults > 14,
            weighs_shares=chosen.defaults > 15,
            presumes_biases=trust.lasts(scenario) and chosen.defaults > 23,
            opens_biases=trust.lasts(scenario) and chosen.defaults > 28,
            most_bias=start.most_bias(scenario, self.range_std, joint=joint) if biased else float("inf"),
            common_bias_std=trust.common_bias_std(scenario, self.range_std, joint=joint),
            own_bias_std=trust.own_bias_std(scenario, self.range_std),
            scale_std=trust.scale_std(scenario) if joint else 0.0,
            told_biases=biased and trust.tells_biases(scenario),
            whole_biases=biased and chosen.defaults > 27,
            lasting=single and trust.lasts(scenario),
            curves=single and trust.curves(scenario),
            doubts_noise=doubts,
            counts_ranges=chosen.defaults > 12,
            learns_noise=chosen.range_std == "auto" and not doubts,
            wrong_share=scenario.sensor.outlier_probability if chosen.defaults > 15 else 0.0,
            recorded=trust.lasts(scenario) and chosen.defaults > 11,
            outliers=start.outliers(scenario),
            weighed=weighing.weighed_errors(scenario, self.range_std, several=bool(self.models)),
        )

    def _finding(self, settings: FilterSettings) -> FilterSettings:
        """With what finds the target, at first and again, and says what the estimate is."""
        scenario, chosen, able, tells = self.scenario, self.scenario.filter, self.abilities, self.tells_ranges
        window = 0 if self.seeks else start.window(scenario, self.settling_steps)
        drawn_flat = tells and telling.none_to_spare(scenario, self.models)
        flat = network.may_be_in_a_plane(scenario, self.space.axes, self.range_std, told=tells, drawn_flat=drawn_flat)
        pauses = not tells and bending.may_pause(scenario, self.plain_motion, self.range_std)
        return replace(
            settings,
            returns=chosen.defaults > 3,
            says_status=chosen.status and able.information,
            judges_agents=chosen.status_rules > 1,
            compares=tells and chosen.defaults > (18 if self.models else 19),
            hearing=self.settling_steps * network.counts_hearers(scenario),
            calls_roll=network.calls_roll(scenario),
            rounds=scenario.consensus.rounds,
            reacquires=window,
            damping=start.damping(scenario, self.space.axes),
            spreading=start.spreading(scenario, window),
            deciding=start.deciding(scenario, window),
            drifts=network.parts(scenario) or not (chosen.defaults > 15 and self.models and settings.splits),
            awaits=chosen.defaults > (22 if trust.real(scenario) else 15),
            bends=chosen.defaults > 7 and not (tells or (self.models and settings.weighed)),
            prompt=chosen.defaults > 8 and not trust.real(scenario),
            supposes=pauses and start.supposes(scenario, window),
            rejoins=chosen.defaults > 13,
            cut_off=scenario.consensus.rounds * (able.biases and network.tells_members(scenario)),
            alone_bend=trust.alone_bend(scenario),
            presumes=trust.presumes(scenario),
            proves=trust.proves(scenario),
            undetermined=chosen.defaults > 13 and bending.undetermined(scenario, self.range_std, self.space.axes),
            sides=able.biases and flat,
            hearers_count=chosen.defaults > 15 and network.counts_hearers(scenario),
            guessed=start.guessed(scenario) if chosen.defaults > 15 else None,
            anywhere=start.anywhere(scenario, self.motion, self.space),
            first_fix=self.first_fix_steps,
            joins_fix=chosen.defaults > 15,
            squared_fix=start.squared_steps(scenario, self.first_fix_steps),
            tries_guess=self.search is not None and start.tries_guess(scenario),
            search=self.search,
            guesses=start.guesses(scenario) if chosen.defaults > 3 else None,
        )

    @cached_property
    def absences(self) -> Absences:
        """When the scenario's agents are not there."""
        return start.absences(self.scenario) if self.like is None else self.like.absences

    @alike
    def settling_steps(self) -> int:
        """After how many steps a network has found its target: at least 20, and about five ranges of every agent."""
        return start.settling_steps(self.scenario)

    @alike
    def first_fix_steps(self) -> int:
        """How many steps the first fix takes, 0 for none: agents must add up what they know, and not lie."""
        return 0 if self.tells_ranges else start.fix_steps(self.scenario, self.settling_steps, self.absences)

    @alike
    def search(self) -> tuple[Floats, Floats] | None:
        """Where a first fix looks for the target, (1, s) and (1, s, s); None: around the initial estimate."""
        told = start.unknown(self.scenario) or not self.first_fix_steps
        return None if told else start.anywhere(self.scenario, self.motion, self.space)
