"""Pages in a real browser, opened from disk without a network.

Oracle: the run's own data, and what the browser says.
"""

import io
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from mjsheaf import simulate
from mjsheaf.page import page as page_module
from mjsheaf.page.page import Ghost
from mjsheaf.scenario import load_scenario
from mjsheaf.show.played import seas_of
from mjsheaf.video.film import film_of
from tests.builders import known, team_of
from tests.page.browser import missing, open_page
from tests.page.pages import Made, make_page, positions_of, said_in
from tests.page.test_page import HOSTILE

pytestmark = [pytest.mark.slow, pytest.mark.skipif(bool(missing()), reason=f"no browser: {missing()}")]

UNNAMED = """() => [...document.querySelectorAll('button, select, input, #scene, [role=img]')].filter(e =>
  !(e.getAttribute('aria-label') || e.textContent.trim() || e.labels?.[0]?.textContent.trim())).map(e => e.outerHTML)"""
ALONE = """(() => { // where the line of an agent is farthest from all others: x, y and the agent
  const { u, lines } = window.mjsheaf.curves.panels[0], { time } = window.mjsheaf.run;
  let best = [0];
  for (let k = 0; time[k] < 40; k += 20) {
    if (time[k] < 1) continue;
    const rows = lines.map((line, n) => u.valToPos(u.data[n + 1][k], 'y'));
    lines.forEach(({ agent }, n) => {
      const apart = Math.min(...rows.filter((_, m) => m !== n).map(other => Math.abs(other - rows[n])));
      if (agent >= 0 && apart > best[0]) best = [apart, u.valToPos(time[k], 'x'), rows[n], agent];
    });
  }
  return best; })()"""
WITHOUT_WEBGL = """HTMLCanvasElement.prototype.getContext = (own => function (kind, ...rest) {
  return /webgl/.test(kind) ? null : own.call(this, kind, ...rest); })(HTMLCanvasElement.prototype.getContext)"""
AT = "t => { const m = window.mjsheaf; m.clock.seek(t); m.world.read(); return Array.from(m.world.positions); }"


@pytest.fixture(scope="module")
def harbour(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Made]:
    made = make_page("harbour_lost_hexarotor", "physics", {"time.end": 55})
    return made.write(tmp_path_factory.mktemp("harbour") / "report.html"), made


def require_quiet(page: Any) -> None:
    """No error occurred, and the page requested nothing outside the file."""
    assert page.failures == []
    assert [words for kind, words in page.words if kind == "error"] == []
    assert [url for url in page.requests if not url.startswith("file:")] == []
    assert len(page.requests) == 1


def wait_until(page: Any, condition: str, seconds: float = 20.0) -> None:
    """Wait for a condition; the browser's own way to do so is against the page's policy."""
    for _ in range(round(10 * seconds)):
        if page.evaluate(condition):
            return
        page.wait_for_timeout(100)
    raise AssertionError(f"not within {seconds} s: {condition}")


def colours_of(page: Any) -> set[tuple[int, ...]]:
    """The colours of the scene's picture, without what is written over it."""
    over = "'#labels, #stage .panel, #scale'"
    page.evaluate(f"for (const e of document.querySelectorAll({over})) e.style.display = 'none'")
    page.wait_for_timeout(300)
    picture = Image.open(io.BytesIO(page.locator("#stage").screenshot())).convert("RGB")
    return {tuple(colour) for colour in np.asarray(picture).reshape(-1, 3)[::3].tolist()}


@pytest.mark.slow(first=True)
def test_a_page_opens_from_disk_without_a_network_in_both_themes(browser: Any, harbour: tuple[Path, Made]) -> None:
    light, dark = (open_page(browser, harbour[0], hash="#t=20", color_scheme=name) for name in ("light", "dark"))
    assert light.title() == "harbour_lost_hexarotor: mjsheaf run"
    assert len(colours_of(light)) > 200
    ground = "getComputedStyle(document.body).backgroundColor"
    grounds = [[int(x) for x in re.findall(r"\d+", page.evaluate(ground))] for page in (light, dark)]
    assert min(grounds[0]) > 200
    assert max(grounds[1]) < 60
    dark.locator("#theme").click()
    wait_until(dark, f"{ground} === '{light.evaluate(ground)}'")
    require_quiet(dark)


