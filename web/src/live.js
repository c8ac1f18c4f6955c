// A run in progress: samples arrive over a websocket, and what the viewer does is sent back. The Python beside this is
// mjsheaf/live.

import { Clock } from "./clock.js";
import { digits } from "./data.js";
import { make, nameRun, rangeInWords } from "./facts.js";

const MOST_VALUES = 600_000; // of the widest array that is kept; of more every second sample is dropped
const CURVES = 300; // ms between two drawings of the curves
const SMOOTH = 0.06; // s in which the picture follows the newest sample
const SLOW = 0.03; // s: where a picture takes longer, there is one for each frame, because the processor draws
const GAINS = 200; // steps of the slider of gains
const MOST_FLOW = 3; // on its slider, in the scenario's flow
const FLOWS = 20; // steps of that slider in the scenario's flow
const LAST = 5; // changes that are listed

/** The clock of a run in progress: it follows the newest sample, unless the viewer goes back. */
export class LiveClock extends Clock {
  constructor(run) {
    super(run);
    this.speeds = [...run.said.live.speeds, Infinity];
    this.speed = 1;
    this.follow = true;
    this.paused = false;
    this.drawn = false; // a picture was drawn since the last call of advance
    this.slow = false;
    this.send = () => {};
  }

  get playing() {
    return this.follow && !this.paused;
  }

  set playing(_) {} // as of a replay: the run goes on

  seek(t) {
    this.follow = t >= this.run.end;
    super.seek(t);
    this.dispatchEvent(new Event("state"));
  }

  /** Go back to the newest sample. */
  catchUp() {
    this.seek(this.run.end);
  }

  toggle() {
    if (this.follow) this.send({ pause: !this.paused });
    else this.catchUp();
  }

  pause() {} // a viewer who looks back does not stop the run

  setSpeed(speed) {
    this.send({ speed: Number.isFinite(speed) ? speed : null });
  }

  change(step) {
    const k = this.speeds.indexOf(this.speed) + step;
    if (this.speeds[k] !== undefined) this.setSpeed(this.speeds[k]);
  }

  advance(seconds) {
    if (this.drawn) this.slow = seconds > SLOW;
    this.drawn = this.follow && this.t < this.run.end;
    if (!this.drawn) return;
    const left = this.slow ? 0 : (this.run.end - this.t) * Math.exp(-seconds / SMOOTH);
    this.t = left < 1e-4 ? this.run.end : this.run.end - left;
    this.dispatchEvent(new Event("time"));
  }
}

/** Append a frame to a run: the time, then one row of each array, as mjsheaf/live/frames.py has them. */
function append(run, buffer) {
  const t = new DataView(buffer).getFloat64(0, true);
  if (t <= run.end) return false;
  const values = new Float32Array(buffer.slice(8));
  if (run.time.length >= run.room) thin(run);
  const row = run.time.length;
  let at = 0;
  for (const name of Object.keys(run.said.arrays)) {
    const width = run.columns(name);
    if (run.series[name].length < (row + 1) * width) run.series[name] = grown(run.series[name], row * width, run.room * width);
    run.series[name].set(values.subarray(at, at + width), row * width);
    at += width;
  }
  run.said.time.push(t);
  run.time = Float64Array.from(run.said.time);
  run.end = t;
  return true;
}

function grown(values, used, size) {
  const found = new Float32Array(size);
  found.set(values.subarray(0, used));
  return found;
}

/** Keep every second sample. */
function thin(run) {
  const kept = run.said.time.map((_, k) => k).filter((k) => k % 2 === 0);
  for (const name of Object.keys(run.said.arrays)) {
    const width = run.columns(name);
    kept.forEach((k, row) => run.series[name].copyWithin(row * width, k * width, (k + 1) * width));
  }
  run.said.time = kept.map((k) => run.said.time[k]);
  run.time = Float64Array.from(run.said.time);
}

