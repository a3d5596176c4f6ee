"""Compares our conflicts with those of SUMO's SSM device on the same tracks. `scripts/traffic/check` runs it.

    check_ssm.py PROGRAM      e.g. target/release/examples/conflicts

1. `crossing`: vehicles go straight across at constant speeds and ignore each other. The events must agree.
   DRAC is compared on the approach only, because it grows without limit before a collision.
2. `following`: reckless drivers in one lane. The events must agree.
3. `junction`: a junction with right of way and turns. Straight vehicles' PET and followers' TTC must agree. The rest is
   printed, because there the definitions differ:
   - SUMO measures turning vehicles along lanes. Its conflict area has the vehicles' widths at any angle. Ours are
     footprints. Vehicles whose corners touch have a PET of 0 or less.
   - SUMO lets a vehicle that brakes go on braking until the crossing. Ours keeps its speed (Hayward).
   - SUMO's merging conflict is at the begin of the common lane. Ours is where the footprints touch.
   - SUMO has no conflict between vehicles that leave one lane in different directions. A vehicle that waits to turn
     blocks those behind it.
"""

from __future__ import annotations

import csv
import io
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from simulate import Pair, Simulation, simulate

TTC_S, DRAC_MPS2, PET_S = LIMITS = (3.0, 3.0, 5.0)
TOLERANCE_S = 0.1
TYPES = (
    '<vType id="{}" length="{}" width="{}" sigma="{}" decel="{}" minGap="{}" tau="{}" '
    'speedFactor="{}" jmIgnoreFoeProb="{}" jmIgnoreJunctionFoeProb="{}" jmIgnoreFoeSpeed="100" jmTimegapMinor="{}"/>'
)
STRAIGHT = ("we", "ew", "sn", "ns")
# Distance from the junction's centre at which tracks are cut to compare decelerations, m.
CUT_M = 15.0
# Deceleration from which the two are compared there, m/s².
APPROACH_MPS2 = 1.0


VARIED = "normc(1,0.2,0.6,1.4)"


def types(sigma: float, decel: float, gap_m: float, tau: float, ignoring: float, speeds: tuple[object, object]) -> str:
    """Cars on the main road, trucks on the minor road, each with a factor of speed."""
    sizes = (("main", 4.6, 1.8), ("minor", 9.0, 2.4))
    return "".join(
        TYPES.format(*size, sigma, decel, gap_m, tau, speed, ignoring, *((1, 0) if ignoring == 1 else (0, 1)))
        for size, speed in zip(sizes, speeds, strict=True)
    )


@dataclass
class Row:
    """One of our conflicts."""

    kind: str
    ttc: float | None
    drac: float | None
    pet: float | None
    ttc_at_s: float


def ours(program: str, simulation: Simulation, nearest_m: float = 0) -> dict[frozenset[str], Row]:
    """Our conflicts on the tracks of a simulation."""
    limits = [f"ttc_s={TTC_S}", f"drac_mps2={DRAC_MPS2}", f"pet_s={PET_S}", "least_speed_mps=0"]
    done = subprocess.run([program, *limits], input=simulation.tracks(nearest_m), text=True, capture_output=True, check=True)
    names = {number: name for name, number in simulation.numbers.items()}
    value = {"": None}
    found = {}
    for row in csv.DictReader(io.StringIO(done.stdout)):
        columns = (row["min_ttc_s"], row["max_drac_mps2"], row["pet_s"], row["min_ttc_at_s"])
        ttc, drac, pet, at = (value.get(text, text and float(text)) for text in columns)
        pair = frozenset(names[int(row[end])] for end in ("first", "second"))
        found[pair] = Row(row["kind"], ttc, drac, pet, at or 0.0)
    return found


def brakes(simulation: Simulation, pair: frozenset[str], time_s: float) -> bool:
    """Whether one of two vehicles brakes at a time."""
    return any(simulation.states[name].get(round(time_s, 1), (0.0,) * 5)[4] < -0.01 for name in pair)


