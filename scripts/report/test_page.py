"""Tests a report in a browser: playing, clicking, keys, drawing, the layout on a phone, and the page without scripts.

  test_page.py REPORT.html [--shots FOLDER] [--save FOLDER]

It needs Chromium, and is skipped with a message if there is none.
"""

import argparse
import shutil
import sys
from pathlib import Path

from drawing import draw_on
from playwright.sync_api import Page, sync_playwright

BROWSERS = ["chromium", "chromium-headless-shell", "chromium-browser", "google-chrome"]

# Script that returns the number of different colours of a canvas.
COUNT_COLOURS = """(selector) => {
    const canvas = document.querySelector(selector);
    const pixels = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
    const seen = new Set();
    for (let i = 0; i < pixels.length; i += 4 * 53) seen.add((pixels[i] << 16) | (pixels[i + 1] << 8) | pixels[i + 2]);
    return seen.size;
}"""

# Script that returns the number of chips that the lower edge of their list cuts, if there are 400 chips.
CUT_CHIPS = """() => {
    const list = document.getElementById("player-list"), count = list.children.length;
    for (let i = count; i < 400; i++) list.append(list.firstElementChild.cloneNode(true));
    const bottom = list.getBoundingClientRect().bottom;
    const rows = [...list.children].map((chip) => chip.getBoundingClientRect());
    while (list.children.length > count) list.lastElementChild.remove();
    return rows.filter((row) => row.top < bottom - 0.5 && row.bottom > bottom + 0.5).length;
}"""


def painted(page: Page, selector: str) -> int:
    """Returns how many different colours a canvas shows, in every 53rd pixel."""
    return page.evaluate(COUNT_COLOURS, selector)


def clock(page: Page) -> str:
    page.wait_for_timeout(150)
    return page.inner_text("#player-clock")


def seek(page: Page, time: float) -> None:
    page.evaluate(
        """(time) => {
            const slider = document.getElementById("player-time");
            slider.value = time;
            slider.dispatchEvent(new Event("input"));
        }""",
        time,
    )
    page.wait_for_timeout(300)


def chosen(page: Page) -> str | None:
    page.wait_for_timeout(150)
    return page.inner_text("#player-detail h3") if page.is_visible("#player-detail") else None


