"""Runs ASAM's checkers on a scene and reads it with scenariogeneration. Exit code 1 if anything is found."""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path

from scenariogeneration import xosc
from scene import read_scene

CHECKERS = {"scenario.xosc": ("qc_openscenario", "xoscBundle"), "road.xodr": ("qc_opendrive", "xodrBundle")}


def issues(file: Path, program: str, bundle: str) -> list[str]:
    """Returns a checker's findings, and those of its checks that did not finish."""
    with tempfile.TemporaryDirectory() as folder:
        result, config = Path(folder, "result.xqar"), Path(folder, "config.xml")
        root = ET.Element("Config")
        ET.SubElement(root, "Param", name="InputFile", value=str(file.resolve()))
        ET.SubElement(ET.SubElement(root, "CheckerBundle", application=bundle), "Param", name="resultFile", value=str(result))
        ET.ElementTree(root).write(config)
        subprocess.run(
            [Path(sys.executable).parent / program, "-c", config],
            check=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        checks = list(ET.parse(result).getroot().iter("Checker"))
    found = [f"{c.attrib['checkerId']}: {i.attrib['description']}" for c in checks for i in c.iter("Issue")]
    # Skipped checks are for later versions of the standard.
    unended = [c.attrib["checkerId"] for c in checks if c.attrib["status"] not in ("completed", "skipped")]
    print(f"{file.name}: {len(checks)} checks, {len(found)} issues")
    return found + unended


def main() -> None:
    """Checks both files, then reads them with the other reader."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path, help="folder that roadplane copy wrote")
    folder = parser.parse_args().scene
    found = [issue for name, how in CHECKERS.items() for issue in issues(folder / name, *how)]
    print("\n".join(found), end="\n" if found else "")
    vehicles, _ = read_scene(folder)
    read = xosc.ParseOpenScenario(str(folder / "scenario.xosc"))
    names = {entity.name for entity in read.entities.scenario_objects}
    assert names == {vehicle.name for vehicle in vehicles}, "scenariogeneration reads other vehicles"
    print(f"scenariogeneration reads {len(names)} vehicles")
    sys.exit(1 if found else 0)


if __name__ == "__main__":
    main()
