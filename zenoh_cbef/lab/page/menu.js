// What can be done to an agent or a link, at the place where the reader clicked.

const FAULTS = {
  link: ([source, destination]) => [
    ["cut", { kind: "partition", links: both(source, destination) }],
    ["lose 30 %", { kind: "loss", probability: 0.3, links: both(source, destination) }],
    ["lose 70 %", { kind: "loss", probability: 0.7, links: both(source, destination) }],
    ["delay 50 ms", { kind: "delay", milliseconds: 50, links: both(source, destination) }],
  ],
  agent: (agent) => [
    ["kill", { kind: "crash", agents: [agent] }],
    ["pause 3 s", { kind: "pause", agents: [agent] }, 3],
    ["cut off", { kind: "outage", agents: [agent] }],
    ["bias its receiver by 5 m", { kind: "sensor-bias", agents: [agent], bias: 5 }],
    ["deafen its receiver", { kind: "sensor-dropout", agents: [agent], probability: 1 }],
    ["let it lie by 5 m", { kind: "byzantine", agents: [agent], magnitude: 5 }],
  ],
};

const both = (first, second) => [[first, second], [second, first]];

export class Menu {
  constructor(place, inject) {
    this.place = place;
    this.inject = inject;
    place.addEventListener("keydown", (event) => this.key(event));
    addEventListener("pointerdown", (event) => { if (!place.contains(event.target)) this.close(); });
  }

  /** Open it for {agent} or {link}, at a place of the window. */
  open(picked, x, y, injectable) {
    const link = picked.link !== undefined;
    const heading = document.createElement("h2");
    heading.textContent = link ? `link ${picked.link[0]}–${picked.link[1]}` : `agent ${picked.agent}`;
    const buttons = injectable ? FAULTS[link ? "link" : "agent"](link ? picked.link : picked.agent).map((one) => this.button(...one)) : [];
    const note = document.createElement("p");
    note.textContent = injectable ? "from the next steps on, until you undo it" : "faults are for runs that go on";
    this.place.replaceChildren(heading, ...buttons, note);
    this.place.hidden = false;
    const { offsetWidth: width, offsetHeight: height } = this.place;
    this.place.style.left = `${Math.max(8, Math.min(x + 10, innerWidth - width - 8))}px`;
    this.place.style.top = `${Math.max(8, Math.min(y + 10, innerHeight - height - 8))}px`;
    this.from = document.activeElement;
    buttons[0]?.focus();
  }

  button(words, table, seconds = null) {
    const one = document.createElement("button");
    one.type = "button";
    one.role = "menuitem";
    one.textContent = words;
    one.addEventListener("click", () => { this.close(); this.inject(table, seconds); });
    return one;
  }

  key(event) {
    const buttons = [...this.place.querySelectorAll("button")];
    const at = buttons.indexOf(document.activeElement);
    if (event.key === "Escape") this.close();
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
