#!/usr/bin/env python3
"""Loads the server of `paig studio`: parallel requests, slow and idle clients, uploads that break off or collide, jobs that
are started many times at once, and kills of the server at random moments.

    python3 tests/server/load.py [--requests 10000] [--kills 100]

Needs target/release/paig (or PAIG). Prints what it finds wrong, and a line of JSON with its counts.
"""

import argparse
import concurrent.futures
import contextlib
import json
import os
import random
import re
import resource
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAIG = Path(os.environ.get("PAIG", ROOT / "target/release/paig"))
VIDEO = ROOT / "tests/data/numbered.mp4"
# Seconds after which an answer, and a job, count as missing, on a busy machine.
PATIENCE = 60
JOB_PATIENCE = 600


class Server:
    """A server with its own folder of projects."""

    def __init__(self, folder):
        self.folder = Path(folder)
        self.process = subprocess.Popen([PAIG, "studio", "--no-open", "--folder", "projects"], cwd=folder, text=True,
                                        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        line = self.process.stdout.readline()
        self.port, self.token = re.search(r":(\d+)/\?token=(\w+)", line).groups()
        self.port = int(self.port)

    @property
    def projects(self):
        return self.folder / "projects"

    def connect(self):
        return socket.create_connection(("127.0.0.1", self.port), timeout=PATIENCE)

    def head(self, method, path, *lines):
        host = f"127.0.0.1:{self.port}"
        head = [f"{method} {path} HTTP/1.1", f"Host: {host}", f"Origin: http://{host}",
                f"Cookie: paig_studio_{self.port}={self.token}", *lines]
        return ("\r\n".join(head) + "\r\n\r\n").encode()

    def ask(self, method, path, body=b"", *lines):
        """The status and body of an answer."""
        if not isinstance(body, bytes):
            body, lines = json.dumps(body).encode(), ("Content-Type: application/json", *lines)
        with self.connect() as connection:
            connection.sendall(self.head(method, path, f"Content-Length: {len(body)}", "Connection: close", *lines) + body)
            answer = b"".join(iter(lambda: connection.recv(1 << 16), b""))
        head, _, rest = answer.partition(b"\r\n\r\n")
        return int(head.split()[1]), rest

    def create(self, title):
        status, body = self.ask("POST", "/api/projects", {"title": title})
        assert status == 201, (status, body)
        return json.loads(body)["name"]

    def state(self, name):
        return json.loads(self.ask("GET", f"/api/projects/{name}")[1])

    def wait(self, name):
        """The project's state once its preview was made."""
        end = time.time() + JOB_PATIENCE
        while time.time() < end:
            state = self.state(name)
            if state["preview_work"]["state"] != "running":
                return state
            time.sleep(0.1)
        raise TimeoutError(name)

    def held(self):
        """Open files, threads, and memory in MB."""
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        number = lambda key: int(re.search(rf"^{key}:\s+(\d+)", status, re.M)[1])
        return len(os.listdir(f"/proc/{self.process.pid}/fd")), number("Threads"), number("VmRSS") // 1024

    def end(self, how=signal.SIGTERM):
        self.process.send_signal(how)
        self.process.wait(PATIENCE)


def parallel(count, workers, work):
    with concurrent.futures.ThreadPoolExecutor(workers) as pool:
        return list(pool.map(work, range(count)))


def requests(server, count, wrong):
    """Allowed and refused requests; each has its answer."""
    name = server.create("many")
    kinds = [("GET", "/api/projects", 200), ("GET", f"/api/projects/{name}", 200), ("GET", "/api/offers", 200),
             ("GET", "/assets/none.js", 404), ("GET", "/api/projects/..%2F..", 404), ("GET", "/", 200),
             ("POST", "/api/projects", 415), ("DELETE", "/api/projects/none", 404),
             ("GET", f"/api/projects/{name}/frames/0", 404), ("PUT", f"/api/projects/{name}/settings", 415)]

    def one(number):
        method, path, expected = kinds[number % len(kinds)]
        begun = time.time()
        try:
            status = server.ask(method, path)[0]
        except (OSError, IndexError, ValueError) as error:
            status = repr(error)
        return f"{method} {path}: {status}, expected {expected}" if status != expected else None, time.time() - begun

    answers = parallel(count, 200, one)
    wrong += sorted({error for error, _ in answers if error})
    return {"server_requests": count, "slowest_answer": round(max(seconds for _, seconds in answers), 2)}


def slow_clients(server, wrong):
    """Clients that send a head byte by byte, and idle ones, while others ask."""
    before = server.held()
    slow = [server.connect() for _ in range(300)]
    idle = [server.connect() for _ in range(200)]
    for connection in idle:
        connection.sendall(server.head("GET", "/api/offers"))
    for byte in server.head("GET", "/api/projects")[:40]:
        for connection in slow:
            connection.sendall(bytes([byte]))
    for _ in range(50):
        begun = time.time()
        status = server.ask("GET", "/api/projects")[0]
        if status != 200 or time.time() - begun > PATIENCE / 2:
            wrong.append(f"beside slow clients: {status} after {time.time() - begun:.1f} s")
    for connection in slow + idle:
        connection.close()
    end = time.time() + PATIENCE
    while server.held()[0] > before[0] + 5 and time.time() < end:
        time.sleep(0.1)
    after = server.held()
    if after[0] > before[0] + 5 or after[1] > before[1] + 8:
        wrong.append(f"after slow clients: {after} open files, threads and MB, before {before}")
    return {"slow_clients": len(slow), "idle_clients": len(idle)}


def full_of_connections(folder, wrong):
    """A server without free file descriptors answers again once it has some."""
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (128, limits[1]))
    try:
        server = Server(folder)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)
    # Beyond these the system's queue of connections would be full, too.
    held = [server.connect() for _ in range(200)]
    time.sleep(2)
    for connection in held:
        connection.close()
    try:
        status = server.ask("GET", "/api/projects")[0]
    except (OSError, IndexError) as error:
        status = repr(error)
    if status != 200:
        wrong.append(f"after 200 connections with 128 descriptors: {status}")
    server.end()
    return {"connections_beyond_descriptors": len(held)}


