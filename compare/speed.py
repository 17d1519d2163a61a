"""Times training steps of the port, of PyTorch and of TensorFlow in turns: python speed.py

Other work on the machine slows all of them, so only the ratios within a round count. The table goes to speed.md as well.
"""
import argparse
import json
import platform
import subprocess
import sys
from datetime import date
from importlib.metadata import version
from pathlib import Path
from statistics import median

HERE = Path(__file__).resolve().parent
# Clips in a step: frames of 64 x 64 are dear.
BATCHES = {"spring_color": 25, "3bp_color": 25, "mnist_spring_color": 10}
REFERENCES = {"PyTorch": "torch_reference.speed", "TensorFlow": "tf_reference.speed"}


def median_seconds(command, task, steps):
    """Of one step, in a process of its own."""
    command = [*command, "--task", task, "--batch", BATCHES[task], "--steps", steps]
    done = subprocess.run([str(part) for part in command], cwd=HERE, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"error: {' '.join(map(str, command))} failed: {done.stderr.strip().splitlines()[-1]}")
    return median(json.loads(done.stdout.splitlines()[-1]))


def spread(values, form):
    return f"{form(median(values))} [{form(min(values))}, {form(max(values))}]"


def processor():
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    return next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), platform.machine())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5, help="[default: 5]")
    parser.add_argument("--steps", type=int, default=5, help="steps of each program in a round [default: 5]")
    parser.add_argument("--binaries", type=Path, default=HERE.parent / "target/release", help="folder of the programs")
    parser.add_argument("--report", type=Path, default=HERE / "speed.md", help="[default: speed.md]")
    arguments = parser.parse_args()
    rust = arguments.binaries.resolve() / "speed"
    if not rust.exists():
        parser.error(f"{rust} is not there; build it with cargo build --release")
    commands = {"Rust": [rust]} | {name: [sys.executable, "-m", module] for name, module in REFERENCES.items()}
    lines = ["| task | clips in a step | Rust, s a step | " + " | ".join(f"{name} / Rust" for name in REFERENCES) + " |",
             "|---" * (3 + len(REFERENCES)) + "|"]
    for task, batch in BATCHES.items():
        rounds = []
        for number in range(arguments.rounds):
            print(f"{task}: round {number + 1} of {arguments.rounds} ..", flush=True)
            rounds.append({name: median_seconds(command, task, arguments.steps) for name, command in commands.items()})
        ratios = [spread([each[name] / each["Rust"] for each in rounds], "{:.2f}".format) for name in REFERENCES]
        seconds = spread([each["Rust"] for each in rounds], "{:.3f}".format)
        lines.append(f"| {task} | {batch} | {seconds} | " + " | ".join(ratios) + " |")
    versions = ", ".join(f"{name} {version(name)}" for name in ("torch", "tensorflow-cpu"))
    head = ["# Speed: a training step in Rust, PyTorch and TensorFlow", "",
            f"{date.today()}, {processor()}, one thread each, Python {platform.python_version()}, {versions}.",
            f"A step of the paper's protocol: all losses, gradients, RMSProp. {arguments.rounds} rounds of "
            f"{arguments.steps} steps, the programs in turns; median [smallest, largest] over the rounds. Above 1: Rust "
            "is faster. Both references are written to be read, TensorFlow's runs as a graph.", ""]
    text = "\n".join([*head, *lines, ""])
    arguments.report.write_text(text)
    print(text)


if __name__ == "__main__":
    main()
