// Obstacles, and lines to what the filter keeps agents from. The Python beside this is mjsheaf/page/safety.py.

import * as THREE from "three";
import { Instances, materialOf, shapeOf } from "./bodies.js";

const SIDES = 24;
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

  /** Place every obstacle, and add a line from each agent that the filter restrains to what restrains it. */
  draw(t, lines, positions, colour, lit, shown) {
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
      lines.add(...positions.subarray(3 * i, 3 * i + 3), ...ends.subarray(3 * i, 3 * i + 3), colour, 0.95, i === lit ? 4.5 : 3);
    }
  }
}
