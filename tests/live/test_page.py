"""The live page in a real browser: what is pressed there happens in the run and is recorded."""

import math
from typing import Any

import pytest

from mjsheaf import load_scenario
from tests.live.test_view import Watched
from tests.page.browser import missing, open_page
from tests.page.test_browser import UNNAMED, wait_until

pytestmark = [pytest.mark.slow, pytest.mark.skipif(bool(missing()), reason=f"no browser: {missing()}")]

SLIDE = "(e, x) => { e.value = x; e.dispatchEvent(new Event('input')); e.dispatchEvent(new Event('change')); }"

FOLLOWS = """(seconds) => {
    const clock = window.mjsheaf.clock;
    clock.t = clock.run.end - 1;
    clock.drawn = true;
    clock.advance(seconds);
    return clock.run.end - clock.t;
}"""


def press(page: Any, name: str) -> None:
    page.locator("#live button", has_text=name).click()


@pytest.mark.long
def test_everything_that_is_pressed_happens_and_is_recorded(browser: Any) -> None:
    scenario = load_scenario("paper", {"time.end": 30})
    with Watched(scenario, "ideal", speed=1.0) as run:
        page = open_page(browser, run.url, width=1200, height=760)
        wait_until(page, "window.mjsheaf.run.end > 0.5")
        assert page.evaluate(UNNAMED) == []
        page.get_by_label("Agent", exact=True).select_option("A5")
        press(page, "Lose")
        wait_until(page, "document.querySelector('#live li').textContent.includes('lose A5')")
        wait_until(page, "!window.mjsheaf.run.present(window.mjsheaf.run.time.length - 1, 4)")
        press(page, "Join")
        wait_until(page, "window.mjsheaf.run.present(window.mjsheaf.run.time.length - 1, 4)")
        page.get_by_label("Gain", exact=True).evaluate(SLIDE, 60)
        page.get_by_label("Flow", exact=True).evaluate(SLIDE, 50)
        wait_until(page, "document.querySelectorAll('#live li').length === 4")
        press(page, "Cut")
        press(page, "Restore")
        wait_until(page, "document.querySelector('#live ol').textContent.includes('restore')")
        page.click("#play")
        wait_until(page, "document.getElementById('worst').textContent.startsWith('Paused')")
        page.wait_for_timeout(300)
        stopped = page.evaluate("window.mjsheaf.run.end")
        page.wait_for_timeout(500)
        assert page.evaluate("window.mjsheaf.run.end") == stopped
        assert 0.0 < page.evaluate(FOLLOWS, 0.01) < 1.0  # smoothly
        assert page.evaluate(FOLLOWS, 0.05) == 0.0  # at once where pictures take long
        page.keyboard.press("Home")  # looks back
        assert page.evaluate("window.mjsheaf.clock.t") < 0.1
        page.click("#play")  # to the newest sample
        page.click("#play")
        wait_until(page, f"window.mjsheaf.clock.t > {stopped} + 0.5")
        page.select_option("#speed", str(math.inf).replace("inf", "Infinity"))
        wait_until(page, "document.getElementById('worst').textContent.startsWith('Ended')", 60.0)
        assert page.evaluate("window.mjsheaf.run.end") == pytest.approx(30.0)
        assert page.failures == [words for kind, words in page.words if kind == "error"] == []
        assert [url for url in page.requests if not url.startswith(run.url.split("?")[0])] == []
        page.context.close()
    (recorded,) = run.recorded
    assert len(recorded.events) == 6


@pytest.mark.long
def test_a_reloaded_page_has_the_whole_run_and_a_second_one_cannot_control_it(browser: Any) -> None:
    with Watched(load_scenario("midpoint", {"time.end": 300}), "ideal", speed=10.0) as run:
        page = open_page(browser, run.url, width=1200, height=760)
        wait_until(page, "window.mjsheaf.run.end > 5")
        page.reload()
        page.wait_for_selector("html[data-ready=yes]", timeout=60_000)
        assert page.evaluate("window.mjsheaf.run.time.length") > 100
        other = open_page(browser, run.url, width=1200, height=760)
        wait_until(other, "document.getElementById('worst').textContent.includes('Another page controls this run')")
        assert other.locator("#live button:enabled").count() == 0
        other.context.close()
        end = page.evaluate("window.mjsheaf.run.end")
        wait_until(page, f"window.mjsheaf.run.end > {end} + 1")
        page.context.close()


SOCKET = """address => new Promise(done => { const s = new WebSocket(address);
    s.onopen = () => done('open'); s.onerror = () => done('refused'); })"""
READ = "address => fetch(address).then(a => a.text()).catch(() => 'refused')"
FRAME = """address => { const f = document.createElement('iframe'); f.src = address; document.body.append(f);
    return new Promise(d => f.onload = () => {
        try { d(String(f.contentDocument?.title ?? 'refused')); } catch { d('refused'); } }); }"""


@pytest.mark.slow(first=True)
def test_a_hostile_page_cannot_control_the_run(browser: Any) -> None:
    """It knows the port, but neither the token nor, with it, the origin."""
    with Watched(load_scenario("midpoint", {"time.end": 60}), "ideal", speed=1.0) as run:
        page = open_page(browser, run.url, width=1200, height=760)
        hostile = browser.new_context().new_page()
        hostile.goto("data:text/html,<p>hostile</p>")
        socket = run.url.replace("http", "ws").replace("/?", "/live?")
        ways = ((SOCKET, socket.split("?")[0]), (SOCKET, socket), (READ, run.url), (FRAME, run.url))
        for way, address in ways:
            assert hostile.evaluate(way, address) == "refused", (way, address)
        wait_until(page, "window.mjsheaf.run.end > 0.5")
        page.context.close()
        hostile.context.close()
    (recorded,) = run.recorded
    assert recorded.events == []
