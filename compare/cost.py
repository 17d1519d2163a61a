"""What the port's computations cost against batch, clip length, side, objects and threads: python cost.py

One number is changed at a time; the others stay at those of a base. On one thread the times are of the processor, which
other work on the machine changes least; where threads are changed, of the clock. Results: ../benches/cost/results.json, a
table and a plot beside it.
"""
import argparse
import json
import os
import sys
import tempfile
from dataclasses import asdict, dataclass, replace
from datetime import date
from pathlib import Path
from statistics import median

import matplotlib
import numpy as np

from speed import measured, processor

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402  (after the backend is chosen)

HERE = Path(__file__).resolve().parent
INPUT = 4  # frames that the encoder sees before the roll-out starts
# Objects that pull and push each other by springs: an equation for any number of them but one.
SPRINGS = "others(k * (norm(q - p) - l) * unit(q - p))"
ALONE = "-k * (p - vec(l, l))"
TASK = """
name = "cost"
[system]
side = {side}
channels = 3
objects = {objects}
input_steps = {input}
pred_steps = {predicted}
dt = 0.1
[system.equation]
acceleration = "{acceleration}"
[system.equation.parameters]
k = {{ unit = [0, -2], start = 1.5 }}
l = {{ unit = [1, 0], start = 4.0 }}
[data]
train_frames = {frames}
test_frames = {longest}
[truth]
k = 1.0
l = 5.0
"""


@dataclass(frozen=True)
class Case:
    """What is computed: `batch` counts clips, in `discover` frames."""
    batch: int = 25
    frames: int = 10
    side: int = 32
    objects: int = 2
    threads: int = 1


# What is timed, and the base of each.
WHATS = {"step": Case(), "discover": Case(batch=48), "inference": Case(), "refinement": Case(batch=100),
         "identify": Case(batch=100)}
# The larger sides are timed on smaller batches, or they would not fit into memory.
BASES = {("step", "side"): Case(batch=5), ("discover", "side"): Case(batch=16), ("inference", "side"): Case(batch=5)}
# What is changed, and to what; only what depends on it is timed.
AXES = {
    "batch": ([5, 10, 25, 50, 100, 200, 400], WHATS),
    "frames": ([6, 10, 20, 40, 60], ["step", "identify"]),
    "side": ([32, 48, 64, 96, 128, 192, 256], ["step", "discover", "inference"]),
    "objects": ([1, 2, 3, 4, 5, 6, 7, 8], WHATS),
    "threads": ([1, 2, 4, 8, 16], ["step", "discover", "inference"]),
}
TITLES = {"batch": "clips (frames of discover)", "frames": "frames of a clip", "side": "side of a frame, pixels",
          "objects": "objects", "threads": "threads"}
# A doubled side has four times as many pixels; a doubled number of threads should halve the time.
SLOPES = {"batch": 1, "frames": 1, "side": 2, "objects": 1, "threads": -1}


def cases(only):
    """Each case once: (axis, what, case)."""
    for axis, (values, whats) in AXES.items():
        for what in whats:
            base = BASES.get((what, axis), WHATS[what])
            for value in values:
                fits = value <= os.cpu_count() if axis == "threads" else not (axis == "batch" and value > 200 and what == "step")
                # The equation of one object alone is another.
                fits = fits and not (what in ("refinement", "identify") and axis == "objects" and value == 1)
                if fits and (not only or axis in only):
                    yield axis, what, replace(base, **{axis: value})


def time_case(what, case, steps, program, folder):
    task = folder / "cost.toml"
    task.write_text(TASK.format(acceleration=SPRINGS if case.objects > 1 else ALONE, side=case.side, objects=case.objects,
                                input=INPUT, predicted=case.frames - INPUT, frames=case.frames,
                                longest=max(case.frames, INPUT + 1) + 20))
    command = [program, "bench", "--what", what, "--task", task, "--batch", case.batch, "--steps", steps,
               "--threads", case.threads, "--set", "model.refinement_steps=3"]
    return measured(command, case.threads)


def exponent(values, seconds):
    """Of the larger half of the values: what a constant part hides among the small ones."""
    first = len(values) // 2 if len(values) > 3 else 0
    return float(np.polyfit(np.log(values[first:]), np.log(seconds[first:]), 1)[0]) if len(values) > 1 else None


def curves(rows):
    """{axis: {what: (values, seconds)}}"""
    found = {}
    for row in rows:
        values, seconds = found.setdefault(row["axis"], {}).setdefault(row["what"], ([], []))
        values.append(row[row["axis"]])
        seconds.append(row["seconds"])
    return found


