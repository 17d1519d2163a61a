"""Times the port beside PyTorch (as well as it can be written, eager and compiled; and as it is read) and TensorFlow, in
turns: python speed.py

Other work on the machine slows all of them, so only the ratios within a round count. On one thread they are of processor
time, which other work changes least; on more of the clock's. Results: ../benches/results.json, a table in
../benches/README.md.
"""
import argparse
import json
import os
import platform
import subprocess
import sys
import time
from datetime import date
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from statistics import median

HERE = Path(__file__).resolve().parent
BENCHES = HERE.parent / "benches"
# What is timed on which task, with how many clips (frames of discover).
ROWS = [("step", "spring_color", 25), ("step", "spring_color", 100), ("step", "3bp_color", 25), ("step", "3bp_color", 100),
        ("step", "mnist_spring_color", 10), ("step", "mnist_spring_color", 100), ("discover", "spring_color", 48),
        ("discover", "spring_color", 50), ("discover", "spring_color", 64), ("inference", "spring_color", 25),
        ("evaluation", "spring_color", 100), ("identify", "spring_color", 100), ("identify", "3bp_color", 100),
        ("generation", "spring_color", 1000)]
NETWORK = ("step", "discover", "inference", "evaluation")
# The references, and what each knows.
REFERENCES = {
    "eager": (["-m", "torch_reference.fast"], (*NETWORK, "identify")),
    "compiled": (["-m", "torch_reference.fast", "--compile"], NETWORK),
    "eager_tf32": (["-m", "torch_reference.fast", "--tf32"], NETWORK),
    "compiled_tf32": (["-m", "torch_reference.fast", "--compile", "--tf32"], NETWORK),
    "readable": (["-m", "torch_reference.speed"], ("step",)),
    "tf": (["-m", "tf_reference.speed"], ("step",)),
    "tf_xla": (["-m", "tf_reference.speed", "--xla"], ("step",)),
    "tf_session": (["-m", "tf_reference.speed", "--session"], ("step",)),
}
NAMES = {"tf32": "ours in TF32", "libtorch": "libtorch's kernels", "eager": "PyTorch", "compiled": "PyTorch, compiled",
         "eager_tf32": "PyTorch in TF32", "compiled_tf32": "PyTorch, compiled, in TF32",
         "readable": "PyTorch, readable", "tf": "TensorFlow graph", "tf_xla": "TensorFlow, XLA",
         "tf_session": "TensorFlow 1's session"}
# The same for all programs, and what the port sets for itself.
ENVIRONMENT = {
    "OMP_WAIT_POLICY": "passive",
    "GLIBC_TUNABLES": "glibc.malloc.mmap_threshold=4294967296:glibc.malloc.trim_threshold=17179869184:"
                      "glibc.malloc.hugetlb=1",
}


def measured(command, threads):
    """What a program prints, and the seconds that it took in all."""
    environment = os.environ | ENVIRONMENT | {"OMP_NUM_THREADS": str(threads)}
    began = time.perf_counter()
    done = subprocess.run(list(map(str, command)), cwd=HERE, capture_output=True, text=True, env=environment)
    if done.returncode:
        lines = done.stderr.strip().splitlines() or ["it said nothing"]
        said = [line for line in lines if "error" in line.lower()] or lines
        raise RuntimeError(f"{' '.join(map(str, command))} failed: {said[-1]}")
    return json.loads(done.stdout.splitlines()[-1]) | {"all_s": time.perf_counter() - began}


def network_flops(task, frames):
    """Of the encoder's convolutions and first dense layer, forward."""
    from shared.tasks import TASKS
    task = TASKS[task]
    base, poolings = (16, 3) if task.deep else (8, 2)
    pixels = [(task.side >> level) ** 2 for level in range(poolings + 1)]
    width = [base << level for level in range(poolings + 1)]
    products = 0
    for level in range(poolings + 1):
        products += 9 * pixels[level] * width[level] * ((width[level - 1] if level else 3) + width[level])
    for level in range(poolings):
        up, skip = 2 * base, width[level]
        products += 9 * pixels[level] * (width[level + 1] * up + (up + skip) * skip + skip * skip)
    products += pixels[0] * base * task.objects
    products += task.objects * 200 * 3 * pixels[0] // (4 if task.deep else 1)
    return 2 * frames * products


def flops(what, task, batch):
    """Of one repetition, counting the encoder alone: forward, and twice that backward."""
    from shared.tasks import TASKS
    encoded = 1 if what == "discover" else TASKS[task].input_steps + TASKS[task].pred_steps
    return network_flops(task, batch * encoded) * (1 if what in ("inference", "evaluation") else 3)


