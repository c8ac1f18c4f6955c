// The scene: vehicles, where they should be, what joins them, where they were, the flow; the camera; what is written in it.

import * as THREE from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { Bodies } from "./bodies.js";
import { Ghosts } from "./ghosts.js";
import { Lines } from "./lines.js";
import { Obstacles } from "./obstacles.js";
import { Sea } from "./sea.js";
import { isSilent, nice } from "./data.js";

export const THEMES = {
  light: { sky: "#f4f7f9", water: "#cfe2ec", ground: "#e9e5d9", none: "#e6ebf0", grid: "#7d97a6", ink: "#17222b", low: "#3f6fb5", high: "#c2410c", kept: "#d6006e", quiet: "#9aa3ab", flow: [["#cdbb86", "#e0a020", "#c23a00"], ["#8fa6c9", "#6a35a5", "#c0109a"]] },
  dark: { sky: "#10161c", water: "#15303f", ground: "#262720", none: "#1a222a", grid: "#5f7b8b", ink: "#e6edf3", low: "#6ea3f0", high: "#ff8a3d", kept: "#ff4fa3", quiet: "#6d7780", flow: [["#6b6750", "#d9a73a", "#ff7a2e"], ["#3f5c8f", "#8a5ad6", "#ff5ad2"]] },
};
const VIEWS = { above: [-90, 89.9], side: [-90, 4] }; // azimuth and elevation of the eye, degrees
const MOST_LABELS = 60; // agents; the names of more would cover one another
const SLOWEST_ARROW = 0.03; // fraction of a scale of speeds
const TRAIL_PIECES = 9000; // in all
const MOST_BALLS = 200; // agents; of more the dotted line to its place is drawn without the ball at its end
const GHOST_PIXELS = 6; // radius of the ball where an agent should be
const FILL = 0.95; // share of the uncovered part of the picture that a view fills
const HEAD = [14, 11]; // length and width of the arrowhead of a link, pixels
const HEAD_AT = 0.65; // where its tip is on the link: vehicles may cover the end
const NEAR = 30; // pixels: what is pointed at

