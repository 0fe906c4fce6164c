// The map: agents, links, target, estimates with their ellipses, and messages that pass. Top view, or turned in space.

const REACH = Math.sqrt(5.991); // 95 % of a normal distribution in a plane
const NEAR_PIXELS = 14;
const ESTIMATE = 6;

const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/** A colour for each agent, apart from those of its neighbours in number. */
export const hue = (agent) => `hsl(${(agent * 137.508 + 205) % 360} 62% 48%)`;

export class MapView {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.yaw = 0;
    this.pitch = Math.PI / 2;
    this.fitted = true;
    this.centre = [0, 0];
    this.scale = 1;
    this.line = null;
    this.chosen = null;
    this.shown = new Map(); // the colour of each link, as drawn last
    this.recolour();
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.recolour());
  }

  recolour() {
    this.colours = Object.fromEntries(
      ["paper", "ink", "muted", "grid", "rule", "accent", "good", "lost", "late", "alarm"].map((one) => [one, css(`--${one}`)]),
    );
  }

  /** Take the unchanging part of a scene. */
  show(scene) {
    this.scene = scene;
    this.fitted = true;
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const ratio = devicePixelRatio || 1;
    if (this.canvas.width !== Math.round(width * ratio) || this.canvas.height !== Math.round(height * ratio)) {
      this.canvas.width = Math.round(width * ratio);
      this.canvas.height = Math.round(height * ratio);
    }
    this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.width = width;
    this.height = height;
  }

  /** The two axes of the picture in space: orthographic, so that ellipsoids become ellipses. */
  axes() {
    const [c, s] = [Math.cos(this.yaw), Math.sin(this.yaw)];
    const [cp, sp] = [Math.cos(this.pitch), Math.sin(this.pitch)];
    return [[c, s, 0], [-s * sp, c * sp, cp]];
  }

  flat(values, at) {
    const [[a, b], [d, e, f]] = this.now;
    const [x, y, z] = [values[at], values[at + 1], values[at + 2]];
    return [a * x + b * y, d * x + e * y + f * z];
  }

  pixel(values, at = 0) {
    const [u, v] = this.flat(values, at);
    return [this.width / 2 + (u - this.centre[0]) * this.scale, this.height / 2 - (v - this.centre[1]) * this.scale];
  }

  fit(arrays) {
    const points = [];
    for (let at = 0; at < arrays.place.length; at += 3) points.push(this.flat(arrays.place, at));
    if (Number.isFinite(arrays.truth[0])) points.push(this.flat(arrays.truth, 0));
    const us = points.map((one) => one[0]);
    const vs = points.map((one) => one[1]);
    const [low, high, bottom, top] = [Math.min(...us), Math.max(...us), Math.min(...vs), Math.max(...vs)];
    const margin = 56;
    const scale = Math.min(
      (this.width - 2 * margin) / Math.max(high - low, 1e-6), (this.height - 2 * margin) / Math.max(top - bottom, 1e-6));
    const centre = [(low + high) / 2, (bottom + top) / 2];
    // A moving target does not make the map tremble: it is fitted again where something would leave it.
    const inside = points.every(([u, v]) => {
      const [x, y] = [this.width / 2 + (u - this.centre[0]) * this.scale, this.height / 2 - (v - this.centre[1]) * this.scale];
      return x > 20 && y > 20 && x < this.width - 20 && y < this.height - 20;
    });
    const sameView = this.fittedView === `${this.yaw} ${this.pitch} ${this.width} ${this.height}`;
    if (!inside || !sameView || this.scale > 1.6 * scale || this.scale < 0.5 * scale) {
      this.scale = Math.min(scale, 1e6);
      this.centre = centre;
      this.fittedView = `${this.yaw} ${this.pitch} ${this.width} ${this.height}`;
    }
  }

  /** Draw a step. trails: of the target and of each agent, lists of points. phase: how far the step has gone, 0 to 1. */
  draw(arrays, trails, marks, phase) {
    this.resize();
    this.now = this.axes();
    if (this.fitted) this.fit(arrays);
    this.arrays = arrays;
    const { context: c, colours } = this;
    c.clearRect(0, 0, this.width, this.height);
    this.grid();
    this.links(arrays, phase);
    this.trail(trails.truth, colours.ink, 2);
    const count = arrays.place.length / 3;
    for (let agent = 0; agent < count; agent++) this.trail(trails.agents[agent] ?? [], hue(agent), 1.2);
    for (let agent = 0; agent < count; agent++) this.estimate(arrays, agent);
    this.agents(arrays, marks);
    this.target(arrays);
    if (this.line) {
      c.strokeStyle = colours.alarm;
      c.setLineDash([8, 5]);
      c.lineWidth = 2;
      this.stroke([this.line.from, this.line.to]);
      c.setLineDash([]);
    }
  }

  stroke(points) {
    const c = this.context;
    c.beginPath();
    points.forEach(([x, y], place) => (place ? c.lineTo(x, y) : c.moveTo(x, y)));
    c.stroke();
  }

  grid() {
    const { context: c, colours } = this;
    const rough = 90 / this.scale;
    const power = 10 ** Math.floor(Math.log10(rough));
    const unit = [1, 2, 5, 10].map((one) => one * power).find((one) => one >= rough);
    c.fillStyle = colours.muted;
    c.font = "11px system-ui, sans-serif";
    if (this.pitch > 1.5 && this.yaw === 0) {
      c.strokeStyle = colours.grid;
      c.lineWidth = 1;
      const left = this.centre[0] - this.width / 2 / this.scale;
      const bottom = this.centre[1] - this.height / 2 / this.scale;
      for (let u = Math.ceil(left / unit) * unit; (u - left) * this.scale < this.width; u += unit) {
        const x = Math.round((u - left) * this.scale) + 0.5;
        this.stroke([[x, 0], [x, this.height]]);
      }
      for (let v = Math.ceil(bottom / unit) * unit; (v - bottom) * this.scale < this.height; v += unit) {
        const y = Math.round(this.height - (v - bottom) * this.scale) + 0.5;
        this.stroke([[0, y], [this.width, y]]);
      }
    }
    c.strokeStyle = colours.muted;
    c.lineWidth = 2;
    const y = this.height - 14;
    this.stroke([[16, y], [16 + unit * this.scale, y]]);
    c.fillText(`${Number(unit.toPrecision(3))} m`, 20, y - 5);
  }

  /** Each direction of a link beside the other; its colour says what the receiver lost and had late in this step. */
  links(arrays, phase) {
    const { context: c, colours } = this;
    this.scene.links.forEach(([source, destination], row) => {
      const [came, lost, late] = [0, 1, 2].map((one) => arrays.links[4 * row + one]);
      const total = came + lost + late;
      const [from, to] = this.beside(arrays, source, destination);
      const bad = total > 0 ? lost / total : 0;
      const slow = total > 0 ? late / total : 0;
      const silent = !(total > 0);
      const colour = silent ? colours.rule : bad > 0 ? colours.lost : slow > 0 ? colours.late : colours.good;
      this.shown.set(`${source} ${destination}`, colour);
      c.strokeStyle = colour;
      c.globalAlpha = silent ? 0.5 : bad > 0 || slow > 0 ? 0.35 + 0.65 * Math.max(bad, slow) : 0.4;
      c.lineWidth = bad > 0 || slow > 0 ? 1.4 + 1.8 * Math.max(bad, slow) : 1.2;
      if (bad >= 1 || silent) c.setLineDash([5, 5]);
      this.stroke([from, to]);
      c.setLineDash([]);
      c.globalAlpha = 1;
      if (phase !== null && total > 0) this.message(from, to, phase, came, lost, late);
    });
  }

  beside(arrays, source, destination) {
    const [from, to] = [this.pixel(arrays.place, 3 * source), this.pixel(arrays.place, 3 * destination)];
    const [dx, dy] = [to[0] - from[0], to[1] - from[1]];
    const length = Math.hypot(dx, dy) || 1;
    const [ox, oy] = [(-dy / length) * 2, (dx / length) * 2];
    return [[from[0] + ox, from[1] + oy], [to[0] + ox, to[1] + oy]];
  }

  message(from, to, phase, came, lost, late) {
    const { context: c, colours } = this;
    const total = came + lost + late;
    const place = Math.min(phase * total, total - 1e-6);
    const which = Math.floor(place);
    const along = place - which;
    const struck = (number) => Math.floor(((which + 1) * number) / total) > Math.floor((which * number) / total);
    const gone = struck(lost);
    if (gone && along > 0.55) return;
    c.fillStyle = gone ? colours.lost : struck(late) ? colours.late : colours.accent;
    c.beginPath();
    c.arc(from[0] + along * (to[0] - from[0]), from[1] + along * (to[1] - from[1]), gone ? 3.2 : 2.6, 0, 7);
    c.fill();
  }

  trail(points, colour, width) {
    const c = this.context;
    c.strokeStyle = colour;
    c.lineWidth = width;
    for (let at = 1; at < points.length; at++) {
      if (!Number.isFinite(points[at][0]) || !Number.isFinite(points[at - 1][0])) continue;
      c.globalAlpha = (0.75 * at) / points.length;
      this.stroke([this.pixel(points[at - 1]), this.pixel(points[at])]);
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
    c.lineWidth = 1.2;
    const ellipse = this.ellipse(arrays.spread.subarray(6 * agent, 6 * agent + 6));
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

  ellipse([xx, xy, xz, yy, yz, zz]) {
    if (!Number.isFinite(xx)) return null;
    const P = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
    const dot = (m, n) => m.reduce((sum, a, i) => sum + a * P[i].reduce((inner, p, j) => inner + p * n[j], 0), 0);
    const [m, n] = this.now;
    const [a, b, d] = [dot(m, m), dot(m, n), dot(n, n)];
    const middle = (a + d) / 2;
    const root = Math.hypot((a - d) / 2, b);
    const size = (value) => REACH * Math.sqrt(Math.max(value, 0)) * this.scale;
    return { major: size(middle + root), minor: size(middle - root), angle: Math.atan2(2 * b, a - d) / 2 };
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
      c.strokeStyle = mark ? colours.alarm : this.chosen === agent ? colours.ink : away ? colours.muted : colours.paper;
      c.stroke();
      if (away) {
        c.strokeStyle = colours.lost;
        this.stroke([[x - 4, y - 4], [x + 4, y + 4]]);
        this.stroke([[x - 4, y + 4], [x + 4, y - 4]]);
      }
      c.fillStyle = colours.ink;
      if (!many || this.chosen === agent || mark) c.fillText(mark ? `${agent} ${mark}` : `${agent}`, x, y - 12);
    }
    c.textAlign = "start";
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

  /** The agent or the link at a place of the canvas; null where there is neither. */
  pick(x, y) {
    if (!this.arrays) return null;
    let best = { away: NEAR_PIXELS };
    for (let agent = 0; agent < this.arrays.place.length / 3; agent++) {
      const [ax, ay] = this.pixel(this.arrays.place, 3 * agent);
      const away = Math.hypot(x - ax, y - ay);
      if (away < best.away) best = { away, agent };
    }
    if (best.agent !== undefined) return { agent: best.agent };
    for (const [source, destination] of this.scene.links) {
      const [from, to] = [this.pixel(this.arrays.place, 3 * source), this.pixel(this.arrays.place, 3 * destination)];
      const [dx, dy] = [to[0] - from[0], to[1] - from[1]];
      const along = Math.min(1, Math.max(0, ((x - from[0]) * dx + (y - from[1]) * dy) / (dx * dx + dy * dy || 1)));
      const away = Math.hypot(x - from[0] - along * dx, y - from[1] - along * dy);
      if (away < best.away * 0.6) best = { away: away / 0.6, link: [source, destination] };
    }
    return best.link ? { link: best.link } : null;
  }

  /** The agents on either side of a line through two places of the canvas. */
  sides([x1, y1], [x2, y2]) {
    const groups = [[], []];
    for (let agent = 0; agent < this.arrays.place.length / 3; agent++) {
      const [x, y] = this.pixel(this.arrays.place, 3 * agent);
      groups[(x2 - x1) * (y - y1) - (y2 - y1) * (x - x1) > 0 ? 1 : 0].push(agent);
    }
    return groups;
  }

  zoom(factor, x, y) {
    const [u, v] = [(x - this.width / 2) / this.scale, (this.height / 2 - y) / this.scale];
    this.fitted = false;
    this.scale *= factor;
    this.centre = [this.centre[0] + u - u / factor, this.centre[1] + v - v / factor];
  }

  move(dx, dy) {
    this.fitted = false;
    this.centre = [this.centre[0] - dx / this.scale, this.centre[1] + dy / this.scale];
  }

  turn(dx, dy) {
    this.yaw += dx * 0.008;
    this.pitch = Math.min(Math.PI / 2, Math.max(0.05, this.pitch + dy * 0.008));
  }
}
