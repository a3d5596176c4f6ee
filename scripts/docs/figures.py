#!/usr/bin/env python3
"""Draws the figures of the book as SVG files: docs/book/figures/*.svg.

  scripts/docs/figures.py           write all figures
  scripts/docs/figures.py --check   exit with 1 when a committed figure is out of date

Standard library only. The same script gives the same bytes on every machine: all numbers are rounded to 0.1 px.
"""

import argparse
import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

FOLDER = Path(__file__).resolve().parents[2] / "docs/book/figures"

INK = "#24323f"
PALE = "#8796a3"
BLUE = "#1f6fb2"
RED = "#c2452d"
GREEN = "#2e8b57"
SAND = "#f1e9d8"
SKY = "#e8f1f8"
MINT = "#e3f3e9"
ROSE = "#f9e6e1"

Point = tuple[float, float]


def number(value: float) -> str:
    """A coordinate with one decimal, without a trailing zero or a negative zero."""
    text = f"{value + 0.0:.1f}"
    text = text.removesuffix(".0")
    return "0" if text == "-0" else text


class Drawing:
    """An SVG picture under construction. Coordinates in px: x to the right, y down."""

    def __init__(self, width: int, height: int, title: str) -> None:
        self.width, self.height, self.title = width, height, title
        self.parts: list[str] = []

    def add(self, name: str, text: str | None = None, **attributes: object) -> None:
        """Appends an element. Underscores in attribute names become hyphens."""
        pairs = {key.replace("_", "-"): value for key, value in attributes.items() if value is not None}
        shown = "".join(f' {key}="{number(value) if isinstance(value, (int, float)) else value}"' for key, value in pairs.items())
        self.parts.append(f"<{name}{shown}/>" if text is None else f"<{name}{shown}>{escape(text)}</{name}>")

    def rect(self, at: Point, size: Point, fill: str, edge: str | None = INK, radius: float = 6) -> None:
        """A rectangle by its top-left corner and its size."""
        self.add("rect", x=at[0], y=at[1], width=size[0], height=size[1], rx=radius, fill=fill, stroke=edge or "none")

    def line(self, a: Point, b: Point, colour: str = INK, width: float = 1.5, dash: str | None = None) -> None:
        """A straight line."""
        self.add("line", x1=a[0], y1=a[1], x2=b[0], y2=b[1], stroke=colour, stroke_width=width, stroke_dasharray=dash)

    def arrow(self, a: Point, b: Point, colour: str = INK, width: float = 1.5, dash: str | None = None) -> None:
        """A line from a to b with a head at b."""
        angle = math.atan2(b[1] - a[1], b[0] - a[0])
        back = 4 + 3 * width
        neck = (b[0] - 0.8 * back * math.cos(angle), b[1] - 0.8 * back * math.sin(angle))
        self.line(a, neck, colour, width, dash)
        corners = [b]
        for side in (-0.4, 0.4):
            corners.append((b[0] - back * math.cos(angle + side), b[1] - back * math.sin(angle + side)))
        self.polygon(corners, colour, None)

    def path(self, points: Sequence[Point], colour: str = INK, width: float = 1.5) -> None:
        """A polyline with an arrow head at its end."""
        for a, b in zip(points[:-2], points[1:-1], strict=True):
            self.line(a, b, colour, width)
        self.arrow(points[-2], points[-1], colour, width)

    def polygon(self, points: Sequence[Point], fill: str, edge: str | None = INK, width: float = 1.5) -> None:
        """A closed polygon."""
        listed = " ".join(f"{number(x)},{number(y)}" for x, y in points)
        pen = {"stroke": edge or "none", "stroke_width": width, "stroke_linejoin": "round"}
        self.add("polygon", points=listed, fill=fill, **pen)

    def circle(self, at: Point, radius: float, fill: str = INK, edge: str | None = None) -> None:
        """A circle."""
        self.add("circle", cx=at[0], cy=at[1], r=radius, fill=fill, stroke=edge or "none")

    def arc(self, centre: Point, radius: float, start: float, end: float, colour: str = INK) -> None:
        """A circular arc between two angles in rad, counted clockwise on the screen from +x."""
        x0, y0 = centre[0] + radius * math.cos(start), centre[1] + radius * math.sin(start)
        x1, y1 = centre[0] + radius * math.cos(end), centre[1] + radius * math.sin(end)
        turn = 1 if end > start else 0
        shape = f"M{number(x0)} {number(y0)}A{number(radius)} {number(radius)} 0 0 {turn} {number(x1)} {number(y1)}"
        self.add("path", d=shape, fill="none", stroke=colour, stroke_width=1.5)

    def text(
        self,
        at: Point,
        text: str,
        size: float = 14,
        colour: str = INK,
        anchor: str = "middle",
        bold: bool = False,
        italic: bool = False,
    ) -> None:
        """One line of text on a baseline."""
        self.add(
            "text",
            text,
            x=at[0],
            y=at[1],
            font_size=size,
            fill=colour,
            text_anchor=anchor,
            font_weight="bold" if bold else None,
            font_style="italic" if italic else None,
        )

    def box(self, at: Point, size: Point, lines: Sequence[str], fill: str, bold_first: bool = True) -> None:
        """A rounded box with centred lines of text, the first one bold."""
        self.rect(at, size, fill)
        top = at[1] + size[1] / 2 - 8.5 * (len(lines) - 1) + 5
        for i, line in enumerate(lines):
            is_head = i == 0 and bold_first
            self.text((at[0] + size[0] / 2, top + 17 * i), line, 14 if is_head else 12, bold=is_head)

    def svg(self) -> str:
        """The file's text."""
        head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {self.width} {self.height}" '
            f'width="{self.width}" height="{self.height}" font-family="DejaVu Sans, Verdana, sans-serif">'
        )
        background = f'<rect width="{self.width}" height="{self.height}" fill="#ffffff"/>'
        return "\n".join([head, f"<title>{escape(self.title)}</title>", background, *self.parts, "</svg>", ""])


