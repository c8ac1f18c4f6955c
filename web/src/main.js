// The page: reads the run, makes its parts, and joins them to one clock and to the viewer.

import "./style.css";
import { Clock, readHash, writeHash } from "./clock.js";
import { LiveClock, goLive } from "./live.js";
import { Curves } from "./curves.js";
import { digits, readRun } from "./data.js";
import { Card, make, nameRun, writeFacts, writeHeader, writeLegend } from "./facts.js";
import { World } from "./scene.js";

const byId = (id) => document.getElementById(id);

const KEYS = [
  ["space", "play or pause"], ["← →", "a sample back or on; with shift a second"], ["Home End", "start or end"],
  [", .", "slower or faster"], ["1 2 3", "at an angle, from above, from the side"], ["F", "follow who is lit, or nobody"],
  ["N P", "light up the next or previous agent"], ["W", "light up who is farthest off now"], ["L", "loop"], ["T", "light or dark"],
  ["in the scene", "arrows turn, shift and arrows move, + and − zoom; drag turns, right drag moves, wheel zooms; a click lights up, a double click follows"],
  ["in the curves", "point at a line to light up its agent, click or drag to go to a time"],
];
const LAYERS = { links: "links", goals: "where agents should be", trails: "trails", names: "names", stems: "heights", larger: "vehicles larger than life", ghosts: "other runs", safety: "whom the filter keeps apart" };

async function begin() {
  const run = await readRun();
  const clock = run.said.live ? new LiveClock(run) : new Clock(run);
  const state = { lit: -1, chosen: -1 };
  let world = null;
  let panel = null;
  try {
    world = new World(run, clock, byId("scene"), byId("labels"));
  } catch (error) {
    byId("nothing").hidden = false;
    byId("nothing").textContent = `This browser cannot draw in three dimensions (${error.message}); the curves and facts work.`;
  }
  const curves = new Curves(run, clock, byId("curves"));
  const card = new Card(run, (vehicle) => follow(vehicle));

  const light = (vehicle) => {
    state.lit = vehicle >= 0 ? vehicle : state.chosen;
    curves.light(state.lit);
    if (world && world.lit !== state.lit) {
      world.lit = state.lit;
      world.changed();
    }
    showCard();
  };
  const choose = (vehicle) => {
    state.chosen = vehicle === state.chosen ? -1 : vehicle;
    panel?.choose(vehicle);
    light(state.chosen);
  };
  const showCard = () => card.show(clock.t, state.lit, run.worst(run.locate(clock.t)[0]));
  const goTo = (t, vehicle = -1) => {
    clock.pause();
    clock.seek(t);
    state.chosen = vehicle;
    light(vehicle);
    window.scrollTo({ top: 0 });
  };
  const follow = (whom, near = true) => {
    const value = whom === -1 || whom === undefined ? "" : whom;
    byId("follow").value = String(value);
    if (Number.isInteger(value)) {
      state.chosen = value;
      light(value);
    }
    world?.follow(value, near);
  };

  if (!run.said.live) writeHeader(run, goTo);
  else nameRun(run);
  writeFacts(run, goTo);
  if (world) writeLegend(run, world);
  const controls = bindClock(run, clock);
  bindViews(run, world, follow);
  bindTheme(world, curves);
  bindKeys(run, clock, world, state, { choose, follow, controls });

  clock.addEventListener("time", () => {
    world?.changed();
    showCard();
  });
  if (world) {
    world.addEventListener("point", ({ detail }) => light(detail));
    world.addEventListener("choose", ({ detail }) => choose(detail));
    world.addEventListener("follow", ({ detail }) => detail >= 0 && follow(detail));
  }
  curves.addEventListener("point", ({ detail }) => light(detail));

  await new Promise(requestAnimationFrame); // until the plots are there
  const said = readHash();
  if (said.speed > 0) clock.setSpeed(+said.speed);
  clock.seek(Number.isFinite(+said.t) && said.t !== undefined ? +said.t : run.start);
  if (said.lit !== undefined && run.names.includes(said.lit)) choose(run.names.indexOf(said.lit));
  if (said.follow !== undefined) follow(said.follow === "team" ? "team" : run.names.indexOf(said.follow), false);
  showCard();
  if (world && said.cam) world.place = said.cam;
  else if (world && said.follow === undefined) world.view("angle"); // now that the panels are there
  if (run.said.live) {
    panel = goLive(run, clock, world, curves, controls);
    clock.catchUp();
  }
  controls.show();
  showCard();

  let [last, frames, remembered] = [performance.now(), 0, ""];
  let written = 0;
  const tick = (now) => {
    clock.advance(Math.min((now - last) / 1000, 2)); // a page that was hidden does not leap
    last = now;
    if (world?.draw()) {
      frames++;
      const words = world.largerInWords();
      if (words !== remembered) world.larger.textContent = remembered = words;
      writeScale(world);
    }
    if (now - written > 400 && !clock.playing) {
      written = now;
      remember(run, clock, world, state);
    }
    requestAnimationFrame(tick);
  };
  requestAnimationFrame(tick);
  // For tests and the curious: the run, the clock, the scene, and how many frames were drawn.
  window.mjsheaf = { run, clock, world, curves, state, get frames() { return frames; } };
  document.documentElement.dataset.ready = "yes";
}

