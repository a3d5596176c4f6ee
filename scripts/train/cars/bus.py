"""City buses and coaches."""

from __future__ import annotations

import numpy as np

from .fittings import WHEEL_M, along, both, doors, head_lamps, mirrors, plates, tail_lamps, wheels, windscreen
from .solids import Span, box, on_end, on_side, prism
from .surface import Shell

# Ranges of sizes, m: common buses of Europe, ESTIMATES.
LENGTH = {"city": (10.5, 12.2), "coach": (11.8, 13.6)}
HEIGHT = {"city": (2.9, 3.15), "coach": (3.4, 3.75)}
WIDTH = (2.5, 2.55)
SKIRT_M = 0.3  # height of the body's lower edge
ARCH_M = 1.08  # height of the wheel arches' upper edge
BODY_RADIUS_M = 0.14


class Bus:
    """A city bus or a coach (`kind`); `rng` chooses sizes and trim. The origin is at half its length."""

    def __init__(self, rng: np.random.Generator, kind: str) -> None:
        self.rng, self.kind = rng, kind
        self.length, self.width, self.height = (rng.uniform(*r) for r in (LENGTH[kind], WIDTH, HEIGHT[kind]))
        self.front, self.rear, self.half = self.length / 2, -self.length / 2, self.width / 2
        self.roof = self.height - (rng.uniform(0.16, 0.26) if kind == "city" else 0.1)
        self.axles = [self.front - rng.uniform(2.6, 2.8), self.rear + rng.uniform(3.1, 3.4)]
        if kind == "coach" and self.length > 12.6:
            self.axles.append(self.axles[1] - 1.3)
        # lower and upper end, x and z
        self.windscreen = (self.front, 1.3), (self.front - (0.12 if kind == "city" else 0.3), self.roof)
        # city buses have low panes, coaches have seats above the luggage
        self.panes: Span = (1.15, 2.3) if kind == "city" else (1.75, self.roof - 0.42)

    def shells(self) -> list[Shell]:
        """Returns all its parts."""
        return [*self._body(), *self._face(), *self._back(), *self._sides(), *self._top()]

    def _body(self) -> list[Shell]:
        """Adds one block above the arches and one between each two of them, slanted towards the wheels."""
        half, low = self.half, SKIRT_M
        shells = []
        fronts, rears = [self.front, *(x - 0.62 for x in self.axles)], [*(x + 0.62 for x in self.axles), self.rear]
        for front, rear in zip(fronts, rears, strict=True):
            if front - rear > 0.2:
                top = front + 0.22 * (front < self.front), rear - 0.22 * (rear > self.rear)
                outline = [(rear, low), (front, low), (top[0], ARCH_M + 0.2), (top[1], ARCH_M + 0.2)]
                shells.append(prism(outline, (-half, half), "paint", 0.03))
        upper = [(self.rear, ARCH_M), (self.front, ARCH_M), *self.windscreen, (self.rear + 0.1, self.roof)]
        shells.append(prism(upper, (-half, half), "paint", BODY_RADIUS_M))
        inside = (self.rear + 0.4, self.front - 0.4), (0.35 - half, half - 0.35), (low + 0.03, ARCH_M + 0.1)
        shells.append(box(*inside, "underbody"))
        for k, x in enumerate(self.axles):
            shells += wheels(x, half - 0.03, WHEEL_M, k == 1)
        return shells

    def _face(self) -> list[Shell]:
        """Adds windscreen, destination display, lamps, bumper and mirrors."""
        x, half, rng, line = self.front, self.half, self.rng, self.windscreen
        low = rng.uniform(0.85, 1.0) if self.kind == "city" else rng.uniform(1.15, 1.25)
        sign = along(*line, 0.8 if self.kind == "city" else 0.86)
        wide = half - 0.12
        shells = [*windscreen(line[0], sign, wide), *plates(x + 0.03, self.rear - 0.03, 0.5, half)]
        shells.append(on_end((x, low), line[0], (-wide, wide), "gap"))
        shells.append(on_end((x, low + 0.06), line[0], (0.05 - wide, wide - 0.05), "glass", 2))
        if self.kind == "city" or rng.random() < 0.5:  # destination display
            top = along(*line, 0.96)
            shells.append(on_end(sign, top, (-wide, wide), "gap", 2))
            letters = np.cumsum(rng.uniform(0.1, 0.22, 9)) - 0.75
            for y, on in zip(letters, rng.random(9) < 0.75, strict=True):
                if on:
                    shells.append(on_end(along(sign, top, 0.25), along(sign, top, 0.75), (y, y + 0.08), "indicator", 3))
        bumper = str(rng.choice(["plastic", "paint", "livery"]))
        shells.append(box((x - 0.3, x + 0.03), (-half, half), (SKIRT_M - 0.02, 0.6), bumper, 0.08))
        shells.append(on_end((x, 0.66), (x, 0.74), (-0.5, 0.5), str(rng.choice(["chrome", "plastic"])), 2))
        shells += head_lamps(x + 0.03, half - 0.04, 0.55, (rng.uniform(0.34, 0.46), rng.uniform(0.16, 0.24)))
        return shells + mirrors(x - 0.1, half - 0.02, 1.95 if self.kind == "city" else 2.2, 0.42)

    def _back(self) -> list[Shell]:
        """Rear window, engine's grille, lamps, bumper."""
        x, half, rng = self.rear, self.half, self.rng
        low, high = self.panes[0] + 0.2, self.roof - 0.35
        line = (x + 0.01, low), (x + 0.05, high)
        shells = [on_end(*line, (0.25 - half, half - 0.25), "gap"), on_end(*line, (0.3 - half, half - 0.3), "glass", 2)]
        shells.append(on_end((x, 0.6), (x, rng.uniform(1.0, 1.2)), (0.5 - half, half - 0.5), str(rng.choice(["gap", "plastic"]))))
        shells.append(box((x - 0.03, x + 0.3), (-half, half), (SKIRT_M, 0.55), str(rng.choice(["plastic", "paint"])), 0.08))
        return shells + tail_lamps(x - 0.005, half - 0.03, 0.75, (0.17, 0.75))

    def _sides(self) -> list[Shell]:
        """Adds a dark band of panes, doors on the right, seams and stripes."""
        half, rng, (low, high) = self.half, self.rng, self.panes
        back, fore = self.rear + 0.35, self.front - (0.45 if self.kind == "city" else 0.6)
        shells = both(on_side(half, (back, fore), (low - 0.06, high + 0.06), "gap", 1, 0.1))
        count = round((fore - back) / rng.uniform(1.4, 1.8))
        step = (fore - back) / count
        for k in range(count):
            pane = (back + k * step + 0.05, back + (k + 1) * step - 0.05)
            shells += both(on_side(half, pane, (low, high), "glass", 2))
            if self.kind == "city":  # tilting windows
                shells += both(on_side(half, pane, (high - 0.3, high - 0.27), "plastic", 3))
        bottom = SKIRT_M + 0.06
        places = [self.front - 1.5] if self.kind == "coach" else [self.front - 1.75, 0.5 * sum(self.axles[:2]) - 0.6]
        if self.kind == "city" and rng.random() < 0.5:
            places.append(self.rear + 1.0)
        for x in places:
            wide = 0.95 if self.kind == "coach" else 1.3
            door = (x, min(x + wide, self.front - 0.18))
            shells += doors(-half, door, (bottom, high + 0.03), (bottom + 0.12, high - 0.06), 1 if self.kind == "coach" else 2)
        stripe = rng.random()
        if stripe < 0.45:
            z = high + 0.12 if self.kind == "city" else low - rng.uniform(0.3, 0.42)
            shells += both(on_side(half, (back, fore), (z, z + rng.uniform(0.1, 0.28)), "livery"))
        elif stripe < 0.75:  # the lower part in another colour
            for a, b in ((self.axles[1] + 0.75, self.axles[0] - 0.75), (self.axles[0] + 0.75, self.front - 0.2)):
                shells += both(on_side(half, (a, b), (SKIRT_M + 0.03, 0.95), "livery"))
        if self.kind == "coach":  # flaps of the luggage hold
            for x in np.arange(self.axles[1] + 0.9, self.axles[0] - 0.7, 1.25):
                shells += both(on_side(half, (x, x + 0.02), (bottom, low - 0.15), "gap", 2))
        for x in self.axles:  # arches' edges
            shells += both(on_side(half - 0.1, (x - 0.5, x + 0.5), (ARCH_M - 0.14, ARCH_M), "gap"))
        for x in np.arange(back + 1.0, fore, 2.8):
            shells += both(on_side(half, (x, x + 0.1), (bottom + 0.22, bottom + 0.27), "indicator", 2))
        return shells

    def _top(self) -> list[Shell]:
        """Air conditioner and hatches."""
        rng, top = self.rng, self.height
        x = rng.uniform(-0.28, 0.25) * self.length
        long, wide = rng.uniform(1.6, 2.8), self.half - rng.uniform(0.3, 0.5)
        a, b, low = x - long / 2, x + long / 2, self.roof - 0.03
        shape = [(a, low), (b, low), (b - 0.2, top), (a + 0.2, top)]
        shells = [prism(shape, (-wide, wide), str(rng.choice(["paint", "livery", "plastic"])), 0.03)]
        for at in (-0.36 * self.length, 0.36 * self.length):
            if abs(at - x) > long / 2 + 0.5:
                shells.append(box((at - 0.38, at + 0.38), (-0.35, 0.35), (self.roof - 0.02, self.roof + 0.06), "plastic"))
        return shells
