"""The cross-entropy planner of `control` in PyTorch, as one writes it there: a batch of candidates, a tensor for each step.

Prints milliseconds a decision on one core, beside those of the Rust planner on the same problem
(`control --planner true-state`), both in processor time. Run from the repository's root after `cargo build --release`:

    python compare/planner.py
"""

import json
import math
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import torch

CANDIDATES, ELITES, ITERATIONS, DECISIONS, HOLD = 1000, 100, 10, 12, 2
G, STEP, LARGEST, MAX_SPEED = 10.0, 0.05, 2.0, 8.0


def wrapped(angle):
    return angle - 2 * math.pi * torch.round(angle / (2 * math.pi))


def returns(angle, rate, plans, substeps):
    """The return of each plan `[candidates, decisions]` from one state."""
    angle = torch.full((plans.shape[0],), angle)
    rate = torch.full((plans.shape[0],), rate)
    total = torch.zeros(plans.shape[0])
    h = STEP / substeps
    for step in range(DECISIONS * HOLD):
        push = 3.0 * plans[:, step // HOLD]
        for _ in range(substeps):
            faster = rate + (1.5 * G * torch.sin(angle) + push) * h
            angle = angle + faster * h
            rate = faster.clamp(-MAX_SPEED, MAX_SPEED)
        total += 1.0 - wrapped(angle).abs() / math.pi
    return total


@torch.no_grad()
def plan(angle, rate, mean, substeps):
    spread = torch.full((DECISIONS,), LARGEST)
    for _ in range(ITERATIONS):
        plans = (mean + spread * torch.randn(CANDIDATES, DECISIONS)).clamp(-LARGEST, LARGEST)
        elites = plans[returns(angle, rate, plans, substeps).topk(ELITES).indices]
        mean, spread = elites.mean(0), elites.std(0)
    return mean


def in_pytorch(substeps, decisions=20):
    plan(1.0, 0.0, torch.zeros(DECISIONS), substeps)
    start = time.process_time()
    for number in range(decisions):
        plan(1.0 + 0.01 * number, 0.0, torch.zeros(DECISIONS), substeps)
    return 1000 * (time.process_time() - start) / decisions


def in_rust():
    with tempfile.TemporaryDirectory() as out:
        command = ["target/release/paig", "control", "--planner", "true-state", "--episodes", "8", "--out", out]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            sys.exit(done.stderr.strip())
        with open(f"{out}/results.json") as file:
            return json.load(file)["rows"][0]["ms_per_decision"]


if __name__ == "__main__":
    if not Path("target/release/paig").exists():
        sys.exit("error: target/release/paig is missing; run this from the repository's root, after make build")
    torch.set_num_threads(1)
    pytorch, rust = in_pytorch(substeps=1), in_rust()
    print(f"true equation, 1 Euler step a frame: PyTorch {pytorch:.1f} ms a decision, Rust {rust:.2f} ms")
    print(f"learned equation, 5 Euler steps a frame: PyTorch {in_pytorch(substeps=5):.1f} ms a decision")