def escape(text: str) -> str:
    """Text as XML content."""
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def data_flow() -> Drawing:
    """From video to tracks."""
    d = Drawing(960, 560, "Data flow: from video to camera and tracks")
    d.rect((12, 34), (936, 134), SKY, None, 10)
    d.text((26, 26), "Perception: streams over the frames, one thread per stage", 14, BLUE, "start", bold=True)
    stages = [
        ("decode", "frames", "with times"),
        ("watch", "camera at rest?", "changed areas"),
        ("detect", "boxes of", "vehicles"),
        ("keypoints", "36 points per car", "with covariances"),
    ]
    d.text((26, 112), "video", 14, anchor="start")
    d.arrow((68, 107), (96, 107))
    x = 96.0
    for name, *lines in stages:
        d.box((x, 70), (150, 74), [name, *lines], "#ffffff")
        d.arrow((x + 150, 107), (x + 180, 107))
        x += 180
    d.box((x, 70), (116, 74), ["frames.jsonl", "one line", "per frame"], SAND)

    d.rect((12, 230), (936, 316), MINT, None, 10)
    d.text((130, 222), "Estimation: mathematics on records, no pictures", 14, GREEN, "start", bold=True)
    d.path([(x + 58, 144), (x + 58, 190), (110, 190), (110, 262)])
    d.box((30, 262), (160, 74), ["windows", "views of cars", "within 30 s"], "#ffffff")
    d.arrow((190, 299), (230, 299))
    d.box((230, 262), (180, 74), ["joint solve", "camera, poses, shapes", "of one window"], "#ffffff")
    d.arrow((410, 299), (450, 299))
    d.box((450, 262), (200, 74), ["fusion", "all windows and factors", "→ camera over time"], "#ffffff")
    d.arrow((650, 299), (700, 299))
    d.box((700, 262), (226, 74), ["camera.json", "focal length, plane, lens,", "each with its sd"], SAND)

    d.box(
        (210, 358),
        (460, 42),
        ["factors: user constraints, scene lines, turns, camera database"],
        ROSE,
        bold_first=False,
    )
    d.arrow((550, 358), (550, 338), RED)

    d.path([(813, 336), (813, 416), (110, 416), (110, 446)])
    d.box((30, 446), (160, 74), ["fit each car", "camera known", "→ pose and shape"], "#ffffff")
    d.arrow((190, 483), (230, 483))
    d.box((230, 446), (180, 74), ["track", "association, smoothing", "→ one shape per track"], "#ffffff")
    d.path([(320, 520), (320, 536), (110, 536), (110, 522)], PALE)
    d.text((215, 532), "second pass with that shape", 11, PALE)
    d.arrow((410, 483), (450, 483))
    d.box((450, 446), (200, 74), ["activity", "turns, starts, stops", "from the motion"], "#ffffff")
    d.arrow((650, 483), (700, 483))
    d.box((700, 446), (226, 74), ["tracks.*, poses.jsonl,", "activities.jsonl,", "report.html"], SAND, bold_first=False)
    return d