export class World extends EventTarget {
  constructor(run, clock, canvas, labels) {
    super();
    Object.assign(this, { run, clock, canvas, labels });
    this.layers = { links: true, goals: true, trails: true, names: true, stems: run.agents <= 100, larger: true, ghosts: true, safety: true };
    run.said.flow.forEach((_, n) => (this.layers[`flow${n}`] = true));
    this.lit = -1; // vehicle that is pointed at
    this.followed = ""; // "", "team" or the number of a vehicle
    this.dirty = true;
    this.positions = new Float32Array(run.vehicles * 3);
    this.quaternions = new Float32Array(run.vehicles * 4);
    this.goals = new Float32Array(run.agents * 3);
    this.residuals = new Float32Array(run.said.edges.length);
    this.present = new Array(run.agents).fill(true);
    this.screen = new Float32Array(run.vehicles * 2).fill(NaN); // in pixels of the page
    this.measure();
    this.software = drawsInSoftware();
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: !this.software, powerPreference: "high-performance" });
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(42, 1, 0.1, 1e5);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.screenSpacePanning = true;
    this.controls.zoomToCursor = true;
    this.controls.addEventListener("change", () => this.changed());
    this.controls.addEventListener("start", () => (this.touched = true));
    this.build();
    this.setTheme("light");
    this.pointing();
    new ResizeObserver(() => this.resize()).observe(canvas.parentElement);
    this.resize();
  }

  /** Something else is to be seen: draw again soon. */
  changed() {
    this.dirty = true;
    this.dispatchEvent(new Event("view"));
  }

  /** Where the run takes place: a box about present agents and targets, and how far apart vehicles usually are. */
  measure() {
    const { run } = this;
    const { centre, size } = run.said;
    const box = new THREE.Box3();
    const gaps = [];
    this.seen = []; // points that views show
    const thin = Math.max(1, Math.floor((run.vehicles * Math.min(run.time.length, 200)) / 4000));
    const p = new THREE.Vector3();
    const every = Math.max(1, Math.floor(run.time.length / 200));
    for (let k = 0; k < run.time.length; k += every) {
      for (let v = 0; v < run.vehicles; v++) {
        if (v < run.agents && !run.present(k, v)) continue;
        p.fromArray(run.series.position, (k * run.vehicles + v) * 3);
        if (Math.max(Math.abs(p.x - centre[0]), Math.abs(p.y - centre[1]), Math.abs(p.z - centre[2])) < 3 * size) {
          box.expandByPoint(p);
          if ((k / every + v) % thin < 1) this.seen.push(p.x, p.y, p.z);
        }
      }
    }
    for (const place of run.said.live?.ahead ?? []) {
      box.expandByPoint(p.fromArray(place));
      this.seen.push(...place);
    }
    if (box.isEmpty()) box.expandByPoint(p.fromArray(centre));
    if (!this.seen.length) this.seen.push(...centre);
    const last = run.time.length - 1;
    const some = Math.max(1, Math.floor(run.vehicles / 40));
    for (let v = 0; v < run.vehicles; v += some) {
      let near = Infinity;
      for (let w = 0; w < run.vehicles; w++) {
        const [a, b] = [(last * run.vehicles + v) * 3, (last * run.vehicles + w) * 3];
        const x = run.series.position;
        if (v !== w) near = Math.min(near, Math.hypot(x[a] - x[b], x[a + 1] - x[b + 1], x[a + 2] - x[b + 2]));
      }
      if (Number.isFinite(near)) gaps.push(near);
    }
    gaps.sort((a, b) => a - b);
    this.gap = gaps.length ? gaps[gaps.length >> 1] : Infinity;
    const radius = Math.max(...run.said.kind.map((k, v) => run.said.kinds[k].radius * run.said.scales[v]));
    this.largest = radius;
    box.expandByScalar(radius);
    this.box = box;
    this.extent = box.getSize(new THREE.Vector3()).length();
    this.floor = run.said.surface === "none" ? box.min.z : run.said.height;
  }

  /** The run has become longer: make room if somebody left what was seen so far. */
  extend() {
    const { box, run } = this;
    const p = new THREE.Vector3();
    const row = (run.time.length - 1) * run.vehicles;
    const outside = (v) => (v >= run.agents || run.present(run.time.length - 1, v)) && !box.containsPoint(p.fromArray(run.series.position, 3 * (row + v)));
    if (run.names.some((_, v) => outside(v))) {
      const grown = 1.1 * this.extent;
      this.measure();
      if (this.extent > grown) this.fit();
    }
    this.changed();
  }

  /** Fit the colours of links to the run so far. */
  rescale() {
    this.residualRange = rangeOf(this.run);
  }

  /** Lay the surface anew, and show everything unless the viewer has chosen what to see. */
  fit() {
    this.scene.remove(this.surface);
    this.surface.geometry.dispose();
    this.surface.material.dispose();
    this.surface = surfaceOf(this);
    this.scene.add(this.surface);
    this.surface.visible = !this.sea;
    this.setTheme(document.documentElement.dataset.theme ?? "light");
    this.labelGrid();
    if (!this.touched && this.followed === "") this.view("angle");
  }

  /** What the flow is has changed. */
  flowChanged() {
    this.flowsNow = null;
    this.changed();
  }

  build() {
    const { run, scene } = this;
    this.surface = surfaceOf(this);
    scene.add(this.surface);
    this.sea = run.said.seas.length ? new Sea(run, scene) : null;
    this.surface.visible = !this.sea;
    this.bodies = new Bodies(run, this.software);
    scene.add(this.bodies.group);
    this.ghosts = new Ghosts(run, this.software, scene);
    this.obstacles = new Obstacles(run, scene);
    const ball = new THREE.SphereGeometry(1, run.agents > 100 ? 6 : 14, run.agents > 100 ? 4 : 8);
    this.balls = new THREE.InstancedMesh(ball, new THREE.MeshBasicMaterial({ transparent: true, opacity: 0.5, depthWrite: false }), run.agents);
    this.balls.frustumCulled = false;
    for (let i = 0; i < run.agents; i++) this.balls.setColorAt(i, this.bodies.colours[i]);
    scene.add(this.balls);
    this.trailPieces = Math.max(4, Math.min(60, Math.floor(TRAIL_PIECES / run.vehicles)));
    this.joints = [];
    const edges = run.said.edges.length;
    this.lines = new Lines(2 * edges + run.vehicles * (2 + this.trailPieces + 2) + (4 + run.said.ghosts.length) * run.agents + 64);
    this.arrows = run.said.flow.map((flow) => new Lines(3 * flow.places.length)); // of each medium
    scene.add(this.lines.mesh, ...this.arrows.map(({ mesh }) => mesh));
    this.residualRange = rangeOf(run);
    this.makeLabels();
  }

  // ---- the camera ----

  /** The part of the picture that no panel covers: left, top, right and bottom, in pixels. */
  uncovered() {
    const { left: x, top: y } = this.canvas.getBoundingClientRect();
    const area = ([left, top, right, bottom]) => Math.max(right - left, 0) * Math.max(bottom - top, 0);
    let free = [0, 0, this.width, this.height];
    for (const panel of document.querySelectorAll("#views, #card, #live")) {
      const box = panel.getBoundingClientRect();
      const cuts = [[0, box.right - x], [1, box.bottom - y], [2, box.left - x], [3, box.top - y]].map(([side, at]) => free.with(side, at));
      const meets = box.right - x > free[0] && box.bottom - y > free[1] && box.left - x < free[2] && box.top - y < free[3];
      if (meets && box.width) free = cuts.reduce((best, cut) => (area(cut) > area(best) ? cut : best));
    }
    return free;
  }

  /** Look from "angle", "above" or "side", at everything. */
  view(name) {
    const [azimuth, elevation] = (VIEWS[name] ?? this.run.said.view).map((angle) => (angle * Math.PI) / 180);
    const way = new THREE.Vector3(Math.cos(elevation) * Math.cos(azimuth), Math.cos(elevation) * Math.sin(azimuth), Math.sin(elevation));
    const { camera } = this;
    const target = this.box.getCenter(new THREE.Vector3());
    const tan = Math.tan((camera.fov * Math.PI) / 360);
    let distance = 2 * this.extent;
    const [left, top, right, bottom] = this.uncovered();
    const middle = new THREE.Vector2((left + right) / this.width - 1, 1 - (top + bottom) / this.height);
    // What the camera looks at is in the middle of what is not covered.
    camera.setViewOffset(this.width, this.height, (-middle.x * this.width) / 2, (middle.y * this.height) / 2, this.width, this.height);
    const p = new THREE.Vector3();
    for (let round = 0; round < 12; round++) {
      // Move and zoom until all that is ever seen fills the picture.
      camera.position.copy(target).addScaledVector(way, distance);
      camera.lookAt(target);
      [camera.near, camera.far] = [distance / 1000, distance * 10];
      camera.updateProjectionMatrix();
      camera.updateMatrixWorld();
      const [low, high] = [new THREE.Vector2(Infinity, Infinity), new THREE.Vector2(-Infinity, -Infinity)];
      for (let i = 0; i < this.seen.length; i += 3) {
        p.fromArray(this.seen, i).project(camera);
        low.min(p);
        high.max(p);
      }
      const { elements } = camera.matrixWorld;
      const [across, up] = [0, 4].map((at) => new THREE.Vector3(elements[at], elements[at + 1], elements[at + 2]));
      target.addScaledVector(across, ((low.x + high.x) / 2 - middle.x) * distance * tan * camera.aspect);
      target.addScaledVector(up, ((low.y + high.y) / 2 - middle.y) * distance * tan);
      const own = (2 * this.largest) / (distance * tan); // what the vehicles at the ends take themselves
      const filled = Math.max(((high.x - low.x + own / camera.aspect) * this.width) / (right - left), ((high.y - low.y + own) * this.height) / (bottom - top));
      distance *= Math.min(Math.max(filled, 1e-3) / 2 / FILL, 3);
      distance = Math.max(distance, 4 * this.largest);
    }
    this.controls.target.copy(target);
    camera.position.copy(target).addScaledVector(way, distance);
    this.controls.update();
    this.anchor = null;
    this.touched = name !== "angle";
    this.changed();
  }

  /** Six numbers for the address: where the camera is and what it looks at. */
  get place() {
    return [...this.camera.position.toArray(), ...this.controls.target.toArray()].map((x) => +x.toFixed(2)).join(",");
  }

  set place(text) {
    const numbers = String(text).split(",").map(Number);
    if (numbers.length !== 6 || !numbers.every(Number.isFinite)) return;
    this.touched = true;
    this.camera.position.fromArray(numbers);
    this.controls.target.fromArray(numbers, 3);
    this.controls.update();
    this.changed();
  }

  /** Keep a vehicle (its number), the "team" or nobody ("") where it is in the picture; a vehicle is first looked at. */
  follow(whom, near = true) {
    this.followed = whom;
    this.anchor = null;
    if (whom !== "" && near) {
      this.read();
      const at = this.middle();
      const way = this.camera.position.clone().sub(this.controls.target).normalize();
      const first = whom === "team" ? 0 : whom;
      const radius = this.run.said.kinds[this.run.said.kind[first]].radius * (this.scales?.[first] ?? 1);
      const distance = whom === "team" ? this.camera.position.distanceTo(this.controls.target) : Math.max(radius * 10, Math.min(this.gap, this.extent) * 1.1);
      this.controls.target.copy(at);
      this.camera.position.copy(at).addScaledVector(way, distance);
      this.controls.update();
    }
    this.changed();
  }

  /** Where what is followed is now. */
  middle() {
    const at = new THREE.Vector3();
    if (this.followed !== "team") return at.fromArray(this.positions, 3 * this.followed);
    let count = 0;
    for (let i = 0; i < this.run.agents; i++) {
      if (!this.present[i] || Number.isNaN(this.positions[3 * i])) continue;
      at.x += this.positions[3 * i]; at.y += this.positions[3 * i + 1]; at.z += this.positions[3 * i + 2];
      count++;
    }
    return at.divideScalar(Math.max(count, 1));
  }

  /** Turn by degrees, zoom by a factor, or move by shares of the picture. */
  turn(azimuth, elevation) {
    this.touched = true;
    const offset = this.camera.position.clone().sub(this.controls.target);
    const sphere = new THREE.Spherical().setFromVector3(new THREE.Vector3(offset.x, offset.z, -offset.y));
    sphere.theta += (azimuth * Math.PI) / 180;
    sphere.phi = Math.min(Math.max(sphere.phi - (elevation * Math.PI) / 180, 0.002), Math.PI - 0.002);
    const turned = new THREE.Vector3().setFromSpherical(sphere);
    this.camera.position.copy(this.controls.target).add(new THREE.Vector3(turned.x, -turned.z, turned.y));
    this.controls.update();
    this.changed();
  }

  zoom(factor) {
    this.touched = true;
    this.camera.position.sub(this.controls.target).multiplyScalar(factor).add(this.controls.target);
    this.controls.update();
    this.changed();
  }

  pan(right, up) {
    this.touched = true;
    const distance = this.camera.position.distanceTo(this.controls.target);
    const { elements } = this.camera.matrix;
    const by = new THREE.Vector3(elements[0], elements[1], elements[2]).multiplyScalar(right * distance);
    by.add(new THREE.Vector3(elements[4], elements[5], elements[6]).multiplyScalar(up * distance));
    this.camera.position.add(by);
    this.controls.target.add(by);
    this.controls.update();
    this.changed();
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement;
    if (!width || !height) return;
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    [this.width, this.height] = [width, height];
    if (!this.touched && this.followed === "") this.view("angle");
    this.changed();
  }

  // ---- colours ----

  setTheme(name) {
    const theme = THEMES[name];
    this.theme = Object.fromEntries(Object.entries(theme).map(([key, code]) => [key, key === "flow" ? code.map(gradient) : new THREE.Color(code)]));
    this.scene.background = this.theme.sky;
    const { uniforms } = this.surface.material;
    uniforms.colour.value = this.theme[this.run.said.surface];
    uniforms.grid.value = this.theme.grid;
    uniforms.sky.value = this.theme.sky;
    this.sea?.setTheme(name, this.theme.sky);
    this.flowsNow = null; // arrows are drawn in other colours
    this.changed();
  }

  /** How far a residual is along the scale of colours, 0 to 1: logarithmic. */
  share(residual) {
    const [low, high] = this.residualRange;
    return Math.min(Math.max(Math.log(Math.max(residual, 1e-12) / low) / Math.log(high / low), 0), 1);
  }

  // ---- each moment ----

  read() {
    const { run, clock } = this;
    run.at("position", clock.t, this.positions);
    run.at("quaternion", clock.t, this.quaternions);
    run.at("q_star", clock.t, this.goals);
    const [k, share] = run.locate(clock.t);
    for (let i = 0; i < run.agents; i++) this.present[i] = run.present(k, i);
    if (this.residuals.length) this.residuals.set(run.series.residual.subarray(k * this.residuals.length, (k + 1) * this.residuals.length));
    this.worst = run.worst(share > 0.5 ? Math.min(k + 1, run.time.length - 1) : k);
  }

  /** Draw, if anything has changed. Returns whether it did. */
  draw() {
    if (!this.dirty || !this.width) return false;
    this.dirty = false;
    this.read();
    if (this.followed !== "") {
      const now = this.middle();
      if (this.anchor && Number.isFinite(now.x)) {
        const by = now.clone().sub(this.anchor);
        this.camera.position.add(by);
        this.controls.target.add(by);
        this.camera.updateMatrixWorld();
      }
      if (Number.isFinite(now.x)) this.anchor = now;
    }
    const distance = this.camera.position.distanceTo(this.controls.target);
    this.camera.near = distance / 200;
    this.camera.far = distance * 4 + 12 * this.extent;
    this.camera.updateProjectionMatrix();
    this.camera.updateMatrixWorld();
    const metres = (2 * Math.tan((this.camera.fov * Math.PI) / 360) * distance) / this.height; // in a pixel
    this.metres = metres;
    this.scales = this.run.said.scales.map((scale) => (this.layers.larger ? scale : 1));
    const unit = metres / distance;
    this.sea?.update(this.clock.t, this.controls.target, distance);
    this.bodies.update(this.positions, this.quaternions, this.scales, this.present, this.camera, unit);
    this.drawGoals(metres);
    this.drawLines(metres, unit);
    if (this.readFlow()) this.drawFlow();
    this.arrows.forEach((arrows, n) => {
      arrows.finish(this.width, this.height);
      arrows.mesh.visible = this.layers[`flow${n}`];
    });
    this.renderer.render(this.scene, this.camera);
    this.writeLabels();
    return true;
  }

  drawGoals(metres) {
    const { run, balls } = this;
    balls.visible = this.layers.goals && run.agents <= MOST_BALLS;
    if (!balls.visible) return;
    const matrix = new THREE.Matrix4();
    const radius = metres * GHOST_PIXELS * Math.min(1, Math.sqrt(60 / run.agents));
    for (let i = 0; i < run.agents; i++) {
      const size = this.present[i] && !Number.isNaN(this.goals[3 * i]) ? radius * (i === this.lit ? 1.6 : 1) : 0;
      matrix.makeScale(size, size, size).setPosition(this.goals[3 * i] || 0, this.goals[3 * i + 1] || 0, this.goals[3 * i + 2] || 0);
      balls.setMatrixAt(i, matrix);
    }
    balls.instanceMatrix.needsUpdate = true;
  }

  drawLines(metres, unit) {
    const { run, lines, positions: p, goals: g, theme, layers } = this;
    lines.clear();
    const some = run.agents <= MOST_LABELS;
    if (layers.trails) this.drawTrails(some ? 2 : 1.2);
    const colour = new THREE.Color();
    if (layers.links) {
      run.said.edges.forEach(({ tail, head, kind, numbers, directed }, e) => {
        const residual = this.residuals[e];
        if (Number.isNaN(residual)) return;
        const silent = isSilent(residual);
        const share = this.share(residual);
        if (silent) colour.copy(theme.quiet);
        else colour.copy(theme.low).lerp(theme.high, share);
        const lit = tail === this.lit || head === this.lit;
        const plain = some ? 0.55 : kind === "sensing" ? 0.06 : 0.16; // many lines to one target would hide the rest
        const strength = lit ? 1 : silent ? 0.5 * plain : plain * (1 + 0.7 * share);
        // The more numbers an edge compares, the wider it is.
        const width = ((lit ? 3 : some ? 1.6 : 0.7) + (silent ? 0 : share * (some ? 1.2 : 0.6))) * (0.55 + 0.15 * Math.min(numbers, 3));
        lines.add(p[3 * tail], p[3 * tail + 1], p[3 * tail + 2], p[3 * head], p[3 * head + 1], p[3 * head + 2], colour, strength, width, kind === "sensing" ? 7 : silent ? 2.5 : 0);
        if (!directed || kind === "sensing") return;
        const at = (part) => [0, 1, 2].map((n) => p[3 * tail + n] + part * (p[3 * head + n] - p[3 * tail + n]));
        const long = Math.hypot(...at(1).map((x, n) => x - at(0)[n]));
        lines.add(...at(Math.max(HEAD_AT - (HEAD[0] * metres) / Math.max(long, 1e-9), 0.35)), ...at(HEAD_AT), colour, strength, some ? HEAD[1] : 0.5 * HEAD[1], 0, strength, 0);
      });
    }
    if (layers.goals) {
      for (let i = 0; i < run.agents; i++) {
        if (this.present[i]) lines.add(p[3 * i], p[3 * i + 1], p[3 * i + 2], g[3 * i], g[3 * i + 1], g[3 * i + 2], this.bodies.colours[i], 0.9, i === this.lit ? 3 : some ? 1.6 : 0.8, 3);
      }
    }
    this.ghosts.draw(this.clock.t, this.scales, this.camera, unit, lines, p, layers.ghosts, theme.ink);
    this.obstacles.draw(this.clock.t, lines, p, theme.kept, this.lit, layers.safety, metres);
    if (layers.stems && this.floor !== null) {
      for (let v = 0; v < run.vehicles; v++) {
        if (Math.abs(p[3 * v + 2] - this.floor) > 12 * metres) {
          lines.add(p[3 * v], p[3 * v + 1], p[3 * v + 2], p[3 * v], p[3 * v + 1], this.floor, theme.ink, some ? 0.3 : 0.1, 1);
        }
      }
    }
    const met = run.said.flow.findIndex(({ vehicles }) => vehicles.includes(this.lit));
    if (this.lit < run.agents && layers[`flow${met}`]) {
      const velocity = run.at("flow", this.clock.t, new Float32Array(3), 3 * this.lit, 3);
      const flow = run.said.flow[met];
      addArrow(lines, p.subarray(3 * this.lit, 3 * this.lit + 3), velocity, flow, theme.flow[flow.scale], 1, 3);
    }
    lines.finish(this.width, this.height);
  }

  /** Where every vehicle was; older pieces fade. Joints stand at multiples of one interval, not to shiver. */
  drawTrails(width) {
    const { run, clock, lines } = this;
    const trail = run.said.live ? run.said.trail : Math.min(run.said.trail, run.end - run.start);
    if (!(trail > 0)) return;
    const interval = trail / this.trailPieces;
    const first = Math.max(clock.t - trail, run.start);
    const times = [];
    for (let n = Math.floor(first / interval) + 1; n * interval < clock.t; n++) times.push(n * interval);
    const kept = this.joints;
    const known = new Map(kept.map((joint) => [joint.t, joint]));
    this.joints = times.map((t) => known.get(t) ?? { t, at: run.at("position", t, new Float32Array(run.vehicles * 3)) });
    let before = { t: first, at: run.at("position", first, new Float32Array(run.vehicles * 3)) };
    for (const joint of [...this.joints, { t: clock.t, at: this.positions }]) {
      const old = 0.75 * Math.max(0, 1 - (clock.t - before.t) / trail);
      const young = 0.75 * Math.max(0, 1 - (clock.t - joint.t) / trail);
      for (let v = 0; v < run.vehicles; v++) {
        const colour = v < run.agents && !this.present[v] ? this.theme.quiet : this.bodies.colours[v];
        const [a, b] = [before.at, joint.at];
        lines.add(a[3 * v], a[3 * v + 1], a[3 * v + 2], b[3 * v], b[3 * v + 1], b[3 * v + 2], colour, old, v === this.lit ? width + 1.5 : width, 0, young);
      }
      before = joint;
    }
  }

  /** Take the flow of this time; events may change it. Returns whether it is another than before. */
  readFlow() {
    const now = this.run.said.flow.map((flow) => flow.changes.findLast(({ time }) => time <= this.clock.t + 1e-9) ?? flow);
    const same = this.flowsNow?.every((flow, n) => flow === now[n]);
    this.flowsNow = now;
    return !same;
  }

  drawFlow() {
    this.run.said.flow.forEach((flow, n) => {
      this.arrows[n].clear();
      const { velocity } = this.flowsNow[n];
      flow.places.forEach((place, k) => addArrow(this.arrows[n], place, velocity[k], flow, this.theme.flow[flow.scale], 0.65, 1.6));
    });
  }

  /** How much larger than life vehicles are drawn, in words. */
  largerInWords() {
    const { larger } = this.run.said;
    if (!this.layers.larger || !larger.length) return "vehicles in their true size";
    return `drawn larger: ${larger.map(([scale, names]) => `${names.slice(0, MOST_LABELS).join(", ")} ×${scale}`).join("; ")}`;
  }

  // ---- what is written ----

  makeLabels() {
    const { run } = this;
    const few = run.agents <= MOST_LABELS;
    this.tags = new Map(); // vehicle to its label
    const make = (v) => {
      const tag = document.createElement("bdi");
      tag.textContent = run.names[v];
      tag.className = v < run.agents ? "agent" : "target";
      tag.style.setProperty("--own", run.said.groups[run.groupOf[v]].colour);
      this.labels.append(tag);
      this.tags.set(v, tag);
    };
    for (let v = few ? 0 : run.agents; v < Math.min(run.vehicles, run.agents + MOST_LABELS); v++) make(v);
    this.extra = few ? null : make; // the labels of many are made when they are wanted
    this.ring = document.createElement("div");
    this.ring.className = "ring";
    this.labels.append(this.ring);
    this.gridTags = [];
    this.labelGrid();
  }

  /** Write coordinates along two sides of the grid. */
  labelGrid() {
    const { run } = this;
    for (const { tag } of this.gridTags) tag.remove();
    this.gridTags = [];
    const step = nice(Math.max(this.box.max.x - this.box.min.x, this.box.max.y - this.box.min.y, 1e-3) / 4);
    this.gridStep = step;
    for (const axis of ["x", "y"]) {
      const [low, high] = [this.box.min[axis], this.box.max[axis]];
      for (let n = Math.ceil(low / step); n <= Math.floor(high / step); n++) {
        const tag = document.createElement("span");
        tag.className = "grid";
        const last = n === Math.floor(high / step);
        tag.textContent = `${last ? axis + " " : ""}${coordinate(n * step + run.said.origin["xy".indexOf(axis)], step)}${last ? " m" : ""}`;
        const at = axis === "x" ? [n * step, this.box.min.y, this.floor] : [this.box.max.x, n * step, this.floor];
        this.labels.append(tag);
        this.gridTags.push({ tag, at: new THREE.Vector3(...at) });
      }
    }
    this.surface.material.uniforms.step.value = step;
  }

  writeLabels() {
    const { run, screen } = this;
    const at = new THREE.Vector3();
    for (let v = 0; v < run.vehicles; v++) {
      at.fromArray(this.positions, 3 * v).project(this.camera);
      const shown = at.z < 1 && Math.abs(at.x) < 1.2 && Math.abs(at.y) < 1.2;
      screen[2 * v] = shown ? ((at.x + 1) / 2) * this.width : NaN;
      screen[2 * v + 1] = shown ? ((1 - at.y) / 2) * this.height : NaN;
    }
    if (this.extra) for (const v of [this.lit, this.worst]) if (v >= 0 && !this.tags.has(v)) this.extra(v);
    const taken = [];
    const order = [...this.tags.keys()].sort((v, w) => (w === this.lit) - (v === this.lit));
    for (const v of order) {
      const tag = this.tags.get(v);
      const [x, y] = [screen[2 * v], screen[2 * v + 1]];
      const wanted = this.layers.names && !Number.isNaN(x) && (!this.extra || v >= run.agents || v === this.lit || v === this.worst);
      tag.hidden = !wanted;
      if (!wanted) continue;
      tag.wide ??= tag.offsetWidth + 2;
      // Of four places about the vehicle the first that is free, the one that it had before all others.
      const places = [[9, -20], [9, 6], [-9 - tag.wide, -20], [-9 - tag.wide, 6]];
      const free = ([dx, dy]) => !taken.some(([a, b, wide]) => x + dx < a + wide && a < x + dx + tag.wide && Math.abs(y + dy - b) < 15);
      const tried = [tag.at ?? 0, 0, 1, 2, 3];
      const found = tried.find((n) => free(places[n]));
      // Names that would cover others are left out, but for that of the vehicle that is lit and those of targets.
      tag.hidden = found === undefined && v !== this.lit && v < run.agents;
      if (tag.hidden) continue;
      tag.at = found ?? tried[0];
      const [dx, dy] = places[tag.at];
      taken.push([x + dx, y + dy, tag.wide]);
      const transform = `translate(${(x + dx).toFixed(1)}px, ${(y + dy).toFixed(1)}px)`;
      if (tag.transform !== transform) tag.style.transform = tag.transform = transform;
      const name = `${v < run.agents ? "agent" : "target"}${v === this.lit ? " lit" : ""}${v < run.agents && !this.present[v] ? " lost" : ""}`;
      if (tag.className !== name) tag.className = name;
    }
    this.ring.hidden = this.lit < 0 || Number.isNaN(screen[2 * this.lit]);
    if (!this.ring.hidden) this.ring.style.transform = `translate(${screen[2 * this.lit]}px, ${screen[2 * this.lit + 1]}px)`;
    for (const { tag, at: place } of this.gridTags) {
      at.copy(place).project(this.camera);
      tag.hidden = at.z > 1 || Math.abs(at.x) > 1 || Math.abs(at.y) > 1;
      if (!tag.hidden) tag.style.transform = `translate(${(((at.x + 1) / 2) * this.width).toFixed(1)}px, ${(((1 - at.y) / 2) * this.height).toFixed(1)}px) translate(-50%, -50%)`;
    }
  }

  /** The vehicle at a place on the canvas, in pixels; -1 for none. */
  at(x, y) {
    let best = -1;
    let least = NEAR;
    for (let v = 0; v < this.run.vehicles; v++) {
      const away = Math.hypot(this.screen[2 * v] - x, this.screen[2 * v + 1] - y);
      if (away < least) [best, least] = [v, away];
    }
    return best;
  }

  pointing() {
    let pressed = null;
    const place = (event) => {
      const { left, top } = this.canvas.getBoundingClientRect();
      return [event.clientX - left, event.clientY - top];
    };
    const tell = (type, vehicle) => this.dispatchEvent(new CustomEvent(type, { detail: vehicle }));
    this.canvas.addEventListener("pointermove", (event) => {
      if (!event.buttons) tell("point", this.at(...place(event)));
    });
    this.canvas.addEventListener("pointerleave", () => tell("point", -1));
    this.canvas.addEventListener("pointerdown", (event) => (pressed = place(event)));
    this.canvas.addEventListener("pointerup", (event) => {
      const now = place(event);
      if (pressed && Math.hypot(now[0] - pressed[0], now[1] - pressed[1]) < 6) tell("choose", this.at(...now));
    });
    this.canvas.addEventListener("dblclick", (event) => tell("follow", this.at(...place(event))));
  }
}

