"""The card of a data set: how it was made, its contents, and credits. All figures come from its truth files."""

from __future__ import annotations

from collections import Counter, defaultdict
from pathlib import Path

import numpy as np

from roadplane_train.cars.meshes import KINDS, catalogue
from roadplane_train.json_files import read_json

SIZES_PX = (0, 24, 40, 64, 96, 160, 10_000)
SHARES = (0.15, 0.4, 0.7, 0.9, 0.98, 1.01)

TEXT = """# {name}: rendered parking lots and streets with truth

{stills} stills and {clips} clips, {sizes}, split `{split}`, seed {seed}. Truth as described in
`scripts/train/render/README.md`.

Made by

```sh
{recipe}
```

with Debian's `sweethome3d-furniture` 1.8 installed, which holds the real car meshes. Without it every car is a built one,
so the pictures differ. Scenes, poses and cameras depend on seed and code alone. Pixels may differ in their last bits
between versions of Mesa, OpenCV and x264.

No car model of this split is in a training split ({models} models here: {bodies}).

## Contents

{table}

Activities, seconds of a car in the clips: {activities}.

## Known weak points

- The pictures are rendered: no lens distortion, no motion blur, simple sky, trees and people, grounds without drains,
  patches or litter. The camera's blur, noise, colour cast and compression are mild. Results on real cameras may differ.
- The ground is exactly flat, the principal point exactly at the centre, and wheels neither steer nor turn.
- Visibility of keypoints comes from a depth buffer of 160 × 160 cells per car (tolerance 0.1 m); glass counts as opaque.
- Most cars are parametric bodies; {meshes} of the models are meshes of real cars.
- In stills all speeds are 0, also those of cars on a lane.

## Licence

[CC-BY 4.0](https://creativecommons.org/licenses/by/4.0/), the roadplane authors. {credits}
"""


def write_card(folder: Path, recipe: str) -> None:
    """Writes `README.md` of a data set from its `dataset.json` and truth files."""
    index = read_json(folder / "dataset.json")
    items = [read_json(folder / item) for item in index["items"]]
    names = {model["model"]: model["body"] for item in items for model in item["models"]}
    real = {entry["name"]: entry["credit"] for kind in KINDS for entry in catalogue(kind) if entry["name"] in names}
    bodies = ", ".join(f"{count} {body}" for body, count in sorted(Counter(names.values()).items()))
    credits = (
        "Car meshes: "
        + "; ".join(f"`{name}`: {credit}" for name, credit in sorted(real.items()))
        + "; changes and licences: `models/CREDITS.md`."
        if real
        else "No works of others are in it."
    )
    sizes = sorted({" × ".join(map(str, item["camera"]["image_size_px"])) for item in items})
    spent: defaultdict[str, float] = defaultdict(float)
    for item in items:
        for frame in item["frames"] if item["fps"] else []:
            for car in frame["cars"]:
                spent[car["activity"]] += 1 / item["fps"]
    kinds = Counter(item["kind"] for item in items)
    text = TEXT.format(
        name=index["name"],
        stills=kinds["still"],
        clips=kinds["clip"],
        sizes=" and ".join(sizes),
        split=index["split"],
        seed=index["seed"],
        recipe=recipe,
        models=len(names),
        bodies=bodies,
        table=_table(items),
        activities=", ".join(f"{name} {seconds:.0f}" for name, seconds in sorted(spent.items())) or "none",
        meshes=len(real),
        credits=credits,
    )
    part = folder / "README.md.part"
    part.write_text(text)
    part.rename(folder / "README.md")


def _table(items: list[dict]) -> str:
    """Returns Markdown rows: name, figures of stills, figures of clips."""
    columns = [[item for item in items if item["kind"] == kind] for kind in ("still", "clip")]
    has_slivers = any(car["visible_share"] < SHARES[0] for car in _cars(items))
    shares = (0.0, *SHARES) if has_slivers else SHARES  # the truth of views has slivers
    rows = {
        "cars in a frame": [_range([len(f["cars"]) for i in c for f in i["frames"]], "{:.0f}") for c in columns],
        "longer side of the visible box, px": [_shares([_side(car) for car in _cars(c)], SIZES_PX, "{:.0f}") for c in columns],
        "visible share": [_shares([car["visible_share"] for car in _cars(c)], shares, "{:.2f}") for c in columns],
        "distance, m": [
            _range([np.hypot(car["world_from_car"][0][3], car["world_from_car"][1][3]) for car in _cars(c)], "{:.0f}")
            for c in columns
        ],
        "focal length, widths": [
            _range([i["camera"]["focal_px"] / i["camera"]["image_size_px"][0] for i in c], "{:.2f}") for c in columns
        ],
        "height, m": [_range([i["camera"]["height_m"] for i in c], "{:.1f}") for c in columns],
        "tilt, °": [_range([np.degrees(i["camera"]["tilt_rad"]) for i in c], "{:.1f}") for c in columns],
        "roll, °": [_range([np.degrees(i["camera"]["roll_rad"]) for i in c], "{:.1f}") for c in columns],
        "layout": [_counts([i["conditions"]["layout"] for i in c]) for c in columns],
        "weather": [_counts([i["conditions"]["weather"] for i in c]) for c in columns],
    }
    lines = ["| | stills | clips |", "|---|---|---|"]
    return "\n".join(lines + [f"| {name} | {still} | {clip} |" for name, (still, clip) in rows.items()])


def _cars(items: list[dict]) -> list[dict]:
    return [car for item in items for frame in item["frames"] for car in frame["cars"]]


def _side(car: dict) -> float:
    x0, y0, x1, y1 = car["box"]
    return max(x1 - x0, y1 - y0)


def _range(values: list[float], form: str) -> str:
    """Returns `lowest – median – highest`."""
    return " – ".join(form.format(v) for v in (min(values), np.median(values), max(values))) if values else "–"


def _shares(values: list[float], edges: tuple[float, ...], form: str) -> str:
    counts, _ = np.histogram(values, edges)
    cells = []
    for count, low, high in zip(counts, edges[:-1], edges[1:], strict=True):
        upper = "…" if high == edges[-1] else f"–{form.format(high)}"
        cells.append(f"{form.format(low)}{upper}: {100 * count / max(len(values), 1):.0f} %")
    return ", ".join(cells)


def _counts(values: list[str]) -> str:
    return ", ".join(f"{name} {count}" for name, count in sorted(Counter(values).items()))
