// What of a map is at a place of its canvas.

const NEAR_PIXELS = 14;

/** The agent or the link at a place of the canvas; null where there is neither. */
export function pick(map, x, y) {
  if (!map.arrays) return null;
  let best = { away: NEAR_PIXELS };
  for (let agent = 0; agent < map.arrays.place.length / 3; agent++) {
    const [ax, ay] = map.pixel(map.arrays.place, 3 * agent);
    const away = Math.hypot(x - ax, y - ay);
    if (away < best.away) best = { away, agent };
  }
  if (best.agent !== undefined) return { agent: best.agent };
  for (const [source, destination] of map.scene.links) {
    const [from, to] = [map.pixel(map.arrays.place, 3 * source), map.pixel(map.arrays.place, 3 * destination)];
    const [dx, dy] = [to[0] - from[0], to[1] - from[1]];
    const along = Math.min(1, Math.max(0, ((x - from[0]) * dx + (y - from[1]) * dy) / (dx * dx + dy * dy || 1)));
    const away = Math.hypot(x - from[0] - along * dx, y - from[1] - along * dy);
    if (away < best.away * 0.6) best = { away: away / 0.6, link: [source, destination] };
  }
  return best.link ? { link: best.link } : null;
}

/** The agents on either side of a line through two places of the canvas. */
export function sides(map, [x1, y1], [x2, y2]) {
  const groups = [[], []];
  for (let agent = 0; agent < map.arrays.place.length / 3; agent++) {
    const [x, y] = map.pixel(map.arrays.place, 3 * agent);
    groups[(x2 - x1) * (y - y1) - (y2 - y1) * (x - x1) > 0 ? 1 : 0].push(agent);
  }
  return groups;
}
