// A partition: by a line that is drawn across the map, or by the agents of one side, chosen by keyboard or mouse.

import { sides } from "./picking.js";

export class Parting {
  /** cut: the button of the line. bar: what is shown while a side is chosen. agents: where the agents' buttons are.
   * acts: inject(table, seconds), tell(words), redraw(). */
  constructor(map, cut, bar, agents, acts) {
    Object.assign(this, { map, cut, bar, agents, acts, draws: false, side: null });
    const [off, cancel] = bar.querySelectorAll("button");
    off.addEventListener("click", () => this.act());
    cancel.addEventListener("click", () => this.stop());
  }

  /** Cut off the side that is chosen; where none is, draw a line, or no longer. */
  act() {
    if (!this.side) { this.line(!this.draws); return; }
    const rest = [...this.agents.children].map((_, agent) => agent).filter((agent) => !this.side.has(agent));
    const groups = [[...this.side].sort((one, other) => one - other), rest];
    if (this.part(groups, "choose at least one agent, and leave at least one")) this.stop();
  }

  /** A line was drawn between two places of the canvas. */
  drawn(from, to) {
    this.line(false);
    this.part(sides(this.map, from, to), "all agents are on one side of that line");
  }

  /** Begin to choose the agents of one side. */
  choose(agent) {
    this.line(false);
    this.side = new Set([agent]);
    this.show();
    this.agents.children[agent].focus();
  }

  /** Take an agent to the side, or from it; false where no side is being chosen. */
  toggles(agent) {
    if (!this.side) return false;
    if (!this.side.delete(agent)) this.side.add(agent);
    this.show();
    return true;
  }

  /** Neither draw nor choose any longer. */
  stop() {
    this.line(false);
    if (!this.side) return;
    const first = this.side.values().next().value ?? 0;
    this.side = null;
    if (this.bar.contains(document.activeElement)) this.agents.children[first]?.focus();
    this.show();
  }

  /** The words for agents, with those of the side that is chosen. */
  marked(words) {
    for (const agent of this.side ?? []) words.set(agent, "this side");
    return words;
  }

  part(groups, refused) {
    const parts = groups.every((one) => one.length);
    if (parts) this.acts.inject({ kind: "partition", links: { between: groups } }, null);
    else this.acts.tell(refused);
    return parts;
  }

  line(on) {
    this.draws = on;
    this.cut.setAttribute("aria-pressed", String(on));
  }

  show() {
    this.bar.hidden = !this.side;
    const chosen = [...(this.side ?? [])].sort((one, other) => one - other).join(", ");
    this.bar.querySelector("output").textContent = this.side ? `choose agents to cut off: ${chosen || "none yet"}` : "";
    [...this.agents.children].forEach((button, agent) => {
      if (this.side) button.setAttribute("aria-pressed", String(this.side.has(agent)));
      else button.removeAttribute("aria-pressed");
    });
    this.acts.redraw();
  }
}
