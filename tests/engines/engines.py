#!/usr/bin/env python3
"""Runs a sweep on real engines on this machine, kills what they run at random, and compares with a plain sweep.

    python3 tests/engines/engines.py parallel hyperqueue slurm [--runs 20] [--kills 10]

Every run must have finished once, with the bits of the plain sweep. Needed are target/release/paig, and GNU
parallel (Debian: parallel), or the Python module `hyperqueue` (PyPI), or slurmctld, slurmd and munge (Debian: slurm-wlm,
munge; as root). Prints a line of JSON for the plain sweep, with the time in which it ran nothing, and one for each engine.
"""

import argparse
import json
import os
import random
import shlex
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAIG = ROOT / "target/release/paig"
# A run of all phases in a second or two.
TINY = """
[discover]
frames = 4
max_steps = 10
[identify]
clips = 2
horizons = [3]
max_iterations = 1
[join]
batch = 2
max_steps = 6
validation_clips = 2
[output]
print_every = 2
checkpoint_every = 2
examples = 0
"""
DEADLINE = 3600
# Seconds between two looks at what a sweep runs.
LOOK = 0.005


def call(*words, **options):
    return subprocess.run([str(word) for word in words], check=True, **options)


def sweep(out, runs, *more):
    return [PAIG, "sweep", "--task", "spring_color", "--seeds", f"0-{runs - 1}", "--name", "tiny", "--config",
            "tiny.toml", "--data", "data", "--threads-per-run", "1", "--out", out, *more]


def folders(out, runs):
    return [Path(out) / f"spring_color/fast-tiny/seed={seed}" for seed in range(runs)]


def finished(out, runs):
    return sum((folder / "DONE").exists() for folder in folders(out, runs))


def weights(folder):
    last = json.loads((folder / "checkpoints/index.json").read_text())["last"]
    return (folder / "checkpoints" / last / "weights.safetensors").read_bytes()


def steps(folder):
    records = [json.loads(line) for line in (folder / "metrics.jsonl").read_text().splitlines()]
    return [(record["kind"], record["phase"], record["step"]) for record in records]


def programs_below(folder):
    """Our own processes that work in this folder."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                name, place = (entry / "comm").read_text().strip(), os.readlink(entry / "cwd")
            except OSError:
                continue
            if name == "paig" and place == str(folder):
                found.append(int(entry.name))
    return found


def kill_some(folder, kills):
    """Kills one program, if any runs."""
    running = programs_below(folder)
    if running and kills > 0:
        try:
            os.kill(random.choice(running), random.choice([signal.SIGKILL, signal.SIGTERM]))
            return 1
        except ProcessLookupError:
            pass
    return 0


def wait(done, folder, kills, until):
    """Waits for an engine, killing now and then; how many were killed."""
    killed = 0
    while not done():
        if time.monotonic() > until:
            raise SystemExit("the engine never ended")
        time.sleep(random.uniform(0.3, 1.5))
        killed += kill_some(folder, kills - killed)
    return killed


def parallel(lines, folder, kills, until):
    process = subprocess.Popen(["parallel", "--jobs", "2"], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL,
                               stderr=subprocess.DEVNULL, text=True)
    process.stdin.write("\n".join(lines))
    process.stdin.close()
    return wait(lambda: process.poll() is not None, folder, kills, until)


def hyperqueue(lines, folder, kills, until):
    from hyperqueue import Job, LocalCluster
    from hyperqueue.cluster import WorkerConfig

    with LocalCluster() as cluster:
        cluster.start_worker(WorkerConfig(cores=2))
        # One that is killed stops no other one.
        client, job = cluster.client(), Job(max_fails=None)
        for line in lines:
            job.program(["bash", "-c", line], cwd=str(folder))
        submitted = client.submit(job)
        child = os.fork()
        if child == 0:
            killed = 0
            while killed < kills:
                time.sleep(random.uniform(0.3, 1.5))
                killed += kill_some(folder, 1)
            os._exit(0)
        try:
            client.wait_for_jobs([submitted], raise_on_error=False)
        finally:
            os.kill(child, signal.SIGKILL)
            _, status = os.waitpid(child, 0)
        return kills if os.WIFEXITED(status) else 0


def slurm(lines, folder, kills, until):
    start_slurm(folder)
    (folder / "runs.txt").write_text("\n".join(lines) + "\n")
    (folder / "array.sh").write_text('#!/bin/bash\nsed -n "${SLURM_ARRAY_TASK_ID}p" runs.txt | bash\n')
    call("sbatch", "--output=/dev/null", f"--array=1-{len(lines)}", "array.sh", stdout=subprocess.DEVNULL, env=slurm.env)

    def queue_is_empty():
        queue = call("squeue", "--noheader", stdout=subprocess.PIPE, text=True, env=slurm.env).stdout
        return not queue.strip()

    return wait(queue_is_empty, folder, kills, until)


slurm.daemons = []
slurm.env = None


def start_slurm(folder):
    if slurm.daemons:
        return
    place, host = folder / "slurm", socket.gethostname().split(".")[0]
    for name in ("ctld", "d", "spool"):
        (place / name).mkdir(parents=True)
    key = place / "munge.key"
    key.write_bytes(os.urandom(1024))
    key.chmod(0o400)
    munge = place / "munge.socket"
    (place / "slurm.conf").write_text(f"""ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket={munge}
