// What is written beside the scene: headings, the agent that is looked at, the legend, and the facts below.

import { digits, isSilent } from "./data.js";

/** An element with a class and contents; strings become text, whatever they contain. */
export function make(tag, name = "", ...contents) {
  const element = document.createElement(tag);
  if (name) element.className = name;
  element.append(...contents.filter((part) => part !== null && part !== undefined));
  return element;
}

const byId = (id) => document.getElementById(id);
const own = (text) => make("bdi", "", text);

const ENDINGS = {
  settled: "The errors have settled.",
  "not settled": "The team has not settled at the end.",
  diverging: "The errors grow to the end.",
};
const MEASURES = {
  mean_disagreement: ["disagreement", "mean over agents"],
  tracking_error: ["from its place", "RMS over agents"],
  formation_error: ["formation", "RMS over links"],
  centering_error: ["centering", "largest of a group"],
};

const ALONG = 0.8; // cosine from which one thing is said to go along another
const RECENT = 0.1; // of the run: an event before that is not mentioned
const JUMP = 0.2; // of an offset: a jump of the place that is less does not explain it
const MOST_AGENTS = 20; // in the table of agents
const SLOW = 0.05; // m/s: what is slower does not explain anything

/** The cosine between an offset and a velocity; 0 where either is small. */
function along(offset, velocity) {
  const [far, fast] = [Math.hypot(...offset), Math.hypot(...velocity)];
  return far > 1e-6 && fast > SLOW ? offset.reduce((sum, x, axis) => sum + x * velocity[axis], 0) / far / fast : 0;
}

/** Why an agent may be where it is at a sample: what is measured there, in words. */
export function reasons(run, k, agent) {
  const { said, series } = run;
  const found = [];
  if (!run.present(k, agent)) return ["lost"];
  const at = (name) => series[name]?.[k * run.agents + agent];
  const kept = run.keptFrom(k, agent);
  if (kept) found.push(`the filter keeps it from ${kept}`);
  const [speed, fastest, limit] = [at("speed"), said.fastest[agent], run.limit(k, agent)];
  if (limit !== null && speed >= 0.99 * limit) found.push(`asks for its speed limit of ${digits(limit)} m/s`);
  if (fastest !== null && speed > fastest) found.push(`asks for ${digits(speed)} m/s, its all-way speed is ${digits(fastest)}`);
  if (at("saturation") >= 0.5) found.push("thrusters at their limits");
  const flow = Math.hypot(...series.flow.subarray((k * run.agents + agent) * 3, (k * run.agents + agent) * 3 + 3));
  if (fastest !== null && flow > fastest) found.push(`the flow of ${digits(flow)} m/s is beyond its all-way speed`);
  const place = (name, row) => Array.from(series[name].subarray((row * run.columns(name)) + 3 * agent, (row * run.columns(name)) + 3 * agent + 3));
  const [q, goal, w] = [place("position", k), place("q_star", k), place("flow", k)];
  const [before, after] = [Math.max(k - 1, 0), Math.min(k + 1, run.time.length - 1)];
  const moved = place("q_star", after).map((x, axis) => (x - place("q_star", before)[axis]) / (run.time[after] - run.time[before] || 1));
  const off = goal.map((x, axis) => x - q[axis]);
  const jumps = run.events.some(({ time }) => time > run.time[before] && time <= run.time[after]); // no motion
  if (!jumps && along(off, moved) > ALONG) found.push(`lags behind its place, which moves at ${digits(Math.hypot(...moved))} m/s`);
  else if (along(off, w) < -ALONG) found.push(`carried off by the flow of ${digits(Math.hypot(...w))} m/s`);
  const width = said.edges.length;
  const links = said.edges.map((edge, e) => [edge, series.residual?.[k * width + e]]).filter(([edge, x]) => (edge.tail === agent || edge.head === agent) && !Number.isNaN(x));
  const silent = links.filter(([, x]) => isSilent(x)).length;
  if (!links.length) found.push("has no links");
  else if (silent) found.push(`${silent} of its ${links.length} links silent`);
  return found.concat(jumpsOf(run, k, agent, Math.hypot(...off)));
}

