"""Draws on a frame of a report in a browser, saves the files, and compares them with the clicks."""

import csv
import json
import re
import tempfile
from pathlib import Path

from playwright.sync_api import CDPSession, Locator, Page, expect

# Largest difference between a click and its coordinates in a file, px of the frame. Files have hundredths.
EXACT_PX = 0.0051
# Surveyed points of the demo clip: pixel, latitude, longitude. The book has the same points (docs/book/map.md).
SURVEY = [
    (197, 397, "51.0499307", "13.7403077"),
    (457, 222, "51.0498413", "13.7404137"),
    (799, 499, "51.0498895", "13.7401678"),
    (864, 257, "51.0497994", "13.7402776"),
]


class Sheet:
    """The frame that is drawn on: converts its pixels to points of the screen, and clicks there."""

    def __init__(self, page: Page, touch: bool) -> None:
        self.page, self.touch = page, touch
        self.data = page.evaluate("JSON.parse(document.getElementById('draw-data').textContent)")
        self.size: list[int] = self.data["size"]
        self.svg: Locator = page.locator("#draw-picture svg")
        page.click("#draw summary")
        page.wait_for_timeout(500)

    def screen(self, x: float, y: float) -> tuple[int, int]:
        """Returns the point of the screen, in whole px, that is nearest to a pixel of the frame."""
        self.svg.evaluate("svg => svg.scrollIntoView({block: 'center'})")
        box = self.svg.bounding_box()
        assert box
        return round(box["x"] + (x + 0.5) * box["width"] / self.size[0]), round(
            box["y"] + (y + 0.5) * box["height"] / self.size[1]
        )

    def pixel(self, at: tuple[int, int]) -> list[float]:
        """Returns the pixel of the frame at a point of the screen. The centre of the first pixel is (0, 0)."""
        box = self.svg.bounding_box()
        assert box
        return [
            (at[0] - box["x"]) * self.size[0] / box["width"] - 0.5,
            (at[1] - box["y"]) * self.size[1] / box["height"] - 0.5,
        ]

    def click(self, x: float, y: float) -> list[float]:
        """Clicks near a pixel of the frame, and returns the exact pixel of the click."""
        at = self.screen(x, y)
        pixel = self.pixel(at)
        if self.touch:
            self.page.touchscreen.tap(*at)
        else:
            self.page.mouse.click(*at)
        return pixel

    def shares(self, *points: tuple[float, float]) -> list[list[float]]:
        """Clicks at points that are given as shares of the width and the height."""
        return [self.click(x * self.size[0], y * self.size[1]) for x, y in points]

    def drag(self, start: list[float], x: float, y: float) -> list[float]:
        before, at = self.screen(*start), self.screen(x, y)
        pixel = self.pixel(at)
        self.page.mouse.move(*before)
        self.page.mouse.down()
        self.page.mouse.move((before[0] + at[0]) / 2, at[1], steps=3)
        self.page.mouse.move(*at)
        self.page.mouse.up()
        return pixel

    def saved(self) -> str:
        with self.page.expect_download() as download:
            self.page.click("#draw [data-do=save]")
        path = Path(tempfile.mkdtemp()) / download.value.suggested_filename
        download.value.save_as(path)
        return path.read_text()

    def open(self, name: str, text: str, words: str) -> None:
        """Opens a file, and waits for a message with these words."""
        file = {"name": name, "mimeType": "", "buffer": text.encode()}
        self.page.set_input_files("#draw input[type=file]", file)
        expect(self.page.locator("#draw-said")).to_contain_text(words)

    def names(self) -> list[str]:
        return [field.input_value() for field in self.page.locator("#draw input[data-key=name]").all()]

    def mode(self, name: str) -> None:
        self.page.click(f"#draw [data-mode={name}]")


def same(found: list[list[float]], clicks: list[list[float]]) -> None:
    assert len(found) == len(clicks), (found, clicks)
    for point, click in zip(found, clicks, strict=True):
        assert all(abs(a - b) <= EXACT_PX for a, b in zip(point, click, strict=True)), (point, click)