def compare(
    name: str, theirs: dict[frozenset[str], float], mine: dict[frozenset[str], float], floor: float = -1e9
) -> tuple[int, int, list[frozenset[str]], list[frozenset[str]]]:
    """Prints and returns the number of events in both, of those within the tolerance, and the events of one only.
    Values below `floor` count as that."""
    both = theirs.keys() & mine.keys()
    differences = sorted(abs(max(mine[pair], floor) - theirs[pair]) for pair in both)
    within = sum(difference <= TOLERANCE_S for difference in differences)
    only = [sorted(a.keys() - b.keys(), key=sorted) for a, b in ((theirs, mine), (mine, theirs))]
    if both or any(only):
        middle, largest = (differences[len(differences) // 2], differences[-1]) if both else (0.0, 0.0)
        print(
            f"  {name}: {len(both)} in both, {within} within {TOLERANCE_S}, median {middle:.4f}, largest {largest:.3f}; "
            f"{len(only[0])} only in SUMO, {len(only[1])} only ours"
        )
    return len(both), within, *only


def theirs_of(simulation: Simulation, value: Callable[[Pair], float | None]) -> dict[frozenset[str], float]:
    """SUMO's values of all pairs that have one."""
    found = ((pair, value(all_of)) for pair, all_of in simulation.pairs.items())
    return {pair: one for pair, one in found if one is not None}


def ttc_of(simulation: Simulation, kinds: tuple[str, ...]) -> dict[frozenset[str], float]:
    """SUMO's shortest times to collision below the limit."""
    return theirs_of(simulation, lambda p: p.ttc.value if p.ttc and p.ttc.kind in kinds and p.ttc.value <= TTC_S else None)


def pet_of(simulation: Simulation) -> dict[frozenset[str], float]:
    """SUMO's post-encroachment times below the limit."""
    return theirs_of(simulation, lambda p: p.pet.value if p.pet and p.pet.value <= PET_S else None)


def must(condition: bool, text: str) -> None:
    """Ends the check if a condition does not hold."""
    if not condition:
        sys.exit(f"check_ssm: {text}")


def crossing(program: str, folder: Path) -> None:
    """Vehicles go straight across and ignore each other."""
    flows = dict.fromkeys(STRAIGHT, 0.08)
    simulation = simulate(folder, flows, types(0, 4.5, 2.5, 1, 1, ("normc(1,0)", "normc(0.8,0)")), True, LIMITS)
    rows = ours(program, simulation)
    print(f"crossing: {len(simulation.states)} vehicles")
    pets = {pair: row.pet for pair, row in rows.items() if row.pet is not None}
    # SUMO counts a negative time as 0.
    both, within, lost, extra = compare("PET, s", pet_of(simulation), pets, floor=0.0)
    must(both > 100 and within == both and not lost and not extra, "PET differs")
    kinds = ("crossing", "collision")
    ttcs = {pair: row.ttc for pair, row in rows.items() if row.ttc is not None and row.ttc <= TTC_S}
    ttcs = {pair: ttc for pair, ttc in ttcs.items() if rows[pair].kind == "crossing"}
    both, within, lost, extra = compare("TTC, s", ttc_of(simulation, kinds), ttcs)
    must(both > 10 and within == both and not lost, "TTC differs")
    must(all(brakes(simulation, pair, rows[pair].ttc_at_s) for pair in extra), "a TTC that braking does not explain")
    cut = ours(program, simulation, CUT_M)
    dracs = {pair: row.drac for pair, row in cut.items() if row.drac is not None and row.drac >= APPROACH_MPS2}

    def on_approach(pair: frozenset[str]) -> float | None:
        times = set.intersection(*(set(simulation.approach(name, CUT_M)) for name in pair))
        return max((drac for time_s, drac in simulation.pairs[pair].dracs.items() if time_s in times), default=None)

    values = {pair: on_approach(pair) for pair in simulation.pairs}
    theirs = {pair: value for pair, value in values.items() if value is not None and value >= APPROACH_MPS2}
    both, within, lost, extra = compare("DRAC on the approach, m/s²", theirs, dracs)
    must(both >= 5 and within == both and not lost and not extra, "DRAC differs")


def following(program: str, folder: Path) -> None:
    """Reckless drivers in one lane."""
    simulation = simulate(folder, {"we": 0.3}, types(1, 6, 0.5, 0.2, 0, (VARIED, VARIED)), True, LIMITS)
    rows = ours(program, simulation)
    print(f"following: {len(simulation.states)} vehicles")
    ttcs = {pair: row.ttc for pair, row in rows.items() if row.ttc is not None and row.ttc <= TTC_S}
    both, within, lost, extra = compare("TTC, s", ttc_of(simulation, ("following",)), ttcs)
    must(both > 30 and within == both and not lost and not extra, "TTC differs")
    theirs = theirs_of(simulation, lambda p: p.drac.value if p.drac else None)
    dracs = {pair: row.drac for pair, row in rows.items() if row.drac is not None and pair in theirs}
    both, within, *_ = compare("DRAC of these, m/s²", {p: v for p, v in theirs.items() if p in dracs}, dracs)
    must(both > 30 and within == both, "DRAC differs")


def junction(program: str, folder: Path) -> None:
    """A junction with right of way and turns."""
    turns = dict(wn=0.03, ws=0.02, en=0.02, es=0.03, sw=0.02, se=0.02, nw=0.01, ne=0.02)
    flows = dict(we=0.08, ew=0.08, sn=0.03, ns=0.03) | turns
    simulation = simulate(folder, flows, types(0.5, 4.5, 2.5, 1, 0.3, (VARIED, VARIED)), False, LIMITS)
    rows = ours(program, simulation)
    print(f"junction: {len(simulation.states)} vehicles")
    for name, straight in (("straight", True), ("turning", False)):

        def chosen(values: dict[frozenset[str], float], straight: bool = straight) -> dict[frozenset[str], float]:
            return {p: v for p, v in values.items() if straight == all(vehicle[:2] in STRAIGHT for vehicle in p)}

        crossings = {p: r.pet for p, r in rows.items() if r.pet is not None and r.kind == "crossing"}
        both, within, lost, extra = compare(f"PET {name}, s", chosen(pet_of(simulation)), chosen(crossings), floor=0.0)
        must(not straight or both > 50 and within == both and not lost and not extra, "PET differs")
        for kind in ("following", "crossing", "merging"):
            mine = {p: r.ttc for p, r in rows.items() if r.ttc is not None and r.ttc <= TTC_S and r.kind == kind}
            both, within, lost, extra = compare(f"TTC {name} {kind}, s", chosen(ttc_of(simulation, (kind,))), chosen(mine))
            must(not straight or kind != "following" or within == both > 10 and not lost, "TTC differs")
            braking = sum(brakes(simulation, pair, rows[pair].ttc_at_s) for pair in extra)
            if extra:
                print(f"    a vehicle brakes in {braking} of the {len(extra)} that are only ours")


if __name__ == "__main__":
    for scenario in (crossing, following, junction):
        with tempfile.TemporaryDirectory() as temporary:
            scenario(sys.argv[1], Path(temporary))
