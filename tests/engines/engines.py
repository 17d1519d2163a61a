#!/usr/bin/env python3
"""Runs a sweep on a real engine on this machine, kills what it runs at random, and compares with a plain sweep.

    python3 tests/engines/engines.py parallel|hyperqueue|slurm [--runs 20] [--kills 10]

Every run must have finished once, with the bits of the plain sweep. Needed are the programs in target/release, and GNU
parallel (Debian: parallel), or the Python module `hyperqueue` (PyPI), or slurmctld, slurmd and munge (Debian: slurm-wlm,
munge; as root). Prints a line of JSON.
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
PROGRAMS = ROOT / "target/release"
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
DEADLINE = 1800


def call(*words, **options):
    return subprocess.run([str(word) for word in words], check=True, **options)


def sweep(out, runs, *more):
    return [PROGRAMS / "sweep", "--task", "spring_color", "--seeds", f"0-{runs - 1}", "--name", "tiny", "--config",
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
            if name in ("run_physics", "sweep") and place == str(folder):
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
        client, job = cluster.client(), Job()
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


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("engine", choices=["parallel", "hyperqueue", "slurm"])
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--kills", type=int, default=10)
    arguments = parser.parse_args()
    engine, runs = globals()[arguments.engine], arguments.runs
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place).resolve()
        os.chdir(folder)
        (folder / "tiny.toml").write_text(TINY)
        call(PROGRAMS / "generate", "--task", "spring_color", "--train", 12, "--valid", 4, "--test", 4, "--out", "data",
             stdout=subprocess.DEVNULL)
        before = time.monotonic()
        call(*sweep("plain", runs), stdout=subprocess.DEVNULL)
        plain = time.monotonic() - before
        training = sum(json.loads((one / "summary.json").read_text())["wall_seconds"] for one in folders("plain", runs))
        dry = call(*sweep("engine", runs, "--dry-run"), stdout=subprocess.PIPE, text=True).stdout.splitlines()
        lines = [" ".join(shlex.quote(word) for word in shlex.split(line)) for line in dry]
        until, killed, rounds = time.monotonic() + DEADLINE, 0, 0
        before = time.monotonic()
        try:
            while finished("engine", runs) < runs:
                rounds += 1
                killed += engine(lines, folder, arguments.kills - killed, until)
        finally:
            for daemon in slurm.daemons:
                daemon.terminate()
        took = time.monotonic() - before
        pairs = list(zip(folders("plain", runs), folders("engine", runs)))
        wrong = sum(weights(one) != weights(other) or steps(one) != steps(other) for one, other in pairs)
    print(json.dumps({"engine": arguments.engine, "runs": runs, "killed": killed, "rounds": rounds, "other_bits": wrong,
                      "seconds": round(took, 1), "plain_seconds": round(plain, 1),
                      "plain_training_seconds": round(training, 1)}))
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
