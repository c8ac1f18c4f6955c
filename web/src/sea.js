// The sea of a run with waves: a lit surface over their elevation, out to the horizon. The Python beside this is
// mjsheaf/page/page.py; the video's is mjsheaf/video/sea.py.

import * as THREE from "three";

const POINTS = 141; // of the grid along x and along y
const REACH = 30; // from its middle to its edge, in distances of the camera
const GRADING = 6.5; // about exp(GRADING) is the ratio of the widest spacing to the finest
const SHORTEST = 1.5; // k times the spacing, in rad, from which on a wave fades
const HAZE = 12; // distances of the camera at which the water has nearly the colour of the sky
const SHADES = {
  light: { deep: "#0f4a6e", crest: "#5f9fb2", zenith: "#5585c2", sun: 0.5 },
  dark: { deep: "#06202f", crest: "#24586b", zenith: "#22405e", sun: 0.25 },
};

const VERTEX = `
attribute vec3 slope; varying vec3 place; varying vec3 up; varying float high;
void main() {
  vec4 p = modelMatrix * vec4(position, 1.0);
  place = p.xyz;
  up = vec3(-slope.x, -slope.y, 1.0);
  high = slope.z;
  gl_Position = projectionMatrix * viewMatrix * p;
}`;
const FRAGMENT = `
uniform vec3 deep, crest, zenith, sky; uniform float sun, distance; varying vec3 place; varying vec3 up; varying float high;
void main() {
  vec3 n = normalize(up);
  vec3 toEye = cameraPosition - place;
  float away = length(toEye);
  toEye /= away;
  float facing = clamp(dot(n, toEye), 0.0, 1.0);
  vec3 mirrored = 2.0 * facing * n - toEye;
  vec3 light = vec3(0.48, 0.36, 0.80);
  vec3 above = mix(sky, zenith, clamp(mirrored.z, 0.0, 1.0));
  vec3 water = mix(deep, crest, clamp(0.5 + high, 0.0, 1.0)) * (0.25 + 0.9 * clamp(dot(n, light), 0.0, 1.0));
  vec3 c = mix(water, above, 0.02 + 0.98 * pow(1.0 - facing, 5.0)) + sun * pow(clamp(dot(mirrored, light), 0.0, 1.0), 60.0);
  float haze = 1.0 - exp(-3.0 * pow(away / (${HAZE}.0 * distance), 2.0));
  gl_FragColor = vec4(mix(c, sky, haze), mix(0.88, 1.0, haze));
  #include <colorspace_fragment>
}`;

export class Sea {
  constructor(run, scene) {
    this.seas = run.said.seas.map((sea) => ({ ...sea, size: Math.max(2.83 * Math.hypot(...sea.waves.map(([amplitude]) => amplitude)), 1e-9) }));
    const geometry = new THREE.BufferGeometry();
    this.places = new Float32Array(3 * POINTS * POINTS);
    this.slopes = new Float32Array(3 * POINTS * POINTS);
    geometry.setAttribute("position", new THREE.BufferAttribute(this.places, 3).setUsage(THREE.DynamicDrawUsage));
    geometry.setAttribute("slope", new THREE.BufferAttribute(this.slopes, 3).setUsage(THREE.DynamicDrawUsage));
    const index = [];
    for (let i = 0; i < POINTS - 1; i++) {
      for (let j = 0; j < POINTS - 1; j++) {
        const a = i * POINTS + j;
        index.push(a, a + POINTS, a + 1, a + 1, a + POINTS, a + POINTS + 1);
      }
    }
    geometry.setIndex(index);
    this.material = new THREE.ShaderMaterial({
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      uniforms: Object.fromEntries(["deep", "crest", "zenith", "sky"].map((name) => [name, { value: new THREE.Color() }]).concat([["sun", { value: 0.5 }], ["distance", { value: 1 }]])),
      transparent: true, // what is under water shows through
      depthWrite: false,
      side: THREE.DoubleSide,
    });
    this.mesh = new THREE.Mesh(geometry, this.material);
    this.mesh.frustumCulled = false;
    this.mesh.renderOrder = -1;
    this.graded = Float64Array.from({ length: POINTS }, (_, k) => Math.sinh(GRADING * ((2 * k) / (POINTS - 1) - 1)) / Math.sinh(GRADING));
    scene.add(this.mesh);
  }

  setTheme(name, sky) {
    const { uniforms } = this.material;
    for (const key of ["deep", "crest", "zenith"]) uniforms[key].value.set(SHADES[name][key]);
    uniforms.sun.value = SHADES[name].sun;
    uniforms.sky.value.copy(sky);
  }

  /** The sea at a time: the last that has begun, or the first. */
  at(t) {
    return this.seas.findLast(({ time }) => time <= t + 1e-9) ?? this.seas[0];
  }

  /** Elevation, m, and slopes along x and y at a place and time. */
  elevation(x, y, t) {
    const found = [0, 0, 0];
    for (const [amplitude, kx, ky, rate, phase] of this.at(t).waves) {
      const angle = kx * x + ky * y - rate * t + phase;
      found[0] += amplitude * Math.cos(angle);
      found[1] -= amplitude * kx * Math.sin(angle);
      found[2] -= amplitude * ky * Math.sin(angle);
    }
    return found;
  }

  /** Move the surface to a time, about a place that the camera looks at from a distance. */
  update(t, centre, distance) {
    const sea = this.at(t);
    const { places, slopes, graded } = this;
    const reach = REACH * distance;
    const waves = sea.waves.map(([amplitude, kx, ky, rate, phase]) => {
      const along = (k, from) => wave(graded, k, from, reach);
      const [x, y] = [along(kx, centre.x), along(ky, centre.y)];
      const [re, im] = [amplitude * Math.cos(phase - rate * t), amplitude * Math.sin(phase - rate * t)];
      return { kx, ky, x, y, re, im };
    });
    for (let i = 0, n = 0; i < POINTS; i++) {
      const row = waves.map(({ x, re, im }) => [x.re[i] * re - x.im[i] * im, x.re[i] * im + x.im[i] * re]);
      for (let j = 0; j < POINTS; j++, n += 3) {
        let [high, sx, sy] = [0, 0, 0];
        for (let w = 0; w < waves.length; w++) {
          const { kx, ky, y } = waves[w];
          const [a, b] = row[w];
          high += a * y.re[j] - b * y.im[j];
          const sine = a * y.im[j] + b * y.re[j];
          sx -= kx * sine;
          sy -= ky * sine;
        }
        places[n] = centre.x + reach * graded[i];
        places[n + 1] = centre.y + reach * graded[j];
        places[n + 2] = sea.level + high;
        slopes[n] = sx; slopes[n + 1] = sy; slopes[n + 2] = high / sea.size;
      }
    }
    this.material.uniforms.distance.value = distance;
    this.mesh.geometry.attributes.position.needsUpdate = true;
    this.mesh.geometry.attributes.slope.needsUpdate = true;
  }
}

/** exp(i k x) on a graded grid, less where the grid is too coarse for the wave. */
function wave(graded, k, from, reach) {
  const [re, im] = [new Float64Array(POINTS), new Float64Array(POINTS)];
  for (let i = 0; i < POINTS; i++) {
    const spacing = (reach * (graded[Math.min(i + 1, POINTS - 1)] - graded[Math.max(i - 1, 0)])) / 2;
    const share = Math.exp(-(((k * spacing) / SHORTEST) ** 4));
    const angle = k * (from + reach * graded[i]);
    re[i] = share * Math.cos(angle);
    im[i] = share * Math.sin(angle);
  }
  return { re, im };
}
