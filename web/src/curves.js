// The curves: panels over time that share the clock, in which agents light up.

import uPlot from "uplot";
import { digits, legible } from "./data.js";

const MOST_LINES = 40; // agents with a line of their own; of more, the spread is drawn
const DECADES = 5; // most that a logarithmic axis shows
const HEIGHT = 104;
const NEAR = 0.85; // fraction of a limit that speeds reach where the limit is drawn
const TEAM = { rms: "RMS over agents", mean: "mean" };
const BOUNDS = ["#c2379b", "#d55e00"];

export class Curves extends EventTarget {
  constructor(run, clock, home) {
    super();
    Object.assign(this, { run, clock, home });
    this.lit = -1;
    this.all = [...run.said.agents.keys()];
    this.panels = panelsOf(run).map((panel) => this.make(panel));
    clock.addEventListener("time", () => this.moveNow());
    new ResizeObserver(() => this.resize()).observe(home);
  }

  /** One panel: its heading, with numbers at the present time, and its plot. */
  make(panel) {
    const { run } = this;
    const box = document.createElement("figure");
    const heading = document.createElement("figcaption");
    const title = document.createElement("b");
    title.textContent = panel.title;
    const unit = document.createElement("span");
    unit.textContent = panel.unit;
    panel.reading = document.createElement("output");
    const keys = [...(panel.bounds ?? []).map((name, k) => [`bound: ${name}`, BOUNDS[k % 2]]), ...(panel.limits ?? []).filter(({ near }) => near).map(({ name }) => [name, "var(--quiet)"]), ...(panel.others ?? []).map(({ name, colour }) => [`team of ${name}`, colour])];
    const dashes = keys.map(([name, colour]) => {
      const key = document.createElement("span");
      const words = document.createElement("bdi");
      words.textContent = name;
      key.append("┄ ", words);
      key.style.color = colour;
      return key;
    });
    heading.append(title, unit, ...dashes, panel.reading);
    const plot = document.createElement("div");
    plot.className = "plot";
    box.append(heading, plot);
    this.home.append(box);
    Object.assign(panel, { box, plot, lines: linesOf(run, panel, this.all) });
    box.setAttribute("role", "img");
    const whole = panel.lines.find((line) => line.name === "team")?.values ?? panel.lines[0]?.values ?? [];
    const known = whole.filter((x) => x !== null);
    const ends = known.length ? `, from ${digits(known[0])} to ${digits(known[known.length - 1])}` : "";
    box.setAttribute("aria-label", `${panel.title}, ${panel.unit}, over time${ends}`);
    const positive = (x) => (panel.log && !(x > 0) ? null : x);
    panel.data = [Array.from(run.time), ...panel.lines.map((line) => line.values.map(positive))];
    panel.u = new uPlot(this.options(panel), panel.data, plot);
    panel.now = document.createElement("div");
    panel.now.className = "now";
    panel.u.over.append(panel.now);
    this.pointing(panel);
    return panel;
  }

  /** The run has become longer: draw it again. */
  extend() {
    for (const panel of this.panels) {
      linesOf(this.run, panel, this.all).forEach(({ values }, n) => panel.lines[n] && (panel.lines[n].values = values));
      const positive = (x) => (panel.log && !(x > 0) ? null : x);
      panel.data = [Array.from(this.run.time), ...panel.lines.map((line) => line.values.map(positive))];
    }
    const { lit } = this;
    this.lit = NaN; // the lines of whom is lit are written again
    for (const panel of this.panels) panel.u.setData(panel.data);
    this.light(lit);
  }

