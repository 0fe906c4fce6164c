// Which moment of a run the page shows, in words.

const STATES = { ended: ", ended", "is out of reach": ", out of reach", "is read": ", the log is being read" };

/** frame.under: the round after which the step after the newest stands, where the run is held in the middle of it. */
export function clock({ frame, scene, held, round }) {
  const between = frame.under !== undefined;
  const step = frame.step + (between ? 1 : 0);
  const rounds = between ? (frame.under ? ` after round ${frame.under} of ${scene.rounds}` : " before its first round")
    : round ? `, round ${round} of ${scene.rounds}` : "";
  return `${(step * scene.dt).toFixed(2)} s, step ${step} of ${scene.live ? scene.steps : frame.newest}`
    + (held ? ", run held" : "") + rounds + (STATES[frame.state] ?? "");
}
