// When the page asks, and when it draws: never more often than the browser shows, and not at all where nothing changes.

const LOOK_MS = 400; // how often is asked whether there is something to ask while nothing moves
const SIDES_MS = 150; // between two times that curves and lists are drawn, which cost more than the map

/** acts: asks(elapsed): the next question after so many seconds, or null; taken(answer); plays(): whether time passes
 * on the page itself; slides(): whether what is shown changes between two steps, too; draw(); sides(): draws what
 * stands beside the map. */
export class Pace {
  constructor(wire, acts) {
    Object.assign(this, { wire, acts, due: false, waits: false, called: false, answer: null, before: 0, shown: 0, soon: false });
    setInterval(() => this.wake(), LOOK_MS);
  }

  /** Draw again: what is shown has changed. */
  redraw() {
    this.due = true;
    this.wake();
  }

  wake() {
    if (this.called) return;
    this.called = true;
    requestAnimationFrame((now) => this.frame(now));
  }

  /** Take in an answer and ask for the next one, which the server finds while the page draws. */
  frame(now) {
    this.called = false;
    const { acts, answer } = this;
    this.answer = null;
    if (answer) acts.taken(answer);
    if (!this.waits && this.wire.socket) {
      this.ask(acts.asks(Math.min((now - this.before) / 1000, 0.25)));
      this.before = now;
    }
    if (answer || this.due || acts.slides()) {
      this.due = false;
      acts.draw();
      this.later(now);
    }
    if (acts.plays()) this.wake();
  }

  ask(table) {
    if (!table) return;
    this.waits = true;
    const came = (answer) => {
      Object.assign(this, { waits: false, answer });
      this.wake();
    };
    this.wire.ask(table).then(came, () => came(null));
  }

  /** Draw what stands beside the map, soon. */
  later(now) {
    if (this.soon) return;
    this.soon = true;
    setTimeout(() => requestAnimationFrame((then) => {
      Object.assign(this, { soon: false, shown: then });
      this.acts.sides();
    }), Math.max(0, this.shown + SIDES_MS - now));
  }
}
