// The page: asks for steps as fast as it draws them, never faster.

import { Beside } from "./beside.js";
import { clock } from "./clock.js";
import { Curves } from "./curves.js";
import { hands } from "./hands.js";
import { MapView } from "./map.js";
import { Menu } from "./menu.js";
import { Opening } from "./opening.js";
import { Pace } from "./pace.js";
import { Panels } from "./panels.js";
import { Parting } from "./parting.js";
import { standing } from "./standing.js";
import { Steering } from "./steering.js";
import { LENGTH, Trails } from "./trails.js";
import { Wire, exported } from "./wire.js";

const SPEEDS = [0.02, 0.05, 0.1, 0.25, 0.5, 1, 2, 5, 10, 50];
const IDLE_MS = 300; // after so long a run is asked for its events although no step is wanted
const AGAIN_MS = 100; // after so long a round is asked for that was ordered and has not begun
const NEWS = { // what is told when a run comes into a state
  ended: ["the run has ended; wind it back, or export the session", "none"],
  "is out of reach": ["the run's target is not there: it was killed, or the link to it is broken; once it is back this page goes on"],
  "goes on": [""],
};
const SLOW_STEPS = 3; // steps a second below which passing messages are drawn

const $ = (id) => document.getElementById(id);
const state = { scene: null, frame: null, step: 1, newest: 0, follows: true, plays: true, speed: 1, known: 0, events: 0, whole: 0, round: 0 };
const trails = new Trails();

const map = new MapView($("canvas"));
const beside = new Beside($("beside"), redraw);
const curves = new Curves($("curves"), (time) => seek(Math.round(time / state.scene.dt)));
const panels = new Panels($("agents"), document.querySelector("#faults ul"), document.querySelector("#events ol"), pick);
const parting = new Parting(map, $("cut"), $("side"), $("agents"), { inject, tell, redraw });
const menu = new Menu($("menu"), inject, (agent) => parting.choose(agent));

function redraw() {
  pace.redraw();
}

function tell(words, level = "bad") {
  $("notice").textContent = words;
  $("notice").dataset.level = level;
  $("notice").hidden = !words;
}

const orders = new Wire(() => {});
const frames = new Wire((there, opened) => {
  if (there) start();
  else lost(opened);
});
const opening = new Opening($("opening"), orders, () => start(), tell);

/** Say why there is no server: it is gone, or another lab has taken its place. */
async function lost(opened) {
  const answer = opened ? null : await fetch(location.href, { cache: "no-store" }).catch(() => null);
  if (frames.socket) return;
  tell(answer?.status === 403 ? "the lab was started again, or never had this address; open the one that 'zenoh-cbef lab' printed"
    : "the lab's server is gone; trying again");
}

async function start() {
  const scene = await frames.ask({ ask: "scene" }).catch(() => null);
  if (!scene) return;
  if (scene.error) {
    $("verdict").textContent = "nothing is open";
    opening.show().catch(() => {});
    return;
  }
  tell("");
  Object.assign(state, { scene, frame: null, known: 0, events: 0, newest: scene.newest, whole: 0, step: 1, held: false });
  const grows = scene.live || scene.state === "is read";
  Object.assign(state, { follows: grows, plays: grows, state: scene.state });
  trails.clear();
  if (!scene.live) state.step = scene.newest;
  document.title = `${scene.run} · zenoh-cbef lab`;
  $("run").textContent = scene.run;
  $("about").textContent = `${scene.scenario}, ${scene.filter}, ${scene.agents} agents, dt ${scene.dt} s, ${scene.mode}`;
  for (const id of ["stop", "cut", "undo", "live"]) $(id).hidden = !scene.live;
  $("hold").hidden = !scene.live || scene.mode !== "lockstep";
  $("export").hidden = false;
  $("export").href = exported();
  parting.stop();
  map.show(scene);
  curves.show(scene.dt);
  beside.show(scene.beside);
  panels.show(scene);
  menu.names = scene.names;
  controls();
}

function controls() {
  $("play").textContent = state.plays ? "Pause" : "Play";
  $("play").setAttribute("aria-pressed", String(state.plays));
  $("live").setAttribute("aria-pressed", String(state.follows));
  pace.wake();
}

function seek(step) {
  Object.assign(state, { follows: false, plays: false, step: Math.min(Math.max(step, 1), state.newest), whole: 0, round: 0 });
  controls();
}

