// Lists beside the map: agents, faults, events. All can be reached by keyboard.

import { hue } from "./colours.js";

const MOST_EVENTS = 300;
const MANY = 40; // agents of whom only the number is shown, and a sign where there is something to see
const SIGNS = { acquiring: "?", coasting: "~", lost: "!", away: "×" };

const short = (value, unit = "") => (Number.isFinite(value) ? `${Number(value.toPrecision(3))}${unit}` : "–");

export class Panels {
  constructor(agents, faults, events, picked) {
    this.agents = agents;
    this.faults = faults;
    this.events = events;
    this.picked = picked;
  }

  show(scene) {
    this.scene = scene;
    this.told = [];
    this.events.replaceChildren();
    this.agents.classList.toggle("many", scene.agents > MANY);
    this.agents.replaceChildren(...Array.from({ length: scene.agents }, (_, agent) => {
      const button = document.createElement("button");
      button.type = "button";
      button.style.setProperty("--hue", hue(agent));
      button.addEventListener("click", () => {
        const box = button.getBoundingClientRect();
        this.picked({ agent }, box.left, box.bottom);
      });
      return button;
    }));
  }

  /** Say of each agent what its estimate is, and how far off. */
  draw(arrays) {
    const { truth, estimate, said } = arrays;
    const count = this.agents.children.length;
    [...this.agents.children].forEach((button, agent) => {
      const there = Number.isFinite(estimate[6 * agent]);
      const off = short(Math.hypot(...[0, 1, 2].map((axis) => estimate[6 * agent + axis] - truth[axis])), " m");
      const status = there ? this.scene.statuses[said[3 * agent]] ?? "" : "away";
      const name = this.scene.names[agent];
      const whole = there ? `agent ${name}: ${status}, error ${off}` : `agent ${name}: away`;
      const told = there ? `${name} ${status} ${off}` : `${name} away`;
      const words = count > MANY ? `${name}${SIGNS[status] ?? ""}` : told.replace("  ", " ");
      if (button.textContent !== words) button.textContent = words;
      if (button.title !== whole) {
        button.title = whole;
        button.setAttribute("aria-label", whole);
      }
      button.dataset.status = status;
    });
  }

  /** The faults, those that are on first. */
  drawFaults(faults, time) {
    const on = (one) => time >= one.from && (one.until === null || time < one.until);
    const shown = JSON.stringify([faults, faults.map(on)]);
    if (shown !== this.shown) {
      this.shown = shown;
      this.faults.replaceChildren(...faults.map((one) => {
        const item = document.createElement("li");
        item.dataset.on = on(one);
        item.textContent = `${one.words}, ${short(one.from, " s")} to ${one.until === null ? "the end" : short(one.until, " s")}`;
        return item;
      }));
      if (!faults.length) this.faults.textContent = "none";
    }
  }

  /** New events, the latest on top; those without a step came before the first one, or belong to none. */
  takeEvents(events) {
    let time = this.told.at(-1)?.time ?? 0;
    for (const one of events) {
      time = one.time ?? time;
      const item = document.createElement("li");
      const when = document.createElement("time");
      when.textContent = one.time === null ? "" : `${one.time.toFixed(1)} s`;
      item.append(when, ` ${one.text}`);
      item.title = one.from;
      this.events.prepend(item);
      this.told.push({ item, time });
    }
    while (this.told.length > MOST_EVENTS) this.told.shift().item.remove();
  }

  /** Show the events up to a time, s. */
  drawEvents(time) {
    for (const one of this.told) one.item.hidden = one.time > time + 1e-9;
  }
}
