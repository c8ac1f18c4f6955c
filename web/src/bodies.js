// The vehicles: their own shapes, every kind drawn at once for all its vehicles.

import * as THREE from "three";
import { mergeGeometries } from "three/addons/utils/BufferGeometryUtils.js";

const MOST_TRIANGLES = 140_000; // of all vehicles together: a machine without a graphics card draws these too
// Sides of round things, and the smallest solid that is drawn as a share of its vehicle; the finest that fits is used.
const DETAILS = [[20, 0], [12, 0], [8, 0.05], [6, 0.12], [5, 0.2], [4, 0.3], [4, 0.5]];
const LOST = new THREE.Color("#8b8f96");

export class Bodies {
  constructor(run) {
    const { kinds, kind } = run.said;
    this.run = run;
    const count = kinds.map((_, k) => kind.filter((own) => own === k).length);
    let built;
    for (const [sides, least] of DETAILS) {
      built = kinds.map((own) => shapesOf(own, sides, least));
      const triangles = built.reduce((sum, shapes, k) => sum + count[k] * trianglesOf(shapes), 0);
      if (triangles <= MOST_TRIANGLES) break;
    }
    this.group = new THREE.Group();
    this.meshes = kinds.map((_, k) =>
      Object.entries(built[k]).filter(([, geometry]) => geometry).map(([part, geometry]) => {
        const own = part === "livery" ? { color: 0xffffff } : { vertexColors: true };
        const mesh = new THREE.InstancedMesh(geometry, new THREE.MeshLambertMaterial(own), count[k]);
        mesh.frustumCulled = false;
        mesh.livery = part === "livery";
        mesh.instanceMatrix.setUsage(THREE.DynamicDrawUsage);
        this.group.add(mesh);
        return mesh;
      }),
    );
    const next = kinds.map(() => 0);
    this.place = kind.map((k) => next[k]++); // of each vehicle among those of its kind
    this.groupColours = run.said.groups.map((group) => new THREE.Color(group.colour));
    this.colours = run.groupOf.map((g) => this.groupColours[g]);
    this.shown = new Array(run.vehicles).fill(null); // whether each is painted as present
    this.matrix = new THREE.Matrix4();
    this.turn = new THREE.Quaternion();
    this.at = new THREE.Vector3();
    this.size = new THREE.Vector3();
    this.ahead = new THREE.Vector3();
  }

  /**
   * Place every vehicle.
   *
   * positions: of the controlled points, V * 3; quaternions: w x y z, V * 4; scales: of each kind; present: of each
   * agent, or null for ghosts, which are all there.
   */
  update(positions, quaternions, scales, present) {
    const { kind, kinds } = this.run.said;
    for (let v = 0; v < this.run.vehicles; v++) {
      const k = kind[v];
      const scale = Number.isNaN(positions[3 * v]) ? 0 : scales[k];
      this.turn.set(quaternions[4 * v + 1], quaternions[4 * v + 2], quaternions[4 * v + 3], quaternions[4 * v]).normalize();
      this.size.setScalar(scale);
      // A boat is controlled at a point ahead of its origin, about which it is drawn larger.
      this.ahead.set(-kinds[k].ahead * scale, 0, 0).applyQuaternion(this.turn);
      this.at.set(positions[3 * v] || 0, positions[3 * v + 1] || 0, positions[3 * v + 2] || 0).add(this.ahead);
      this.matrix.compose(this.at, this.turn, this.size);
      const here = !present || v >= this.run.agents || present[v];
      for (const mesh of this.meshes[k]) {
        mesh.setMatrixAt(this.place[v], this.matrix);
        if (this.shown[v] !== here) {
          mesh.setColorAt(this.place[v], here ? (mesh.livery ? this.colours[v] : WHITE) : LOST);
          mesh.instanceColor.needsUpdate = true;
        }
        mesh.instanceMatrix.needsUpdate = true;
      }
      this.shown[v] = here;
    }
  }
}

const WHITE = new THREE.Color(0xffffff);

function trianglesOf(shapes) {
  return Object.values(shapes).reduce((sum, geometry) => sum + (geometry ? geometry.index.count / 3 : 0), 0);
}

/** The geometry of a kind: what is painted in the group's colour, and the rest. */
function shapesOf(kind, sides, least) {
  const parts = { livery: [], fixed: [] };
  const big = kind.solids.filter((solid) => extentOf(solid) >= least * kind.radius);
  for (const solid of big.length ? big : kind.solids) {
    const geometry = shapeOf(solid, sides);
    geometry.applyQuaternion(new THREE.Quaternion(...solid.quaternion.slice(1), solid.quaternion[0]));
    geometry.translate(...solid.position);
    for (const name of Object.keys(geometry.attributes)) {
      if (name !== "position" && name !== "normal") geometry.deleteAttribute(name);
    }
    if (!solid.livery) {
      const colour = new THREE.Color().setRGB(...solid.colour, THREE.SRGBColorSpace);
      const colours = new Float32Array(geometry.attributes.position.count * 3);
      for (let i = 0; i < colours.length; i += 3) colour.toArray(colours, i);
      geometry.setAttribute("color", new THREE.BufferAttribute(colours, 3));
    }
    parts[solid.livery ? "livery" : "fixed"].push(geometry);
  }
  return Object.fromEntries(Object.entries(parts).map(([name, all]) => [name, all.length ? mergeGeometries(all) : null]));
}

function extentOf({ shape, size }) {
  if (shape === "mesh") return Infinity;
  return shape === "capsule" || shape === "cylinder" ? size[0] + size[1] : Math.max(...size);
}

/** A solid at the origin, with MuJoCo's sizes: half lengths, along z. */
function shapeOf({ shape, size, vertices, faces }, sides) {
  const rings = Math.max(3, sides >> 1);
  if (shape === "box") return new THREE.BoxGeometry(2 * size[0], 2 * size[1], 2 * size[2]);
  if (shape === "sphere") return new THREE.SphereGeometry(size[0], sides, rings);
  if (shape === "ellipsoid") return new THREE.SphereGeometry(1, sides, rings).scale(...size);
  if (shape === "cylinder") return new THREE.CylinderGeometry(size[0], size[0], 2 * size[1], sides).rotateX(Math.PI / 2);
  if (shape === "capsule") {
    const thin = sides <= 6; // its caps are then not seen
    const made = thin
      ? new THREE.CylinderGeometry(size[0], size[0], 2 * size[1], sides, 1)
      : new THREE.CapsuleGeometry(size[0], 2 * size[1], Math.max(2, sides >> 2), sides, 1);
    return made.rotateX(Math.PI / 2);
  }
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(bytes(vertices)), 3));
  geometry.setIndex(new THREE.BufferAttribute(new Uint32Array(bytes(faces)), 1));
  geometry.computeVertexNormals();
  return geometry;
}