/** Events not long before a sample at which the agent's place jumped, by a good part of how far off it is. */
function jumpsOf(run, k, agent, far) {
  const place = (row) => Array.from(run.series.q_star.subarray((row * run.agents + agent) * 3, (row * run.agents + agent) * 3 + 3));
  const found = [];
  for (const { time, events } of run.events) {
    if (time <= run.start || time > run.time[k] || run.time[k] - time >= RECENT * (run.end - run.start)) continue;
    const after = run.time.findIndex((t) => t >= time - 1e-9);
    if (after < 2) continue;
    const [before, now, then] = [place(after - 2), place(after - 1), place(after)];
    const pace = (run.time[after] - run.time[after - 1]) / (run.time[after - 1] - run.time[after - 2]);
    const jump = Math.hypot(...then.map((x, axis) => x - now[axis] - pace * (now[axis] - before[axis])));
    if (jump > JUMP * far) found.push(`its place jumped by ${digits(jump)} m at ${digits(time)} s: ${events.join(", ")}`);
  }
  return found;
}

/** Title, and what it is, with the law as it is now. */
export function nameRun(run, law = run.said.facts.law) {
  const { facts } = run.said;
  document.title = `${facts.scenario}: mjsheaf run`;
  byId("title").textContent = facts.scenario;
  byId("subtitle").title = facts.summary || "";
  byId("subtitle").replaceChildren(own(facts.summary || ""), facts.summary ? " · " : "", `${facts.backend}, ${law}`);
}

/** Title, what it is, and who is worst. */
export function writeHeader(run, goTo) {
  const { facts } = run.said;
  nameRun(run);
  const worst = byId("worst");
  if (facts.status !== "finished") {
    worst.append(make("strong", "bad", "Blew up"), ` at ${digits(run.end)} s. `, own(facts.message || ""));
    return;
  }
  const half = run.locate((run.start + run.end) / 2)[0];
  const errors = run.over("tracking_error", [...run.said.agents.keys()], "rms");
  const last = errors[errors.length - 1];
  if (last !== null) worst.append(make("strong", "headline", `RMS over agents: ${digits(last)} m`), " from their places at the end. ");
  let [at, who, most] = [0, -1, -1];
  for (let k = half; k < run.time.length; k++) {
    const i = run.worst(k);
    const x = i < 0 ? -1 : run.series.tracking_error[k * run.agents + i];
    if (x > most) [at, who, most] = [k, i, x];
  }
  if (who < 0) return;
  const link = make("button", "link", own(run.names[who]), `, ${digits(most)} m from its place at ${digits(run.time[at])} s`);
  link.title = "Go there";
  link.addEventListener("click", () => goTo(run.time[at], who));
  const why = reasons(run, at, who);
  worst.append("Farthest off in the second half: ", link, why.length ? `: ${why.join("; ")}.` : ".");
}

/** The agent that is lit, or else the one that is worst now; kept up to date. */
export class Card {
  constructor(run, onFollow) {
    this.run = run;
    this.home = byId("card");
    this.name = make("bdi", "name");
    this.role = make("span", "role");
    this.rows = make("dl");
    this.why = make("p", "why");
    const button = make("button", "", "Follow");
    button.addEventListener("click", () => onFollow(this.vehicle));
    this.brief = make("span", "brief");
    this.details = make("details", "", make("summary", "", this.name, this.brief), make("div", "top", this.role, button), this.rows, this.why);
    this.details.open = !matchMedia("(max-width: 760px)").matches; // as in style.css
    this.home.append(this.details);
    this.said = "";
  }

