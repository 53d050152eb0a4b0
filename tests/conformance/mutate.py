#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Measures what the conformance vectors find: changes one thing at a time in the reference decoder, and decodes the
vectors with each mutant until one result differs from the manifest.

usage: mutate.py [--workers N] [--only TEXT] [--every N]

Prints the share of mutants that are found and the others; those that change nothing (equivalent.txt) do not
count. Exit code 1: less than 97 %, or a line of equivalent.txt that names no mutant that survives.
"""
import fractions  # noqa: F401  imported here, so that each process need not
import hashlib
import importlib.util
import json
import os
import resource
import signal
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
DECODER = os.path.join(HERE, "../../spec/reference_decoder")
sys.dont_write_bytecode = True
sys.path.insert(0, DECODER)

from mutants import mutants  # noqa: E402

SECONDS = 60          # for one mutant
GOAL = 0.97


def load_vectors():
    with open(os.path.join(HERE, "manifest.json"), encoding="utf-8") as file:
        entries = json.load(file)["vectors"]
    vectors = []
    for entry in entries:
        with open(os.path.join(HERE, "vectors", entry["name"] + ".stgs"), "rb") as file:
            vectors.append((entry, file.read()))
    return sorted(vectors, key=lambda v: len(v[1]))


def agrees(entry, data):
    from container import Limits
    from decode import describe
    from expected_floats import expected_floats
    out = describe(data, Limits(**entry.get("limits", {})))
    return hashlib.sha256(out.text().encode()).hexdigest() == entry["decoded"] and \
        [e.number for e in out.reports] == entry.get("reported", []) and \
        [[part, e.number] for part, e in out.refused] == entry.get("refused", []) and \
        ("floats" not in entry or expected_floats(out) == entry["floats"])


class Sources:
    """Imports the decoder from compiled sources, so that each process need not compile them again."""

    def __init__(self):
        self.code = {}
        for file in sorted(os.listdir(DECODER)):
            if file.endswith(".py"):
                with open(os.path.join(DECODER, file), encoding="utf-8") as handle:
                    self.code[file[:-3]] = compile(handle.read(), file, "exec")

    def find_spec(self, name, _path, _target=None):
        return importlib.util.spec_from_loader(name, self) if name in self.code else None

    def create_module(self, _spec):
        return None

    def exec_module(self, module):
        exec(self.code[module.__name__], module.__dict__)


def finder(module, source, vectors, sources):
    """Runs in a process of its own; returns the number of the vector that finds the mutant, or -1."""
    resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30))
    signal.alarm(SECONDS)
    sys.setrecursionlimit(500)
    i = 0
    try:
        sources.code[module] = compile(source, module, "exec")
        sys.meta_path.insert(0, sources)
        for i, (entry, data) in enumerate(vectors):
            if not agrees(entry, data):
                return i
        return -1
    except Exception:  # a reader must not fail in any other way
        return i


def run(found, vectors, workers, known):
    """Returns the keys of the surviving mutants, and prints them. The vectors that found other mutants of a module
    are tried first."""
    left, running, survivors = list(reversed(found)), {}, []
    scores, sources = {}, Sources()
    while left or running:
        while left and len(running) < workers:
            key, module, source = left.pop()
            score = scores.setdefault(module, {})
            order = sorted(vectors, key=lambda v: -score.get(v[0]["name"], 0))
            reading, writing = os.pipe()
            process = os.fork()
            if process == 0:
                with open(os.devnull, "w", encoding="utf-8") as null:
                    os.dup2(null.fileno(), 2)
                number = finder(module, source, order, sources)
                os.write(writing, (order[number][0]["name"] if number >= 0 else "").encode() + b"\n")
                os._exit(0)
            os.close(writing)
            running[process] = key, module, reading
        process, _ = os.wait()
        key, module, reading = running.pop(process)
        with os.fdopen(reading) as pipe:
            name = pipe.read()
        if name == "\n":
            survivors.append(key)
            print("survives:" if key not in known else "survives, equivalent:", key, flush=True)
        scores[module][name.strip()] = scores[module].get(name.strip(), 0) + 1
    return survivors


def equivalents():
    """Returns {key: reason} of mutants that change nothing."""
    out, keys = {}, []
    with open(os.path.join(HERE, "equivalent.txt"), encoding="utf-8") as file:
        for line in file.read().splitlines():
            if line.startswith("    "):
                out.update({key: line.strip() for key in keys})
                keys = []
            elif line and not line.startswith("#"):
                keys.append(line)
    return out


def main(arguments):
    workers, only, every = 2, "", 1
    while arguments:
        argument = arguments.pop(0)
        if argument == "--workers" and arguments:
            workers = int(arguments.pop(0))
        elif argument == "--only" and arguments:
            only = arguments.pop(0)
        elif argument == "--every" and arguments:
            every = int(arguments.pop(0))
        else:
            sys.exit(__doc__)
    vectors = load_vectors()
    found = [m for m in mutants(DECODER) if only in m[0]][::every]
    known = equivalents()
    survivors = run(found, vectors, workers, known)
    counted = [m[0] for m in found if m[0] not in known]
    missed = [key for key in survivors if key not in known]
    wrong = [] if only or every > 1 else sorted(set(known) - set(survivors))
    for key in wrong:
        print("equivalent.txt names a mutant that does not survive:", key)
    share = 1 - len(missed) / max(1, len(counted))
    print(f"{len(found)} mutants, {len(found) - len(counted)} of them equivalent; {len(counted) - len(missed)} of "
          f"{len(counted)} found: {100 * share:.1f} %")
    sys.exit(1 if share < GOAL or wrong else 0)


if __name__ == "__main__":
    main(sys.argv[1:])