def test_scrubbing_puts_vehicles_where_the_data_have_them(browser: Any, harbour: tuple[Path, Made]) -> None:
    """Between kept samples too; and bodies, drawn in their true size, about their own origins."""
    path, made = harbour
    page = open_page(browser, path)
    data, there = made.dataset, positions_of(made.dataset)
    error, rounding = said_in(made.page)["largest_error"], 1e-4  # m, of 32-bit floats
    every = data["time"].values
    for t in (0.0, 0.02, 3.14, 17.77, 44.98, 45.0, 49.99, 55.0):
        k = int(np.searchsorted(every, t - 1e-9))
        found = np.array(page.evaluate(AT, float(every[k]))).reshape(-1, 3)
        assert np.abs(found - there[k]).max() <= error + rounding
    page.evaluate("window.mjsheaf.world.layers.larger = false; window.mjsheaf.clock.seek(30)")
    page.wait_for_timeout(300)
    places = page.evaluate(
        """() => { const { world, run } = window.mjsheaf; const found = [];
          for (const shown of [...world.bodies.usual, ...world.bodies.near]) for (let i = 0; i < shown.mesh.count; i++)
            found[shown.vehicles[i]] = Array.from(shown.mesh.instanceMatrix.array.slice(16 * i + 12, 16 * i + 15));
          return found; }"""
    )
    k = int(np.searchsorted(every, 30 - 1e-9))
    bodies = np.concatenate([data[f"{kind}_body_position"].values[k] for kind in ("agent", "target")])
    assert np.abs(np.array(places) - bodies).max() < 0.05
    require_quiet(page)


@pytest.mark.long
def test_playing_keeps_time_and_ends_or_begins_again(browser: Any, harbour: tuple[Path, Made]) -> None:
    page = open_page(browser, harbour[0])
    played, passed = page.evaluate(
        """async () => { const { clock } = window.mjsheaf; clock.setSpeed(5); clock.seek(2); clock.play();
          const begun = performance.now(); await new Promise(done => setTimeout(done, 2500));
          const found = [clock.t - 2, (performance.now() - begun) / 1000]; clock.pause(); return found; }"""
    )
    assert played == pytest.approx(5 * passed, abs=5 * 0.5)
    page.evaluate("window.mjsheaf.clock.setLoop(false); window.mjsheaf.clock.seek(54.5); window.mjsheaf.clock.play()")
    wait_until(page, "!window.mjsheaf.clock.playing && window.mjsheaf.clock.t === 55")
    page.evaluate("window.mjsheaf.clock.setLoop(true); window.mjsheaf.clock.seek(54); window.mjsheaf.clock.play()")
    wait_until(page, "window.mjsheaf.clock.playing && window.mjsheaf.clock.t < 50")


@pytest.mark.long
def test_everything_is_reached_by_keyboard_and_named(browser: Any, harbour: tuple[Path, Made]) -> None:
    page = open_page(browser, harbour[0])
    assert page.evaluate(UNNAMED) == []
    state = "[window.mjsheaf.clock.t, window.mjsheaf.clock.playing, window.mjsheaf.world.place]"
    page.keyboard.press("Space")
    assert page.evaluate("window.mjsheaf.clock.playing")
    page.keyboard.press("Space")
    page.keyboard.press("Home")
    assert page.evaluate(state)[:2] == [0, False]
    page.keyboard.press("ArrowRight")
    assert page.evaluate("window.mjsheaf.clock.t === window.mjsheaf.run.time[1]")
    page.keyboard.press("End")
    assert page.evaluate(state)[0] == 55
    seen = {page.evaluate(state)[2]}
    for key in ("2", "3", "1"):
        page.keyboard.press(key)
        seen.add(page.evaluate(state)[2])
    page.locator("#scene").focus()
    for key in ("ArrowLeft", "ArrowUp", "+", "Shift+ArrowRight"):
        page.keyboard.press(key)
        seen.add(page.evaluate(state)[2])
    assert len(seen) == 3 + 4
    page.keyboard.press("n")
    assert page.locator("#card .name").inner_text() == "H1"
    page.keyboard.press("f")
    assert page.evaluate("window.mjsheaf.world.followed") == 0
    reached = set()
    for _ in range(40):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.id || document.activeElement.innerText"))
    assert {"scene", "play", "slider", "speed", "loop", "theme", "help", "follow", "Above"} <= reached
    require_quiet(page)


