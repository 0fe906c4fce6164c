// What is to be said of single agents at a moment: dead, paused, cut off, parted from the others, coasting.

const AWAY = { crash: "dead", pause: "paused", outage: "cut off" };
const TOUCHED = { lies: "lies", receiver: "receiver" };

/** Words for agents, by agent. faults: as the package tells them (lab/faulted.py), time: s. */
export function standing(scene, arrays, faults, time) {
  const words = new Map();
  const count = arrays.place.length / 3;
  for (let agent = 0; agent < count; agent++) {
    const status = scene.statuses[arrays.said[3 * agent]];
    if (status === "coasting" || status === "lost") words.set(agent, status);
  }
  if (scene.counted !== false) parts(scene, arrays).slice(1).forEach((part) => part.forEach((agent) => words.set(agent, "parted")));
  for (const one of faults) {
    if (time < one.from || (one.until !== null && time >= one.until)) continue;
    const [away, touched] = [AWAY[one.kind], TOUCHED[one.touches]];
    for (const agent of away || touched ? one.agents : []) {
      const said = words.get(agent);
      // What an agent makes of a wrong receiver stands beside it.
      words.set(agent, away ?? (["coasting", "lost", "parted"].includes(said) ? `${said}, ${touched}` : touched));
    }
  }
  return words;
}

/** The agents that are there in the parts that the network has fallen into, the largest first. */
export function parts(scene, arrays) {
  const there = (agent) => Number.isFinite(arrays.estimate[6 * agent]);
  const root = Array.from({ length: arrays.place.length / 3 }, (_, agent) => agent);
  const find = (agent) => (root[agent] === agent ? agent : (root[agent] = find(root[agent])));
  scene.links.forEach(([source, destination], row) => {
    if (arrays.links[4 * row] > 0) root[find(source)] = find(destination);
  });
  const groups = new Map();
  for (const agent of root.keys()) {
    if (there(agent)) groups.set(find(agent), [...(groups.get(find(agent)) ?? []), agent]);
  }
  return [...groups.values()].sort((one, other) => other.length - one.length);
}