/** Join a page to its run. */
export function goLive(run, clock, world, curves, controls) {
  const { live } = run.said;
  const widest = Math.max(...Object.keys(run.said.arrays).map((name) => run.columns(name)));
  run.room = Math.max(Math.min(4000, Math.floor(MOST_VALUES / widest)), 2 * run.time.length);
  const token = new URLSearchParams(location.search).get("token");
  const socket = new WebSocket(`${live.address}?token=${encodeURIComponent(token)}`);
  socket.binaryType = "arraybuffer";
  const send = (action) => socket.readyState === WebSocket.OPEN && socket.send(JSON.stringify(action));
  clock.send = send;
  const panel = new Panel(run, clock, send);
  let drawn = 0;
  socket.addEventListener("message", ({ data }) => {
    if (typeof data === "string") {
      panel.show(JSON.parse(data));
      controls.mark();
      world?.flowChanged();
    } else if (append(run, data)) {
      world?.extend();
      if (performance.now() - drawn > CURVES) {
        drawn = performance.now();
        curves.extend();
        rescale(world);
      }
    }
    controls.show();
  });
  let seen = false;
  socket.addEventListener("open", () => (seen = true));
  socket.addEventListener("close", () => {
    curves.extend();
    panel.disconnect(seen);
  });
  return panel;
}

/** Fit the colours of links to the run so far. */
function rescale(world) {
  if (!world?.rangeSaid) return;
  world.rescale();
  world.rangeSaid.textContent = rangeInWords(world);
}

/** The controls of the run, and what was done. */
class Panel {
  constructor(run, clock, send) {
    Object.assign(this, { run, clock, send });
    const { live } = run.said;
    this.status = document.getElementById("worst");
    this.status.setAttribute("role", "status");
    this.problem = make("p", "bad");
    this.problem.setAttribute("role", "alert");
    this.done = make("ol");
    this.agent = select("Agent", live.agents.map((id) => [id, id]));
    this.link = select("Link", live.links.map((pair) => [JSON.stringify(pair), pair.join(" – ")]));
    const gain = new Slider("Gain", GAINS, {
      valueOf: (k) => +(live.gain * live.factor ** ((2 * k) / GAINS - 1)).toPrecision(4),
      placeOf: (x) => ((Math.log(x / live.gain) / Math.log(live.factor) + 1) * GAINS) / 2,
      words: (x) => `${digits(x)} 1/s`,
      changed: (x) => send({ gain: x }),
    });
    const flow = new Slider("Flow", MOST_FLOW * FLOWS, { valueOf: (k) => k / FLOWS, placeOf: (x) => x * FLOWS, words: (x) => `${digits(x)} ×`, changed: (x) => send({ flow: x }) });
    this.sliders = { gain, flow };
    this.limit = make("p", "limit");
    const rows = [gain.row, this.limit, live.flow ? flow.row : null];
    rows.push(make("div", "pick", make("label", "", "Agent ", this.agent), this.button("Lose", () => ({ lose: this.agent.value })), this.button("Join", () => ({ join: this.agent.value }))));
    if (live.links.length) rows.push(make("div", "pick", make("label", "", "Link ", this.link), this.button("Cut", () => ({ cut: JSON.parse(this.link.value) })), this.button("Restore", () => ({ restore: JSON.parse(this.link.value) }))));
    const body = make("details", "", make("summary", "", "Change the run"), ...rows, this.problem, make("b", "", "Done so far"), this.done);
    body.open = true;
    this.box = make("div", "panel", body);
    this.box.id = "live";
    document.getElementById("legend").after(this.box);
    this.show({ paused: false, ended: false, speed: 1, message: "", phases: [], absent: [], flow: [], done: [] });
  }

  button(text, action) {
    const button = make("button", "", text);
    button.addEventListener("click", () => this.send(action()));
    return button;
  }

  /** Choose an agent that is lit up. */
  choose(vehicle) {
    if (vehicle >= 0 && vehicle < this.run.agents) this.agent.value = this.run.names[vehicle];
  }