@pytest.mark.long
def test_pointing_lights_an_agent_in_both_halves_and_a_click_on_a_curve_goes_there(
    browser: Any, harbour: tuple[Path, Made]
) -> None:
    page = open_page(browser, harbour[0], width=1280, height=720, hash="#t=20")
    page.wait_for_timeout(300)
    x, y = page.evaluate("Array.from(window.mjsheaf.world.screen.slice(10, 12))")  # W2, the sixth
    box = page.locator("#scene").bounding_box()
    page.mouse.move(box["x"] + x, box["y"] + y)
    lit = "[window.mjsheaf.state.lit, window.mjsheaf.curves.lit, window.mjsheaf.world.lit]"
    assert page.evaluate(lit) == [5, 5, 5]
    assert "W2" in page.locator("figcaption output").first.inner_text()
    over = page.locator(".u-over").first.bounding_box()
    page.mouse.click(over["x"] + over["width"] * 0.5, over["y"] + 5)
    assert page.evaluate("window.mjsheaf.clock.t") == pytest.approx(27.5, abs=0.2)
    apart, x, y, agent = page.evaluate(ALONE)
    assert apart > 5  # pixels
    page.mouse.move(over["x"] + x, over["y"] + y)
    wait_until(page, f"window.mjsheaf.state.lit === {agent}")
    assert page.evaluate(lit) == [agent] * 3
    require_quiet(page)


@pytest.mark.long
def test_events_are_named_and_lost_agents_turn_grey(browser: Any, harbour: tuple[Path, Made]) -> None:
    page = open_page(browser, harbour[0], hash="#t=46")
    page.wait_for_timeout(300)
    assert page.locator("#event").inner_text() == "lose H3 (45.0 s)"
    assert page.evaluate("[...document.querySelectorAll('#labels .lost')].map(e => e.textContent)") == ["H3"]
    assert page.evaluate("window.mjsheaf.world.present") == [True, True, False, True, True, True, True, True]


@pytest.mark.long
def test_an_address_shows_a_moment_to_somebody_else(browser: Any, harbour: tuple[Path, Made]) -> None:
    page = open_page(browser, harbour[0])
    page.evaluate("window.mjsheaf.clock.seek(12.5); window.mjsheaf.world.view('above')")
    page.keyboard.press("n")
    wait_until(page, "location.hash.includes('t=12.5') && location.hash.includes('lit=H1')")
    state = "[window.mjsheaf.clock.t, window.mjsheaf.world.place, window.mjsheaf.state.chosen]"
    first, hash = page.evaluate(state), page.evaluate("location.hash")
    other = open_page(browser, harbour[0], hash=hash)
    assert other.evaluate(state) == first


@pytest.mark.parametrize("size", [(1400, 900), (1920, 1080), (1024, 768), (900, 600), (390, 844)])
@pytest.mark.parametrize("view", ["angle", "above"])
def test_no_panel_covers_a_vehicle(browser: Any, harbour: tuple[Path, Made], size: tuple[int, int], view: str) -> None:
    """Oracle: the places on the screen of all vehicles over the run, and the browser's boxes of panels."""
    page = open_page(browser, harbour[0], width=size[0], height=size[1])
    page.evaluate(f"window.mjsheaf.world.view('{view}')")
    covered = page.evaluate(
        """() => { const { world, run, clock } = window.mjsheaf, found = [];
          const { left, top, width, height } = world.canvas.getBoundingClientRect();
          for (let t = run.start; t <= run.end; t += 5) {
            clock.seek(t); world.draw();
            const boxes = ['views', 'card', 'legend'].map((id) => document.getElementById(id).getBoundingClientRect());
            run.names.forEach((name, v) => {
              const [x, y] = [world.screen[2 * v], world.screen[2 * v + 1]];
              if (v < run.agents && !world.present[v]) return;
              const within = (b) => b.left < left + x && left + x < b.right && b.top < top + y && top + y < b.bottom;
              if (boxes.some(within) || !(x > 0 && x < width && y > 0 && y < height)) found.push([name, t]);
            });
          }
          return found; }"""
    )
    assert covered == []


