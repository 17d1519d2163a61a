"""What each known defect of earlier ports does: the tensor at which it shows, and what the fast recipe reaches with it.

Trains the faithful port and each defect once (minutes each, on one core). A finished training is kept in
defect_runs/; a command that was stopped goes on with the next one when it is given again. The table shows what is
trained so far; once complete it is written to defects.md.
"""
import argparse
import hashlib
import json
import sys
from pathlib import Path

import torch

from .defects_report import report
from .training.data import MissingData
from .training.loop import train
from .training.recipe import Training, fast_recipe

HERE = Path(__file__).resolve().parents[1]
RUNS = HERE / "defect_runs"
STEPS = 1500
# By the name under which --only takes them, in the order in which they are trained.
TRAININGS = {"faithful": Training()} | {str(n): Training(n) for n in (1, 2, 3, 4, 8, 10, 9, 11)} | {
    "rmsprop": Training(rmsprop=True)} | {str(n): Training(n, rmsprop=True) for n in (5, 6, 7)} | {
    "3bp": Training(task_key="3bp_color"), "12": Training(12, task_key="3bp_color")}


def key(*what):
    """Changes with the recipe, the seed, the steps and what is trained."""
    return hashlib.sha256(json.dumps(what, sort_keys=True, default=vars).encode()).hexdigest()[:12]


def place(name, seed, steps):
    training = TRAININGS[name]
    return RUNS / f"{name}-{key(fast_recipe(training.task_key), seed, steps, training)}.json"


def run(name, path, seed, steps):
    """Trains and keeps the record."""
    RUNS.mkdir(exist_ok=True)
    training = TRAININGS[name]
    recipe = fast_recipe(training.task_key)
    first_phase = key(recipe["model"], recipe["discover"], seed, steps, training.discovery())
    discovered = RUNS / f"discovered-{first_phase}.pt"
    record = train(training, recipe, seed, steps, discovered, lambda line: print(f"{name:>8} {line}", flush=True))
    record |= {"seed": seed, "steps": steps, "torch": torch.__version__}
    partial = path.with_name(path.name + ".partial")
    partial.write_text(json.dumps(record, indent=1) + "\n")
    partial.replace(path)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("goldens", type=Path)
    parser.add_argument("--only", metavar="N", choices=TRAININGS, action="append",
                        help=f"train this alone; may be repeated; one of {', '.join(TRAININGS)}")
    parser.add_argument("--steps", type=int, default=STEPS, help=f"gradient steps at most [default: {STEPS}]")
    parser.add_argument("--seed", type=int, default=0, help="[default: 0]")
    arguments = parser.parse_args()
    seed, steps = arguments.seed, arguments.steps
    paths = {name: place(name, seed, steps) for name in TRAININGS}
    missing = [name for name in arguments.only or TRAININGS if not paths[name].exists()]
    try:
        for count, name in enumerate(missing, 1):
            print(f"training {name}, {count} of {len(missing)}", flush=True)
            run(name, paths[name], seed, steps)
    except MissingData as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    records = {name: json.loads(path.read_text()) for name, path in paths.items() if path.exists()}
    text = report(records, TRAININGS, arguments.goldens, seed, steps)
    print(text)
    if len(records) == len(TRAININGS):
        (HERE / "defects.md").write_text(text)


if __name__ == "__main__":
    main()