def frames_of_reference() -> Drawing:
    """Camera, world and car frames; tilt, roll and height."""
    d = Drawing(960, 660, "Frames of reference: camera, world and car, with tilt, roll and height")
    # Side view: 1 m is 24 px.
    ground, foot = 330.0, 150.0
    eye = (foot, 110.0)
    tilt = math.radians(22)
    d.text((20, 26), "From the side", 15, anchor="start", bold=True)
    d.polygon([(20, ground), (940, ground), (940, ground + 12), (20, ground + 12)], SAND, None)
    d.line((20, ground), (940, ground), INK, 2)
    d.line((eye[0], eye[1]), (700, eye[1]), PALE, 1.2, "6 5")
    d.text((560, eye[1] - 8), "horizontal: every pixel of the horizon", 12, PALE)
    reach = (ground - eye[1]) / math.sin(tilt)
    axis_end = (eye[0] + reach * math.cos(tilt), ground)
    d.line(eye, axis_end, BLUE, 1.5, "6 5")
    d.text((375, 236), "optical axis", 12, BLUE)
    d.arc(eye, 150, 0, tilt, BLUE)
    d.text((eye[0] + 182, eye[1] + 36), "tilt", 14, BLUE, bold=True)
    for angle, name, offset in ((tilt, "z", (12, 4)), (tilt + math.pi / 2, "y", (-12, 6))):
        tip = (eye[0] + 72 * math.cos(angle), eye[1] + 72 * math.sin(angle))
        d.arrow(eye, tip, BLUE, 2.5)
        d.text((tip[0] + offset[0], tip[1] + offset[1]), name, 15, BLUE, italic=True)
    d.circle(eye, 6, BLUE)
    d.text((eye[0] - 10, eye[1] - 16), "camera frame", 13, BLUE, bold=True)
    d.text((eye[0] + 58, eye[1] - 16), "x: towards you", 11, BLUE, "start")
    d.line((90, eye[1]), (90, ground), RED, 1.5)
    d.line((82, eye[1]), (98, eye[1]), RED, 1.5)
    d.line((82, ground), (98, ground), RED, 1.5)
    d.text((80, 226), "height", 14, RED, "end", bold=True)
    d.line(eye, (foot, ground), PALE, 1.2, "3 4")
    d.arrow((foot, ground), (foot, ground - 66), GREEN, 2.5)
    d.text((foot + 14, ground - 56), "z", 15, GREEN, italic=True)
    d.arrow((foot, ground), (foot + 74, ground), GREEN, 2.5)
    d.text((foot + 86, ground - 7), "y", 15, GREEN, italic=True)
    d.text((foot + 106, ground - 7), "x: towards you", 11, GREEN, "start")
    d.circle((foot, ground), 5, GREEN)
    d.text((20, ground + 30), "world frame: origin on the ground below the camera", 13, GREEN, "start", bold=True)
    car_side(d, 800, ground)
    d.arrow((800, ground), (800 - 100, ground), RED, 2.5)
    d.text((800 - 96, ground - 8), "x", 15, RED, italic=True)
    d.arrow((800, ground), (800, ground - 84), RED, 2.5)
    d.text((800 + 13, ground - 78), "z", 15, RED, italic=True)
    d.text((800 + 28, ground - 74), "y: towards you", 11, RED, "start")
    d.circle((800, ground), 5, RED)
    d.text((945, ground + 30), "car frame: on the ground, midway between the axles", 13, RED, "end", bold=True)

    # The picture.
    left, top, width, height = 40.0, 430.0, 320.0, 180.0
    d.text((20, 410), "In the picture", 15, anchor="start", bold=True)
    d.rect((left, top), (width, height), SKY, INK, 0)
    middle = (left + width / 2, top + height / 2)
    roll = math.radians(7)
    above = 58.0
    crossing = (middle[0] + above * math.sin(roll), middle[1] - above * math.cos(roll))

    def along(t: float) -> Point:
        return (crossing[0] + t * math.cos(roll), crossing[1] + t * math.sin(roll))

    d.line(along(-160), along(150), GREEN, 2)
    d.text((left + 8, top + 36), "horizon", 12, GREEN, "start", bold=True)
    d.line((crossing[0] - 4, crossing[1]), (left + width, crossing[1]), PALE, 1.2, "4 4")
    d.arc(crossing, 118, 0, roll, RED)
    d.text((left + width + 8, crossing[1] + 14), "roll", 14, RED, "start", bold=True)
    d.line(middle, crossing, BLUE, 1.5, "5 4")
    d.text((middle[0] - 6, middle[1] - 24), "f · tan(tilt)", 12, BLUE, "end")
    d.circle(middle, 4, BLUE)
    d.text((middle[0], middle[1] + 20), "principal point", 12, BLUE)
    d.arrow((left + 12, top + 110), (left + 62, top + 110), INK, 1.5)
    d.arrow((left + 12, top + 110), (left + 12, top + 160), INK, 1.5)
    d.text((left + 70, top + 114), "x", 13, italic=True)
    d.text((left + 24, top + 164), "y", 13, italic=True)
    d.text((left, top + height + 24), "pixel frame: (0, 0) is the centre of the top-left pixel", 12, anchor="start")

    # From above.
    d.text((500, 410), "From above", 15, anchor="start", bold=True)
    origin = (560.0, 590.0)
    d.arrow(origin, (origin[0] + 80, origin[1]), GREEN, 2.5)
    d.text((origin[0] + 92, origin[1] + 5), "x", 15, GREEN, italic=True)
    d.arrow(origin, (origin[0], origin[1] - 80), GREEN, 2.5)
    d.text((origin[0] - 12, origin[1] - 74), "y", 15, GREEN, italic=True)
    d.circle(origin, 5, GREEN)
    d.text((origin[0], origin[1] + 28), "world (the camera is above this point)", 12, GREEN)
    car = (770.0, 510.0)
    heading = math.radians(35)
    car_above(d, car, heading)
    d.line(car, (car[0] + 120, car[1]), PALE, 1.2, "4 4")
    d.arc(car, 92, 0, -heading, INK)
    d.text((car[0] + 100, car[1] - 26), "heading", 13, INK, "start", bold=True)
    tip = (car[0] + 84 * math.cos(heading), car[1] - 84 * math.sin(heading))
    d.arrow(car, tip, RED, 2.5)
    d.text((tip[0] + 10, tip[1] - 4), "x", 15, RED, italic=True)
    side = (car[0] - 58 * math.sin(heading), car[1] - 58 * math.cos(heading))
    d.arrow(car, side, RED, 2.5)
    d.text((side[0] - 10, side[1] - 2), "y", 15, RED, italic=True)
    d.circle(car, 4, RED)
    d.text((car[0] + 20, car[1] + 80), "car: x forward, y left", 12, RED)
    return d