@pytest.fixture(scope="module")
def estuary(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Made]:
    """Boats and drones in wind and current for a few seconds."""
    made = make_page("harbour", "physics", {"time.end": 4})
    return made.write(tmp_path_factory.mktemp("estuary") / "report.html"), made


@pytest.mark.long
def test_wind_and_current_are_shown_apart(browser: Any, estuary: tuple[Path, Made]) -> None:
    page = open_page(browser, estuary[0], width=1280, height=800)
    page.locator("#layers summary").click()
    words = page.locator("#layers label").all_inner_texts()
    assert {"arrows of the wind", "arrows of the current"} <= set(words)
    shown = "window.mjsheaf.world.arrows.map(({ mesh }) => mesh.visible)"
    for n, name in enumerate(("wind", "current")):
        page.get_by_label(f"arrows of the {name}").uncheck()
        wait_until(page, f"!{shown}[{n}] && {shown}[{1 - n}]")
        page.get_by_label(f"arrows of the {name}").check()
    colours = page.evaluate(
        """() => window.mjsheaf.world.arrows.map(({ look, count }) => {
          const found = []; for (let i = 0; i < count; i += 3) found.push(Array.from(look.slice(32 * i, 32 * i + 3)));
          return found; })"""
    )
    for own in colours:  # slow and fast arrows differ
        assert np.ptp(np.array(own), axis=0).max() > 40
    legend = page.locator("#legend").inner_text()
    for flow in said_in(estuary[1].page)["flow"]:
        assert f"speed of the {flow['name']}" in legend
        assert f"{flow['top']:g} m/s" in legend
    assert page.locator("#legend .row").count() == page.locator("#legend .row > i").count()
    require_quiet(page)


@pytest.mark.long
def test_small_vehicles_are_seen_beside_large_ones_as_in_the_video(browser: Any, estuary: tuple[Path, Made]) -> None:
    """Oracle: the sizes on the screen of what three.js draws, and the video's scales, which the legend states."""
    page = open_page(browser, estuary[0], width=1280, height=800)
    wait_until(page, "window.mjsheaf.world.scales !== undefined")
    pixels, scales = page.evaluate(
        """() => { const { world, run } = window.mjsheaf; return [run.said.kind.map((k, v) =>
          2 * run.said.kinds[k].radius * world.scales[v] / world.metres), world.scales]; }"""
    )
    assert min(pixels) > 24.0
    film, _ = film_of(estuary[1].scenario, estuary[1].dataset)
    np.testing.assert_allclose(scales, film.scales)
    assert max(scales) > 2.0 > min(scales)
    assert "drawn larger: x500 ×" in page.locator("#legend").inner_text()
    page.evaluate("window.mjsheaf.world.layers.larger = false; window.mjsheaf.world.changed()")
    wait_until(page, "document.getElementById('legend').innerText.includes('true size')")
    x = np.array([float(part) for part in page.evaluate("window.mjsheaf.world.place").split(",")])
    way = x[:3] - x[3:]
    azimuth, elevation = np.degrees([np.arctan2(way[1], way[0]), np.arcsin(way[2] / np.linalg.norm(way))])
    assert (azimuth, elevation) == pytest.approx(estuary[1].scenario.video.eye, abs=0.5)


@pytest.mark.long
def test_limits_far_above_the_data_do_not_squeeze_them(browser: Any, estuary: tuple[Path, Made]) -> None:
    page = open_page(browser, estuary[0], width=1280, height=800)
    data = float(np.nanmax(np.linalg.norm(np.nan_to_num(estuary[1].dataset["velocity_command"].values), axis=2)))
    panel = "window.mjsheaf.curves.panels.find(({ title }) => title === 'Speed asked for')"
    for lit in (-1, 0, 5):
        page.evaluate(f"window.mjsheaf.curves.light({lit})")
        low, high = page.evaluate(f"[{panel}.u.scales.y.min, {panel}.u.scales.y.max]")
        assert low <= 0.1 * data
        assert high < 1.4 * data
    assert " of 3.00" in page.evaluate(f"{panel}.reading.textContent")  # the limit of who is pointed at


