"""Long runs of the reliability tests, on the release binary.

Call it as `scripts/reliability/check.py NAME [AMOUNT]`; default amounts are in brackets:

- `kill` [50 times]: kill -9 at random moments, then --resume; the bytes are the same.
- `disk` [20 sizes]: disk full after some KiB, in steps over a whole run; needs root.
- `readonly`: output folder on a read-only file system; needs root.
- `memory`: ulimit -v from 400 MiB to 1.7 GiB.
- `cgroup`: a control group's limit from 100 MiB to 700 MiB; needs root.
- `clock`: a clock that jumps by an hour at every call; needs Debian's libfaketime.
- `mutate` [600 s each]: damaged videos, images, JSON lines, configs, models and evidence.
- `soak` [500 clips]: short clips in one process; memory and open files stay constant.

Each check prints one line with its figure, and exits with 1 if it fails. Random choices come from fixed seeds.
"""

import argparse
import json
import os
import pathlib
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence

# Whether a check passed, and the output of its last command.
Result = tuple[bool, str]

ROOT = pathlib.Path(__file__).resolve().parents[2]
BINARY = ROOT / "target/release/roadplane"
CLIP = ROOT / "tests/data/lot.mp4"
STILL = ROOT / "tests/data/lots/scenes/still_0000.jpg"
ENVIRONMENT = os.environ | {
    "ORT_DYLIB_PATH": str(ROOT / ".runtime/libonnxruntime.so"),
    "ROADPLANE_MODELS": str(ROOT / "models"),
}
SHORT = ["--set", "decode.max_frames=24"]
# Accepted exit codes for a damaged input: success, usage, damage, model rejected. Never 1, a signal, or a panic (101).
ALLOWED = {0, 2, 3, 4}
HANG_S = 60


def command(*arguments: object, limit_kib: int | None = None) -> list[str]:
    """Returns a command line of the binary, with a limit of address space if one is given."""
    line = [str(BINARY), *map(str, arguments)]
    return line if limit_kib is None else ["bash", "-c", f'ulimit -v {limit_kib}; exec "$0" "$@"', *line]


def run(*arguments: object, limit_kib: int | None = None) -> tuple[int | None, str]:
    """Returns exit code and output; the code of a run that hangs is None."""
    line = command(*arguments, limit_kib=limit_kib)
    try:
        done = subprocess.run(line, env=ENVIRONMENT, capture_output=True, timeout=HANG_S, check=False)
    except subprocess.TimeoutExpired:
        return None, "hangs"
    return done.returncode, done.stderr.decode(errors="replace")


def contents(folder: pathlib.Path) -> dict[str, bytes]:
    """Returns the files of a result that must not differ: all files except those that contain times."""
    names = sorted(p.name for p in folder.iterdir() if p.name not in ("summary.json", "report.html"))
    return {name: (folder / name).read_bytes() for name in names}


def kill(folder: pathlib.Path, count: int) -> Result:
    """Checks that a run, killed at random moments and resumed, ends with the bytes of an undisturbed one."""
    chance = random.Random(1)
    whole, cut = folder / "whole", folder / "cut"
    begun = time.monotonic()
    run("run", CLIP, *SHORT, "--out", whole)
    lasts_s = time.monotonic() - begun
    expected = contents(whole / "lot")
    finished = same = 0
    for _ in range(count):
        line = command("run", CLIP, *SHORT, "--out", cut, "--resume")
        with subprocess.Popen(line, env=ENVIRONMENT, stderr=subprocess.DEVNULL) as child:
            time.sleep(chance.uniform(0, 1.1 * lasts_s))
            child.kill()
        if (cut / "lot").exists():
            finished += 1
            same += contents(cut / "lot") == expected
            shutil.rmtree(cut / "lot")
    code, text = run("run", CLIP, *SHORT, "--out", cut, "--resume")
    last = code == 0 and contents(cut / "lot") == expected
    clean = sorted(p.name for p in cut.iterdir()) == [".roadplane.lock", "lot"]
    print(f"kill: {count} kills, {finished} results published on the way, {same} of them and the last same: {last}")
    return last and clean and same == finished, text


