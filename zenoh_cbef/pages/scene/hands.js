// Mouse, touch and wheel on a map: move it, turn it, zoom, click what is on it, draw a line, drag the target.

import { pick } from "./picking.js";

const STILL_PIXELS = 4;
const GRAB_PIXELS = 16;

/** acts: redraw(); clicked(picked, event); draws(): whether a line is drawn; drawn(from, to);
 * steers(): whether the target may be dragged; steered(place, last). All but redraw may be left out. */
export function hands(map, acts) {
  const { canvas } = map;
  let down = null;
  const at = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  const onTarget = (place) => {
    if (!acts.steers?.() || !map.arrays || !Number.isFinite(map.arrays.truth[0])) return false;
    const [x, y] = map.pixel(map.arrays.truth);
    return Math.hypot(x - place[0], y - place[1]) < GRAB_PIXELS;
  };
  const steer = (now, last) => acts.steered(map.place(...now, map.arrays.truth[2]), last);
  const cursor = (now) => (acts.draws?.() ? "crosshair" : onTarget(now) ? "move" : acts.clicked && pick(map, ...now) ? "pointer" : "grab");
  canvas.addEventListener("pointerdown", (event) => {
    const now = at(event);
    down = { at: now, last: now, moved: false, target: !acts.draws?.() && onTarget(now) };
    canvas.setPointerCapture(event.pointerId);
    if (acts.draws?.()) map.line = { from: now, to: now };
  });
  canvas.addEventListener("pointermove", (event) => {
    const now = at(event);
    if (!down) { canvas.style.cursor = cursor(now); return; }
    const [dx, dy] = [now[0] - down.last[0], now[1] - down.last[1]];
    down.moved ||= Math.hypot(now[0] - down.at[0], now[1] - down.at[1]) > STILL_PIXELS;
    if (map.line) map.line.to = now;
    else if (down.target) { map.goal = map.place(...now, map.arrays.truth[2]); if (down.moved) steer(now, false); }
    else if (down.moved && map.pitch < 1.5 && !event.shiftKey) map.turn(dx, dy);
    else if (down.moved) map.move(dx, dy);
    down.last = now;
    acts.redraw();
  });
  canvas.addEventListener("pointerup", (event) => {
    const now = at(event);
    if (map.line) { map.line = null; acts.drawn(down.at, now); }
    else if (down?.target) { map.goal = null; if (down.moved) steer(now, true); }
    else if (down && !down.moved) acts.clicked?.(pick(map, ...now), event);
    down = null;
    acts.redraw();
  });
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    map.zoom(Math.exp(-event.deltaY * 0.0015), ...at(event));
    acts.redraw();
  }, { passive: false });
}