@pytest.mark.long
def test_headline_errors_say_what_they_are(browser: Any, estuary: tuple[Path, Made]) -> None:
    """Oracle: the data's own RMS over agents at the end."""
    page = open_page(browser, estuary[0], width=1280, height=800)
    rms = float(np.sqrt((estuary[1].dataset["tracking_error"].values[-1] ** 2).mean()))
    said = known(re.search(r"RMS over agents: ([\d.]+) m", page.locator("#worst").inner_text()))
    assert float(said[1]) == pytest.approx(rms, rel=5e-3)
    headings = page.locator("#facts table").first.locator("thead th").all_inner_texts()
    assert [heading.split("\n")[-1] for heading in headings[1:3]] == ["mean over agents", "RMS over agents"]


@pytest.mark.long
def test_a_phone(browser: Any, estuary: tuple[Path, Made]) -> None:
    """The page fits, answers to touches, its card is small, and tables say that they go on."""
    page = open_page(browser, estuary[0], width=390, height=844, hash="#t=2", has_touch=True, is_mobile=True)
    page.wait_for_timeout(500)
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    x, y = page.evaluate("Array.from(window.mjsheaf.world.screen.slice(8, 10))")
    box = page.locator("#scene").bounding_box()
    page.touchscreen.tap(box["x"] + x, box["y"] + y)
    assert page.evaluate("window.mjsheaf.state.lit") >= 0
    scene, card = (page.locator(name).bounding_box() for name in ("#stage", "#card"))
    assert card["width"] * card["height"] < 0.05 * scene["width"] * scene["height"]
    page.locator("#card summary").tap()
    assert page.locator("#card dl").is_visible()
    page.locator("#card summary").tap()
    assert not page.locator("#card dl").is_visible()
    cut = "[...document.querySelectorAll('#facts .wide')].map(e => e.scrollWidth > e.clientWidth + 1)"
    hints = "[...document.querySelectorAll('#facts .hint')].map(e => !e.hidden)"
    assert True in page.evaluate(cut)
    assert page.evaluate(cut) == page.evaluate(hints)
    faded = page.locator("#facts .wide.cut").first
    faded.evaluate("e => { e.scrollLeft = e.scrollWidth; }")
    wait_until(
        page, "document.querySelectorAll('#facts .wide.cut').length < document.querySelectorAll('#facts .wide').length"
    )
    require_quiet(page)


def test_a_browser_without_webgl_shows_curves_and_facts(browser: Any, harbour: tuple[Path, Made]) -> None:
    page = open_page(browser, harbour[0], hash="#t=20", before=WITHOUT_WEBGL)
    assert "cannot draw in three dimensions" in page.locator("#nothing").inner_text()
    page.keyboard.press("End")
    page.keyboard.press("n")
    assert page.locator("#card .name").inner_text() == "H1"
    assert "RMS over agents" in page.locator("figcaption output").first.inner_text()
    assert page.failures == []


@pytest.mark.long
@pytest.mark.parametrize(
    ("event", "jumps"), [({"lose": "A1"}, True), ({"set": {"controller.gain": 0.7}}, False)], ids=["lose", "gain"]
)
def test_an_event_is_named_only_where_the_place_jumped(
    browser: Any, tmp_path: Path, event: dict[str, Any], jumps: bool
) -> None:
    """The finding: "soon after lose O2" hinted at a cause that `check` refutes. A jump of q* is measured."""
    motion = {"kind": "lissajous", "amplitude": [8, 6], "rate": [0.3, 0.2], "phase": [0, 1]}
    made = make_page(
        team_of(
            {"A1": [3, 0], "A2": [6, 0], "A3": [9, 6]},
            {"T1": {"position": [0, 0], "motion": motion}, "T2": [20, 0]},
            "A1 T1, A2 T2, A1 A2, A2 A3, A1 A3",
            time={"end": 20},
            controller={"gain": 0.6, "control_period": 0.05},
            events=[{"time": 15.0, **event}],
        ),
        "ideal",
    )
    q_star = np.nan_to_num(made.dataset["harmonic_extension"].values[[299, 300], 2])
    assert bool(np.linalg.norm(q_star[1] - q_star[0]) > 5.0) is jumps
    page = open_page(browser, made.write(tmp_path / "report.html"), width=1300)
    worst = page.locator("#worst").inner_text()
    assert ("its place jumped by 14.7 m at 15.0 s: lose A1" in worst) is jumps
    assert "soon after" not in worst
    assert "its place, which moves at" not in worst or not jumps
    require_quiet(page)