  options(panel) {
    const ink = (name) => () => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
    const axis = { stroke: ink("--quiet"), font: "10px system-ui", grid: { stroke: ink("--rule"), width: 1 }, ticks: { show: false } };
    return {
      width: Math.max(this.home.clientWidth - 24, 200),
      height: HEIGHT,
      padding: [4, 18, 0, 0],
      legend: { show: false },
      cursor: { y: false, drag: { x: false, y: false, setScale: false }, points: { show: false }, focus: { prox: 14 } },
      focus: { alpha: 0.25 },
      scales: { x: { time: false, range: () => [this.run.start, Math.max(this.run.end, this.run.start + 1e-9)] }, y: panel.log ? { distr: 3, range: (_, low, high) => logRange(panel, low, high) } : { range: (_, low, high) => [0, linearTop(panel, high)] } },
      axes: [
        { ...axis, size: 18, gap: 2, values: (_, ticks) => ticks.map((t, k) => `${+t.toFixed(6)}${k === ticks.length - 1 ? " s" : ""}`) },
        { ...axis, size: 42, gap: 4, filter: (_, ticks) => ticks, splits: panel.log ? (_, __, low, high) => decades(low, high) : undefined, values: (_, ticks) => ticks.map((x) => (x === null ? "" : plain(x))) },
      ],
      series: [{}, ...panel.lines.map((line) => ({
        label: "",
        stroke: line.colour.startsWith("--") ? ink(line.colour) : line.agent >= 0 || line.group ? () => legible(line.colour, document.documentElement.dataset.theme === "dark") : line.colour,
        width: line.width,
        dash: line.dash,
        alpha: line.alpha ?? 1,
        points: { show: false },
        spanGaps: false,
      }))],
      bands: panel.lines.flatMap((line, k) => (line.bandTo ? [{ series: [k + 1, panel.lines.indexOf(line.bandTo) + 1], fill: line.fill }] : [])),
      hooks: {
        draw: [(u) => this.drawEvents(u)],
        setSeries: [(u, index) => this.pointed(panel, index)],
      },
    };
  }

  drawEvents(u) {
    const style = getComputedStyle(document.documentElement);
    u.ctx.save();
    u.ctx.strokeStyle = style.getPropertyValue("--quiet");
    u.ctx.setLineDash([4, 4]);
    u.ctx.lineWidth = 1;
    for (const { time } of this.run.events) {
      const x = Math.round(u.valToPos(time, "x", true)) + 0.5;
      u.ctx.beginPath();
      u.ctx.moveTo(x, u.bbox.top);
      u.ctx.lineTo(x, u.bbox.top + u.bbox.height);
      u.ctx.stroke();
    }
    u.ctx.restore();
  }

  /** A line is pointed at: its agent lights up. */
  pointed(panel, index) {
    if (this.telling) return;
    const line = index > 0 ? panel.lines[index - 1] : null;
    const agent = line?.agent ?? -1;
    if (agent !== this.lit) this.dispatchEvent(new CustomEvent("point", { detail: agent }));
  }

  pointing(panel) {
    const { over } = panel.u;
    const go = (event) => {
      const { left } = over.getBoundingClientRect();
      this.clock.pause();
      this.clock.seek(panel.u.posToVal(event.clientX - left, "x"));
    };
    over.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      over.setPointerCapture(event.pointerId);
      go(event);
    });
    over.addEventListener("pointermove", (event) => {
      if (event.buttons & 1) go(event);
    });
    over.addEventListener("pointerleave", () => this.dispatchEvent(new CustomEvent("point", { detail: -1 })));
  }

  /** Light up an agent, -1 for none, in every panel. */
  light(agent) {
    if (agent >= this.run.agents) agent = -1;
    if (agent === this.lit) return;
    this.lit = agent;
    this.telling = true;
    for (const panel of this.panels) {
      const own = panel.lines.findIndex((line) => line.agent === agent && agent >= 0);
      const extra = panel.lines.findIndex((line) => line.extra);
      if (extra >= 0) {
        const positive = (x) => (panel.log && !(x > 0) ? null : x);
        panel.lines[extra].agent = agent;
        panel.data[extra + 1] = agent < 0 ? this.run.said.time.map(() => null) : this.run.column(panel.agents, agent).map(positive);
        panel.u.setData(panel.data, false);
        panel.u.redraw();
      }
      const limit = panel.lines.findIndex((line) => line.own);
      if (limit >= 0) {
        panel.data[limit + 1] = this.run.said.time.map((_, k) => (agent < 0 ? null : this.run.most(k, agent)));
        panel.u.setData(panel.data, false);
        panel.u.redraw();
      }
      if (extra >= 0) continue;
      if (own >= 0) panel.u.setSeries(own + 1, { focus: true });
      else panel.u.setSeries(null, { focus: false });
    }
    this.telling = false;
    this.moveNow();
  }

  /** The line of the present time, and what the panels read there. */
  moveNow() {
    const { run, clock } = this;
    const [k] = run.locate(clock.t);
    for (const panel of this.panels) {
      panel.now.style.transform = `translateX(${panel.u.valToPos(clock.t, "x").toFixed(1)}px)`;
      const parts = [];
      const team = panel.lines.find((line) => line.name === "team");
      if (team) parts.push(`${TEAM[panel.how] ?? "team"} ${digits(team.values[Math.min(k, team.values.length - 1)])}`);
      if (panel.agents && this.lit >= 0) parts.push(`${run.names[this.lit]} ${digits(run.series[panel.agents][k * run.agents + this.lit])}${panel.limits ? ofMost(run, k, this.lit) : ""}`);
      const text = parts.join("   ");
      if (panel.said !== text) panel.reading.textContent = panel.said = text;
    }
  }

  resize() {
    const width = Math.max(this.home.clientWidth - 24, 200);
    for (const { u } of this.panels) u.setSize({ width, height: HEIGHT });
    this.moveNow();
  }

  /** Colours have changed. */
  redraw() {
    for (const { u } of this.panels) u.redraw(false, true);
  }
}

