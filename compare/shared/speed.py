"""Times a reference's computations, as the port's `speed` does: prints JSON, the `seconds` of each repetition, the
`processor_seconds` of one on average, and the largest memory in MB."""
import argparse
import json
import resource
import time

from .tasks import TASKS

WARM_UP = 2  # libraries choose and compile their kernels in the first
PREDICTED = 26  # frames that are predicted where only inference is timed


def main(new, whats=("step",), to_device=None):
    """`new(what, task, batch, threads)` gives a function that does it once. `to_device(device)`, where a reference computes on
    others than the CPU, makes it do so, and gives a function that waits for what is under way there."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--task", choices=TASKS, required=True)
    parser.add_argument("--what", choices=whats, default="step")
    parser.add_argument("--batch", type=int, default=25, help="clips, or frames of `discover` [default: 25]")
    parser.add_argument("--steps", type=int, default=5, help="repetitions that are timed [default: 5]")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--device", default="cpu")
    arguments = parser.parse_args()
    if arguments.device != "cpu" and to_device is None:
        parser.error("this reference computes on the CPU")
    wait = to_device(arguments.device) if to_device else lambda: None
    repeat = new(arguments.what, TASKS[arguments.task], arguments.batch, arguments.threads)
    for _ in range(WARM_UP if arguments.steps else 0):
        repeat()
    wait()
    busy, seconds = time.process_time(), []
    for _ in range(arguments.steps):
        began = time.perf_counter()
        repeat()
        wait()
        seconds.append(time.perf_counter() - began)
    busy = (time.process_time() - busy) / max(arguments.steps, 1)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    print(json.dumps({"seconds": seconds, "processor_seconds": busy, "peak_mb": peak}))