@pytest.mark.long
def test_a_run_that_blew_up(browser: Any, tmp_path: Path) -> None:
    made = make_page("paper", "ideal", {"controller.gain": 300, "time.end": 5, "controller.control_period": 0.02})
    assert made.dataset.attrs["status"] == "unstable"
    page = open_page(browser, made.write(tmp_path / "report.html"))
    assert page.locator("#worst").inner_text().startswith("Blew up")
    for t in np.linspace(0.01, float(made.dataset["time"][-1]), 5):
        page.evaluate(f"window.mjsheaf.clock.seek({t})")
        page.wait_for_timeout(150)
    assert len(colours_of(page)) > 50
    require_quiet(page)


@pytest.mark.long
def test_a_run_of_a_thousand_agents(browser: Any, tmp_path: Path) -> None:
    made = make_page("swarm", "ideal", {"time.end": 2, "swarm.size": 1000})
    page = open_page(browser, made.write(tmp_path / "report.html"), width=1280, height=720, hash="#t=1")
    assert len(colours_of(page)) > 200
    page.keyboard.press("w")
    assert page.locator("#card .name").inner_text() in made.scenario.team.agent_ids
    require_quiet(page)


@pytest.mark.long
def test_ghosts_are_drawn_where_they_were_until_their_run_ends(browser: Any, tmp_path: Path) -> None:
    """Of ideal kinematics, with the distance of bodies from them, and of a shorter run, whose name is text."""
    ideal = simulate(load_scenario("harbour", {"time.end": 10}), "ideal")
    other = simulate(load_scenario("harbour", {"time.end": 5, "controller.gain": 1}), "ideal")
    ghosts = [Ghost("ideal kinematics", None, ideal, 0.0, twin=True), Ghost("<b>high", "#7b2cbf", other, 0.0)]
    made = make_page("harbour", "physics", {"time.end": 10}, ghosts=ghosts)
    page = open_page(browser, made.write(tmp_path / "report.html"))
    for time, gone in ((2.5, False), (8.0, True)):
        page.evaluate(AT, time)
        page.wait_for_timeout(500)
        shown = page.evaluate("window.mjsheaf.world.ghosts.runs.map(r => Array.from(r.positions.slice(6, 9)))")
        k = round(time / 0.02)
        assert np.abs(np.array(shown[0]) - positions_of(ideal)[k, 2]).max() < 0.05
        assert np.isnan(np.array(shown[1], dtype=float)).all() == gone
        assert gone or np.abs(np.array(shown[1]) - positions_of(other)[k, 2]).max() < 0.05
    apart = page.evaluate("window.mjsheaf.run.column('apart', 2)[window.mjsheaf.run.locate(5)[0]]")
    expected = np.linalg.norm(positions_of(made.dataset)[250, 2] - positions_of(ideal)[250, 2])
    assert apart == pytest.approx(expected, rel=1e-3)
    legend, curves = (page.locator(part).inner_text() for part in ("#legend", "#curves"))
    assert "Bodies from their ideal twins" in curves
    assert "<b>high" in curves
    assert {"translucent: ideal kinematics", "translucent: <b>high"} <= set(legend.splitlines())
    require_quiet(page)


def test_names_are_text_whatever_they_contain(browser: Any, tmp_path: Path) -> None:
    """All texts of the page are escaped, also names of agents and groups that no scenario could contain."""
    made = make_page("midpoint", "physics", {"time.end": 2})

    def spoilt(value: Any, key: str = "") -> Any:
        if isinstance(value, dict):
            return {name: spoilt(own, name) for name, own in value.items()}
        if isinstance(value, list):
            return [spoilt(own, key) for own in value]
        kept = ("colour", "shape", "vertices", "faces", "surface", "status", "verdict", "kind", "measures", "measure")
        return HOSTILE + value if isinstance(value, str) and key not in kept else value

    said = spoilt({**said_in(made.page), "notes": [{"text": "note", "time": 1.0, "agent": "A1"}]})
    data = known(re.search(rb'id="data">(.*?)</script>', made.page, re.DOTALL))
    path = tmp_path / "report.html"
    path.write_bytes(page_module._fill(said, data[1].decode()))
    page = open_page(browser, path, hash="#t=1")
    page.keyboard.press("n")
    assert page.locator("#card .name").text_content() == HOSTILE + "A1"
    assert page.locator("#title").text_content() == HOSTILE + "midpoint"
    assert page.evaluate("[...document.querySelectorAll('script')].length") == 3
    assert page.title().endswith("mjsheaf run")
    require_quiet(page)