StateSaveLocation={place}/ctld
SlurmdSpoolDir={place}/spool
SlurmctldPidFile={place}/ctld.pid
SlurmdPidFile={place}/d.pid
SlurmctldLogFile={place}/ctld.log
SlurmdLogFile={place}/d.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
ReturnToService=2
MpiDefault=none
NodeName={host} NodeAddr=127.0.0.1 CPUs=2 State=UNKNOWN
PartitionName=test Nodes={host} Default=YES State=UP OverSubscribe=YES
""")
    slurm.env = {**os.environ, "SLURM_CONF": str(place / "slurm.conf")}
    daemon = lambda *words: slurm.daemons.append(subprocess.Popen(words, env=slurm.env, stdout=subprocess.DEVNULL,
                                                                  stderr=subprocess.DEVNULL))
    daemon("munged", "--foreground", "--force", f"--key-file={key}", f"--socket={munge}",
           f"--pid-file={place}/munge.pid", f"--log-file={place}/munge.log", f"--seed-file={place}/munge.seed")
    time.sleep(1)
    daemon("slurmctld", "-D")
    time.sleep(1)
    daemon("slurmd", "-D")
    time.sleep(3)


def is_running(process):
    try:
        # The state follows the name, which stands in brackets.
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (OSError, IndexError):
        return False


def plain_sweep(runs):
    """A sweep of one run at a time: its seconds, and those in which none of its runs was under way."""
    began = last = time.monotonic()
    idle = 0
    process = subprocess.Popen([str(word) for word in sweep("plain", runs)], stdout=subprocess.DEVNULL)
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    while process.poll() is None:
        time.sleep(LOOK)
        try:
            busy = any(map(is_running, children.read_text().split()))
        except OSError:
            busy = False
        now = time.monotonic()
        idle += 0 if busy else now - last
        last = now
    if process.returncode != 0:
        raise SystemExit("the plain sweep failed")
    return last - began, idle


def on_engine(name, runs, kills, folder):
    """Kills and rounds until all runs have finished."""
    out = f"runs-{name}"
    dry = call(*sweep(out, runs, "--dry-run"), stdout=subprocess.PIPE, text=True).stdout.splitlines()
    lines = [" ".join(shlex.quote(word) for word in shlex.split(line)) for line in dry]
    until, killed, rounds = time.monotonic() + DEADLINE, 0, 0
    while finished(out, runs) < runs:
        rounds += 1
        killed += ENGINES[name](lines, folder, kills - killed, until)
    return killed, rounds


def has_other_bits(one, other):
    return weights(one) != weights(other) or steps(one) != steps(other)


ENGINES = {"parallel": parallel, "hyperqueue": hyperqueue, "slurm": slurm}


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("engines", choices=ENGINES, nargs="+")
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--kills", type=int, default=10, help="for each engine")
    parser.add_argument("--folder", help="work here and keep it; a plain sweep that is there is not run again")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(arguments.folder or place).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        os.chdir(folder)
        try:
            plainly(arguments.runs, folder)
            right = all([try_out(name, arguments, folder) for name in arguments.engines])
        finally:
            for daemon in slurm.daemons:
                daemon.terminate()
    sys.exit(0 if right else 1)


def plainly(runs, folder):
    """Makes the data and the runs that all engines are compared with, if they are not there; prints what that took."""
    if finished("plain", runs) == runs:
        return
    (folder / "tiny.toml").write_text(TINY)
    call(PAIG, "generate", "--task", "spring_color", "--train", 12, "--valid", 4, "--test", 4, "--out", "data",
         stdout=subprocess.DEVNULL)
    took, idle = plain_sweep(runs)
    print(json.dumps({"engine": "none", "runs": runs, "seconds": round(took, 1), "overhead": round(idle / took, 4)}),
          flush=True)


def try_out(name, arguments, folder):
    """Runs the sweep on an engine; prints what came of it, and says whether all is as it should be."""
    runs, before = arguments.runs, time.monotonic()
    killed, rounds = on_engine(name, runs, arguments.kills, folder)
    pairs = zip(folders("plain", runs), folders(f"runs-{name}", runs))
    wrong = sum(has_other_bits(one, other) for one, other in pairs)
    print(json.dumps({"engine": name, "runs": runs, "killed": killed, "rounds": rounds, "other_bits": wrong,
                      "seconds": round(time.monotonic() - before, 1)}), flush=True)
    return wrong == 0


if __name__ == "__main__":
    main()