/** What is shown: values of each agent (`agents`), of the team and of groups, limits and bounds. */
function panelsOf(run) {
  const { said, series } = run;
  const limits = limitsOf(run);
  return [
    { title: "Distance from its place", unit: "|q* − q|, m; of the team RMS over agents", agents: "tracking_error", how: "rms", log: true, bounds: said.bounds, others: said.ghosts },
    series.apart && { title: "Bodies from their ideal twins", unit: "m", agents: "apart", how: "rms", log: true },
    { title: "Disagreement", unit: "|η|, m", agents: "disagreement", how: "mean", log: true },
    { title: "Formation error", unit: "RMS over a group's links, m", team: "formation_error", groups: "group_formation_error", log: true },
    { title: "Centering error", unit: "centre off its target, m", team: "centering_error", groups: "group_centering_error", log: true },
    { title: "Speed asked for", unit: "m/s", agents: "speed", how: "mean", limits, log: isSpread(run) },
    series.saturation && { title: "Thrusters at a limit", unit: "fraction of them", agents: "saturation", how: "mean", most: 1 },
  ].filter((panel) => panel && (panel.agents || run.column(panel.team, 0).some((x) => x !== null)));
}

/**
 * What limits the speeds that are asked for, and whether speeds come near: what each kind of vehicle can make, and the
 * law's limit. A limit far above the data would squeeze them; it is only said of the agent that is pointed at.
 */
function limitsOf(run) {
  const { said } = run;
  const fastest = (agents) => agents.reduce((most, i) => run.column("speed", i).reduce((x, y) => Math.max(x, y ?? 0), most), 0);
  const all = [...said.agents.keys()];
  const limits = said.kinds.flatMap(({ name }, k) => {
    const own = all.filter((i) => said.kind[i] === k && said.fastest[i] !== null && Number.isFinite(said.fastest[i]));
    if (!own.length) return [];
    const most = said.fastest[own[0]];
    return [{ name: `all-way speed of ${name} ${digits(most)}`, at: () => most, near: fastest(own) > NEAR * most }];
  });
  const lowest = said.limits.map(({ limit }) => limit.reduce((least, x) => (x === null ? least : Math.min(least ?? x, x)), null));
  const some = [...new Set(lowest.filter((x) => x !== null))];
  const then = (k) => lowest[said.limits.findLastIndex(({ time }, n) => n === 0 || time <= run.time[k] + 1e-9)];
  if (some.length) limits.push({ name: `limit of the law ${some.map(digits).join(", ")}`, at: then, near: fastest(all) > NEAR * Math.min(...some) });
  return limits;
}

/** The largest speed of an agent at a sample, in words; nothing where it has no limit. */
function ofMost(run, k, agent) {
  const most = run.most(k, agent);
  return most === null ? "" : ` of ${digits(most)}`;
}

/** Whether the speeds asked for need a logarithmic axis: the first is often a hundred times the usual one. */
function isSpread(run) {
  const speeds = Float32Array.from(run.series.speed).sort();
  return speeds[speeds.length - 1] > 12 * (speeds[speeds.length >> 1] || Infinity);
}