def gates(sheet: Sheet) -> str:
    """Draws two gates and a zone, edits them, and compares the saved file with the clicks."""
    page = sheet.page
    entrance = sheet.shares((0.2, 0.3), (0.45, 0.35))
    page.keyboard.press("Enter")
    exit_ = sheet.shares((0.6, 0.3), (0.7, 0.45), (0.8, 0.5))
    sheet.shares((0.8, 0.5))  # a click on the last point finishes the gate
    zone = sheet.shares((0.15, 0.55), (0.5, 0.55), (0.5, 0.85), (0.15, 0.9))
    sheet.shares((0.15, 0.55))  # a click on the first point closes the zone
    assert sheet.names() == ["gate 1", "gate 2", "zone 1"]
    page.locator("#draw input[data-key=name]").nth(0).fill("entrance; north")
    assert page.inner_text("#player-clock") == "0:00.0" and page.is_hidden("#player-detail"), "keys stay in the field"

    # Escape cancels a drawing. A point is moved, and another is deleted and brought back.
    sheet.shares((0.9, 0.9), (0.95, 0.95))
    page.keyboard.press("Escape")
    assert page.locator("#draw-list .entry").count() == 3
    entrance[1] = sheet.drag(entrance[1], 0.4 * sheet.size[0], 0.4 * sheet.size[1])
    sheet.click(*exit_[1])
    page.keyboard.press("Delete")
    assert len(json.loads(sheet.saved())["features"][1]["geometry"]["coordinates"]) == 2
    page.keyboard.press("Control+z")
    sheet.click(*exit_[2])
    page.keyboard.press("Shift+ArrowLeft")
    page.keyboard.press("ArrowUp")
    exit_[2] = [exit_[2][0] - 10, exit_[2][1] - 1]

    text = sheet.saved()
    file = json.loads(text)
    assert file["type"] == "FeatureCollection" and file["coordinates"] == "pixels"
    assert file["image_size_px"] == sheet.size and file["frame"] == sheet.data["stills"][0]["frame"]
    assert file["segment"] == 0
    kinds = [(feature["properties"]["name"], feature["geometry"]["type"]) for feature in file["features"]]
    assert kinds == [("entrance; north", "LineString"), ("gate 2", "LineString"), ("zone 1", "Polygon")]
    lines = [feature["geometry"]["coordinates"] for feature in file["features"]]
    same(lines[0], entrance)
    same(lines[1], exit_)
    same(lines[2][0], [*zone, zone[0]])

    # The arrow of a gate points from the left side of its direction to the right side.
    (x0, y0), (x1, y1) = entrance
    arrow = page.locator("#draw-picture g[data-id='1'] path[fill=none]").last.get_attribute("d")
    assert arrow
    tail, tip = (tuple(map(float, point.split(" "))) for point in arrow[1:].split("M")[0].split("L"))
    assert (x1 - x0) * (tip[1] - tail[1]) - (y1 - y0) * (tip[0] - tail[0]) > 0, "forward is from left to right"

    # Two names that are the same are rejected.
    page.locator("#draw input[data-key=name]").nth(1).fill("zone 1")
    assert "Two drawings" in page.inner_text("#draw-said") and page.is_disabled("#draw [data-do=save]")
    page.keyboard.press("Escape")
    return text


def load(sheet: Sheet, text: str) -> None:
    """Opens a file of gates in an empty page, goes on drawing, and saves it again."""
    page = sheet.page

    def opened(value: dict, words: str) -> None:
        sheet.open("gates.geojson", json.dumps(value), words)

    file = json.loads(text)
    file["features"][0]["properties"]["road"] = "A 4"
    opened({**file, "coordinates": "metres"}, "metres")
    opened({**file, "image_size_px": [10, 90]}, "10 × 90 px")
    opened(file, "3 drawings")
    added = sheet.shares((0.9, 0.1), (0.95, 0.2))
    page.keyboard.press("Enter")
    again = json.loads(sheet.saved())
    assert again["features"][:3] == file["features"], "other properties stay"
    same(again["features"][3]["geometry"]["coordinates"], added)


def lengths_and_points(sheet: Sheet, save: Path | None) -> None:
    """Draws lengths and surveyed points, and compares the tables with the clicks."""
    page = sheet.page
    sheet.mode("lengths")
    ends = [sheet.click(412, 688), sheet.click(902, 691)]
    page.keyboard.type("5.08")  # the field has the focus
    page.locator("#draw input[data-key=name]").fill('two bays, "front"')
    assert page.is_enabled("#draw [data-do=save]")
    text = sheet.saved()
    (row,) = csv.DictReader(text.splitlines())
    same([[float(row["x1"]), float(row["y1"])], [float(row["x2"]), float(row["y2"])]], ends)
    assert (row["length_m"], row["sd_m"], row["name"]) == ("5.08", "0.102", 'two bays, "front"')
    assert float(row["pixel_sd"]) >= 1 and "frame" not in row, "the camera is at rest"
    page.fill("#draw input[data-key=sd]", "6")
    assert "sd must be" in page.inner_text("#draw-said") and page.is_disabled("#draw [data-do=save]")
    page.fill("#draw input[data-key=sd]", "0.03")
    text = sheet.saved()

    sheet.mode("points")
    clicks = []
    for x, y, latitude, longitude in SURVEY:
        clicks.append(sheet.click(x, y))
        # Both numbers are pasted into the first field.
        page.locator("#draw input[data-key=latitude]").last.fill(f"{latitude}, {longitude}")
    points = sheet.saved()
    rows = list(csv.DictReader(points.splitlines()))
    same([[float(row["x_px"]), float(row["y_px"])] for row in rows], clicks)
    assert [(row["latitude"], row["longitude"], row["height_m"]) for row in rows] == [
        (latitude, longitude, "0") for _, _, latitude, longitude in SURVEY
    ]
    sheet.open("bays.csv", text, "bays.csv: 1 row")
    assert sheet.names() == ['two bays, "front"'] * 2, "a table is opened again"
    if save:
        (save / "lengths.csv").write_text(text)
        (save / "points.csv").write_text(points)