/** The scale bar: a round length at the distance of what is looked at. */
function writeScale(world) {
  const length = 10 ** Math.floor(Math.log10(world.metres * 160));
  const round = [5, 2, 1].map((n) => n * length).find((x) => x <= world.metres * 160);
  const scale = byId("scale");
  const text = round >= 1e4 ? `${round / 1000} km` : `${digits(round).replace(/\.0+$/, "")} m`;
  if (scale.firstElementChild.textContent !== text) scale.firstElementChild.textContent = text;
  scale.lastElementChild.style.width = `${(round / world.metres).toFixed(1)}px`;
}

let lastHash = "";
function remember(run, clock, world, state) {
  const parts = { t: clock.t.toFixed(3).replace(/\.?0+$/, "") || "0" };
  if (world) parts.cam = world.place;
  if (world && world.followed !== "") parts.follow = world.followed === "team" ? "team" : run.names[world.followed];
  if (state.chosen >= 0) parts.lit = run.names[state.chosen];
  const text = JSON.stringify(parts);
  if (lastHash && text !== lastHash) writeHash(parts);
  lastHash = text;
}

function bindClock(run, clock) {
  const [play, slider, time, speed, loop] = ["play", "slider", "time", "speed", "loop"].map(byId);
  const end = () => run.said.live?.end ?? run.end;
  Object.assign(slider, { min: run.start, max: end() });
  const named = (value) => Object.assign(document.createElement("option"), { value, textContent: Number.isFinite(value) ? `${value}×` : "as fast as possible" });
  for (const value of clock.speeds) speed.append(named(value));
  loop.hidden = Boolean(run.said.live);
  const mark = () => {
    const marks = run.events.map((event) => {
      const line = make("i");
      line.style.left = `${(100 * (event.time - run.start)) / (end() - run.start || 1)}%`;
      line.title = event.events.join(", ");
      return line;
    });
    byId("marks").replaceChildren(...marks);
  };
  mark();
  let told = null;
  const show = () => {
    slider.value = clock.t;
    const text = `${clock.t.toFixed(2)} s`;
    time.textContent = `${text} of ${+end().toFixed(3)} s`;
    slider.setAttribute("aria-valuetext", text);
    const now = [...run.events].reverse().find((event) => event.time <= clock.t);
    const long = Math.max(Math.min(2 * clock.speed, run.end), 0.06 * (run.end - run.start));
    const words = now && clock.t - now.time < long ? `${now.events.join(", ")} (${digits(now.time)} s)` : "";
    if (words !== told) {
      byId("event").replaceChildren(make("bdi", "", words));
      byId("event").classList.toggle("seen", words !== "");
      told = words;
    }
  };
  const state = () => {
    play.textContent = clock.playing ? "❚❚" : "▶";
    play.setAttribute("aria-label", clock.playing ? "Pause" : "Play");
    if (![...speed.options].some((option) => +option.value === clock.speed)) speed.append(named(clock.speed));
    speed.value = String(clock.speed);
    loop.setAttribute("aria-pressed", String(clock.loop));
  };
  clock.addEventListener("time", show);
  clock.addEventListener("state", state);
  play.addEventListener("click", () => clock.toggle());
  slider.addEventListener("input", () => {
    clock.pause();
    clock.seek(+slider.value);
  });
  speed.addEventListener("change", () => clock.setSpeed(+speed.value));
  loop.addEventListener("click", () => clock.setLoop(!clock.loop));
  state();
  return { show, mark };
}

