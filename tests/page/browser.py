"""Real browser without a network and without a GPU: Chromium of the distribution."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome")
ARGUMENTS = [
    *("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync"),
    *("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),  # WebGL in software
]


def missing() -> str:
    """Why no browser can be driven here, or empty."""
    try:
        import playwright.sync_api  # noqa: F401
    except ImportError:
        return "playwright is not installed"
    return "" if chromium() else f"none of {', '.join(NAMES)} is installed"


def chromium() -> str | None:
    """The path of the browser; None where there is none."""
    return next((path for name in NAMES if (path := shutil.which(name))), None)


@contextmanager
def open_browser() -> Iterator[Any]:
    """A browser with a fresh profile, for as long as the block lasts."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=chromium(), args=ARGUMENTS)
        yield browser
        browser.close()


def open_page(
    browser: Any,
    place: Path | str,
    *,
    width: int = 900,
    height: int = 600,
    hash: str = "",
    before: str = "",
    **context: Any,
) -> Any:
    """Open a page from disk, without a network, or from an address, and wait until it is ready.

    `before` is a script that runs before those of the page. Requests, console messages and failures of the page
    are the lists `requests`, `words` and `failures` of the result.
    """
    on_disk = isinstance(place, Path)
    made = browser.new_context(viewport={"width": width, "height": height}, offline=on_disk, **context)
    page = made.new_page()
    page.requests, page.words, page.failures = [], [], []
    page.on("request", lambda request: page.requests.append(request.url))
    page.on("console", lambda said: page.words.append((said.type, said.text)))
    page.on("pageerror", lambda error: page.failures.append(str(error)))
    if before:
        page.add_init_script(before)
    page.goto((place.resolve().as_uri() if isinstance(place, Path) else place) + hash)
    page.wait_for_selector("html[data-ready=yes]", timeout=60_000)
    return page
