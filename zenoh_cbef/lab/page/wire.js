// Questions to the server, and what it answers: JSON and arrays of numbers.

import { unpacked } from "./packed.js";

const token = new URLSearchParams(location.search).get("token") ?? "";

export const exported = () => `scenario.toml?token=${encodeURIComponent(token)}`;

/** One socket: answers come in the order of the questions. A lost socket is opened again, once a second. */
export class Wire {
  constructor(changed) {
    this.changed = changed;
    this.waiting = [];
    this.open();
  }

  open() {
    const url = new URL(`talk?token=${encodeURIComponent(token)}`, location.href);
    url.protocol = url.protocol.replace("http", "ws");
    const socket = new WebSocket(url);
    socket.binaryType = "arraybuffer";
    let opened = false;
    socket.onopen = () => { opened = true; this.socket = socket; this.changed(true); };
    socket.onmessage = (event) => this.waiting.shift()?.resolve(unpacked(event.data));
    socket.onclose = () => {
      this.socket = undefined;
      for (const one of this.waiting.splice(0)) one.reject(new Error("gone"));
      this.changed(false, opened);
      setTimeout(() => this.open(), 1000);
    };
  }

  /** Ask; the promise fails where the server is gone. */
  ask(table) {
    if (this.socket?.readyState !== WebSocket.OPEN) return Promise.reject(new Error("gone"));
    return new Promise((resolve, reject) => {
      this.waiting.push({ resolve, reject });
      this.socket.send(JSON.stringify(table));
    });
  }
}
