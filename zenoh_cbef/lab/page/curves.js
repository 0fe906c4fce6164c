// Curves over time, all with one time axis; a click winds to that time, faults are shaded.

import { css } from "./colours.js";
import uPlot from "./uplot.js";

const CHARTS = [
  { title: "position error, m", lines: [["error", "--accent"], ["claimed", "--muted"]] },
  { title: "disagreement, m", lines: [["disagreement", "--accent"]] },
  { title: "NIS", lines: [["nis", "--accent"]] },
  { title: "lost and late, % of messages", lines: [["lost", "--lost"], ["late", "--late"]], factor: 100 },
  { title: "latency, ms", lines: [["latency", "--accent"]], factor: 1000 },
];

/** Numbers at an axis, also very small ones, which would all be rounded to zero. */
const short = (_, values) => values.map((value) => String(Number(value.toPrecision(3))));

export class Curves {
  constructor(place, seek) {
    this.place = place;
    this.seek = seek;
    this.spans = [];
    this.time = 0;
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.build());
    new ResizeObserver(() => this.resize()).observe(place);
  }

  show(dt) {
    this.dt = dt;
    this.steps = 0;
    this.values = {};
    this.other = null;
    this.times = [];
    this.build();
  }

  build() {
    if (this.dt === undefined) return;
    this.place.replaceChildren();
    this.plots = CHARTS.map((chart) => {
      const figure = document.createElement("figure");
      const caption = document.createElement("figcaption");
      caption.textContent = chart.title;
      const now = document.createElement("output");
      caption.append(now);
      figure.append(caption);
      this.place.append(figure);
      const plot = new uPlot(this.options(chart, figure), [[], ...this.lines(chart).map(() => [])], figure);
      plot.root.setAttribute("aria-hidden", "true"); // its title and its value at this time are in the caption
      plot.over.addEventListener("click", () => {
        if (plot.cursor.left >= 0) this.seek(plot.posToVal(plot.cursor.left, "x"));
      });
      return { plot, chart, figure, now };
    });
    this.refresh();
  }

  options(chart, figure) {
    const axis = { stroke: css("--muted"), grid: { stroke: css("--grid"), width: 1 }, ticks: { show: false }, font: "11px system-ui" };
    return {
      ...this.size(figure),
      legend: { show: false },
      cursor: { sync: { key: "time" }, drag: { x: false, y: false }, points: { size: 5 } },
      scales: { x: { time: false }, y: { range: (_, low, high) => [Math.min(0, low ?? 0), high > 0 ? high * 1.08 : 1] } },
      axes: [{ ...axis, size: 20, gap: 2 }, { ...axis, size: 44, gap: 3, space: 18, values: short }],
      series: [{}, ...this.lines(chart).map(([name, colour]) => ({
        label: name, stroke: css(colour), width: 1.4, points: { show: false }, dash: name === "claimed" ? [4, 3] : undefined,
      }))],
      hooks: { drawClear: [(plot) => this.shade(plot)], draw: [(plot) => this.mark(plot)] },
    };
  }

  /** A chart's lines; the first one of the run beside comes last. */
  lines({ lines }) {
    return this.other ? [...lines, [`${lines[0][0]} beside`, "--doubt"]] : lines;
  }

  size(figure) {
    const height = Math.max(72, Math.floor(this.place.clientHeight / CHARTS.length) - 22);
    return { width: Math.max(200, (figure.clientWidth || this.place.clientWidth) - 4), height };
  }

  resize() {
    for (const { plot, figure } of this.plots ?? []) plot.setSize(this.size(figure));
  }

  shade(plot) {
    const { ctx, bbox } = plot;
    ctx.save();
    ctx.fillStyle = css("--alarm-shade");
    for (const { from, until } of this.spans) {
      const [left, right] = [from, until ?? Infinity].map((time) =>
        Math.min(Math.max(plot.valToPos(Math.min(time, plot.scales.x.max ?? 0), "x", true), bbox.left), bbox.left + bbox.width));
      if (right > left) ctx.fillRect(left, bbox.top, right - left, bbox.height);
    }
    ctx.restore();
  }

  mark(plot) {
    const { ctx, bbox } = plot;
    const x = plot.valToPos(this.time, "x", true);
    if (!(x >= bbox.left && x <= bbox.left + bbox.width)) return;
    ctx.save();
    ctx.strokeStyle = css("--ink");
    ctx.lineWidth = devicePixelRatio || 1;
    ctx.beginPath();
    ctx.moveTo(x, bbox.top);
    ctx.lineTo(x, bbox.top + bbox.height);
    ctx.stroke();
    ctx.restore();
  }

  /** Take in curves of the run beside, of steps since+1 to until of dt s each. */
  takeBeside(arrays, dt, since, until) {
    if (!this.other) {
      this.other = { dt, steps: 0, values: {} };
      this.build();
    }
    const { other } = this;
    for (const { lines: [[name]], factor = 1 } of CHARTS) {
      const kept = (other.values[name] ??= []);
      for (let step = other.steps; step < until; step++) kept.push(arrays[`curve ${name}`][step - since] * factor);
    }
    this.changed ||= until > other.steps;
    other.steps = Math.max(other.steps, until);
  }

  /** A curve of the run beside at this run's times. */
  beside([[name]]) {
    return this.times.map((time) => {
      const value = this.other.values[name]?.[Math.round(time / this.other.dt) - 1];
      return Number.isFinite(value) ? value : null;
    });
  }

  /** Take in curves of steps since+1 to until, as far as they are new. */
  take(arrays, since, until) {
    if (until <= this.steps) return;
    for (const { lines, factor = 1 } of CHARTS) {
      for (const [name] of lines) {
        const kept = (this.values[name] ??= []);
        const fresh = arrays[`curve ${name}`];
        for (let step = this.steps; step < until; step++) {
          const value = fresh[step - since];
          kept.push(Number.isFinite(value) ? value * factor : null);
        }
      }
    }
    for (let step = this.steps; step < until; step++) this.times.push((step + 1) * this.dt);
    this.steps = until;
    this.changed = true;
  }

  /** Draw, at most so often: curves cost more than the map. */
  refresh() {
    for (const { plot, chart, now } of this.plots ?? []) {
      const values = chart.lines.map(([name]) => this.values[name] ?? []);
      if (this.changed && this.other) values.push(this.beside(chart.lines));
      if (this.changed) plot.setData([this.times, ...values]);
      else plot.redraw(false);
      const value = values[0][Math.round(this.time / this.dt) - 1];
      now.textContent = value === null || value === undefined ? "" : String(Number(value.toPrecision(3)));
    }
    this.changed = false;
  }
}
