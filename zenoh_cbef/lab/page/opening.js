// The dialog in which a reader chooses what to see: a scenario to start, a run that goes on, or a log.

export class Opening {
  constructor(dialog, wire, opened, told) {
    this.dialog = dialog;
    this.wire = wire;
    this.opened = opened;
    this.told = told;
  }

  async show() {
    const offered = await this.wire.ask({ ask: "what" });
    const choices = this.dialog.querySelector(".choices");
    choices.replaceChildren(
      this.list("Runs that go on", offered.runs.map((run) => [run, "", { ask: "join", run }])),
      this.list("Start a scenario", Object.entries(offered.scenarios).map(([name, what]) => [name, what, { ask: "start", scenario: name, set: [] }])),
      this.own(),
      this.list("Logs", offered.logs.map((log) => [log, "", { ask: "open", log }])),
    );
    if (!this.dialog.open) this.dialog.showModal();
  }

  list(title, entries) {
    const part = document.createElement("section");
    const heading = document.createElement("h3");
    heading.textContent = title;
    part.append(heading);
    for (const [name, what, order] of entries) {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = name;
      const about = document.createElement("small");
      about.textContent = what;
      button.append(about);
      button.addEventListener("click", () => this.choose(order, name));
      part.append(button);
    }
    if (!entries.length) part.append("none on this host");
    return part;
  }

  own() {
    const part = document.createElement("section");
    part.innerHTML = "<h3>Start your own</h3><form><input name='scenario' required placeholder='scenario or file.toml' aria-label='scenario'>"
      + "<input name='set' placeholder='key=value; key=value' aria-label='settings'><button>Start</button></form>";
    part.querySelector("form").addEventListener("submit", (event) => {
      event.preventDefault();
      const form = new FormData(event.target);
      const set = String(form.get("set")).split(";").map((one) => one.trim()).filter(Boolean);
      this.choose({ ask: "start", scenario: String(form.get("scenario")), set }, String(form.get("scenario")));
    });
    return part;
  }

  async choose(order, name) {
    this.dialog.close();
    this.told(`opening ${name} ...`, "none");
    const answer = await this.wire.ask(order);
    if (answer.error) this.told(answer.error, "bad");
    else this.opened();
  }
}