def table(found):
    lines = []
    for axis, whats in found.items():
        columns = sorted({value for values, _ in whats.values() for value in values})
        lines += [f"## {TITLES[axis]}", "",
                  f"| | {' | '.join(map(str, columns))} | exponent |", "|---" * (len(columns) + 2) + "|"]
        for what, (values, seconds) in whats.items():
            known = dict(zip(values, seconds))
            shown = [f"{known[value]:.3g} s" if value in known else "" for value in columns]
            slope = exponent(values, seconds)
            lines.append(f"| {what} | {' | '.join(shown)} | {'–' if slope is None else f'{slope:.2f}'} |")
        lines.append("")
    return lines


def plot(found, path):
    figure, panels = plt.subplots(1, len(found), figsize=(4.2 * len(found), 4.4), squeeze=False)
    for panel, (axis, whats) in zip(panels[0], found.items()):
        for what, (values, seconds) in whats.items():
            colour = f"C{list(WHATS).index(what)}"
            panel.loglog(values, seconds, "o-", color=colour, label=what)
            ideal = seconds[-1] * (np.array(values) / values[-1]) ** SLOPES[axis]
            panel.loglog(values, ideal, ":", color=colour, alpha=0.6)
        ticks = sorted({value for values, _ in whats.values() for value in values})
        panel.set_xticks(ticks, labels=map(str, ticks))
        panel.minorticks_off()
        panel.set_xlabel(TITLES[axis])
        panel.grid(alpha=0.3)
    panels[0][0].set_ylabel("seconds")
    panels[0][0].legend()
    figure.tight_layout()
    figure.savefig(path, dpi=110)


def kept_rows(arguments):
    """Of the numbers that are not changed now, where those rows were timed alike."""
    path = arguments.out / "results.json"
    before = json.loads(path.read_text()) if arguments.only and path.exists() else {"about": {}, "rows": []}
    alike = all(before["about"].get(key) == value for key, value in settings(arguments).items())
    return [row for row in before["rows"] if alike and row["axis"] not in arguments.only]


def settings(arguments):
    return {"processor": processor(), "rounds": arguments.rounds, "steps": arguments.steps}


def report(rows, arguments):
    arguments.out.mkdir(parents=True, exist_ok=True)
    rows = sorted(kept_rows(arguments) + rows, key=lambda row: list(AXES).index(row["axis"]))
    about = {"date": str(date.today())} | settings(arguments)
    (arguments.out / "results.json").write_text(json.dumps({"about": about, "rows": rows}, indent=1) + "\n")
    found = curves(rows)
    plot(found, arguments.out / "cost.png")
    base = ", ".join(f"{name} {value}" for name, value in asdict(Case()).items())
    lines = ["# What a computation costs", "",
             f"{date.today()}, {processor()}; made with `{' '.join(['cost.py', *sys.argv[1:]])}` (rounds: {arguments.rounds}, repetitions in each: "
             f"{arguments.steps}; medians). One number is changed, the others stay at their base: " + base + "; discover has 48 "
             "frames, refinement and identify 100 clips; sides are timed with 5 clips, 16 frames of discover. "
             "The equation is text: springs between all objects. On one thread the seconds are of the processor, where "
             "threads are changed of the clock. The exponent is that of the larger half: 1 is linear, 2 for a side is "
             "linear in its pixels. Dotted lines have the exponent that it should be.", "",
             "![seconds over each number](cost.png)", "", *table(found)]
    (arguments.out / "README.md").write_text("\n".join(lines))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3, help="[default: 3]")
    parser.add_argument("--steps", type=int, default=3, help="repetitions in a round [default: 3]")
    parser.add_argument("--only", nargs="+", choices=AXES, default=[], help="what is changed; rows of the rest are kept [default: all]")
    parser.add_argument("--binaries", type=Path, default=HERE.parent / "target/release", help="folder of the programs")
    parser.add_argument("--out", type=Path, default=HERE.parent / "benches/cost", help="[default: ../benches/cost]")
    arguments = parser.parse_args()
    program = arguments.binaries.resolve() / "paig"
    if not program.exists():
        parser.error(f"{program} is not there; build it with make build")
    rounds = []
    with tempfile.TemporaryDirectory() as folder:
        for number in range(arguments.rounds):
            rounds.append([])
            for axis, what, case in cases(arguments.only):
                print(f"round {number + 1} of {arguments.rounds}: {what}, {case}", flush=True)
                done = time_case(what, case, arguments.steps, program, Path(folder))
                seconds = median(done["seconds"]) if axis == "threads" else done["processor_seconds"]
                rounds[-1].append({"axis": axis, "what": what} | asdict(case) | {"seconds": seconds, "mb": done["peak_mb"]})
            rows = [same[0] | {"seconds": median(row["seconds"] for row in same)} for same in zip(*rounds)]
            report(rows, arguments)
    print((arguments.out / "README.md").read_text())


if __name__ == "__main__":
    try:
        main()
    except (RuntimeError, OSError) as error:
        sys.exit(f"error: {error}")