def car_side(d: Drawing, x: float, ground: float) -> None:
    """A car from its left side, front to the left, the midpoint between its axles at (x, ground)."""
    outline = [(-84, -14), (-84, -30), (-70, -38), (-42, -42), (-22, -62), (34, -62), (62, -42), (82, -38), (84, -14)]
    d.polygon([(x + a, ground + b) for a, b in outline], "#ffffff")
    d.polygon([(x + a, ground + b) for a, b in [(-34, -42), (-18, -57), (4, -57), (4, -42)]], SKY, INK, 1)
    d.polygon([(x + a, ground + b) for a, b in [(10, -42), (10, -57), (31, -57), (50, -42)]], SKY, INK, 1)
    for wheel in (-50, 50):
        d.circle((x + wheel, ground - 13), 13, INK)
        d.circle((x + wheel, ground - 13), 6, "#ffffff")


def car_above(d: Drawing, at: Point, heading: float) -> None:
    """A car from above: heading in rad, counter-clockwise from +x."""

    def turned(forward: float, to_left: float) -> Point:
        x = forward * math.cos(heading) - to_left * math.sin(heading)
        y = forward * math.sin(heading) + to_left * math.cos(heading)
        return (at[0] + x, at[1] - y)

    d.polygon([turned(a, b) for a, b in [(58, 18), (58, -18), (50, -24), (-54, -24), (-54, 24), (50, 24)]], "#ffffff")
    d.polygon([turned(a, b) for a, b in [(24, 19), (24, -19), (12, -16), (12, 16)]], SKY, INK, 1)
    for axle in (34, -34):
        d.line(turned(axle, -26), turned(axle, 26), PALE, 2.5)