/** Whether there is no graphics card: less is drawn then. */
function drawsInSoftware() {
  const gl = document.createElement("canvas").getContext("webgl2");
  const info = gl?.getExtension("WEBGL_debug_renderer_info");
  const name = info ? gl.getParameter(info.UNMASKED_RENDERER_WEBGL) : "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software|basic render/i.test(name);
}

/** A coordinate on a grid of a step, with the digits that tell it from its neighbours. */
function coordinate(x, step) {
  return String(+x.toFixed(Math.max(0, -Math.floor(Math.log10(step))))).replace("-", "−");
}

/** Add an arrow whose colour and length show a speed on the scale of its medium. */
function addArrow(lines, at, w, flow, shades, opacity, width) {
  const speed = Math.hypot(w[0], w[1], w[2]);
  if (!(speed > SLOWEST_ARROW * flow.top)) return;
  const fraction = Math.min(speed / flow.top, 1);
  const colour = shades[Math.round(fraction * (shades.length - 1))];
  const shown = 0.95 * fraction * flow.spacing;
  const [x, y, z] = [(w[0] / speed) * shown, (w[1] / speed) * shown, (w[2] / speed) * shown];
  const [ax, ay, az] = [at[0] - x / 2, at[1] - y / 2, at[2] - z / 2];
  const [bx, by, bz] = [ax + x, ay + y, az + z];
  lines.add(ax, ay, az, bx, by, bz, colour, 0.5 * opacity, width, 0, opacity);
  for (const side of [1, -1]) {
    lines.add(bx, by, bz, bx - 0.3 * x - side * 0.16 * y, by - 0.3 * y + side * 0.16 * x, bz - 0.3 * z, colour, opacity, width);
  }
}