  show(t, lit, worst) {
    const { run } = this;
    const v = lit >= 0 ? lit : worst;
    this.vehicle = v;
    this.home.hidden = v < 0;
    if (v < 0) return;
    const [k] = run.locate(t);
    const rows = [];
    const { said, series } = run;
    let why = [];
    if (v < run.agents) {
      const at = (name) => series[name]?.[k * run.agents + v];
      const f = (k * run.agents + v) * 3;
      rows.push(["from its place", `${digits(at("tracking_error"))} m`], ["disagreement", `${digits(at("disagreement"))} m`]);
      const most = run.most(k, v);
      rows.push(["asks for, m/s", `${digits(at("speed"))}${most === null ? "" : ` of ${digits(most)}`}`]);
      rows.push(["flow about it, m/s", digits(Math.hypot(series.flow[f], series.flow[f + 1], series.flow[f + 2]))]);
      if (series.saturation) rows.push(["thrusters at a limit", `${Math.round(100 * at("saturation"))} %`]);
      if (series.cause) rows.push(["filter changes, m/s", digits(at("correction"))]);
      if (series.apart) rows.push(["from its ideal twin", `${digits(at("apart"))} m`]);
      why = reasons(run, k, v);
    } else rows.push(["", "a target: it does not cooperate"]);
    const brief = v < run.agents ? `${digits(series.tracking_error[k * run.agents + v])} m off` : "target";
    const text = JSON.stringify([v, lit >= 0, rows, why, brief]);
    if (text === this.said) return;
    this.said = text;
    this.name.textContent = run.names[v];
    this.brief.textContent = brief;
    this.name.style.setProperty("--own", said.groups[run.groupOf[v]].colour);
    this.role.replaceChildren(own(said.kinds[said.kind[v]].name), ", ", lit >= 0 ? own(said.groups[run.groupOf[v]].name) : "farthest off now");
    this.rows.replaceChildren(...rows.flatMap(([name, value]) => [make("dt", "", name), make("dd", "", value)]));
    this.why.textContent = why.join("; ");
  }
}

/** What colours and lines mean. */
export function writeLegend(run, world) {
  const home = byId("legend");
  const swatch = (style, name = "swatch") => {
    const mark = make("i", name);
    for (const [key, value] of Object.entries(style)) mark.style.setProperty(key, value);
    return mark;
  };
  const row = (mark, ...words) => make("div", "row", mark, make("span", "", ...words));
  const used = [...new Set(run.groupOf)].slice(0, 9);
  const rows = used.map((g) => row(swatch({ background: run.said.groups[g].colour }, g === run.groupOf[run.agents] ? "swatch target" : "swatch"), own(run.said.groups[g].name)));
  rows.push(row(make("i", "goal"), "where an agent should be, q*"));
  for (const { name, colour } of run.said.ghosts) rows.push(row(colour ? swatch({ background: colour }, "ghost") : make("i", "ghost"), "translucent: ", own(name)));
  if (run.said.edges.length) {
    world.rangeSaid = make("span", "", rangeInWords(world));
    rows.push(row(make("i", "bar"), world.rangeSaid));
    if (run.said.edges.some(({ kind }) => kind === "sensing")) rows.push(row(make("i", "dashed"), run.said.edges.some(({ kind, directed }) => kind !== "sensing" && !directed) ? "sees a target (solid: agents talk)" : "sees a target"));
    if (run.said.edges.some(({ kind, directed }) => kind !== "sensing" && directed)) rows.push(row(make("i", "one-way"), "one agent senses another, one way"));
    if (run.series.residual.some(isSilent)) rows.push(row(make("i", "silent"), "grey: silent"));
  }
  if (run.series.cause) rows.push(row(make("i", "kept"), "the filter keeps the agent at the tip away from the other end"));
  if (run.said.obstacles.length) rows.push(row(make("i", "swatch obstacle"), "obstacle"));
  for (const { name, scale, top } of run.said.flow) {
    const bar = make("div", "speeds", make("span", "", "0"), make("i", `flow${scale}`), make("span", "", `${digits(top).replace(/\.?0+$/, "")} m/s`));
    rows.push(row(make("i", `arrow flow${scale}`), `speed of the ${name}`, bar));
  }
  world.larger = make("span", "");
  rows.push(row(make("i", "larger", "↗"), world.larger));
  const details = make("details", "", make("summary", "", "Legend"), make("div", "", ...rows));
  details.open = !matchMedia("(max-width: 760px)").matches; // as in style.css
  home.append(details);
}

