#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares the conformance vectors, the manifest, the reference decoder and, if given, the project's decoder.

usage: check_vectors.py [PROGRAM...]     PROGRAM is describe_vectors, or a command that runs it

The generator must produce the committed bytes. Each decoder must produce the manifest's hash and floats, refuse the
same parts with the same issue numbers, and report the same other errors; PROGRAM's validator must report the
manifest's numbers, or none for a valid file. Exit code 77: PROGRAM's, which is for a test that is skipped.
"""
import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "../../spec/reference_decoder"))
from container import Limits
from decode import describe
from expected_floats import expected_floats
from make_vectors import VECTORS, write_all

MANIFEST = os.path.join(HERE, "manifest.json")
TOLERANCE = 2.0 ** -20  # 8.5
WARNINGS = (201, 208)   # among reported numbers


def sha(data):
    return hashlib.sha256(data).hexdigest()


class Result:
    """What a decoder found in a file."""

    def __init__(self, text, refused, reported, errors=None, floats=None):
        self.text = text          # the lines of conformance.md 3.2
        self.refused = refused    # [part, issue]
        self.reported = reported  # issues
        self.errors = errors      # of the validator
        self.floats = floats      # {(part, level, slot, tier, name): components}


def reference(data, limits):
    out = describe(data, Limits(**limits))
    return Result(out.text(), [[part, e.number] for part, e in out.refused], [e.number for e in out.reports]), out


def issue_of(line):
    found = re.search(r"issue (\d+)\)$", line)
    return int(found.group(1)) if found else None


def parsed(lines):
    """Returns the Result of the lines that PROGRAM prints for a file."""
    text, out = "", Result("", [], [], [], {})
    for line in lines:
        word = line.split(" ", 1)[0]
        if word == "refused":
            out.refused.append([line[len("refused "):line.index(":")], issue_of(line)])
        elif word == "reported:":
            out.reported.append(issue_of(line))
        elif word == "errors":
            out.errors = [int(n) for n in line.split()[1:]]
        elif word == "floats":
            words = line.split()
            key = (*map(int, words[1:5]), words[5])
            out.floats.setdefault(key, []).append([float(v) for v in words[7:]])
        else:
            text += line + "\n"
    out.text = text
    return out


def program_results(program, files):
    """Returns the Result of a command for each file. files: paths and limits."""
    arguments = ["--floats"]
    for path, limits in files:
        for name, value in limits.items():
            arguments += ["--" + name.replace("_", "-"), str(value)]
        arguments.append(path)
    run = subprocess.run([*program, *arguments], capture_output=True, text=True, check=False)
    if run.returncode == 77:
        print(run.stdout.strip())
        sys.exit(77)
    if run.returncode != 0:
        sys.exit(f"{program[0]} exited with {run.returncode}: {run.stderr.strip()}")
    blocks, lines = {}, []
    for line in run.stdout.splitlines():
        if line.startswith("  "):
            lines.append(line.strip())
        else:
            lines = blocks[line[:-1]] = []
    return {path: parsed(lines) for path, lines in blocks.items()}


def differences(entry, result):
    """Yields a message for each difference between a decoder's result and the manifest."""
    if sha(result.text.encode()) != entry["decoded"]:
        yield "decodes other data:\n" + result.text
    if result.refused != entry.get("refused", []):
        yield f"refuses {result.refused} instead of {entry.get('refused', [])}"
    if sorted(result.reported) != sorted(entry.get("reported", [])):
        yield f"reports {result.reported} instead of {entry.get('reported', [])}"


def float_differences(entry, floats):
    """Yields a message for each attribute whose floats are outside of the tolerance (conformance.md 3.4)."""
    for tier in entry.get("floats", []):
        for name, numbers in tier["floats"].items():
            found = floats.get((*tier["tier"], name), [])
            found = [v for primitive in zip(*found) for v in primitive]
            origin = tier["origins"][name]
            if len(found) != len(numbers) or any(abs(a - b) > TOLERANCE * (abs(b) + origin)
                                                 for a, b in zip(found, numbers)):
                yield f"{name} of tier {tier['tier']} differs"


def validator_differences(entry, errors):
    """Yields a message if the validator does not find what the manifest states."""
    expected = {issue for issue in entry.get("reported", []) if issue not in WARNINGS}
    expected |= {issue for _, issue in entry.get("refused", [])} | set(entry.get("validator", []))
    if expected - set(errors) or (errors and not expected):
        yield f"the validator reports {errors}, not {sorted(expected)}"


def check_program(program, paths, entries):
    """Yields (name, message) for each difference of PROGRAM."""
    results = program_results(program, [(path, entry.get("limits", {})) for entry, path in zip(entries, paths)])
    for entry, path in zip(entries, paths):
        result = results[path]
        for message in (*differences(entry, result), *float_differences(entry, result.floats),
                        *validator_differences(entry, result.errors)):
            yield entry["name"], f"the decoder: {message}"


def check_reference(entry, data):
    result, out = reference(data, entry.get("limits", {}))
    yield from differences(entry, result)
    if "floats" in entry and expected_floats(out) != entry["floats"]:
        yield "other floats"


def main():
    with open(MANIFEST, encoding="utf-8") as file:
        entries = json.load(file)["vectors"]
    problems = []
    if [(v.name, v.clause, v.about) for v in VECTORS] != [(e["name"], e["clause"], e["about"]) for e in entries]:
        problems.append("generator and manifest state different names, clauses or subjects")
    paths = [os.path.join(HERE, "vectors", entry["name"] + ".stgs") for entry in entries]
    with tempfile.TemporaryDirectory() as folder:
        write_all(folder)
        names = sorted(entry["name"] + ".stgs" for entry in entries)
        if sorted(os.listdir(folder)) != names or sorted(os.listdir(os.path.join(HERE, "vectors"))) != names:
            problems.append("generator, folder and manifest do not have the same vectors")
        for entry, path in zip(entries, paths):
            with open(path, "rb") as file:
                data = file.read()
            with open(os.path.join(folder, entry["name"] + ".stgs"), "rb") as file:
                if file.read() != data or sha(data) != entry["file"]:
                    problems.append(f"{entry['name']}: the generator produces other bytes")
            problems += [f"{entry['name']} (clause {entry['clause']}): the reference: {message}"
                         for message in check_reference(entry, data)]
    if len(sys.argv) > 1:
        problems += [f"{name}: {message}" for name, message in check_program(sys.argv[1:], paths, entries)]
    for problem in problems:
        print(problem)
    print(f"{len(entries)} vectors, {len(problems)} problems")
    sys.exit(1 if problems else 0)


if __name__ == "__main__":
    main()
