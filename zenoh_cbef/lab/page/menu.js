// What can be done to an agent or a link, at the place where the reader clicked.

const FAULTS = {
  link: ([source, destination]) => [
    { words: "cut", table: () => ({ kind: "partition", links: both(source, destination) }) },
    { words: "lose", value: 30, most: 100, unit: "%", table: (value) => ({ kind: "loss", probability: value / 100, links: both(source, destination) }) },
    { words: "delay", value: 50, most: 10000, unit: "ms", table: (value) => ({ kind: "delay", milliseconds: value, links: both(source, destination) }) },
  ],
  agent: (agent) => [
    { words: "kill", table: () => ({ kind: "crash", agents: [agent] }) },
    { words: "pause 3 s", seconds: 3, table: () => ({ kind: "pause", agents: [agent] }) },
    { words: "cut off", table: () => ({ kind: "outage", agents: [agent] }) },
    { words: "bias its receiver by", value: 5, most: 1000, unit: "m", table: (value) => ({ kind: "sensor-bias", agents: [agent], bias: value }) },
    { words: "deafen its receiver", table: () => ({ kind: "sensor-dropout", agents: [agent], probability: 1 }) },
    { words: "let it lie by", value: 5, most: 1000, unit: "m", table: (value) => ({ kind: "byzantine", agents: [agent], magnitude: value }) },
  ],
};

const both = (first, second) => [[first, second], [second, first]];

export class Menu {
  /** inject(table, seconds): gives an order. sided(agent): begins to choose the agents of one side. */
  constructor(place, inject, sided) {
    Object.assign(this, { place, inject, sided, names: [] });
    place.addEventListener("keydown", (event) => this.key(event));
    addEventListener("pointerdown", (event) => { if (!place.contains(event.target)) this.close(); });
  }

  /** Open it for {agent} or {link}, at a place of the window. neighbours: of the agent, whose links it leads to. */
  open(picked, x, y, injectable, neighbours = []) {
    const link = picked.link !== undefined;
    const heading = document.createElement("h2");
    heading.textContent = link ? `link ${picked.link.map((one) => this.names[one]).join("–")}` : `agent ${this.names[picked.agent]}`;
    const faults = injectable ? FAULTS[link ? "link" : "agent"](link ? picked.link : picked.agent).map((one) => this.fault(one)) : [];
    const links = injectable && !link ? neighbours.map((other) => this.button(`link to ${this.names[other]} …`, () => this.open({ link: [picked.agent, other] }, x, y, true))) : [];
    const side = injectable && !link ? [this.button("part it and others from the rest …", () => { this.close(); this.sided(picked.agent); })] : [];
    const note = document.createElement("p");
    note.textContent = injectable ? "from the next steps on, until you undo it" : "faults are for runs that go on";
    this.place.replaceChildren(heading, ...faults, ...side, ...links, note);
    if (this.place.hidden) this.from = document.activeElement;
    this.place.setAttribute("aria-label", heading.textContent);
    this.place.hidden = false;
    const { offsetWidth: width, offsetHeight: height } = this.place;
    this.place.style.left = `${Math.max(8, Math.min(x + 10, innerWidth - width - 8))}px`;
    this.place.style.top = `${Math.max(8, Math.min(y + 10, innerHeight - height - 8))}px`;
    this.place.querySelector("button")?.focus();
  }

  /** An order; one with a value has a field for it beside. */
  fault({ words, table, seconds = null, value, most, unit }) {
    if (value === undefined) return this.button(words, () => this.order(table(), seconds));
    const row = document.createElement("div");
    const field = Object.assign(document.createElement("input"), { type: "number", min: "0", max: String(most), value: String(value) });
    field.setAttribute("aria-label", `${words}, ${unit}`);
    const give = () => (field.value !== "" && field.checkValidity() ? this.order(table(Number(field.value)), seconds) : field.focus());
    field.addEventListener("keydown", (event) => { if (event.key === "Enter") give(); });
    row.append(this.button(words, give), field, ` ${unit}`);
    return row;
  }

  order(table, seconds) {
    this.close();
    this.inject(table, seconds);
  }

  button(words, act) {
    const one = document.createElement("button");
    one.type = "button";
    one.role = "menuitem";
    one.textContent = words;
    one.addEventListener("click", act);
    return one;
  }

  key(event) {
    const buttons = [...this.place.querySelectorAll("button")];
    const at = buttons.indexOf(document.activeElement);
    if (event.key === "Escape") this.close();
    if (at < 0 && event.key !== "Escape") return; // arrows change a field's number
    if (event.key === "ArrowDown") buttons[(at + 1) % buttons.length]?.focus();
    if (event.key === "ArrowUp") buttons[(at + buttons.length - 1) % buttons.length]?.focus();
    if (["Escape", "ArrowDown", "ArrowUp"].includes(event.key)) { event.preventDefault(); event.stopPropagation(); }
  }

  close() {
    if (this.place.hidden) return;
    this.place.hidden = true;
    this.from?.focus?.();
  }
}
