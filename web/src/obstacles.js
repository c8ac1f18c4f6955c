// Obstacles, and lines to what the filter keeps agents from. The Python beside this is mjsheaf/page/safety.py.

import * as THREE from "three";
import { Instances, materialOf, shapeOf } from "./bodies.js";

const SIDES = 24;
const HEAD = [18, 15]; // length and width of an arrow's head, pixels
const TIP = 0.35; // of the way from the agent, where the head ends: bodies may cover what is nearer
const PAINT = new THREE.Color(1, 1, 1);

export class Obstacles {
  constructor(run, scene) {
    this.run = run;
    this.places = new Float32Array(3 * run.said.obstacles.length);
    this.matrix = new THREE.Matrix4();
    this.shapes = run.said.obstacles.map((solid) => new Instances(shapeOf({ radius: 1, solids: [solid] }, SIDES, 0), 1, materialOf(solid.opacity)));
    if (this.shapes.length) scene.add(...this.shapes.map(({ mesh }) => mesh));
    this.ends = new Float32Array(3 * run.agents);
  }

  /** Place every obstacle, and add an arrow to each agent that the filter restrains, from what restrains it. */
  draw(t, lines, positions, colour, lit, shown, metres) {
    const { run, places, ends } = this;
    if (!run.series.cause) return;
    run.at("obstacle", t, places);
    this.shapes.forEach((shape, n) => {
      shape.add(n, this.matrix.makeTranslation(places[3 * n], places[3 * n + 1], places[3 * n + 2]), PAINT, true);
      shape.finish();
    });
    if (!shown) return;
    const [k] = run.locate(t);
    run.at("kept_from", t, ends);
    for (let i = 0; i < run.agents; i++) {
      if (!run.keptFrom(k, i) || Number.isNaN(ends[3 * i])) continue;
      const agent = positions.subarray(3 * i, 3 * i + 3);
      const cause = ends.subarray(3 * i, 3 * i + 3);
      const length = Math.hypot(...cause.map((x, n) => x - agent[n]));
      const at = (part) => agent.map((x, n) => x + part * (cause[n] - x));
      lines.add(...agent, ...cause, colour, 0.95, i === lit ? 4 : 2.5);
      lines.add(...at(Math.min(TIP + (HEAD[0] * metres) / Math.max(length, 1e-9), 0.8)), ...at(TIP), colour, 0.95, HEAD[1], 0, 0.95, 0);
    }
  }
}