/** One round of consensus on: a held run makes it; of a step that is over its messages pass one after the other. */
function round() {
  if (state.held && state.step >= state.newest) { hold(true, 0, 1); return; }
  const next = state.round + 1;
  if (next > state.scene.rounds) forward();
  else { seek(state.step); redraw(); }
  state.round = next > state.scene.rounds ? 1 : next;
}

function follow() {
  Object.assign(state, { follows: state.scene.live, plays: state.scene.live, step: state.newest });
  controls();
}

function play() {
  Object.assign(state, { plays: !state.plays, round: 0 });
  if (!state.plays) state.follows = false;
  else if (state.step >= state.newest && !state.scene.live) state.step = 1;
  controls();
}

async function inject(table, seconds) {
  const answer = await orders.ask({ ask: "fault", table, seconds }).catch(() => ({ error: "the server is gone" }));
  tell(answer.error ?? answer.warnings.join("; "));
}

async function order(ask) {
  const answer = await orders.ask({ ask }).catch(() => ({ error: "the server is gone" }));
  tell(answer.error ?? "");
}

function pick(picked, x, y) {
  if (picked?.agent !== undefined && parting.toggles(picked.agent)) return;
  map.chosen = picked?.agent ?? null;
  redraw();
  if (!picked) return;
  const neighbours = state.scene.links.filter(([source]) => source === picked.agent).map(([, destination]) => destination);
  menu.open(picked, x, y, state.scene.live && state.state === "goes on", neighbours);
}

/** Let the run in lockstep stand still, or go on; held, it takes single steps, or single rounds of one.
 * after: the step that was over when a round was ordered. */
async function hold(on, steps = 0, rounds = 0, after = rounds ? state.newest : -1) {
  const answer = await orders.ask({ ask: "hold", on, steps, rounds }).catch(() => ({ error: "the server is gone" }));
  tell(answer.error ?? "");
  if (answer.error) return;
  const between = (answer.round ?? null) !== null && on && !steps;
  Object.assign(state, { held: answer.held, under: between ? { step: answer.step, round: answer.round } : null, round: 0 });
  $("hold").setAttribute("aria-pressed", String(state.held));
  $("hold").textContent = state.held ? "Let run go on" : "Hold run";
  follow();
  if (!between && answer.step <= after) setTimeout(() => state.held && hold(true, 0, 0, after), AGAIN_MS);
}

function forward() {
  if (state.held && state.step >= state.newest) hold(true, 1);
  else seek(state.step + 1);
}

/** The next question, or null where nothing has changed that the page shows. */
function question(elapsed) {
  const { scene, plays, follows } = state;
  if (plays && !follows) {
    state.whole += (elapsed * state.speed) / scene.dt;
    const steps = Math.floor(state.whole);
    state.whole -= steps;
    state.step = Math.min(state.step + steps, state.newest);
    if (state.step >= state.newest && !(scene.live && state.state !== "ended")) { state.plays = false; controls(); }
  }
  const between = follows && state.under;
  const fresh = between ? between !== state.shown : follows || state.frame === null || state.step !== state.frame.step;
  const idle = !["ended", "log"].includes(state.state) && performance.now() - state.asked > IDLE_MS;
  if (!fresh && !idle) return null;
  state.asked = performance.now();
  const table = { ask: "frame", curves: state.known, events: state.events, beside: beside.known, marks: true };
  if (between) table.under = [between.step, between.round];
  state.shown = between;
  if (follows) table.after = state.newest;
  else table.step = state.step;
  const next = follows ? state.newest + 1 : state.step;
  if (trails.lack(next)) table.trail = LENGTH;
  return table;
}

function take(frame) {
  if (frame.error) { tell(frame.error); return; }
  if (frame.number !== state.scene.number) { start(); return; }
  if (frame.state !== state.state && frame.state in NEWS) tell(...NEWS[frame.state]);
  Object.assign(state, { frame, newest: frame.newest, state: frame.state });
  if (state.follows) state.step = frame.step;
  if (state.under && state.under.step <= frame.newest) state.under = null;
  curves.take(frame.arrays, frame.curves[0], frame.newest);
  state.known = frame.newest;
  beside.take(frame, curves);
  panels.takeEvents(frame.events);
  state.events += frame.events.length;
  if (["ended", "log"].includes(frame.state) && state.follows) { state.follows = false; state.plays = false; controls(); }
  if (frame.under === undefined) trails.take(frame, state.scene.agents);
}