  /** Show the state of the run, as mjsheaf/live/live.py has it. */
  show(state) {
    const { run, clock } = this;
    this.state = state;
    clock.paused = state.paused || state.ended;
    clock.speed = state.speed ?? Infinity;
    clock.dispatchEvent(new Event("state"));
    run.events = state.phases;
    run.said.phases = state.phases;
    for (const flow of run.said.flow) {
      flow.first ??= flow.changes;
      const scaled = ({ time, factor }) => ({ time, velocity: flow.velocity.map((w) => w.map((x) => factor * x)) });
      flow.changes = [...flow.first, ...state.flow.map(scaled)].sort((a, b) => a.time - b.time);
    }
    this.problem.textContent = state.message;
    const nothing = state.done.length ? state.done : ["nothing yet"];
    this.done.replaceChildren(...nothing.slice(-LAST).map((words) => make("li", "", make("bdi", "", words))));
    for (const option of this.agent.options) option.textContent = option.value + (state.absent.includes(option.value) ? " (lost)" : "");
    const gain = state.gain ?? run.said.live.gain;
    this.sliders.gain.show(gain);
    this.sliders.gain.mark(state.stable_gain);
    const known = Number.isFinite(state.stable_gain);
    this.limit.textContent = known ? `${gain < state.stable_gain ? "stable below" : "unstable from"} ${digits(state.stable_gain)} 1/s${gain < state.stable_gain ? "" : " on"}` : "";
    this.limit.classList.toggle("bad", known && gain >= state.stable_gain);
    if (state.law) nameRun(run, state.law);
    this.sliders.flow.show(state.flow.at(-1)?.factor ?? 1);
    this.tell();
  }

  /** Say what the run does. */
  tell() {
    const { state } = this;
    const name = this.closed ? "Disconnected" : state.ended ? "Ended" : state.paused ? "Paused" : "Running";
    const words = this.closed ?? (state.ended ? "Close this page to end the server; what you did is recorded as a scenario." : `${state.paused ? "" : `until ${+this.run.said.live.end.toFixed(3)} s. `}Closing this page ends the run; what you do is recorded as events of a scenario.`);
    this.status.replaceChildren(make("strong", this.closed ? "bad" : "headline", name), ` ${words}`);
  }

  /** The server has gone, or refused the page. */
  disconnect(seen) {
    this.closed = seen ? "The run was ended." : "Another page controls this run, or it has ended.";
    this.clock.paused = true;
    for (const control of this.box.querySelectorAll("button, select, input")) control.disabled = true;
    this.clock.dispatchEvent(new Event("state"));
    this.tell();
  }
}

function select(name, options) {
  const made = document.createElement("select");
  made.setAttribute("aria-label", name);
  made.append(...options.map(([value, text]) => new Option(text, value)));
  return made;
}

/** A slider whose value is sent when it is let go. */
class Slider {
  constructor(name, most, { valueOf, placeOf, words, changed }) {
    Object.assign(this, { placeOf, words });
    this.input = Object.assign(document.createElement("input"), { type: "range", min: 0, max: most, step: 1 });
    this.input.setAttribute("aria-label", name);
    this.output = document.createElement("output");
    this.input.addEventListener("input", () => (this.output.textContent = words(valueOf(+this.input.value))));
    this.input.addEventListener("change", () => changed(valueOf(+this.input.value)));
    this.tick = Object.assign(make("i"), { hidden: true });
    this.row = make("label", "slider", make("span", "", name), make("div", "", this.input, this.tick), this.output);
  }

  /** Mark a value on the track; nothing where it is not known or not on it. */
  mark(value) {
    const fraction = this.placeOf(value) / this.input.max;
    this.tick.hidden = !(fraction >= 0 && fraction <= 1);
    this.tick.style.left = `calc(8px + ${fraction} * (100% - 16px))`; // where the middle of the thumb is
  }

  /** Show a value of the run. */
  show(value) {
    this.input.value = Math.round(this.placeOf(value));
    this.output.textContent = this.words(value);
  }
}