def disk(folder: pathlib.Path, count: int) -> Result:
    """Checks that the message names a full disk, no partial file gets a final name, and the command can resume."""
    if os.geteuid() != 0:
        print("disk: skipped, mounting a small file system needs root")
        return True, ""
    run("run", CLIP, *SHORT, "--out", folder / "whole", "--frames")
    needs_kib = sum(p.stat().st_size for p in (folder / "whole/lot").iterdir()) // 1024 + 64
    small = folder / "small"
    small.mkdir()
    named = 0
    for i in range(count):
        kib = 40 + needs_kib * i // count
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={kib}k", "tmpfs", small], check=True)
        try:
            code, text = run("run", CLIP, *SHORT, "--out", small / "out", "--frames")
            is_there = (small / "out/lot").exists()
        finally:
            subprocess.run(["umount", small], check=True)
        if code == 0 and is_there:
            named += 1
        elif code == 1 and "no space left" in text and not is_there and "panicked" not in text:
            named += 1
        else:
            print(f"disk: {kib} KiB: {code} {text}")
    print(f"disk: {named} of {count} sizes up to {needs_kib} KiB named the file or were enough; no half result")
    return named == count, ""


def readonly(folder: pathlib.Path, _count: int) -> Result:
    """Checks that the message names a read-only output folder."""
    if os.geteuid() != 0:
        print("readonly: skipped, mounting needs root")
        return True, ""
    subprocess.run(["mount", "-t", "tmpfs", "-o", "ro", "tmpfs", folder], check=True)
    try:
        code, text = run("run", CLIP, *SHORT, "--out", folder / "out")
    finally:
        subprocess.run(["umount", folder], check=True)
    print(f"readonly: exit {code}, named: {str(folder / 'out') in text}")
    return code == 1 and str(folder / "out") in text, text


def memory(folder: pathlib.Path, _count: int) -> Result:
    """Checks that every limit of address space leads to a result or to a message."""
    answers = {}
    # Below 400 MiB the system's loader cannot load the libraries, and ends the process before it begins.
    for mib in range(400, 1701, 50):
        code, text = run("run", CLIP, *SHORT, "--out", folder / "out", "--overwrite", limit_kib=mib * 1024)
        answers[mib] = code == 0 or (code == 1 and "ulimit -v" in text)
        if not answers[mib]:
            print(f"memory: {mib} MiB: {code} {text[-400:]}")
    print(f"memory: {sum(answers.values())} of {len(answers)} limits gave a result or a message")
    return all(answers.values()), ""


def control_group() -> tuple[pathlib.Path, str] | None:
    """Returns a new control group and its file for a limit of memory; None if it cannot be made.

    Version 2 accepts groups with limits below one with processes only at the top. Version 1 keeps ours within the
    limits of this process.
    """
    groups = [line.split(":", 2) for line in pathlib.Path("/proc/self/cgroup").read_text().splitlines()]
    own = next((path for _, controllers, path in groups if "memory" in controllers.split(",")), None)
    top = pathlib.Path("/sys/fs/cgroup")
    above, limit = (top, "memory.max") if own is None else (top / "memory" / own.lstrip("/"), "memory.limit_in_bytes")
    group = above / f"roadplane-check-{os.getpid()}"
    try:
        group.mkdir()
    except OSError:
        return None
    if (group / limit).exists():
        return group, limit
    group.rmdir()
    return None


def cgroup(folder: pathlib.Path, _count: int) -> Result:
    """Checks that every limit of a control group leads to a result or to a message."""
    made = control_group()
    if made is None:
        print("cgroup: skipped, no control group with a limit of memory can be made here")
        return True, ""
    group, limit = made
    answers = {}
    try:
        for mib in range(100, 701, 50):
            (group / limit).write_text(str(mib << 20))
            line = command("run", CLIP, *SHORT, "--out", folder / "out", "--overwrite")
            within = ["bash", "-c", f'echo $$ > {group}/cgroup.procs; exec "$0" "$@"', *line]
            done = subprocess.run(within, env=ENVIRONMENT, capture_output=True, timeout=HANG_S, check=False)
            text = done.stderr.decode(errors="replace")
            answers[mib] = done.returncode == 0 or (done.returncode == 1 and "control group" in text)
            if not answers[mib]:
                print(f"cgroup: {mib} MiB: {done.returncode} {text[-400:]}")
    finally:
        group.rmdir()
    print(f"cgroup: {sum(answers.values())} of {len(answers)} limits gave a result or a message")
    return all(answers.values()), ""


