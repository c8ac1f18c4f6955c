// The vehicles: their own shapes, every kind drawn at once for all its vehicles.

import * as THREE from "three";
import { mergeGeometries } from "three/addons/utils/BufferGeometryUtils.js";

// Of all vehicles as they are usually seen, small; a processor that draws them has time for fewer.
const MOST_TRIANGLES = { hardware: 300_000, software: 26_000 };
// Sides of round things, and the smallest solid that is drawn as a share of its vehicle; the finest that fits is used.
const DETAILS = [[20, 0], [12, 0.03], [8, 0.08], [6, 0.15], [5, 0.25], [4, 0.35], [3, 0.5]];
const NEAR_PIXELS = 90; // length on the screen from which a vehicle is drawn with everything it has,
const MOST_NEAR = 12; // as many as these
const LOST = new THREE.Color(-1, -1, -1);

// One light, at the corners of triangles: the standard material costs several times as much where nothing but a
// processor draws. `base` has the colour of a corner, and whether it is painted in the colour of the vehicle's group.
const VERTEX = `
attribute vec4 base; varying vec3 tint;
void main() {
  vec3 n = normalize(mat3(instanceMatrix) * normal);
  vec3 paint = instanceColor.r < 0.0 ? vec3(0.26, 0.28, 0.3) : mix(base.rgb, instanceColor, base.a);
  tint = paint * (0.66 + 0.3 * dot(n, vec3(-0.32, -0.48, 0.82)) + 0.18 * n.z);
  gl_Position = projectionMatrix * viewMatrix * instanceMatrix * vec4(position, 1.0);
}`;
const FRAGMENT = `
uniform float opacity; varying vec3 tint;
void main() {
  gl_FragColor = vec4(tint, opacity);
  #include <colorspace_fragment>
}`;

/** Of one kind: instances of its shape in one detail, of which the first few of `mesh.count` are drawn. */
export class Instances {
  constructor(geometry, room, material) {
    this.room = room;
    this.vehicles = new Array(room).fill(-1); // which one each instance shows, and how it is painted
    this.painted = new Array(room).fill(null);
    this.count = 0;
    this.mesh = new THREE.InstancedMesh(geometry, material, room);
    this.mesh.frustumCulled = false;
    this.mesh.instanceMatrix.setUsage(THREE.DynamicDrawUsage);
    for (let i = 0; i < room; i++) this.mesh.setColorAt(i, LOST);
  }

  add(vehicle, matrix, colour, here) {
    const i = this.count++;
    this.mesh.setMatrixAt(i, matrix);
    if (this.vehicles[i] === vehicle && this.painted[i] === here) return;
    this.mesh.setColorAt(i, here ? colour : LOST);
    this.mesh.instanceColor.needsUpdate = true;
    [this.vehicles[i], this.painted[i]] = [vehicle, here];
  }

  finish() {
    this.mesh.count = this.count;
    this.mesh.visible = this.count > 0;
    this.mesh.instanceMatrix.needsUpdate = true;
    this.count = 0;
  }
}

export class Bodies {
  constructor(run, software, opacity = 1) {
    const { kinds, kind } = run.said;
    this.run = run;
    const count = kinds.map((_, k) => kind.filter((own) => own === k).length);
    const most = MOST_TRIANGLES[software ? "software" : "hardware"];
    const material = materialOf(opacity);
    let built;
    for (const [sides, least] of DETAILS) {
      built = kinds.map((own) => shapeOf(own, sides, least));
      if (built.reduce((sum, shape, k) => sum + (count[k] * shape.index.count) / 3, 0) <= most) break;
    }
    this.usual = built.map((shape, k) => new Instances(shape, count[k], material));
    this.near = kinds.map((own, k) => new Instances(shapeOf(own, ...DETAILS[0]), Math.min(count[k], MOST_NEAR), material));
    this.group = new THREE.Group();
    this.group.add(...[...this.usual, ...this.near].map(({ mesh }) => mesh));
    this.groupColours = run.said.groups.map((group) => new THREE.Color(group.colour));
    this.colours = run.groupOf.map((g) => this.groupColours[g]);
    this.matrix = new THREE.Matrix4();
    this.turn = new THREE.Quaternion();
    this.at = new THREE.Vector3();
    this.size = new THREE.Vector3();
    this.ahead = new THREE.Vector3();
  }

