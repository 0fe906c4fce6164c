// How places in space become places on a canvas: orthographic, from above or turned, so that ellipsoids become ellipses.

export class View {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.yaw = 0;
    this.pitch = Math.PI / 2;
    this.fitted = true;
    this.centre = [0, 0];
    this.scale = 1;
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

  /** Fit the picture again, whatever was in view. */
  refit() {
    this.fitted = true;
    this.fittedView = "";
  }

  /** Bring places into view; those that are nowhere do not matter. */
  fit(places) {
    const points = places.filter((one) => Number.isFinite(one[0])).map((one) => this.flat(one, 0));
    const us = points.map((one) => one[0]);
    const vs = points.map((one) => one[1]);
    const [low, high, bottom, top] = [Math.min(...us), Math.max(...us), Math.min(...vs), Math.max(...vs)];
    const margin = 56;
    const [across, down] = [this.width, this.height].map((size) => Math.max(size - 2 * margin, size / 4));
    const scale = Math.min(across / Math.max(high - low, 1e-6), down / Math.max(top - bottom, 1e-6));
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

  /** The place on the ground, at a height, that is seen at a place of the canvas; m. */
  place(x, y, height) {
    const [[a, b], [d, e, f]] = this.now;
    const u = (x - this.width / 2) / this.scale + this.centre[0];
    const v = (this.height / 2 - y) / this.scale + this.centre[1] - f * height;
    const all = a * e - b * d;
    return [(u * e - b * v) / all, (a * v - d * u) / all, height];
  }

  /** Turn between the view from above and one in space; returns whether it is in space now. */
  solid() {
    const above = this.pitch > 1.5;
    this.yaw = above ? -0.6 : 0;
    this.pitch = above ? 0.6 : Math.PI / 2;
    return above;
  }
}
