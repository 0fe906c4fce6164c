// A second run beside the first, over the same time: its map, its verdict, and its error among the curves.

import { hands } from "./hands.js";
import { MapView } from "./map.js";
import { standing } from "./standing.js";

const TRAIL = 40;

export class Beside {
  constructor(place, redraw) {
    this.place = place;
    this.map = new MapView(place.querySelector("canvas"));
    this.verdict = place.querySelector("p");
    hands(this.map, { redraw });
  }

  /** scene: of the run, or undefined where there is none. */
  show(scene) {
    this.scene = scene;
    this.known = 0;
    this.trail = [];
    this.place.hidden = !scene;
    document.body.classList.toggle("paired", Boolean(scene));
    if (!scene) return;
    this.map.show(scene);
    this.place.querySelector("h2").textContent = `beside: ${scene.run}`;
  }

  /** Take a frame in; the curves of the run among it are handed on. */
  take(frame, curves) {
    if (!frame.beside) return;
    this.told = frame.beside;
    this.arrays = Object.fromEntries(Object.entries(frame.arrays)
      .filter(([name]) => name.startsWith("beside ")).map(([name, values]) => [name.slice(7), values]));
    curves.takeBeside(this.arrays, this.scene.dt, ...this.told.curves);
    this.known = this.told.curves[1];
    const truth = [...this.arrays.truth.subarray(0, 3)];
    const near = Math.abs(this.told.step - (this.trail.at(-1)?.step ?? -9)) < 12;
    this.trail = [...(near ? this.trail : []), { step: this.told.step, truth }].slice(-TRAIL);
  }

  draw() {
    if (!this.told || !this.scene) return;
    const { arrays, told, scene } = this;
    const marks = standing(scene, arrays, told.faults, told.step * scene.dt);
    this.map.draw(arrays, { truth: this.trail.map((one) => one.truth), agents: [] }, marks, null);
    const [level, words] = told.verdict;
    this.verdict.dataset.level = level;
    this.verdict.textContent = words;
  }
}
