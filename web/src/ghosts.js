// Other runs: their agents, translucent, each run in its colour, or in those of the groups. The Python beside this is
// mjsheaf/page/page.py.

import * as THREE from "three";
import { Bodies } from "./bodies.js";

const OPACITY = 0.38;

export class Ghosts {
  constructor(run, software, scene) {
    this.run = run;
    this.runs = run.said.ghosts.map(({ colour }, k) => {
      const bodies = new Bodies(run, software, OPACITY);
      const tint = colour && new THREE.Color(colour);
      if (tint) bodies.colours = bodies.colours.map(() => tint);
      scene.add(bodies.group);
      return { k, bodies, tint, positions: new Float32Array(run.vehicles * 3), quaternions: new Float32Array(run.vehicles * 4) };
    });
  }

  /** Place the agents of every run as they are at a time, and join each to the page's own; `shown` is a layer. */
  draw(t, scales, camera, metres, lines, own, shown, ink) {
    for (const { k, bodies, tint, positions, quaternions } of this.runs) {
      bodies.group.visible = shown;
      if (!shown) continue;
      this.run.at(`ghost${k}`, t, positions);
      this.run.at(`ghost_quaternion${k}`, t, quaternions);
      bodies.update(positions, quaternions, scales, null, camera, metres);
      for (let v = 0; v < 3 * this.run.agents; v += 3) {
        if (!Number.isNaN(positions[v])) lines.add(own[v], own[v + 1], own[v + 2], positions[v], positions[v + 1], positions[v + 2], tint ?? ink, 0.7, 1.2);
      }
    }
  }
}
