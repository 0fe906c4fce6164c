// Where target and estimates were in the last steps.

export const LENGTH = 40; // steps
const GAP = 12; // steps that may be left out before whole trails are asked for

/** Lists of points, the oldest first: of the target, and of each agent, with how strongly they are drawn. */
export class Trails {
  constructor() {
    this.clear();
  }

  clear() {
    Object.assign(this, { truth: [], agents: [], step: 0 });
  }

  /** Whether a step does not follow on what is known. */
  lack(step) {
    return step < this.step || step > this.step + GAP;
  }

  /** Lengthen the trails by a frame, or take whole ones in. */
  take({ arrays, step }, agents) {
    const point = (values, at) => [values[at], values[at + 1], values[at + 2]];
    if (arrays["trail steps"]) {
      const [truth, estimates, count] = [arrays["trail truth"], arrays["trail estimates"], arrays["trail steps"].length];
      const times = Array.from({ length: count }, (_, at) => at);
      this.truth = times.map((at) => point(truth, 3 * at));
      this.agents = Array.from({ length: agents }, (_, agent) => times.map((at) => [...point(estimates, 4 * (at * agents + agent)), estimates[4 * (at * agents + agent) + 3]]));
    }
    if (step !== this.step) {
      this.truth = [...this.truth, point(arrays.truth, 0)].slice(-LENGTH);
      this.agents = Array.from({ length: agents }, (_, agent) =>
        [...(this.agents[agent] ?? []), [...point(arrays.estimate, 6 * agent), arrays.drawn[agent]]].slice(-LENGTH));
    }
    this.step = step;
  }
}