@pytest.mark.long
@pytest.mark.parametrize("name", ["range_formation", "harbour_gusts", "leader_follower", "swap"])
def test_pages_of_teams_to_which_an_assumption_does_not_apply_open(browser: Any, name: str, tmp_path: Path) -> None:
    made = make_page(name, "ideal", {"time.end": 1.0})
    page = open_page(browser, made.write(tmp_path / "report.html"))
    require_quiet(page)
    assert page.locator("#facts article").count() >= 4


@pytest.mark.long
def test_the_sea_of_a_page_is_the_one_that_boats_meet(browser: Any, tmp_path: Path) -> None:
    """Oracle: the sea of the video, which is tested against the compiled one."""
    made = make_page("open_sea", "physics", {"time.end": 2.0})
    page = open_page(browser, made.write(tmp_path / "report.html"))
    require_quiet(page)
    (sea,) = seas_of(made.scenario.phases)
    x, y = np.linspace(-4.0, 4.0, 401), np.linspace(7.0, 9.0, 101)
    expected = sea.surface(x, y, 1.3)
    for i, j in ((0, 0), (200, 50), (400, 73)):
        found = page.evaluate(f"window.mjsheaf.world.sea.elevation({x[i]}, {y[j]}, 1.3)")
        np.testing.assert_allclose(found, expected[:, i, j], atol=1e-5)
    page.evaluate("window.mjsheaf.clock.seek(1.3)")
    wait_until(page, "window.mjsheaf.world.dirty === false")
    middle = "(() => { const { sea } = window.mjsheaf.world, n = 3 * (sea.places.length / 3 - 1) / 2;"
    px, py, pz = page.evaluate(middle + " return [sea.places[n], sea.places[n + 1], sea.places[n + 2]]; })()")
    assert pz == pytest.approx(page.evaluate(f"window.mjsheaf.world.sea.elevation({px}, {py}, 1.3)")[0], abs=5e-3)


@pytest.mark.long
@pytest.mark.parametrize("width", [390, 701, 760, 761, 1280])
def test_the_legend_lies_beside_the_scene(browser: Any, harbour: tuple[Path, Made], width: int) -> None:
    """Open or closed, as it is at first next to a narrow scene; and the scale bar lies within the scene."""
    page = open_page(browser, harbour[0], width=width, hash="#t=20")
    legend = page.locator("#legend details")
    assert legend.evaluate("d => d.open") == (width > 760)
    for opened in ("true", "false"):
        legend.evaluate(f"d => {{ d.open = {opened}; }}")
        stage, key, scale = (page.locator(name).bounding_box() for name in ("#stage", "#legend", "#scale"))
        assert key["y"] >= stage["y"] + stage["height"]
        assert key["x"] + key["width"] <= width
        assert stage["x"] <= scale["x"]
        assert scale["x"] + scale["width"] <= stage["x"] + stage["width"]
        assert stage["y"] + stage["height"] >= scale["y"] + scale["height"]


def test_the_policy_stops_what_would_go_outside(browser: Any, harbour: tuple[Path, Made]) -> None:
    page = open_page(browser, harbour[0])
    stopped = page.evaluate(
        """async () => {
          const seen = [];
          document.addEventListener('securitypolicyviolation', event => seen.push(event.effectiveDirective));
          await fetch('https://example.org/').catch(() => {});
          document.body.append(Object.assign(new Image(), { src: 'https://example.org/x.png' }));
          document.body.append(Object.assign(document.createElement('script'), { textContent: 'window.broken = 1' }));
          await new Promise(done => setTimeout(done, 300));
          return [seen, window.broken];
        }"""
    )
    assert set(stopped[0]) == {"connect-src", "img-src", "script-src-elem"}
    assert stopped[1] is None