function bindViews(run, world, follow) {
  const select = byId("follow");
  const option = (value, text) => select.append(Object.assign(document.createElement("option"), { value, textContent: text }));
  option("team", "the team");
  run.names.forEach((name, v) => option(String(v), name));
  select.addEventListener("change", () => follow(select.value === "" || select.value === "team" ? select.value : +select.value));
  if (!world) {
    byId("views").hidden = true;
    return;
  }
  for (const button of document.querySelectorAll("#views [data-view]")) {
    button.addEventListener("click", () => {
      follow("");
      world.view(button.dataset.view);
    });
  }
  const flows = run.said.flow.map(({ name }, n) => [`flow${n}`, `arrows of the ${name}`]);
  for (const [name, words] of [...Object.entries(LAYERS), ...flows]) {
    if (name === "ghosts" && !run.said.ghosts.length) continue;
    if (name === "safety" && !run.series.cause) continue;
    const box = Object.assign(document.createElement("input"), { type: "checkbox", checked: world.layers[name] });
    box.addEventListener("change", () => {
      world.layers[name] = box.checked;
      world.changed();
    });
    byId("layers").lastElementChild.append(make("label", "", box, words));
  }
}

function bindTheme(world, curves) {
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const apply = (name) => {
    document.documentElement.dataset.theme = name;
    world?.setTheme(name);
    curves.redraw();
  };
  apply(dark.matches ? "dark" : "light");
  dark.addEventListener("change", () => apply(dark.matches ? "dark" : "light"));
  byId("theme").addEventListener("click", () => apply(document.documentElement.dataset.theme === "dark" ? "light" : "dark"));
}

function bindKeys(run, clock, world, state, { choose, follow }) {
  const list = make("dl");
  for (const [key, what] of KEYS) list.append(make("dt", "", key), make("dd", "", what));
  byId("keys").append(list);
  const help = (open) => {
    byId("keys").hidden = !open;
    byId("help").setAttribute("aria-expanded", String(open));
  };
  byId("help").addEventListener("click", () => help(byId("keys").hidden));
  const next = (step) => {
    state.chosen = state.chosen < 0 ? (step > 0 ? 0 : run.vehicles - 1) : (state.chosen + step + run.vehicles) % run.vehicles;
    const wanted = state.chosen;
    state.chosen = -1;
    choose(wanted);
  };
  const inScene = {
    ArrowLeft: (shift) => (shift ? world.pan(-0.05, 0) : world.turn(-6, 0)),
    ArrowRight: (shift) => (shift ? world.pan(0.05, 0) : world.turn(6, 0)),
    ArrowUp: (shift) => (shift ? world.pan(0, 0.05) : world.turn(0, 5)),
    ArrowDown: (shift) => (shift ? world.pan(0, -0.05) : world.turn(0, -5)),
    "+": () => world.zoom(0.87), "=": () => world.zoom(0.87), "-": () => world.zoom(1.15),
  };
  const anywhere = {
    " ": () => clock.toggle(),
    ArrowLeft: (shift) => (shift ? clock.seek(clock.t - 1) : clock.step(-1)),
    ArrowRight: (shift) => (shift ? clock.seek(clock.t + 1) : clock.step(1)),
    Home: () => clock.seek(run.start), End: () => clock.seek(run.end),
    ",": () => clock.change(-1), ".": () => clock.change(1),
    1: () => world?.view("angle"), 2: () => world?.view("above"), 3: () => world?.view("side"),
    f: () => follow(world?.followed !== "" ? "" : state.lit >= 0 ? state.lit : run.worst(run.locate(clock.t)[0])),
    n: () => next(1), p: () => next(-1),
    w: () => choose(run.worst(run.locate(clock.t)[0])),
    l: () => clock.setLoop(!clock.loop), t: () => byId("theme").click(),
    "?": () => help(byId("keys").hidden), Escape: () => (help(false), choose(-1)),
  };
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const { target, key, shiftKey } = event;
    if (target.matches("select") || (target.matches("button, summary, input[type=checkbox]") && (key === " " || key === "Enter"))) return;
    // On the slider arrows go by samples, as anywhere: its own steps would be of any size.
    const act = (target === byId("scene") && world && inScene[key]) || anywhere[key] || anywhere[key.toLowerCase()];
    if (!act) return;
    event.preventDefault();
    act(shiftKey);
  });
}

begin().catch((error) => {
  byId("nothing").hidden = false;
  byId("nothing").textContent = `The page cannot be shown: ${error.message}`;
  throw error;
});