/** What the colours of links mean. */
export function rangeInWords(world) {
  const [low, high] = world.residualRange;
  return `link, blue to red: ${digits(low)} to ${digits(high)} m off`;
}

/** The facts below the scene. */
export function writeFacts(run, goTo) {
  const { facts, notes } = run.said;
  const home = byId("facts");
  const card = (title, ...contents) => {
    const box = make("article", "", make("h2", "", title), ...contents);
    home.append(box);
    return box;
  };
  const time = (t, who = -1) => {
    const button = make("button", "link", `${digits(t)} s`);
    button.addEventListener("click", () => goTo(t, who));
    return button;
  };

  if (run.said.live) {
    card("How it is made", madeOf(run));
    return;
  }
  const state = facts.status === "finished" ? (ENDINGS[facts.ending] ?? "The run came to its end.") : `The run blew up: ${facts.message}`;
  const list = make("ul");
  for (const note of notes) {
    const who = note.agent === undefined || note.agent === null ? -1 : run.names.indexOf(note.agent);
    list.append(make("li", "", own(note.text), note.time === undefined || note.time === null ? null : make("span", "", " ", time(note.time, who))));
  }
  card("What happened", make("p", facts.status === "finished" ? "" : "bad", own(state)), safetyOf(facts.safety), notes.length ? list : null, eventsOf(run, time));
  card("At the end", finalOf(facts));
  card("Does the theory hold", ...theoryOf(facts, time));
  card("Agents", agentsOf(run, goTo));
  const made = madeOf(run);
  made.append(make("dt", "", "samples"), make("dd", "", `${run.time.length} of ${run.said.samples} are kept here; no vehicle is shown more than ${digits(run.said.largest_error)} m from where result.nc has it at any sample`));
  card("How it was made", made);
}

/** Versions, seed and command. */
function madeOf({ said: { facts } }) {
  const made = make("dl");
  const say = (name, ...value) => made.append(make("dt", "", name), make("dd", "", ...value));
  for (const [name, value] of Object.entries(facts.versions)) say(name, own(value));
  say("seed", String(facts.seed));
  say("again", make("code", "", facts.command), facts.where);
  return made;
}

/** How close vehicles came, and what the filter that keeps them apart did; null without one. */
function safetyOf(safety) {
  if (!safety) return null;
  const least = safety.smallest_separation;
  const shares = Object.entries(safety.filtered).sort(([, a], [, b]) => b - a);
  const parts = [];
  if (least !== null) parts.push(least < 0 ? make("strong", "bad", `Too close: ${digits(-least)} m below the distance to keep. `) : `Vehicles kept their distance, with ${digits(least)} m to spare at the closest. `);
  if (shares.length) parts.push("The filter acted most on ", own(shares[0][0]), `, ${digits(100 * shares[0][1])} % of the time. `);
  if (safety.deadlocked.length) parts.push(make("strong", "bad", "Deadlocked at the end: "), own(safety.deadlocked.join(", ")), ".");
  return make("p", "", ...parts);
}

function eventsOf(run, time) {
  if (!run.events.length) return null;
  const list = make("ul");
  for (const event of run.events) list.append(make("li", "", time(event.time), " ", own(event.events.join(", "))));
  return list;
}

function table(headings, rows) {
  const head = make("tr");
  for (const heading of headings) head.append(make("th", "", ...[heading].flat()));
  head.querySelectorAll("th").forEach((th) => th.setAttribute("scope", "col"));
  const room = make("div", "wide", make("table", "", make("thead", "", head), make("tbody", "", ...rows)));
  const hint = make("small", "hint", "there are more columns: scroll sideways →");
  hint.hidden = true;
  const look = () => {
    const cut = room.scrollWidth > room.clientWidth + 1;
    const end = room.scrollLeft + room.clientWidth >= room.scrollWidth - 1;
    hint.hidden = !cut;
    room.classList.toggle("cut", cut && !end);
    if (cut) room.tabIndex = 0; // so that a keyboard scrolls it
    else room.removeAttribute("tabindex");
  };
  new ResizeObserver(look).observe(room);
  room.addEventListener("scroll", look, { passive: true });
  return make("div", "table", hint, room);
}