def focal_length() -> Drawing:
    """Why cars on one plane determine the focal length."""
    d = Drawing(960, 640, "Why cars on one plane determine the focal length")
    # The picture: a camera without roll. The vertical vanishing point is below the picture.
    d.text((20, 26), "1. In the picture", 15, anchor="start", bold=True)
    horizon, middle_x = 84.0, 220.0
    vanishing = (middle_x, 520.0)
    d.rect((40, 60), (360, 250), SKY, INK, 0)
    d.polygon([(40, horizon), (400, horizon), (400, 310), (40, 310)], SAND, None)
    d.rect((40, 60), (360, 250), "none", INK, 0)
    d.line((40, horizon), (400, horizon), GREEN, 2)
    d.text((406, horizon + 5), "horizon", 13, GREEN, "start", bold=True)
    for x, base in ((150.0, 285.0), (300.0, 225.0), (185.0, 170.0), (250.0, 125.0)):
        scale = (base - horizon) / 200
        box_on_ground(d, (x, base), scale, vanishing)
    d.circle(vanishing, 5, RED)
    d.text((vanishing[0] + 12, vanishing[1] + 5), "vertical vanishing point", 13, RED, "start", bold=True)
    notes = [
        "A car twice as far below the horizon appears twice as large:",
        "sizes determine the horizon and the camera's height.",
        "The cars' vertical edges meet in one point. Its position depends",
        "on how steeply the camera looks down at each car.",
    ]
    for i, note in enumerate(notes):
        d.text((20, 562 + 18 * i), note, 12, anchor="start")

    # The section: right angle at the optical centre.
    d.text((500, 26), "2. From the side", 15, anchor="start", bold=True)
    tilt = math.radians(35)
    eye = (540.0, 190.0)
    focal = 200.0
    along, up = (math.cos(tilt), math.sin(tilt)), (math.sin(tilt), -math.cos(tilt))
    principal = (eye[0] + focal * along[0], eye[1] + focal * along[1])
    to_horizon, to_vertical = focal * math.tan(tilt), focal / math.tan(tilt)

    def on_plane(t: float) -> Point:
        return (principal[0] + t * up[0], principal[1] + t * up[1])

    at_horizon, at_vertical = on_plane(to_horizon), on_plane(-to_vertical)
    d.line(on_plane(to_horizon + 50), on_plane(-to_vertical - 30), INK, 2)
    label = on_plane(to_horizon + 60)
    d.text((label[0] - 6, label[1] - 4), "image plane", 13)
    d.line(eye, at_horizon, GREEN, 2)
    d.line(eye, at_vertical, RED, 2)
    d.line(eye, principal, BLUE, 2)
    square = 16.0
    d.line((eye[0] + square, eye[1]), (eye[0] + square, eye[1] + square), INK, 1.2)
    d.line((eye[0], eye[1] + square), (eye[0] + square, eye[1] + square), INK, 1.2)
    d.arc(eye, 70, 0, tilt, BLUE)
    d.text((eye[0] + 86, eye[1] + 30), "tilt", 13, BLUE, bold=True)
    d.text((eye[0] - 10, eye[1] - 10), "camera", 13, INK)
    d.text((eye[0] + 130, eye[1] - 10), "horizontal ray", 12, GREEN)
    d.text((eye[0] - 12, eye[1] + 130), "vertical", 12, RED, "end")
    d.text((eye[0] - 12, eye[1] + 146), "ray", 12, RED, "end")
    d.text((eye[0] + 92, eye[1] + 92), "f", 16, BLUE, italic=True, bold=True)
    for at, colour in ((eye, INK), (principal, BLUE), (at_horizon, GREEN), (at_vertical, RED)):
        d.circle(at, 5, colour)
    d.text((principal[0] + 12, principal[1] + 14), "principal point", 12, BLUE, "start")
    near = on_plane(to_horizon / 2)
    d.text((near[0] + 14, near[1] + 8), "a = f · tan(tilt)", 14, GREEN, "start", bold=True)
    far = on_plane(-to_vertical / 2)
    d.text((far[0] + 14, far[1] + 8), "b = f / tan(tilt)", 14, RED, "start", bold=True)
    d.rect((690, 470), (240, 54), MINT)
    d.text((810, 493), "a · b = f²", 18, bold=True)
    d.text((810, 513), "tan(tilt)² = a / b", 12)
    return d


