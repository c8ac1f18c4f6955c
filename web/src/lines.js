// Straight lines of a width in pixels, all in one draw call: WebGL's own are one pixel wide.

import * as THREE from "three";

const STRIDE = 16; // two ends, two colours with opacity, width, dash

const VERTEX = `
attribute vec3 start; attribute vec3 end; attribute vec4 first; attribute vec4 last; attribute vec2 style;
uniform vec2 size; varying vec4 colour; varying float along; varying float dash; varying float side;
void main() {
  vec4 p = projectionMatrix * viewMatrix * vec4(start, 1.0);
  vec4 q = projectionMatrix * viewMatrix * vec4(end, 1.0);
  float near = 0.01;
  if (p.w < near && q.w > near) p = mix(q, p, (q.w - near) / (q.w - p.w));
  else if (q.w < near && p.w > near) q = mix(p, q, (p.w - near) / (p.w - q.w));
  vec2 way = (q.xy / q.w - p.xy / p.w) * size * 0.5;
  float length_ = length(way);
  vec2 unit = length_ > 0.0 ? way / length_ : vec2(1.0, 0.0);
  vec4 c = mix(p, q, position.x);
  float wide = style.x + 1.0;  // a pixel for the soft edge
  c.xy += (vec2(-unit.y, unit.x) * position.y * wide) / size * c.w;
  colour = mix(first, last, position.x);
  along = position.x * length_;
  dash = style.y;
  side = position.y * wide;
  gl_Position = p.w < near && q.w < near ? vec4(2.0, 2.0, 2.0, 1.0) : c;
}`;

const FRAGMENT = `
varying vec4 colour; varying float along; varying float dash; varying float side;
void main() {
  if (dash > 0.0 && mod(along, 2.0 * dash) > dash) discard;
  gl_FragColor = colour;
  #include <colorspace_fragment>
}`;

export class Lines {
  /** Room for so many lines; more are left out. */
  constructor(room) {
    this.room = Math.max(room, 1);
    this.count = 0;
    this.array = new Float32Array(this.room * STRIDE);
    const geometry = new THREE.InstancedBufferGeometry();
    geometry.setAttribute("position", new THREE.Float32BufferAttribute([0, -1, 0, 1, -1, 0, 1, 1, 0, 0, 1, 0], 3));
    geometry.setIndex([0, 1, 2, 0, 2, 3]);
    this.buffer = new THREE.InstancedInterleavedBuffer(this.array, STRIDE).setUsage(THREE.DynamicDrawUsage);
    let offset = 0;
    for (const [name, width] of [["start", 3], ["end", 3], ["first", 4], ["last", 4], ["style", 2]]) {
      geometry.setAttribute(name, new THREE.InterleavedBufferAttribute(this.buffer, width, offset));
      offset += width;
    }
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

  /** Add a line from a to b, points; colours {r, g, b} in linear light, opacities at both ends, width and dash in pixels. */
  add(a, b, colour, opacity, width, dash = 0, last = opacity) {
    this.addNumbers(a.x, a.y, a.z, b.x, b.y, b.z, colour, opacity, width, dash, last);
  }

  addNumbers(ax, ay, az, bx, by, bz, colour, opacity, width, dash = 0, last = opacity) {
    if (this.count >= this.room || Number.isNaN(ax + ay + az + bx + by + bz)) return;
    const { array } = this;
    let i = this.count++ * STRIDE;
    array[i++] = ax; array[i++] = ay; array[i++] = az;
    array[i++] = bx; array[i++] = by; array[i++] = bz;
    array[i++] = colour.r; array[i++] = colour.g; array[i++] = colour.b; array[i++] = opacity;
    array[i++] = colour.r; array[i++] = colour.g; array[i++] = colour.b; array[i++] = last;
    array[i++] = width; array[i] = dash;
  }

  /** Hand over to the graphics card what was added. */
  finish(width, height, ratio) {
    this.material.uniforms.size.value.set(width / ratio, height / ratio);
    this.geometry.instanceCount = this.count;
    this.mesh.visible = this.count > 0;
    this.buffer.clearUpdateRanges();
    this.buffer.addUpdateRange(0, this.count * STRIDE);
    this.buffer.needsUpdate = true;
  }
}
