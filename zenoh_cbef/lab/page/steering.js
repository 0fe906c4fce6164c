// Orders to a target that is steered by hand: dragged on the map, or sent on by keys.

const STEER_MS = 500;
const NUDGE = 3; // m

export class Steering {
  constructor(state, inject) {
    Object.assign(this, { state, inject, steered: 0 });
  }

  /** Whether the target can be steered now. */
  may() {
    const { scene, state } = this.state;
    return Boolean(scene?.steered && scene.live && state === "goes on");
  }

  /** Send the target somewhere: at most so often while it is dragged, and where it is let go. */
  steer(place, last) {
    if (!last && performance.now() - this.steered < STEER_MS) return;
    this.steered = performance.now();
    this.inject({ kind: "steer", to: place.map((one) => Number(one.toFixed(3))) }, null);
  }

  /** Send the target some metres on from where it is: dx, dy of -1, 0 or 1. */
  nudge(dx, dy) {
    if (!this.may()) return;
    const [x, y, z] = this.state.frame.arrays.truth;
    this.steer([x + NUDGE * dx, y + NUDGE * dy, z], true);
  }
}