/** Whether time passes on the page itself, between two steps. */
const slow = () => state.plays && !state.follows && state.speed / state.scene.dt < SLOW_STEPS;

function draw() {
  const { frame, scene } = state;
  if (!frame) return;
  const time = frame.step * scene.dt;
  map.marks = frame.marks;
  const phase = frame.under ? 1 - 0.5 / frame.marks[0]?.length : state.round ? (state.round - 0.5) / scene.rounds : slow() ? state.whole : null;
  map.draw(frame.arrays, trails, parting.marked(standing(scene, frame.arrays, frame.faults, time)), phase);
  beside.draw();
  const [level, words] = frame.verdict;
  if ($("verdict").textContent !== words) $("verdict").textContent = words;
  $("verdict").dataset.level = level;
  $("step").max = String(Math.max(frame.newest, 1));
  if (document.activeElement !== $("step") || state.follows) $("step").value = String(frame.step);
  // A screen reader says where time stands, not how it passes.
  $("clock").ariaLive = state.held || !(state.plays || state.follows) ? "polite" : "off";
  $("clock").textContent = clock(state);
}

function sides() {
  const { frame, scene } = state;
  if (!frame) return;
  const time = frame.step * scene.dt;
  panels.drawFaults(frame.faults, time);
  panels.draw(frame.arrays);
  panels.drawEvents(time);
  Object.assign(curves, { time, spans: frame.faults });
  curves.refresh();
}

/** What tests and benchmarks look at. */
const counts = { frames: 0 };
globalThis.lab = { state, counts, map, trails, curves, beside, colour: (source, destination) => map.shown.get(`${source} ${destination}`) };

const pace = new Pace(frames, {
  asks: (elapsed) => state.scene && question(elapsed),
  taken: (answer) => {
    if (answer.answer !== "frame" || !state.scene) return;
    take(answer);
    counts.frames += 1;
  },
  plays: () => state.scene !== null && state.plays && !state.follows,
  slides: () => state.scene !== null && slow(),
  draw,
  sides,
});

hands(map, {
  redraw,
  clicked: (picked, event) => pick(picked, event.clientX, event.clientY),
  draws: () => parting.draws,
  drawn: (from, to) => parting.drawn(from, to),
  steers: () => steering.may(),
  steered: (place, last) => steering.steer(place, last),
});

const steering = new Steering(state, inject);

function solid() {
  $("view").setAttribute("aria-pressed", String(map.solid()));
  redraw();
}

const acts = {
  play, view: solid, back: () => seek(state.step - 1), on: forward, round, live: follow, hold: () => hold(!state.held),
  fit: () => { map.refit(); redraw(); }, cut: () => parting.act(),
  undo: () => order("undo"), stop: () => order("stop"), choose: () => opening.show().catch(() => {}),
};
for (const [id, act] of Object.entries(acts)) $(id).addEventListener("click", () => (state.scene || id === "choose") && act());

const keys = {
  " ": play, ArrowLeft: () => seek(state.step - 1), ArrowRight: forward, r: round, h: () => !$("hold").hidden && hold(!state.held), Home: () => seek(1), End: follow,
  f: acts.fit, t: solid, p: () => !$("cut").hidden && acts.cut(), u: () => !$("undo").hidden && acts.undo(), l: follow, Escape: () => parting.stop(),
  w: () => steering.nudge(0, 1), s: () => steering.nudge(0, -1), a: () => steering.nudge(-1, 0), d: () => steering.nudge(1, 0),
};
addEventListener("keydown", (event) => {
  const field = event.target.closest("input:not([type=range]), select, button, dialog, #menu");
  const act = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (!act || !state.scene || event.ctrlKey || event.metaKey || (field && (event.key === " " || !field.matches("button")))) return;
  event.preventDefault();
  act();
});

for (const one of SPEEDS) $("speed").add(new Option(`${one}×`, String(one), one === 1, one === 1));
$("speed").addEventListener("change", () => { state.speed = Number($("speed").value); if (state.follows) seek(state.step); });
$("step").addEventListener("input", () => seek(Number($("step").value)));
new ResizeObserver(redraw).observe($("canvas"));