function linesOf(run, panel, all) {
  const { said } = run;
  const colour = (g) => said.groups[g].colour;
  const nothing = run.said.time.map(() => null);
  const lines = [];
  if (panel.agents) {
    if (all.length > MOST_LINES) {
      const low = { values: run.over(panel.agents, all, 0.05), colour: "transparent", width: 0 };
      const high = { values: run.over(panel.agents, all, 0.95), colour: "transparent", width: 0, bandTo: low, fill: "#5b8fd640" };
      const most = { values: run.over(panel.agents, all, 1), colour: "#5b8fd6", width: 0.8, alpha: 0.9 };
      lines.push(low, high, most);
    } else {
      for (const i of all) lines.push({ values: run.column(panel.agents, i), colour: colour(run.groupOf[i]), width: 1.1, alpha: 0.75, agent: i });
    }
    if (all.length > 1) lines.push({ name: "team", values: run.over(panel.agents, all, panel.how), colour: "--ink", width: 2 });
    if (all.length > MOST_LINES) lines.push({ values: nothing, colour: "#d9480f", width: 1.8, extra: true, agent: -1 });
  } else {
    said.formations.forEach((name, g) => lines.push({ values: run.column(panel.groups, g), colour: colour(g), width: 1.4, group: true }));
    lines.push({ name: "team", values: run.column(panel.team, 0), colour: "--ink", width: 2 });
  }
  panel.bounds?.forEach((name, k) => lines.push({ values: run.column(`bound${k}`, 0), colour: BOUNDS[k % 2], width: 1.6, dash: [7, 4], bound: name }));
  panel.others?.forEach(({ colour }, k) => lines.push({ values: run.column(`ghost_error${k}`, 0), colour: colour ?? "--quiet", width: 2, dash: [4, 3] }));
  const dashed = { colour: "--quiet", width: 1.3, dash: [5, 4], limit: true };
  panel.limits?.filter(({ near }) => near).forEach(({ at }) => lines.push({ ...dashed, values: nothing.map((_, k) => at(k)), near: true }));
  if (panel.limits) lines.push({ ...dashed, values: nothing, own: true }); // of the agent that is pointed at
  return lines;
}

/** Of what is drawn, not of bounds far above it: they may leave the panel. */
function logRange(panel, low, high) {
  let [least, most] = [Infinity, 0];
  for (const line of panel.lines) {
    if (line.bound || line.limit || line.fill || line.width === 0) continue;
    for (const x of line.values) if (x > 0) [least, most] = [Math.min(least, x), Math.max(most, x)];
  }
  for (const line of panel.lines) {
    if (line.bound) for (const x of line.values) if (x > 0 && x < 30 * most) most = Math.max(most, x);
  }
  if (!(most > 0)) return [low || 0.1, high || 1];
  return [Math.max(least, most / 10 ** DECADES) / 1.3, most * 1.3];
}

function linearTop(panel, high) {
  let most = 0;
  for (const line of panel.lines) if (!line.limit) for (const x of line.values) if (x > most) most = x;
  const data = most;
  for (const line of panel.lines) if (line.near) for (const x of line.values) if (x !== null && x * NEAR < data) most = Math.max(most, x);
  return panel.most ?? (most > 0 ? most * 1.08 : high || 1);
}

/** Ticks of a logarithmic axis: powers of ten, or 1, 2, 5 where there are few. */
function decades(low, high) {
  for (const steps of [[1], [1, 3], [1, 2, 5], [1, 1.5, 2, 3, 4, 5, 6, 8]]) {
    const found = [];
    for (let power = Math.floor(Math.log10(low)); power <= Math.ceil(Math.log10(high)); power++) {
      for (const step of steps) {
        const tick = +`${step}e${power}`;
        if (tick >= low && tick <= high) found.push(tick);
      }
    }
    if (found.length >= 3 || (found.length === 2 && steps.length > 2)) return found.filter((_, k) => k % Math.ceil(found.length / 4) === 0);
  }
  return [low, high];
}

function plain(x) {
  if (x === 0) return "0";
  return Math.abs(x) >= 1e4 || Math.abs(x) < 1e-3 ? x.toExponential(0).replace("-", "−") : String(+x.toPrecision(3));
}