def look_around(page: Page, shots: Path | None) -> None:
    def shot(name: str) -> None:
        if shots:
            page.screenshot(path=shots / f"{name}.png")

    data = page.evaluate("JSON.parse(document.getElementById('player-data').textContent)")
    assert data["tracks"] and data["frames"], "a report of a clip with vehicles is wanted"
    page.wait_for_timeout(500)
    assert painted(page, "#player-picture canvas") > 200, "the picture is there"
    assert painted(page, "#player-above canvas") > 5, "and the view from above"
    shot("begin")

    # Play and stop.
    begin = clock(page)
    page.click("#player-play")
    page.wait_for_timeout(1000)
    page.click("#player-play")
    page.wait_for_selector("#player-play[aria-label=play]")
    played = clock(page)
    assert played != begin, "time goes on"
    page.wait_for_timeout(300)
    assert clock(page) == played, "and stands still"

    # Scrub.
    middle = data["frames"][len(data["frames"]) // 2][0]
    seek(page, middle)
    before = clock(page)
    page.keyboard.press("ArrowRight")
    assert clock(page) != before, "the next picture"
    page.keyboard.press("ArrowLeft")

    # The list, keys, and back.
    page.click("#player-list button")
    first = chosen(page)
    assert first and first.endswith(str(data["tracks"][0]["id"]))
    drives = data["tracks"][0]["top"] >= 0.3
    assert page.locator("#player-detail svg polyline").count() == (1 if drives else 0), "its speed, if it has one"
    assert page.locator("#player-detail .views img").count() == len(data["tracks"][0]["crops"]), "its cut-outs"
    page.keyboard.press("Escape")
    assert chosen(page) is None

    # A click on a vehicle in the picture; where two boxes overlap, on the smaller one.
    at = data["frames"][0][0]
    there = [t for t in data["tracks"] if t["t"][0] <= at + 0.02]
    track = max(there, key=lambda t: (t["bbox"][0][2] - t["bbox"][0][0]) * (t["bbox"][0][3] - t["bbox"][0][1]))
    seek(page, at)
    page.locator("#player-picture canvas").scroll_into_view_if_needed()
    box = page.locator("#player-picture canvas").bounding_box()
    scale = box["width"] / data["size"][0]
    x0, y0, x1, y1 = track["bbox"][0]
    page.mouse.click(box["x"] + scale * (x0 + x1) / 2, box["y"] + scale * (y0 + y1) / 2)
    assert chosen(page), "a click in the picture chooses"
    shot("chosen")
    page.keyboard.press("Escape")
    page.keyboard.press("n")
    assert chosen(page) == first
    page.keyboard.press("n")
    if len(data["tracks"]) > 1:
        assert chosen(page) != first

    # Colours.
    for by in ["class", "speed", "activity"]:
        page.select_option("#player-colour", by)
        page.wait_for_timeout(150)
        assert page.locator("#player-legend .dot").count() >= 3, by
    shot("activity")

    # Zoom in, and back to the whole.
    page.click("#player-above [data-zoom='1.4']")
    page.click("#player-above [data-zoom='0']")

    assert "track=" in page.evaluate("location.hash"), "the address can be passed on"


def fits(page: Page) -> None:
    """Checks that no table or plan is wider than the page outside a box that scrolls, and that no chip is cut."""
    wide = page.evaluate(
        """() => [...document.querySelectorAll("table, svg.birdseye")].filter((part) => {
            const box = part.closest(".scroll");
            return !box || box.getBoundingClientRect().right > document.documentElement.clientWidth;
        }).length"""
    )
    assert not wide, f"{wide} tables or plans do not scroll in a box of their own"
    cut = page.evaluate(CUT_CHIPS)
    assert not cut, f"{cut} chips of the list of vehicles are cut"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("report", type=Path)
    parser.add_argument("--shots", type=Path, help="folder for pictures of the page")
    parser.add_argument("--save", type=Path, help="folder for the drawn files")
    args = parser.parse_args()
    browser_path = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser_path is None:
        print(f"skipped: none of {', '.join(BROWSERS)} is installed")
        return 0
    if args.shots:
        args.shots.mkdir(parents=True, exist_ok=True)
    address = args.report.resolve().as_uri()
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=browser_path, args=["--no-sandbox"])
        for name, width, height in [("desk", 1280, 1000), ("phone", 360, 780)]:
            is_phone = name == "phone"
            context = browser.new_context(viewport={"width": width, "height": height}, has_touch=is_phone)
            page = context.new_page()
            wrong: list[str] = []
            context.on("weberror", lambda error: wrong.append(str(error.error)))
            page.on("console", lambda message: wrong.append(message.text) if message.type == "error" else None)
            asked: list[str] = []
            page.on("request", lambda request: asked.append(request.url))
            page.goto(address)
            shots = args.shots / name if args.shots else None
            look_around(page, shots)
            page.goto("about:blank")
            page.goto(address)
            draw_on(page, args.report, is_phone, shots, args.save)
            fits(page)
            over = page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")
            assert over <= 0, f"{over} px too wide for a {name}"
            assert not wrong, wrong
            outside = [url for url in asked if not url.startswith(("file:", "data:", "blob:", "about:"))]
            assert not outside, f"the page asks the network: {outside}"
            track = page.evaluate("JSON.parse(document.getElementById('player-data').textContent).tracks.at(-1)")
            linked = context.new_page()
            linked.goto(f"{address}#t={track['t'][0]}&track={track['id']}")
            assert chosen(linked) == f"{track['class']} {track['id']}", "an address leads to a vehicle at a time"
            context.close()
        plain = browser.new_context(java_script_enabled=False).new_page()
        plain.goto(address)
        assert not plain.is_visible("#player"), "nothing that does not work is shown"
        said = plain.inner_text("main")
        for heading in ["Camera", "From above", "tracks", "Run"]:
            assert heading in said, heading
        browser.close()
    print("the report plays, takes selections, fits a phone and works without scripts")
    return 0


if __name__ == "__main__":
    sys.exit(main())
