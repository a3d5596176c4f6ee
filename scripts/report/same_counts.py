"""Checks that the page of `roadplane traffic` has the gates and zones that were drawn, and the figures of the tables.

same_counts.py GATES FOLDER
"""

import html
import json
import re
import sys
from pathlib import Path

gates, folder = json.loads(Path(sys.argv[1]).read_text()), Path(sys.argv[2])
names = {feature["properties"]["name"] for feature in gates["features"]}
file = json.loads((folder / "traffic.json").read_text())
assert {place["name"] for camera in file["cameras"] for place in camera["places"]} == names, file["cameras"]
page = html.unescape((folder / "traffic.html").read_text())
shown = {
    (name, direction): int(n) for name, direction, n in re.findall(r"<h3>([^<]*), (forward|backward): (\d+) vehicles</h3>", page)
}
rows = [row for row in file["counts"] if row["class"] == "all" and row["vehicles"]]
listed = {(row["place"], row["direction"]): row["vehicles"] for row in rows}
assert shown == listed, (shown, listed)
stays = {row["place"]: row["entered"] for row in file["zones"] if row["class"] == "all"}
for name, entered in stays.items():
    assert re.search(rf"<td class=\"words\">{re.escape(name)}</td><td>[^<]*</td><td>{entered}</td>", page), name
print(f"the page has the figures of the tables: {listed}, zones {stays}")
