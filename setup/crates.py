#!/usr/bin/env python3
"""The crates that the program and the Python module are built of, as Cargo.lock pins them.

    setup/crates.py --table             a table: lines, lines with `unsafe`, what requires the crate, purpose
    setup/crates.py --sbom FILE         a bill of materials (CycloneDX 1.5), the same bytes from the same Cargo.lock

Sources are those in cargo's registry; nothing is fetched.
"""

import argparse
import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
CARGO = os.environ.get("CARGO", "cargo")
PLATFORM = "x86_64-unknown-linux-gnu"
# The packages of the wheel, with their features.
SHIPPED = {"paig-cli": [], "paig-python": ["module"]}


def cargo(*arguments):
    command = [CARGO, *arguments, "--locked", "--offline"]
    return subprocess.run(command, check=True, cwd=ROOT, capture_output=True, text=True).stdout


class Crates:
    """Packages by their name and version, with what each requires."""

    def __init__(self):
        metadata = json.loads(cargo("metadata", "--format-version", "1", "--all-features", "--filter-platform", PLATFORM))
        self.packages = {(package["name"], package["version"]): package for package in metadata["packages"]}
        self.required = {}
        for package, features in SHIPPED.items():
            self.read_tree(package, features)
        lock = tomllib.loads((ROOT / "Cargo.lock").read_text())
        self.checksums = {(it["name"], it["version"]): it.get("checksum") for it in lock["package"]}

    def read_tree(self, package, features):
        """What is compiled, without what tests need."""
        tree = cargo("tree", "--package", package, "--features", ",".join(features), "--edges", "normal,build", "--target",
                     PLATFORM, "--prefix", "depth", "--no-dedupe", "--format", " {p}")
        path = []
        for line in tree.splitlines():
            depth, name, version = line.split()[:3]
            crate = (name, version.removeprefix("v"))
            path[int(depth):] = [crate]
            self.required.setdefault(crate, set())
            if int(depth):
                self.required[path[-2]].add(crate)

    def foreign(self):
        return sorted(crate for crate in self.required if self.packages[crate]["source"])

    def own(self):
        return sorted(crate for crate in self.required if not self.packages[crate]["source"])


def identifier(crate):
    return f"pkg:cargo/{crate[0]}@{crate[1]}"


def component(crates, crate):
    package = crates.packages[crate]
    found = {"type": "library", "bom-ref": identifier(crate), "name": crate[0], "version": crate[1],
             "purl": identifier(crate)}
    if package["license"]:
        # Older packages write "/" for "or".
        found["licenses"] = [{"expression": package["license"].replace("/", " OR ")}]
    if crates.checksums[crate]:
        found["hashes"] = [{"alg": "SHA-256", "content": crates.checksums[crate]}]
    return found


def bill(crates):
    """Without a date or a random number: two builds have the same."""
    version = crates.packages[crates.own()[0]]["version"]
    program = {"type": "application", "bom-ref": f"pkg:pypi/paig@{version}", "name": "paig", "version": version,
               "purl": f"pkg:pypi/paig@{version}"}
    links = [{"ref": identifier(crate), "dependsOn": sorted(map(identifier, required))}
             for crate, required in sorted(crates.required.items())]
    shipped = sorted(identifier(crate) for crate in crates.own() if crate[0] in SHIPPED)
    return {"bomFormat": "CycloneDX", "specVersion": "1.5", "version": 1, "metadata": {"component": program},
            "components": [component(crates, crate) for crate in sorted(crates.required)],
            "dependencies": [{"ref": program["bom-ref"], "dependsOn": shipped}, *links]}


def counts(package):
    """Lines of Rust, and those of code in which `unsafe` stands, without tests, examples and benchmarks."""
    folder = Path(package["manifest_path"]).parent
    lines = unsafe = 0
    for path in folder.rglob("*.rs"):
        if {"tests", "examples", "benches"} & set(path.relative_to(folder).parts):
            continue
        for line in path.read_text(errors="replace").splitlines():
            lines += 1
            unsafe += bool(re.search(r"\bunsafe\b(?!_)", line.split("//")[0]))
    return lines, unsafe


def table(crates):
    users = {crate: sorted(name for (name, _), required in crates.required.items() if crate in required)
             for crate in crates.required}
    own = {name for name, _ in crates.own()}
    rows, total = [], [0, 0]
    for crate in crates.foreign():
        package = crates.packages[crate]
        lines, unsafe = counts(package)
        total = [total[0] + lines, total[1] + unsafe]
        direct = [name for name in users[crate] if name in own]
        by = ", ".join((direct or users[crate])[:3])
        purpose = " ".join((package["description"] or "").split()).replace("|", "/")[:70]
        by = f"**{by}**" if direct else by
        rows.append((-unsafe, f"| {crate[0]} {crate[1]} | {lines} | {unsafe} | {by} | {purpose} |"))
    yield f"{len(rows)} crates, {total[0]} lines, {total[1]} with `unsafe`. Bold: required by a crate of this project."
    yield "\n| crate | lines | `unsafe` | required by | purpose |\n|---|---|---|---|---|"
    yield from (row for _, row in sorted(rows))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    kind = parser.add_mutually_exclusive_group(required=True)
    kind.add_argument("--table", action="store_true", help="print the table")
    kind.add_argument("--sbom", type=Path, metavar="FILE", help="write the bill of materials")
    arguments = parser.parse_args()
    crates = Crates()
    if arguments.table:
        print("\n".join(table(crates)))
    else:
        arguments.sbom.parent.mkdir(parents=True, exist_ok=True)
        arguments.sbom.write_text(json.dumps(bill(crates), indent=1) + "\n")


if __name__ == "__main__":
    try:
        main()
    except subprocess.CalledProcessError as error:
        sys.exit(f"crates: error: {error.cmd[0]} failed: {error.stderr.strip()}")