def without_mouse(sheet: Sheet) -> None:
    """Draws a gate with the keyboard alone, in a zoomed picture."""
    page = sheet.page
    sheet.mode("gates")
    before = page.locator("#draw-list .entry").count()
    page.click("#draw [data-zoom='1.5']")
    sheet.svg.focus()
    page.keyboard.press("Escape")
    for key in ["ArrowLeft"] * 8 + ["Space"] + ["ArrowDown"] * 6 + ["Space", "Enter"]:
        page.keyboard.press(key)
    assert page.locator("#draw-list .entry").count() == before + 1
    line = json.loads(sheet.saved())["features"][-1]["geometry"]["coordinates"]
    box = sheet.svg.bounding_box()
    assert box
    step = 12 * sheet.size[0] / box["width"] / 1.5
    middle = [(side - 1) / 2 for side in sheet.size]
    expected = [[middle[0] - 8 * step, middle[1]], [middle[0] - 8 * step, middle[1] + 6 * step]]
    same(line, expected)
    page.keyboard.press("Delete")
    page.click("#draw [data-zoom='0']")


def with_fingers(sheet: Sheet, session: CDPSession) -> None:
    """Draws a gate by touch, and moves a point with a finger."""
    page = sheet.page
    line = sheet.shares((0.2, 0.4), (0.6, 0.5))
    page.tap("#draw [data-do=gate]")
    at, to = sheet.screen(*line[1]), sheet.screen(0.7 * sheet.size[0], 0.7 * sheet.size[1])
    for kind, point in [("touchStart", at), ("touchMove", ((at[0] + to[0]) / 2, to[1])), ("touchMove", to)]:
        touch = {"type": kind, "touchPoints": [{"x": point[0], "y": point[1]}]}
        session.send("Input.dispatchTouchEvent", touch)
    session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    line[1] = sheet.pixel(to)
    same(json.loads(sheet.saved())["features"][0]["geometry"]["coordinates"], line)


def moving(page: Page, report: Path, folder: Path) -> None:
    """Tests a report whose camera moves: a drawing belongs to its frame, and tables name the frame."""
    copy = folder / "moving.html"
    text, count = re.subn(r'"moving":false', '"moving":true', report.read_text())
    assert count == 1
    copy.write_text(text)
    page.goto(copy.as_uri())
    sheet = Sheet(page, False)
    first, second = (still["frame"] for still in sheet.data["stills"][:2])
    sheet.shares((0.2, 0.3), (0.4, 0.3))
    page.keyboard.press("Enter")
    page.select_option("#draw-frame select", str(second))
    assert not sheet.names(), "the drawing belongs to the other frame"
    sheet.shares((0.5, 0.5), (0.6, 0.6))
    page.keyboard.press("Enter")
    file = json.loads(sheet.saved())
    assert file["frame"] == second and len(file["features"]) == 1
    assert "1 drawing of other frames" in page.inner_text("#draw-said")
    sheet.mode("lengths")
    sheet.shares((0.5, 0.5), (0.6, 0.6))
    page.locator("#draw input[data-key=metres]").fill("4")
    page.select_option("#draw-frame select", str(first))
    sheet.shares((0.2, 0.5), (0.3, 0.6))
    page.locator("#draw input[data-key=metres]").fill("3")
    rows = list(csv.DictReader(sheet.saved().splitlines()))
    assert [(row["length_m"], row["frame"]) for row in rows] == [("4", str(second)), ("3", str(first))]


def draw_on(page: Page, report: Path, touch: bool, shots: Path | None, save: Path | None) -> None:
    """Tests the drawing part of a report. With `save`, the drawn files are kept in that folder."""

    def shot(name: str) -> None:
        if shots:
            page.locator("#draw").screenshot(path=shots / f"{name}.png")

    sheet = Sheet(page, touch)
    if touch:
        with_fingers(sheet, page.context.new_cdp_session(page))
        shot("drawn")
        return
    text = gates(sheet)
    if save:
        (save / "gates.geojson").write_text(text)
    shot("gates")
    fresh = page.context.new_page()
    fresh.goto(page.url)
    load(Sheet(fresh, touch), text)
    with tempfile.TemporaryDirectory() as folder:
        moving(fresh, report, Path(folder))
    fresh.close()
    lengths_and_points(sheet, save)
    shot("points")
    sheet.mode("gates")
    page.locator("#draw input[data-key=name]").nth(1).fill("exit")
    without_mouse(sheet)
