// The map: agents, links, target, estimates with their ellipses, and messages that pass. Top view, or turned in space.

import { css, hue } from "./colours.js";
import { outline } from "./ellipse.js";
import { View } from "./view.js";

const ESTIMATE = 6;
const THIN = 1; // pixels: a browser that draws in software draws such a line in a tenth of the time of a wider one
const BAND = 8; // points of a trail that fade alike, in one stroke
const ALIKE = 32; // links of one look in one stroke: more of them cross each other too often
const MILD = new Set(["coasting", "parted"]);

export class MapView extends View {
  constructor(canvas) {
    super(canvas);
    this.line = null;
    this.chosen = null;
    this.goal = null; // where the target is dragged to, m
    this.shown = new Map(); // the colour of each link, as drawn last
    this.recolour();
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.recolour());
  }

  recolour() {
    this.colours = Object.fromEntries(
      ["paper", "ink", "muted", "grid", "rule", "accent", "good", "lost", "late", "alarm"].map((one) => [one, css(`--${one}`)]),
    );
  }

  /** Take the unchanging part of a scene. way: places that the target comes by, where they are known beforehand. */
  show(scene, way = []) {
    this.scene = scene;
    this.way = way;
    this.refit();
  }

  /** Draw a step. trails: of the target and of each agent, lists of points. marks: a word for some agents, by agent.
   * phase: how far the step has gone, 0 to 1; null where no message is shown. */
  draw(arrays, trails, marks, phase) {
    this.resize();
    if (!(this.width > 0 && this.height > 0)) return; // a page that is hidden, or being laid out
    this.now = this.axes();
    this.arrays = arrays;
    const agents = Array.from({ length: arrays.place.length / 3 }, (_, agent) => arrays.place.subarray(3 * agent, 3 * agent + 3));
    if (this.fitted) this.fit([...agents, arrays.truth, ...trails.truth, ...this.way]);
    const { context: c, colours } = this;
    c.clearRect(0, 0, this.width, this.height);
    this.grid();
    this.links(arrays, phase);
    this.trail(trails.truth, colours.ink, 2);
    const count = agents.length;
    for (let agent = 0; agent < count; agent++) this.trail(trails.agents[agent] ?? [], hue(agent), THIN);
    for (let agent = 0; agent < count; agent++) this.estimate(arrays, agent);
    this.agents(arrays, marks);
    this.target(arrays);
    if (this.goal) {
      c.setLineDash([3, 4]);
      this.stroke([this.pixel(arrays.truth), this.pixel(this.goal)]);
      c.setLineDash([]);
    }
    if (this.line) {
      c.strokeStyle = colours.alarm;
      c.setLineDash([8, 5]);
      c.lineWidth = 2;
      this.stroke([this.line.from, this.line.to]);
      c.setLineDash([]);
    }
  }

  /** A line through places, and not through those that are nowhere. */
  stroke(points) {
    const c = this.context;
    let drawn = false;
    c.beginPath();
    for (const [x, y] of points) {
      const there = Number.isFinite(x);
      if (there && drawn) c.lineTo(x, y);
      else if (there) c.moveTo(x, y);
      drawn = there;
    }
    c.stroke();
  }

  grid() {
    const { context: c, colours } = this;
    const rough = 90 / this.scale;
    const power = 10 ** Math.floor(Math.log10(rough));
    const unit = [1, 2, 5, 10].map((one) => one * power).find((one) => one >= rough);
    c.fillStyle = colours.muted;
    c.font = "11px system-ui, sans-serif";
    c.strokeStyle = colours.grid;
    c.lineWidth = 1;
    const above = this.pitch > 1.5 && this.yaw === 0;
    const [[left, right], [low, high]] = above ? this.seen() : this.ground(unit);
    for (let x = Math.ceil(left / unit) * unit; x <= right; x += unit) this.stroke([this.pixel([x, low, 0]), this.pixel([x, high, 0])]);
    for (let y = Math.ceil(low / unit) * unit; y <= high; y += unit) this.stroke([this.pixel([left, y, 0]), this.pixel([right, y, 0])]);
    // In space a stem leads from each agent, and the target, to the ground.
    const { place, truth } = this.arrays;
    const feet = above ? [] : Array.from({ length: place.length / 3 }, (_, agent) => place.subarray(3 * agent, 3 * agent + 3));
    if (!above && Number.isFinite(truth[0])) feet.push(truth);
    c.strokeStyle = colours.rule;
    for (const one of feet) this.stroke([this.pixel(one), this.pixel([one[0], one[1], 0])]);
    c.strokeStyle = colours.muted;
    c.lineWidth = 2;
    const y = this.height - 14;
    this.stroke([[16, y], [16 + unit * this.scale, y]]);
    c.fillText(`${Number(unit.toPrecision(3))} m`, 20, y - 5);
  }

  /** The stretches of x and y that are seen from above, m. */
  seen() {
    return [[this.centre[0], this.width], [this.centre[1], this.height]].map(([middle, size]) => [middle - size / 2 / this.scale, middle + size / 2 / this.scale]);
  }

  /** The stretches of x and y that the agents fill, in whole units, m. */
  ground(unit) {
    return [0, 1].map((axis) => {
      const values = this.arrays.place.filter((_, at) => at % 3 === axis);
      return [Math.floor(Math.min(...values) / unit) * unit, Math.ceil(Math.max(...values) / unit) * unit];
    });
  }

  /** Each direction of a link beside the other; its colour says what the receiver lost and had late in this step. */
  links(arrays, phase) {
    const [looks, passing] = [new Map(), []];
    this.scene.links.forEach(([source, destination], row) => {
      const counts = [0, 1, 2].map((one) => arrays.links[4 * row + one]);
      const ends = this.beside(arrays, source, destination);
      const look = this.look(...counts);
      this.shown.set(`${source} ${destination}`, look.colour);
      const key = `${look.colour} ${look.bad} ${look.dashed}`;
      if (!looks.has(key)) looks.set(key, { ...look, lines: [] });
      looks.get(key).lines.push(ends);
      if (phase !== null && counts[0] + counts[1] + counts[2] > 0) passing.push([...ends, phase, ...counts, this.marks?.[row]]);
    });
    for (const look of [...looks.values()].sort((one, other) => one.bad - other.bad)) this.alike(look);
    for (const one of passing) this.message(...one);
  }

  /** How a link looks. bad: the share of what came too late or not at all, in quarters. */
  look(came, lost, late) {
    const { colours } = this;
    const total = came + lost + late;
    if (!(total > 0)) return { colour: colours.rule, bad: 0, dashed: total === 0 };
    const share = Math.ceil((4 * Math.max(lost, late)) / total) / 4;
    return { colour: lost > 0 ? colours.lost : late > 0 ? colours.late : colours.good, bad: share, dashed: lost >= total };
  }

  /** Draw links of one look. */
  alike({ colour, bad, dashed, lines }) {
    const c = this.context;
    c.strokeStyle = colour;
    c.globalAlpha = bad > 0 ? 0.35 + 0.65 * bad : dashed ? 0.5 : 0.4;
    c.lineWidth = bad > 0 ? 1.4 + 1.8 * bad : THIN;
    if (dashed) c.setLineDash([5, 5]);
    for (let first = 0; first < lines.length; first += ALIKE) {
      c.beginPath();
      for (const [from, to] of lines.slice(first, first + ALIKE)) {
        c.moveTo(...from);
        c.lineTo(...to);
      }
      c.stroke();
    }
    c.setLineDash([]);
    c.globalAlpha = 1;
  }

  beside(arrays, source, destination) {
    const [from, to] = [this.pixel(arrays.place, 3 * source), this.pixel(arrays.place, 3 * destination)];
    const [dx, dy] = [to[0] - from[0], to[1] - from[1]];
    const length = Math.hypot(dx, dy) || 1;
    const [ox, oy] = [(-dy / length) * 2, (dx / length) * 2];
    return [[from[0] + ox, from[1] + oy], [to[0] + ox, to[1] + oy]];
  }

  /** A message on its way. marks: what became of each of the step; without them the lost ones are spread over it. */
  message(from, to, phase, came, lost, late, marks) {
    const { context: c, colours } = this;
    const total = came + lost + late;
    const place = Math.min(phase * total, total - 1e-6);
    const which = Math.floor(place);
    const along = place - which;
    const told = marks?.length === total ? marks[which] : undefined;
    const struck = (number) => Math.floor(((which + 1) * number) / total) > Math.floor((which * number) / total);
    const gone = told ? "x!-".includes(told) : struck(lost);
    const slow = told ? told === ">" : struck(late);
    if (gone && along > 0.55) return;
    c.fillStyle = gone ? colours.lost : slow ? colours.late : colours.accent;
    c.beginPath();
    c.arc(from[0] + along * (to[0] - from[0]), from[1] + along * (to[1] - from[1]), gone ? 3.2 : 2.6, 0, 7);
    c.fill();
  }

  /** A way. points: x, y, z, and how strongly it is drawn there, 0 to 1; as strongly as it can be where that is left out. */
  trail(points, colour, width) {
    const c = this.context;
    const places = points.map((one) => (one[3] === 0 ? [NaN, NaN] : this.pixel(one)));
    c.strokeStyle = colour;
    c.lineWidth = width;
    for (let first = 0; first + 1 < places.length; first += BAND) {
      const band = places.slice(first, first + BAND + 1);
      c.globalAlpha = (0.75 * (points[first][3] || 1) * (first + band.length / 2)) / places.length;
      this.stroke(band);
    }
    c.globalAlpha = 1;
  }

  /** The estimate of an agent, and where the target is with 95 % by it: the covariance seen along the view. */
  estimate(arrays, agent) {
    if (!Number.isFinite(arrays.estimate[ESTIMATE * agent])) return;
    const { context: c } = this;
    const [x, y] = this.pixel(arrays.estimate, ESTIMATE * agent);
    c.strokeStyle = hue(agent);
    c.fillStyle = hue(agent);
    c.lineWidth = THIN;
    const ellipse = outline(this, arrays.spread.subarray(6 * agent, 6 * agent + 6));
    if (ellipse) {
      c.beginPath();
      c.ellipse(x, y, Math.min(ellipse.major, 1e4), Math.min(ellipse.minor, 1e4), -ellipse.angle, 0, 2 * Math.PI);
      c.globalAlpha = 0.07;
      c.fill();
      c.globalAlpha = 0.75;
      c.stroke();
      c.globalAlpha = 1;
    }
    c.beginPath();
    c.arc(x, y, 2.2, 0, 7);
    c.fill();
  }

  agents(arrays, marks) {
    const { context: c, colours } = this;
    c.font = "600 12px system-ui, sans-serif";
    c.textAlign = "center";
    const many = arrays.place.length / 3 > 40;
    for (let agent = 0; agent < arrays.place.length / 3; agent++) {
      const [x, y] = this.pixel(arrays.place, 3 * agent);
      const away = !Number.isFinite(arrays.estimate[ESTIMATE * agent]);
      const mark = marks.get(agent);
      c.beginPath();
      c.arc(x, y, many ? 5 : 8, 0, 7);
      c.fillStyle = away ? colours.paper : hue(agent);
      c.fill();
      c.lineWidth = this.chosen === agent ? 3 : 1.5;
      c.strokeStyle = MILD.has(mark) ? colours.late : mark ? colours.alarm : this.chosen === agent ? colours.ink : away ? colours.muted : colours.paper;
      c.stroke();
      if (away) {
        c.strokeStyle = colours.lost;
        this.stroke([[x - 4, y - 4], [x + 4, y + 4]]);
        this.stroke([[x - 4, y + 4], [x + 4, y - 4]]);
      }
      if (!many || this.chosen === agent || mark) this.label(mark ? `${this.scene.names[agent]} ${mark}` : this.scene.names[agent], x, y - 12);
    }
    c.textAlign = "start";
  }

  /** Words that can be read on top of links. */
  label(words, x, y) {
    const { context: c, colours } = this;
    c.strokeStyle = colours.paper;
    c.lineWidth = 3;
    c.lineJoin = "round";
    c.strokeText(words, x, y);
    c.fillStyle = colours.ink;
    c.fillText(words, x, y);
  }

  target(arrays) {
    if (!Number.isFinite(arrays.truth[0])) return;
    const { context: c, colours } = this;
    const [x, y] = this.pixel(arrays.truth);
    c.strokeStyle = colours.ink;
    c.lineWidth = 2;
    c.beginPath();
    c.arc(x, y, 7, 0, 7);
    c.stroke();
    this.stroke([[x - 11, y], [x - 4, y]]);
    this.stroke([[x + 4, y], [x + 11, y]]);
    this.stroke([[x, y - 11], [x, y - 4]]);
    this.stroke([[x, y + 4], [x, y + 11]]);
  }
}
