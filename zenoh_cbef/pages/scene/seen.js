// The report's map: a run in its file, played over its time.

import { enclosed } from "./enclosed.js";
import { hands } from "./hands.js";
import { Heat } from "./heat.js";
import { MapView } from "./map.js";
import { unpacked } from "./packed.js";
import { standing } from "./standing.js";

const TRAIL = 40;
const PLAYED_MS = 15_000;
const WAY = 500; // places of the whole way

const part = (values, at, size) => values.subarray(at * size, (at + 1) * size);

class Seen {
  constructor(told) {
    const of = (id) => document.getElementById(id);
    Object.assign(this, { told, arrays: told.arrays, count: told.arrays.step.length, agents: told.names.length });
    this.parts = { slider: of("moment"), play: of("play"), clock: of("clock"), verdict: of("verdict") };
    this.map = new MapView(of("map"));
    this.map.show(told, this.way());
    this.parts.slider.max = String(this.count - 1);
    this.parts.slider.addEventListener("input", () => this.seek(Number(this.parts.slider.value)));
    const acts = { play: () => this.play(!this.playing), turn: () => this.turn(), fit: () => { this.map.refit(); this.draw(); } };
    for (const [id, act] of Object.entries(acts)) of(id).addEventListener("click", act);
    const keys = { " ": acts.play, t: acts.turn, f: acts.fit, ArrowLeft: () => this.seek(this.at - 1), ArrowRight: () => this.seek(this.at + 1) };
    this.map.canvas.addEventListener("keydown", (event) => {
      const act = keys[event.key];
      if (act) { event.preventDefault(); act(); }
    });
    hands(this.map, { redraw: () => this.draw() });
    new ResizeObserver(() => this.draw()).observe(this.map.canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
    this.seek(this.count - 1);
  }

  turn() {
    document.getElementById("turn").setAttribute("aria-pressed", String(this.map.solid()));
    this.draw();
  }

  seek(moment) {
    this.play(false);
    this.at = Math.min(Math.max(moment, 0), this.count - 1);
    this.draw();
  }

  play(on) {
    this.playing = on;
    this.parts.play.textContent = on ? "Pause" : "Play";
    this.parts.play.setAttribute("aria-pressed", String(on));
    if (!on) return;
    const from = this.at >= this.count - 1 ? 0 : this.at;
    const begun = performance.now();
    const next = (now) => {
      if (!this.playing) return;
      this.at = Math.min(from + Math.floor(((now - begun) / PLAYED_MS) * this.count), this.count - 1);
      this.draw();
      if (this.at === this.count - 1) this.play(false);
      else requestAnimationFrame(next);
    };
    requestAnimationFrame(next);
  }

  /** A moment as the map draws it. */
  moment() {
    const { arrays, agents, at } = this;
    const estimate = new Float32Array(6 * agents).fill(NaN);
    for (let agent = 0; agent < agents; agent++) estimate.set(part(arrays.estimate, at * agents + agent, 3), 6 * agent);
    const said = new Float32Array(3 * agents);
    part(arrays.status, at, agents).forEach((status, agent) => { said[3 * agent] = status; });
    const moves = arrays.place.length > 3 * agents;
    return {
      truth: part(arrays.truth, at, 3), place: part(arrays.place, moves ? at : 0, 3 * agents), estimate, said,
      spread: part(arrays.spread, at, 6 * agents), links: part(arrays.passed, at, 4 * this.told.links.length),
    };
  }

  /** Places that the target comes by: true ones, or else the first agent's estimates where it is sure of them. */
  way() {
    const { arrays, agents, count } = this;
    const every = Math.ceil(count / WAY);
    return Array.from({ length: Math.ceil(count / every) }, (_, place) => place * every).map((at) => {
      const truth = part(arrays.truth, at, 3);
      return Number.isFinite(truth[0]) ? truth : arrays.drawn[at * agents] === 1 ? part(arrays.estimate, at * agents, 3) : [NaN];
    });
  }

  trails() {
    const { arrays, agents } = this;
    const first = Math.max(0, this.at + 1 - TRAIL);
    const moments = Array.from({ length: this.at + 1 - first }, (_, place) => first + place);
    return {
      truth: moments.map((one) => part(arrays.truth, one, 3)),
      agents: Array.from({ length: agents }, (_, agent) => moments.map((one) => one * agents + agent).map((at) => [...part(arrays.estimate, at, 3), arrays.drawn[at]])),
    };
  }

  draw() {
    if (this.at === undefined) return;
    const { told, parts, at } = this;
    const step = this.arrays.step[at];
    const moment = this.moment();
    this.map.draw(moment, this.trails(), standing(told, moment, told.faults, step * told.dt), null);
    const [level, words] = told.verdicts[at];
    parts.verdict.dataset.level = level;
    parts.verdict.textContent = words;
    parts.slider.value = String(at);
    parts.clock.textContent = `${(step * told.dt).toFixed(1)} s, step ${step}`;
  }
}

enclosed("scene").then((buffer) => {
  const told = unpacked(buffer);
  const seen = new Seen(told);
  globalThis.replay = seen;
  const heat = document.getElementById("heat");
  if (heat) new Heat(heat, told, told.arrays.step, told.arrays.passed, (moment) => {
    seen.seek(moment);
    seen.map.canvas.scrollIntoView({ block: "nearest" });
  });
});