def box_on_ground(d: Drawing, at: Point, scale: float, vanishing: Point) -> None:
    """A box on the ground whose vertical edges point to the vanishing point; `at`: middle of its front edge."""
    corners = [(at[0] - 60 * scale, at[1]), (at[0] + 60 * scale, at[1])]
    tops = []
    for x, y in corners:
        dx, dy = x - vanishing[0], y - vanishing[1]
        grow = 46 * scale / -dy
        tops.append((x + dx * grow, y + dy * grow))
        d.line((x, y), vanishing, ROSE if scale < 0.3 else "#e9b8ab", 1, "3 4")
    back = [(t[0] * 0.93 + 0.07 * vanishing[0], t[1] - 18 * scale) for t in tops]
    d.polygon([*tops, back[1], back[0]], "#ffffff", INK, 1.2)
    d.polygon([corners[0], tops[0], tops[1], corners[1]], "#dfe7ee", INK, 1.2)
    for (x, y), top in zip(corners, tops, strict=True):
        d.line((x, y), top, RED, 2)


def arrow_matrix() -> Drawing:
    """Which blocks of the normal equations are not zero."""
    d = Drawing(860, 560, "The arrow structure of the normal equations")
    # Name, side in unknowns, group.
    blocks = [
        ("pose 1", 3, 1),
        ("shape 1", 6, 1),
        ("pose 2a", 3, 2),
        ("pose 2b", 3, 2),
        ("shape 2", 6, 2),
        ("pose 3", 3, 3),
        ("shape 3", 6, 3),
        ("camera", 4, 0),
    ]
    colours = {"pose": "#9cc3e4", "shape": "#a9d8bd", "camera": "#efb5a6"}
    unit, left, top = 13.0, 110.0, 60.0
    edges = [0]
    for _, side, _ in blocks:
        edges.append(edges[-1] + side)
    total = edges[-1] * unit

    def filled(i: int, j: int) -> str | None:
        (a, _, group_a), (b, _, group_b) = blocks[i], blocks[j]
        if "camera" in (a, b):
            return colours["camera"]
        if group_a != group_b or (i != j and a.startswith("pose") and b.startswith("pose")):
            return None
        kinds = {name.split()[0] for name in (a, b)}
        return colours["shape"] if "shape" in kinds else colours["pose"]

    d.text((left, 30), "Normal equations of a window with three cars", 15, anchor="start", bold=True)
    d.rect((left, top), (total, total), "#fbfbfb", PALE, 0)
    for i, (name, _, _) in enumerate(blocks):
        for j in range(len(blocks)):
            if colour := filled(i, j):
                d.rect(
                    (left + edges[j] * unit, top + edges[i] * unit),
                    ((edges[j + 1] - edges[j]) * unit, (edges[i + 1] - edges[i]) * unit),
                    colour,
                    "#ffffff",
                    0,
                )
        d.text((left - 8, top + (edges[i] + edges[i + 1]) / 2 * unit + 4), name, 12, anchor="end")
    for start, end in ((0, 2), (2, 5), (5, 7)):
        corner = (left + edges[start] * unit, top + edges[start] * unit)
        side = (edges[end] - edges[start]) * unit
        d.add("rect", x=corner[0], y=corner[1], width=side, height=side, fill="none", stroke=INK, stroke_width=1.5)
    x = left + total + 24
    legend = [
        ("pose", ["pose of a view:", "x, y, heading (3)"]),
        ("shape", ["shape of a car (6),", "shared by all its views"]),
        ("camera", ["camera (4): log f, tilt, roll,", "log height; touches all cars"]),
    ]
    for i, (kind, lines) in enumerate(legend):
        y = top + 8 + 62 * i
        d.rect((x, y), (26, 26), colours[kind], None, 3)
        for k, line in enumerate(lines):
            d.text((x + 36, y + 11 + 17 * k), line, 12, anchor="start")
    steps = [
        "White blocks are zero: no term links",
        "two cars except through the camera.",
        "",
        "1. Per view: eliminate its pose.",
        "2. Per car: eliminate its shape.",
        "3. Solve the 4 × 4 system that is left.",
        "4. Substitute back.",
        "",
        "The cost is linear in the number of views.",
    ]
    for i, step in enumerate(steps):
        d.text((x, top + 236 + 19 * i), step, 12, anchor="start")
    return d


FIGURES: dict[str, Callable[[], Drawing]] = {
    "data_flow": data_flow,
    "frames": frames_of_reference,
    "focal_length": focal_length,
    "normal_equations": arrow_matrix,
}


def main() -> int:
    """Writes the figures, or compares them with the committed ones. Returns the exit status."""
    parser = argparse.ArgumentParser(description="Draws the figures of the book.")
    parser.add_argument("--check", action="store_true", help="write nothing; fail when a committed figure differs")
    args = parser.parse_args()
    stale = []
    for name, draw in FIGURES.items():
        path = FOLDER / f"{name}.svg"
        text = draw().svg()
        if not args.check:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        elif not path.exists() or path.read_text(encoding="utf-8") != text:
            stale.append(path.name)
    if stale:
        print(f"out of date: {', '.join(stale)}; run scripts/docs/figures.py", file=sys.stderr)
    return 1 if stale else 0


if __name__ == "__main__":
    sys.exit(main())