def peak_gflops():
    """Of a float32 matrix product on one thread, by processor time."""
    import torch
    torch.set_num_threads(1)
    a, best = torch.rand(1024, 1024), 0.0
    for _ in range(10):
        began = time.process_time()
        for _ in range(4):
            a @ a
        best = max(best, 4 * 2 * 1024**3 / (time.process_time() - began) / 1e9)
    return best


def commands(row, steps, threads, device, rust, references):
    what, task, batch = row
    given = ["--what", what, "--task", task, "--batch", batch, "--steps", steps, "--threads", threads, "--device", device]
    chosen = {"ours": [rust, "bench", *given]}
    if device != "cpu":
        chosen["tf32"] = [rust, "bench", *given, "--set", "model.tf32=true"]
    elif what in NETWORK:
        chosen["libtorch"] = [rust, "bench", *given, "--set", 'model.kernels="libtorch"']
    for name in references:
        module, known = REFERENCES[name]
        if what in known:
            chosen[name] = [sys.executable, *module, *given]
    return chosen


def time_row(row, threads, arguments, rust):
    chosen = commands(row, arguments.steps, threads, arguments.device, rust, arguments.references)
    rounds = []
    for number in range(arguments.rounds):
        print(f"{' '.join(map(str, row))}, {threads} thread(s): round {number + 1} of {arguments.rounds} ..", flush=True)
        rounds.append({})
        for name, command in list(chosen.items()):
            try:
                rounds[-1][name] = measured(command, threads)
            except RuntimeError as error:
                # A reference may be unable to do it (a fault of its compiler): it is left out of the row.
                if name not in REFERENCES or number > 0:
                    raise
                print(f"left out: {error}", flush=True)
                del chosen[name]
    what, task, batch = row
    by_processor = threads == 1 and arguments.device == "cpu"
    clock = (lambda done: done["processor_seconds"]) if by_processor else (lambda done: median(done["seconds"]))
    result = {"what": what, "task": task, "batch": batch, "threads": threads, "device": arguments.device, "ratios": {}}
    for name in chosen:
        result[f"{name}_s"] = median(clock(each[name]) for each in rounds)
        result[f"{name}_mb"] = median(each[name]["peak_mb"] for each in rounds)
        if name != "ours":
            ratios = sorted(clock(each[name]) / clock(each["ours"]) for each in rounds)
            result["ratios"][name] = [ratios[0], median(ratios), ratios[-1]]
    if what in NETWORK:
        result["ours_gflops"] = flops(*row) / result["ours_s"] / 1e9
    return result


def table(results, peak):
    others = [name for name in NAMES if any(name in row["ratios"] for row in results)]
    lines = ["| what | task | batch | threads | ours, s | " + " | ".join(f"{NAMES[name]} / ours" for name in others)
             + " | GFLOP/s | of a matrix product's | memory, MB | PyTorch's |",
             "|---" * (9 + len(others)) + "|"]
    for row in results:
        ratios = [row["ratios"].get(name) for name in others]
        shown = ["–" if ratio is None else "{1:.2f} [{0:.2f}, {2:.2f}]".format(*ratio) for ratio in ratios]
        gflops = row.get("ours_gflops")
        rate = f"{gflops:.0f}" if gflops else "–"
        share = f"{gflops / peak:.0%}" if gflops and row["threads"] == 1 and row["device"] == "cpu" else "–"
        memory = f"{row['eager_mb']:.0f}" if "eager_mb" in row else "–"
        ours = f"{row['ours_s']:.3f}" if row["ours_s"] >= 0.02 else f"{row['ours_s']:.2g}"
        lines.append(f"| {row['what']} | {row['task']} | {row['batch']} | {row['threads']} | {ours} | "
                     + " | ".join(shown)
                     + f" | {rate} | {share} | {row['ours_mb']:.0f} | {memory} |")
    return lines


def processor(device="cpu"):
    if device != "cpu":
        import torch
        return torch.cuda.get_device_name(device)
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    return next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), platform.machine())


def versions():
    for name in ("torch", "tensorflow-cpu"):
        try:
            yield f"{name} {version(name)}"
        except PackageNotFoundError:
            pass


def settings(arguments):
    """What rows of one table have in common."""
    return {"processor": processor(arguments.device), "rounds": arguments.rounds, "steps": arguments.steps, "versions": list(versions())}


def kept_rows(arguments):
    before = json.loads((arguments.out / "results.json").read_text())
    now = settings(arguments)
    if any(before["about"][key] != value for key, value in now.items()):
        raise RuntimeError(f"--keep: the rows of {arguments.out} were timed otherwise than now: {now}")
    return before["rows"]