def clock(folder: pathlib.Path, _count: int) -> Result:
    """Checks that a jumping clock changes neither a byte of the results nor the wall time that a run reports."""
    library = next(pathlib.Path("/usr/lib").glob("*/faketime/libfaketime.so.1"), None)
    if library is None:
        print("clock: skipped, needs libfaketime (apt-get install libfaketime)")
        return True, ""
    run("run", CLIP, *SHORT, "--out", folder / "whole")
    expected = contents(folder / "whole/lot")
    for jump_s in (3600, -3600):
        out = folder / f"jump{jump_s}"
        jumps = {"LD_PRELOAD": str(library), "FAKETIME": f"+0 i{jump_s}", "DONT_FAKE_MONOTONIC": "1", "NO_FAKE_STAT": "1"}
        begun = time.monotonic()
        line = command("run", CLIP, *SHORT, "--out", out)
        done = subprocess.run(line, env=ENVIRONMENT | jumps, capture_output=True, timeout=HANG_S, check=False)
        lasted_s = time.monotonic() - begun
        text = done.stderr.decode(errors="replace")
        same = done.returncode == 0 and contents(out / "lot") == expected
        reported_s = json.loads((out / "lot/summary.json").read_text())["wall_s"] if same else float("nan")
        print(
            f"clock: jumps of {jump_s} s: exit {done.returncode}, same bytes: {same}, {reported_s} s reported of {lasted_s:.1f}"
        )
        if not (same and 0 < reported_s <= lasted_s):
            return False, text
    return True, ""


def spoilt(sound: bytes, chance: random.Random) -> bytes:
    """Returns the bytes with some flipped, cut, zeroed, doubled, or replaced by extreme ones."""
    data = bytearray(sound)
    for _ in range(chance.choice([1, 1, 2, 5, 20])):
        at = chance.randrange(max(len(data), 1))
        length = chance.choice([1, 2, 4, 8, 64, 1024])
        match chance.randrange(6):
            case 0:
                data[at : at + 1] = bytes([chance.randrange(256)])
            case 1:
                del data[at:]
            case 2:
                data[at : at + length] = bytes(len(data[at : at + length]))
            case 3:
                data[at:at] = data[at : at + length]
            case 4:
                data[at : at + length] = chance.choice([b"\xff" * length, b"\x7f" + b"\xff" * 7, b"-1", b"1e999", b"NaN"])
            case 5:
                del data[at : at + length]
    return bytes(data)


def kinds(folder: pathlib.Path) -> dict[str, tuple[bytes, Callable[[pathlib.Path], Sequence[object]]]]:
    """Yields, for each kind of input, valid bytes and the command that reads the damaged file."""
    lines, results = folder / "sound.jsonl", folder / "sound"
    run("run", CLIP, "--set", "decode.max_frames=4", "--out", results, "--frames", "--cameras", folder / "c", "--camera-id", "c")
    shutil.copy(results / "lot/frames.jsonl", lines)
    two = ["--set", "decode.max_frames=2", "--overwrite", "--out", folder / "out"]

    def model(path: pathlib.Path) -> list[object]:
        models = folder / "models"
        if not models.exists():
            shutil.copytree(ROOT / "models", models)
        shutil.copy(path, models / "hourglass.card.json")
        return ["doctor", "--set", f"models.folder={models}"]

    def evidence(path: pathlib.Path) -> list[object]:
        (folder / "cameras/c").mkdir(parents=True, exist_ok=True)
        shutil.copy(path, folder / "cameras/c/clip.0.json")
        return ["cameras", "list", folder / "cameras"]

    config = (ROOT / "configs/default.toml").read_bytes()
    return {
        "video.mp4": (CLIP.read_bytes(), lambda p: ["run", p, *two]),
        "image.jpg": (STILL.read_bytes(), lambda p: ["run", p, *two]),
        "lines.jsonl": (lines.read_bytes(), lambda p: ["stage", "solve", p, "--out", folder / "p.jsonl"]),
        "config.toml": (config, lambda p: ["stage", "solve", lines, "--config", p, "--out", folder / "p.jsonl"]),
        "card.json": ((ROOT / "models/hourglass.card.json").read_bytes(), model),
        "evidence.json": (next((folder / "c/c").iterdir()).read_bytes(), evidence),
    }