/** Shades from the first colour to the last one. */
function gradient(codes) {
  const stops = codes.map((code) => new THREE.Color(code));
  return Array.from({ length: 33 }, (_, k) => {
    const at = (k / 32) * (stops.length - 1);
    const n = Math.min(Math.floor(at), stops.length - 2);
    return stops[n].clone().lerp(stops[n + 1], at - n);
  });
}

/** What residuals the colours span, m: at most two decades below what nearly all stay below. */
function rangeOf(run) {
  const found = [];
  const { residual } = run.series;
  for (let i = 0; i < residual.length; i += Math.max(1, Math.floor(residual.length / 20000))) {
    const x = Math.abs(residual[i]);
    if (Number.isFinite(x)) found.push(x);
  }
  found.sort((a, b) => a - b);
  const high = found[Math.floor(0.95 * (found.length - 1))] || 1;
  return [Math.max(found[Math.floor(0.05 * (found.length - 1))] || 0, high / 100), Math.max(high, 1e-9)].map(Number);
}

/** Water, ground or nothing, with a grid, that fades into the sky. */
function surfaceOf({ run, extent, box, floor }) {
  const centre = box.getCenter(new THREE.Vector3());
  const radius = 2.2 * extent;
  const material = new THREE.ShaderMaterial({
    uniforms: {
      colour: { value: new THREE.Color() }, grid: { value: new THREE.Color() }, sky: { value: new THREE.Color() },
      step: { value: 1 }, centre: { value: centre }, radius: { value: radius }, clear: { value: run.said.surface === "ground" ? 0.96 : 0.72 },
    },
    vertexShader: "varying vec2 place; void main() { vec4 p = modelMatrix * vec4(position, 1.0); place = p.xy; gl_Position = projectionMatrix * viewMatrix * p; }",
    fragmentShader: `
      uniform vec3 colour, grid, sky, centre; uniform float step, radius, clear; varying vec2 place;
      void main() {
        vec2 cell = place / step;
        vec2 away = abs(fract(cell - 0.5) - 0.5) / max(fwidth(cell), vec2(1e-6));
        float line = 1.0 - min(min(away.x, away.y), 1.0);
        float fade = 1.0 - smoothstep(0.25, 1.0, length(place - centre.xy) / radius);
        vec3 c = mix(colour, grid, 0.45 * line * fade);
        gl_FragColor = vec4(mix(sky, c, fade), clear * smoothstep(0.0, 0.3, fade));
        #include <colorspace_fragment>
      }`,
    transparent: true,
    depthWrite: false,
    side: THREE.DoubleSide,
  });
  const mesh = new THREE.Mesh(new THREE.CircleGeometry(radius, 48), material);
  mesh.position.set(centre.x, centre.y, floor);
  mesh.renderOrder = -1;
  return mesh;
}