def report(results, arguments, peak, start):
    about = {"date": str(date.today()), "matrix_product_gflops": peak, "start_s": start} | settings(arguments)
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "results.json").write_text(json.dumps({"about": about, "rows": results}, indent=1) + "\n")
    lines = ["# Benchmarks", "",
             f"{date.today()}, {processor(arguments.device)}, Python {platform.python_version()}, {', '.join(versions())}; made with "
             f"`{' '.join(['speed.py', *sys.argv[1:]])}` ({arguments.rounds} rounds of {arguments.steps} repetitions, the programs in turns; median "
             "[smallest, largest] over the rounds). Above 1: ours is faster.", "",
             "`step` is a step of the paper's protocol: all losses, gradients, RMSProp; the batch is of clips. `discover` is "
             "a step of the autoencoder; the batch is of frames. `inference` is encoder, roll-out over 26 frames and "
             "decoder, without gradients; `evaluation` is the same and the three losses. `identify` is the fit of the "
             "parameters to the positions of so many clips; PyTorch's is that of `compare/torch_reference/training`, which is "
             "not compiled. `generation` draws and writes the files of a dataset. On one thread the times are of the "
             "processor, on more of the clock. *libtorch's kernels* is ours with `model.kernels = \"libtorch\"`. *PyTorch* is `compare/torch_reference/fast.py`, written "
             "for speed; *readable* the reference that the comparisons use. All run with the same allocator and OpenMP "
             "settings. On a GPU all times are of the clock, and the memory is the processor's. GFLOP/s count the encoder's "
             "convolutions and first dense layer alone; a float32 matrix product "
             f"(MKL) reaches {peak:.0f} on one thread of this machine. From start to the end of an empty run: {start:.2f} s. – stands "
             "where a reference has no such step or fails in it.",
             "", *table(results, peak), ""]
    (arguments.out / "README.md").write_text("\n".join(lines))
    print("\n".join(lines))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5, help="[default: 5]")
    parser.add_argument("--steps", type=int, default=5, help="repetitions of each program in a round [default: 5]")
    parser.add_argument("--threads", type=int, nargs="+", default=[1], help="[default: 1]")
    parser.add_argument("--device", default="cpu", help="cpu, cuda or cuda:n [default: cpu]")
    parser.add_argument("--only", nargs="+", default=[], help="what is timed: step, discover, inference, .., or a task")
    parser.add_argument("--batch", type=int, nargs="+", default=[], help="only rows of these batches")
    parser.add_argument("--references", nargs="*", choices=REFERENCES,
                        default=["eager", "compiled", "tf", "tf_xla", "tf_session"],
                        help="[default: eager compiled tf tf_xla tf_session]")
    parser.add_argument("--binaries", type=Path, default=HERE.parent / "target/release", help="folder of the programs")
    parser.add_argument("--keep", action="store_true", help="keep the rows of --out that are not timed now")
    parser.add_argument("--out", type=Path, default=BENCHES, help="folder of the results [default: ../benches]")
    arguments = parser.parse_args()
    rust = arguments.binaries.resolve() / "paig"
    if not rust.exists():
        parser.error(f"{rust} is not there; build it with make build")
    of_a_gpu = [name for name in arguments.references if name.endswith("_tf32")]
    if of_a_gpu and arguments.device == "cpu":
        parser.error(f"a CPU has no TF32: leave out {', '.join(of_a_gpu)}, or give a GPU with --device")
    known = {name for row in ROWS for name in row[:2]}
    if unknown := sorted({*arguments.only} - known):
        parser.error(f"--only: nothing is called {', '.join(unknown)}; there are {', '.join(sorted(known))}")
    rows = [row for row in ROWS if (not arguments.only or {*row[:2]} & {*arguments.only})
            and (not arguments.batch or row[2] in arguments.batch)]
    peak = peak_gflops()
    start = median(measured([rust, "bench", "--task", "spring_color", "--steps", 0], 1)["all_s"] for _ in range(3))
    timed = {(*row, threads) for row in rows for threads in arguments.threads}
    kept = kept_rows(arguments) if arguments.keep else []
    results = [row for row in kept if (row["what"], row["task"], row["batch"], row["threads"]) not in timed]
    for threads in arguments.threads:
        for row in rows if arguments.device == "cpu" else [row for row in rows if row[0] in NETWORK]:
            results.append(time_row(row, threads, arguments, rust))
            report(results, arguments, peak, start)


if __name__ == "__main__":
    try:
        main()
    except (RuntimeError, OSError) as error:
        sys.exit(f"error: {error}")