def mutate(folder: pathlib.Path, seconds: int) -> Result:
    """Checks that damaged inputs of each kind end in time with an accepted code."""
    sound = True
    for name, (data, reads) in kinds(folder).items():
        chance = random.Random(name)
        path, tried, bad = folder / name, 0, 0
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            path.write_bytes(spoilt(data, chance))
            code, text = run(*reads(path))
            allowed = ALLOWED | ({1} if name == "card.json" else set())
            if code not in allowed or "panicked" in text:
                bad += 1
                kept = ROOT / "target" / f"spoilt-{tried}-{name}"
                shutil.copy(path, kept)
                print(f"mutate: {name}: {code}, kept as {kept}: {text[-300:]}")
            tried += 1
        print(f"mutate: {name}: {tried} tried in {seconds} s, {bad} without a clear end")
        sound &= bad == 0
    return sound, ""


def slope(values: Sequence[float]) -> float:
    """Returns the change from one value to the next, by least squares."""
    middle = (len(values) - 1) / 2
    spread = sum((i - middle) ** 2 for i in range(len(values)))
    return sum((i - middle) * value for i, value in enumerate(values)) / max(spread, 1)


def soak(folder: pathlib.Path, count: int) -> Result:
    """Checks that memory and open files do not grow over many short clips in one process."""
    clips = folder / "clips"
    clips.mkdir()
    inputs = [clips / f"s{i:04}.mp4" for i in range(count)]
    for path in inputs:
        path.symlink_to(CLIP)
    # Memory and open files as each result appears.
    usage: list[tuple[float, int]] = []
    settings = ["--set", "decode.max_frames=2", "--set", "output.sample_frames=0", "--set", "output.report_mib=0"]
    line = command("run", *inputs, "--out", folder / "out", *settings)
    with subprocess.Popen(line, env=ENVIRONMENT, stderr=subprocess.DEVNULL) as child:
        while child.poll() is None:
            time.sleep(0.05)
            if len(usage) < count and (folder / "out" / inputs[len(usage)].stem).exists():
                try:
                    status = pathlib.Path(f"/proc/{child.pid}/status").read_text()
                    kib = int(next(line for line in status.splitlines() if line.startswith("VmRSS")).split()[1])
                    usage.append((kib / 1024, len(os.listdir(f"/proc/{child.pid}/fd"))))
                except (OSError, StopIteration):
                    break
        code = child.wait()
    done = sum(1 for path in inputs if (folder / "out" / path.stem / "summary.json").exists())
    memory_mib, files = zip(*usage)
    quarter = len(usage) // 4
    early, late = max(memory_mib[quarter : 2 * quarter]), max(memory_mib[3 * quarter :])
    early_files, late_files = max(files[quarter : 2 * quarter]), max(files[3 * quarter :])
    grows_kib = 1024 * slope(memory_mib[quarter:])
    print(
        f"soak: {done} of {count}, exit {code}; {early:.0f} MiB, {early_files} files in the second quarter, {late:.0f} MiB, "
        f"{late_files} files in the last; {grows_kib:+.1f} KiB a clip after the first quarter"
    )
    return code == 0 and done == count and late < 1.1 * early and late_files <= early_files, ""


CHECKS: dict[str, tuple[Callable[[pathlib.Path, int], Result], int]] = {
    "kill": (kill, 50),
    "disk": (disk, 20),
    "readonly": (readonly, 0),
    "memory": (memory, 0),
    "cgroup": (cgroup, 0),
    "clock": (clock, 0),
    "mutate": (mutate, 600),
    "soak": (soak, 500),
}


def main() -> None:
    """Runs the given checks, or all of them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("check", choices=[*CHECKS, "all"])
    parser.add_argument("amount", type=int, nargs="?")
    arguments = parser.parse_args()
    failed = []
    for name in CHECKS if arguments.check == "all" else [arguments.check]:
        check, usual = CHECKS[name]
        with tempfile.TemporaryDirectory() as folder:
            sound, text = check(pathlib.Path(folder), arguments.amount or usual)
        if not sound:
            failed.append(name)
            print(f"{name}: FAILED {text[-1000:]}")
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