def uploads(server, wrong):
    """Uploads that break off leave nothing; those of one name at a time leave one of them, whole."""
    aborted = 200
    name = server.create("broken off")
    source = server.projects / name / "source"

    def abort(number):
        with contextlib.closing(server.connect()) as connection:
            head = server.head("PUT", f"/api/projects/{name}/source/{number}.mp4", "Content-Length: 1000000")
            connection.sendall(head + b"x" * random.randrange(300000))
            if number % 2:
                # A reset instead of an end.
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")

    parallel(aborted, 20, abort)
    end = time.time() + PATIENCE
    while any(source.iterdir()) and time.time() < end:
        time.sleep(0.1)
    left = sorted(path.name for path in source.iterdir())
    if left:
        wrong.append(f"{len(left)} of {aborted} aborted uploads left files, the first {left[0]}")
    name = server.create("twice")
    contents = [bytes([65 + number]) * 3_000_000 for number in range(8)]
    colliding = [(f"{number}.jpg" if number < 4 else f"{number - 4}.png", contents[number]) for number in range(8)]
    colliding += [("same.jpg", content) for content in contents]
    put = lambda number: server.ask("PUT", f"/api/projects/{name}/source/{colliding[number][0]}", colliding[number][1])[0]
    for status, (file, _) in zip(parallel(len(colliding), len(colliding), put), colliding):
        if status != 201:
            wrong.append(f"parallel upload of {file}: {status}")
    for file, content in colliding:
        path = server.projects / name / "source" / file
        allowed = contents if file == "same.jpg" else [content]
        if not path.exists() or path.read_bytes() not in allowed:
            wrong.append(f"parallel uploads: {file} is missing or mixed from several")
    partial = [path.name for path in (server.projects / name / "source").glob("*.partial")]
    if partial:
        wrong.append(f"parallel uploads left {partial}")
    return {"aborted_uploads": aborted, "colliding_uploads": len(colliding)}


def settings(server, wrong):
    """Of settings that are saved by several pages at a time one stays, whole."""
    name = server.create("settings")
    saved = lambda number: {"equation": "falling", "marks": [{"frame": 0, "at": [1, 1]}] * number}
    put = lambda number: server.ask("PUT", f"/api/projects/{name}/settings", saved(number % 40))[0]
    statuses = parallel(400, 40, put)
    if set(statuses) != {200}:
        wrong.append(f"parallel settings: statuses {sorted(set(statuses))}")
    try:
        equation = server.state(name)["settings"]["equation"]
    except (KeyError, ValueError) as error:
        equation = repr(error)
    if equation != "falling":
        wrong.append(f"parallel settings left {equation}")
    return {"colliding_settings": len(statuses)}


def starts(server, wrong):
    """A job that is started by many at once runs once."""
    name = server.create("started.mp4")
    server.ask("PUT", f"/api/projects/{name}/source/started.mp4", VIDEO.read_bytes())
    for place in ["preview", "measure"]:
        statuses = parallel(40, 40, lambda _: server.ask("POST", f"/api/projects/{name}/{place}")[0])
        if statuses.count(202) != 1 or set(statuses) - {202, 400, 409}:
            wrong.append(f"40 parallel starts of {place}: statuses {sorted(statuses)}")
        if place == "preview":
            server.wait(name)
    numbers = sorted(path.name for path in (server.projects / name / "measurements").iterdir())
    if numbers != ["1"]:
        wrong.append(f"40 parallel starts of a measurement made {numbers}")
    server.ask("POST", f"/api/projects/{name}/stop")
    return {"parallel_starts": 80}