  /**
   * Place every vehicle.
   *
   * positions: of the controlled points, V * 3; quaternions: w x y z, V * 4; scales: of each vehicle; present: of each
   * agent, or null for ghosts, which are all there; camera, and metres in a pixel at a distance of 1 m from it.
   */
  update(positions, quaternions, scales, present, camera, metres) {
    const { kind, kinds } = this.run.said;
    for (let v = 0; v < this.run.vehicles; v++) {
      const k = kind[v];
      const scale = Number.isNaN(positions[3 * v]) ? 0 : scales[v];
      this.turn.set(quaternions[4 * v + 1], quaternions[4 * v + 2], quaternions[4 * v + 3], quaternions[4 * v]).normalize();
      this.size.setScalar(scale);
      this.at.set(positions[3 * v] || 0, positions[3 * v + 1] || 0, positions[3 * v + 2] || 0);
      const pixels = (2 * kinds[k].radius * scale) / (metres * this.at.distanceTo(camera.position));
      // A boat is controlled at a point ahead of its origin, about which it is drawn larger.
      this.at.add(this.ahead.set(-kinds[k].ahead * scale, 0, 0).applyQuaternion(this.turn));
      this.matrix.compose(this.at, this.turn, this.size);
      const here = !present || v >= this.run.agents || present[v];
      const near = pixels > NEAR_PIXELS && this.near[k].count < this.near[k].room;
      (near ? this.near[k] : this.usual[k]).add(v, this.matrix, this.colours[v], here);
    }
    for (const instances of [...this.usual, ...this.near]) instances.finish();
  }
}

/** The material of all solids. */
export function materialOf(opacity) {
  const material = new THREE.ShaderMaterial({ vertexShader: VERTEX, fragmentShader: FRAGMENT, uniforms: { opacity: { value: opacity } } });
  return Object.assign(material, { transparent: opacity < 1, depthWrite: opacity === 1 });
}

/** The shape of a kind, in one piece. */
export function shapeOf(kind, sides, least) {
  const big = kind.solids.filter((solid) => extentOf(solid) >= least * kind.radius);
  const chosen = big.length || !kind.solids.length ? big : [kind.solids.reduce((a, b) => (extentOf(b) > extentOf(a) ? b : a))];
  const parts = chosen.map((solid) => {
    const geometry = geometryOf(solid, sides);
    geometry.applyQuaternion(new THREE.Quaternion(...solid.quaternion.slice(1), solid.quaternion[0]));
    geometry.translate(...solid.position);
    for (const name of Object.keys(geometry.attributes)) if (name !== "position" && name !== "normal") geometry.deleteAttribute(name);
    const colour = new THREE.Color().setRGB(...solid.colour, THREE.SRGBColorSpace);
    const base = new Float32Array(geometry.attributes.position.count * 4);
    for (let i = 0; i < base.length; i += 4) base.set([colour.r, colour.g, colour.b, solid.livery ? 1 : 0], i);
    geometry.setAttribute("base", new THREE.BufferAttribute(base, 4));
    return geometry;
  });
  // A vehicle without anything to see is a ball.
  return parts.length ? mergeGeometries(parts) : shapeOf({ radius: kind.radius, solids: [{ ...BALL, size: [kind.radius] }] }, sides, 0);
}

const BALL = { shape: "sphere", position: [0, 0, 0], quaternion: [1, 0, 0, 0], colour: [0.6, 0.6, 0.6], livery: true };

function extentOf({ shape, size }) {
  if (shape === "mesh") return Infinity;
  return shape === "capsule" || shape === "cylinder" ? size[0] + size[1] : Math.max(...size);
}

/** A solid at the origin, with MuJoCo's sizes: half lengths, along z. */
function geometryOf({ shape, size, vertices, faces }, sides) {
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