function finalOf(facts) {
  const bounds = Object.fromEntries(facts.expect.map((check) => [check.measure, check]));
  const rows = facts.final.map(([name, ...values]) => {
    const cells = values.map((x, k) => {
      const check = name === "team" ? bounds[facts.measures[k]] : null;
      const cell = make("td", check ? (check.met ? "good" : "bad") : "", digits(x));
      if (check) cell.append(make("small", "", check.met ? ` ✓ at most ${digits(check.bound)}` : ` ✗ expected at most ${digits(check.bound)}`));
      return cell;
    });
    return make("tr", "", make("th", "", own(name)), ...cells);
  });
  const headings = facts.measures.map((name) => [MEASURES[name][0], make("small", "", MEASURES[name][1])]);
  return table(["errors, m", ...headings], rows);
}

/** What theory says of each phase; of a later one what has changed since the phase before. */
function theoryOf(facts, time) {
  const [first, ...later] = facts.theory;
  let before = verdictsOf(first);
  const parts = [make("ul", "verdicts", ...before.map(itemOf))];
  for (const phase of later) {
    const now = verdictsOf(phase);
    const changed = now.filter(({ text, why }, k) => text !== before[k].text || why !== before[k].why);
    const heading = make("h3", "", "From ", time(phase.time), ": ", own(phase.events.join(", ")));
    parts.push(heading, changed.length ? make("ul", "verdicts", ...changed.map(itemOf)) : make("p", "", "All as before."));
    before = now;
  }
  return parts;
}

function verdictsOf({ assumptions, theorem, held }) {
  return [
    ...assumptions.map(({ number, name, verdict, why }) => ({ verdict, text: `Assumption ${number}, ${name}: ${verdict}`, why: verdict === "holds" ? "" : why })),
    theorem.applies ? { verdict: "holds", text: `Theorem 1 bounds the error${theorem.approximate ? ", approximately" : ""}`, why: "" } : { verdict: "undecided", text: "Theorem 1 does not apply:", why: theorem.reason },
    held.applies ? { verdict: "holds", text: "The bound of the held law applies", why: "" } : { verdict: "undecided", text: "No bound of the held law:", why: held.reason },
  ];
}

function itemOf({ verdict, text, why }) {
  const [mark, colour] = { holds: ["✓ ", "good"], fails: ["✗ ", "bad"], undecided: ["? ", ""] }[verdict] ?? ["– ", ""];
  return make("li", colour, make("b", "", mark), text, why ? make("small", "", " ", own(why)) : null);
}

function agentsOf(run, goTo) {
  const last = run.time.length - 1;
  const rows = run.said.agents.map((name, i) => {
    let [most, at] = [-1, 0];
    for (let k = run.locate((run.start + run.end) / 2)[0]; k <= last; k++) {
      const x = run.series.tracking_error[k * run.agents + i];
      if (x > most) [most, at] = [x, k];
    }
    return { name, i, most, at, end: run.series.tracking_error[last * run.agents + i] };
  });
  rows.sort((a, b) => b.most - a.most);
  const shown = rows.slice(0, MOST_AGENTS).map(({ name, i, most, at, end }) => {
    const button = make("button", "link", own(name));
    button.addEventListener("click", () => goTo(run.time[at], i));
    return make("tr", "", make("th", "", button), make("td", "", own(run.said.groups[run.groupOf[i]].name)), make("td", "", own(run.said.kinds[run.said.kind[i]].name)), make("td", "", most < 0 ? "–" : digits(most)), make("td", "", most < 0 ? "–" : digits(run.time[at])), make("td", "", digits(end)));
  });
  const whole = table(["agent", "group", "vehicle", "farthest off, m", "when, s", "at the end, m"], shown);
  if (rows.length > MOST_AGENTS) whole.append(make("p", "", `The ${MOST_AGENTS} of ${rows.length} that are farthest off in the second half.`));
  return whole;
}
