"""How soon a map of 100,000 signs answers to the hand, and how smoothly it moves.

Prints milliseconds from the request of the page to its being ready, and of each redraw while
the map is dragged and zoomed, in headless Chromium without a graphics card. The peer in the same
run is the same page with 1000 signs.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from pipeline.view.command import serving
from tests.browser import launched, watched
from tests.unit.view_maps import write_large_map

_REDRAWS = """async ([steps, zoom]) => {
  const map = globalThis.automapMap, times = [];
  for (let k = 0; k < steps; k++) {
    const start = performance.now();
    if (zoom) map.zoomBy(1.12); else map.panBy(Math.cos(k) * 30, Math.sin(k) * 30);
    map.draw();
    times.push(performance.now() - start);
    await new Promise(requestAnimationFrame);
  }
  times.sort((a, b) => a - b);
  return {median: times[steps >> 1], p95: times[Math.floor(0.95 * steps)]};
}"""


def measure(count: int) -> dict[str, float]:
    """Figures in milliseconds for one size."""
    with tempfile.TemporaryDirectory() as folder:
        out = write_large_map(Path(folder) / "map", count)
        start = time.perf_counter()
        with serving(out) as server:
            served = time.perf_counter() - start
            with launched() as browser:
                page = browser.new_page(viewport={"width": 1440, "height": 900})
                troubles = watched(page)
                page.goto(server.url)
                page.wait_for_selector("html[data-ready]")
                ready = float(page.evaluate("document.documentElement.dataset.ready"))
                pan = page.evaluate(_REDRAWS, [60, False])
                zoom = page.evaluate(_REDRAWS, [80, True])
                start = time.perf_counter()
                page.keyboard.press("n")
                page.wait_for_selector("#accept")
                card = time.perf_counter() - start
                if troubles:
                    raise SystemExit("\n".join(troubles))
    return {
        "server ready": 1e3 * served,
        "page ready": ready,
        "redraw while panning, median": pan["median"],
        "redraw while panning, 95 %": pan["p95"],
        "redraw while zooming in, median": zoom["median"],
        "redraw while zooming in, 95 %": zoom["p95"],
        "card of a sign": 1e3 * card,
    }


if __name__ == "__main__":
    small, large = measure(1_000), measure(100_000)
    for name, value in large.items():
        print(f"{name:<34} {value:8.1f} ms   1000 signs: {small[name]:8.1f} ms")
    print(json.dumps(large))
