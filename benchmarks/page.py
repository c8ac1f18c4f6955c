"""Measure the frames per second of pages in headless Chromium without a GPU: the median over ten seconds of playing.

    python benchmarks/page.py runs/paper-physics/report.html ...

Needs playwright and a Chromium; see tests/page. Also prints the size of each page and how long it takes to open.
"""

import statistics
import sys
import time
from itertools import pairwise
from pathlib import Path

from tests.page.browser import open_browser, open_page

SECONDS = 10.0
FRAMES = """seconds => new Promise(done => {
  const times = [], begun = performance.now();
  let before = window.mjsheaf.frames;
  window.mjsheaf.clock.play();
  const tick = now => {
    if (window.mjsheaf.frames > before) { before = window.mjsheaf.frames; times.push(now); }
    if (now - begun < 1000 * seconds) requestAnimationFrame(tick); else done(times);
  };
  requestAnimationFrame(tick);
})"""


def main() -> None:
    """Measure every page that is named."""
    with open_browser() as browser:
        for name in sys.argv[1:]:
            path = Path(name).resolve()
            begun = time.perf_counter()
            page = open_page(browser, path, width=1280, height=720)
            opened = time.perf_counter() - begun
            times = page.evaluate(FRAMES, SECONDS)
            each = [after - before for before, after in pairwise(times)]
            rate = 1000.0 / statistics.median(each)
            print(f"{name}: {path.stat().st_size / 1e6:.2f} MB, opens in {opened:.1f} s, {rate:.1f} frames/s (median)")
            page.context.close()


if __name__ == "__main__":
    main()
