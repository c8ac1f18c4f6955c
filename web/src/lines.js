// Straight lines of a width in pixels, all in one draw call: WebGL's own are one pixel wide. Every line is a rectangle
// of its own, not an instance of one: where a processor draws, an instance costs as much as a hundred triangles.

import * as THREE from "three";

const SLOTS = 6; // numbers of a corner: both ends
const WIDTH_STEPS = 16; // in a pixel
const DASH_STEPS = 8;

const VERTEX = `
attribute vec3 start; attribute vec3 end; attribute vec4 colour; attribute vec4 style;
uniform vec2 size; varying vec4 shade; varying float along; varying float dash;
void main() {
  vec4 p = projectionMatrix * viewMatrix * vec4(start, 1.0);
  vec4 q = projectionMatrix * viewMatrix * vec4(end, 1.0);
  float near = 0.01;
  bool behind = p.w < near && q.w < near;
  if (p.w < near && q.w > near) p = mix(q, p, (q.w - near) / (q.w - p.w));
  else if (q.w < near && p.w > near) q = mix(p, q, (p.w - near) / (p.w - q.w));
  vec2 way = (q.xy / q.w - p.xy / p.w) * size * 0.5;
  float far = length(way);
  vec2 unit = far > 0.0 ? way / far : vec2(1.0, 0.0);
  float last = mod(style.x, 2.0);  // which end this corner is at, and on which side
  float side = style.x < 2.0 ? -1.0 : 1.0;
  vec4 c = last > 0.5 ? q : p;
  c.xy += vec2(-unit.y, unit.x) * side * (mix(style.y, style.w, last) / ${WIDTH_STEPS}.0) / size * c.w;
  shade = colour;
  along = last * far;
  dash = style.z / ${DASH_STEPS}.0;
  gl_Position = behind ? vec4(2.0, 2.0, 2.0, 1.0) : c;
}`;

const FRAGMENT = `
varying vec4 shade; varying float along; varying float dash;
void main() {
  if (dash > 0.0 && mod(along, 2.0 * dash) > dash) discard;
  gl_FragColor = shade;
}`;

export class Lines {
  /** Room for so many lines; more are left out. */
  constructor(room) {
    this.room = Math.max(room, 1);
    this.count = 0;
    this.floats = new Float32Array(this.room * 4 * SLOTS);
    const geometry = new THREE.BufferGeometry();
    this.ends = new THREE.InterleavedBuffer(this.floats, SLOTS).setUsage(THREE.DynamicDrawUsage);
    this.looks = new THREE.InterleavedBuffer(new Uint8Array(this.room * 4 * 8), 8).setUsage(THREE.DynamicDrawUsage);
    this.look = this.looks.array;
    geometry.setAttribute("start", new THREE.InterleavedBufferAttribute(this.ends, 3, 0));
    geometry.setAttribute("end", new THREE.InterleavedBufferAttribute(this.ends, 3, 3));
    geometry.setAttribute("colour", new THREE.InterleavedBufferAttribute(this.looks, 4, 0, true));
    geometry.setAttribute("style", new THREE.InterleavedBufferAttribute(this.looks, 4, 4, false));
    const index = new Uint32Array(this.room * 6);
    for (let i = 0; i < this.room; i++) index.set([4 * i, 4 * i + 1, 4 * i + 3, 4 * i, 4 * i + 3, 4 * i + 2], 6 * i);
    geometry.setIndex(new THREE.BufferAttribute(index, 1));
    this.material = new THREE.ShaderMaterial({
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      uniforms: { size: { value: new THREE.Vector2(1, 1) } },
      transparent: true,
      depthWrite: false,
    });
    this.mesh = new THREE.Mesh(geometry, this.material);
    this.mesh.frustumCulled = false;
    this.geometry = geometry;
  }

  clear() {
    this.count = 0;
  }

  /** Add a line: its ends, a colour in linear light, opacity, width and dash in pixels, the last end's opacity and width. */
  add(ax, ay, az, bx, by, bz, colour, opacity, width, dash = 0, last = opacity, tip = width) {
    if (this.count >= this.room || Number.isNaN(ax + ay + az + bx + by + bz)) return;
    const { floats, look } = this;
    const [r, g, b] = bytesOf(colour);
    const corner = 4 * this.count++;
    for (let n = 0; n < 4; n++) {
      const i = (corner + n) * SLOTS;
      floats[i] = ax; floats[i + 1] = ay; floats[i + 2] = az;
      floats[i + 3] = bx; floats[i + 4] = by; floats[i + 5] = bz;
      const j = (corner + n) * 8;
      look[j] = r; look[j + 1] = g; look[j + 2] = b;
      look[j + 3] = 255 * (n & 1 ? last : opacity);
      look[j + 4] = n; look[j + 5] = Math.min(width * WIDTH_STEPS, 255); look[j + 6] = Math.min(dash * DASH_STEPS, 255);
      look[j + 7] = Math.min(tip * WIDTH_STEPS, 255);
    }
  }

  /** Hand over to the graphics card what was added, for a picture of so many pixels. */
  finish(width, height) {
    this.material.uniforms.size.value.set(width, height);
    this.geometry.setDrawRange(0, 6 * this.count);
    this.mesh.visible = this.count > 0;
    for (const buffer of [this.ends, this.looks]) {
      buffer.clearUpdateRanges();
      buffer.addUpdateRange(0, 4 * this.count * buffer.stride);
      buffer.needsUpdate = true;
    }
  }
}

const known = new WeakMap();

/** A colour as it is shown, three bytes; those of colours that do not change are kept. */
function bytesOf(colour) {
  let found = known.get(colour);
  if (!found || found.r !== colour.r || found.g !== colour.g || found.b !== colour.b) {
    const hex = colour.getHex();
    found = Object.assign([hex >> 16, (hex >> 8) & 255, hex & 255], { r: colour.r, g: colour.g, b: colour.b });
    known.set(colour, found);
  }
  return found;
}