def hostile(server, wrong):
    """Script in names, and requests of other pages: answered as text, or refused."""
    script = "<img src=x onerror=alert(1)>"
    name = server.create(script)
    title = next(card["title"] for card in json.loads(server.ask("GET", "/api/projects")[1]) if card["name"] == name)
    if re.search(r"[<>]", name) or title != script:
        wrong.append(f"a title of markup is {title!r} in {name!r}")
    requests = {"another host": ("GET", "/api/projects", "evil.example", None, 421),
                "another page": ("POST", "/api/projects", None, "http://evil.example", 403),
                "no page": ("POST", "/api/projects", None, "", 403)}
    for what, (method, path, host, origin, expected) in requests.items():
        own = f"127.0.0.1:{server.port}"
        lines = [f"{method} {path} HTTP/1.1", f"Host: {host or own}", f"Cookie: paig_studio_{server.port}={server.token}",
                 "Connection: close"] + ([f"Origin: {origin}"] if origin else [])
        with server.connect() as connection:
            connection.sendall(("\r\n".join(lines) + "\r\n\r\n").encode())
            status = int(connection.recv(100).split()[1])
        if status != expected:
            wrong.append(f"a request from {what}: {status}, expected {expected}")
    return {}


def kills(folder, count, wrong):
    """The server is killed at random moments of uploads, previews and changes of settings, and started anew."""
    lost, kept = [], {}
    server = Server(folder)
    for number in range(count):
        finished = []

        def work():
            with contextlib.suppress(OSError, IndexError, ValueError, AssertionError, KeyError):
                name = server.create(f"killed {number}.mp4")
                finished.append(name)
                if server.ask("PUT", f"/api/projects/{name}/source/a.mp4", VIDEO.read_bytes())[0] == 201:
                    finished.append("video")
                if server.ask("PUT", f"/api/projects/{name}/settings", {"equation": "falling"})[0] == 200:
                    finished.append("settings")
                server.ask("POST", f"/api/projects/{name}/preview")

        with concurrent.futures.ThreadPoolExecutor(1) as pool:
            running = pool.submit(work)
            time.sleep(random.uniform(0, 0.08))
            server.end(signal.SIGKILL)
            running.result()
        server = Server(folder)
        if finished:
            kept[finished[0]] = set(finished[1:])
    cards = {card["name"] for card in json.loads(server.ask("GET", "/api/projects")[1])}
    for name, done in kept.items():
        if name not in cards:
            lost.append(name)
            continue
        state = server.wait(name)
        video = server.projects / name / "source/a.mp4"
        if "video" in done and video.read_bytes() != VIDEO.read_bytes():
            lost.append(f"video of {name}")
        if "settings" in done and state["settings"]["equation"] != "falling":
            lost.append(f"settings of {name}")
        if state["preview_work"]["state"] not in ["none", "done"]:
            lost.append(f"preview of {name}: {state['preview_work']}")
    wrong += [f"after kills: {what}" for what in lost]
    known = {path.name for path in Path(folder).iterdir()}
    if known != {"projects"}:
        wrong.append(f"files outside the projects: {sorted(known)}")
    # Those whose server was killed between the folder and its record.
    without = [path.name for path in server.projects.iterdir() if path.name not in cards]
    server.end()
    return {"server_kills": count, "server_lost": len(lost), "projects_after_kills": len(kept),
            "folders_without_a_record": len(without)}


def orphans(folder):
    """Processes that work in a folder."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if str(folder) in (process / "cmdline").read_text().replace("\0", " ") + str((process / "cwd").readlink()):
                found.append(process.name)
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--requests", type=int, default=10000)
    parser.add_argument("--kills", type=int, default=100)
    arguments = parser.parse_args()
    random.seed(0)
    wrong, counts = [], {}
    with tempfile.TemporaryDirectory() as folder:
        places = {name: Path(folder) / name for name in ["load", "full", "kills"]}
        for place in places.values():
            place.mkdir()
        server = Server(places["load"])
        counts |= requests(server, arguments.requests, wrong)
        for part in [slow_clients, uploads, settings, hostile, starts]:
            counts |= part(server, wrong)
            print(f"{part.__name__}: {len(wrong)} wrong so far", file=sys.stderr, flush=True)
        counts["files_threads_megabytes"] = server.held()
        server.end()
        counts |= full_of_connections(places["full"], wrong)
        counts |= kills(places["kills"], arguments.kills, wrong)
        end = time.time() + JOB_PATIENCE
        while orphans(folder) and time.time() < end:
            time.sleep(0.5)
        counts["orphans"] = len(orphans(folder))
    for line in wrong:
        print(line)
    print(json.dumps(counts | {"server_wrong": len(wrong) + counts["orphans"]}))
    sys.exit(bool(wrong or counts["orphans"]))


if __name__ == "__main__":
    main()
