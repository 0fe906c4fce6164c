// Numbers of each link over time as colours: a row for each link, a column for each stretch of steps.

import { css } from "./colours.js";

const WHAT = {
  lost: { of: ([came, lost, late]) => (100 * lost) / (came + lost + late), unit: "%", colour: "--lost" },
  late: { of: ([came, lost, late]) => (100 * late) / (came + lost + late), unit: "%", colour: "--late" },
  latency: { of: (one) => 1000 * one[3], unit: "ms", colour: "--accent" },
};
const ROW_PIXELS = [3, 9];
const TALLEST = 420;

/** Draws the heat maps of a figure. passed: (B, e, 4) flat. seek: called with the moment that is clicked. */
export class Heat {
  constructor(place, told, steps, passed, seek) {
    Object.assign(this, { told, steps, passed });
    this.links = told.links.length;
    this.maps = [...place.querySelectorAll(".heat")].map((box) => this.prepared(box, seek));
    this.maps = this.maps.filter(({ box, most }) => !(box.hidden = !(most > 0)));
    place.hidden = !this.maps.length;
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
    new ResizeObserver(() => this.draw()).observe(place);
  }

  prepared(box, seek) {
    const canvas = box.querySelector("canvas");
    const { of, unit, colour } = WHAT[canvas.dataset.what];
    const values = Float32Array.from({ length: this.steps.length * this.links }, (_, at) => of(this.passed.subarray(4 * at, 4 * at + 4)));
    const most = values.reduce((high, one) => (one > high ? one : high), 0);
    const one = { box, canvas, unit, colour, values, most, note: box.querySelector("output") };
    canvas.addEventListener("pointermove", (event) => { one.note.textContent = this.said(one, ...this.at(one, event)); });
    canvas.addEventListener("pointerleave", () => { one.note.textContent = this.range(one); });
    canvas.addEventListener("click", (event) => seek(this.at(one, event)[0]));
    return one;
  }

  at({ canvas }, event) {
    const { left, top, width, height } = canvas.getBoundingClientRect();
    const within = (share, count) => Math.min(count - 1, Math.max(0, Math.floor(share * count)));
    return [within((event.clientX - left) / width, this.steps.length), within((event.clientY - top) / height, this.links)];
  }

  said({ values, unit }, moment, row) {
    const value = values[moment * this.links + row];
    const [source, destination] = this.told.links[row].map((agent) => this.told.names[agent]);
    const time = (this.steps[moment] * this.told.dt).toFixed(1);
    return `${source} → ${destination} at ${time} s: ${Number.isFinite(value) ? `${Number(value.toPrecision(3))} ${unit}` : "nothing sent"}`;
  }

  range({ most, unit }) {
    return `0 to ${Number(most.toPrecision(3))} ${unit}`;
  }

  draw() {
    for (const one of this.maps) {
      const { canvas, values, most, colour } = one;
      const [low, high] = ROW_PIXELS;
      canvas.width = this.steps.length;
      canvas.height = this.links;
      canvas.style.height = `${Math.max(Math.min(high * this.links, TALLEST), Math.min(low * this.links, 900))}px`;
      const context = canvas.getContext("2d");
      context.clearRect(0, 0, canvas.width, canvas.height);
      context.fillStyle = css(colour);
      for (let at = 0; at < values.length; at++) {
        if (!(values[at] > 0)) continue;
        context.globalAlpha = 0.08 + 0.92 * Math.min(1, values[at] / most);
        context.fillRect(Math.floor(at / this.links), at % this.links, 1, 1);
      }
      one.note.textContent = this.range(one);
    }
  }
}
