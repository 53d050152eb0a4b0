# SPDX-License-Identifier: Apache-2.0
"""Runs the program with failing calls of the C library (faults.c), one at a time.

usage: run_faults.py --stgs PROGRAM --fixture MAKE_FIXTURE --faults LIBRARY [--all] [--only TEXT]

Each run must end by itself, with the exit code of success or of a failure that a user can
understand, and one error line in that case; its output must be complete or missing, and nothing
else may remain in its folder. Without --all, a sample of the calls fails.
"""
import argparse
import os
import shutil
import subprocess
import sys
import tempfile

CALLS = ("malloc", "read", "write", "fsync", "rename", "mmap", "thread", "open")
OK, USAGE, IO, INVALID, RUNTIME, UNSUPPORTED = range(6)
NO_MEMORY = 8  # of StatusCode, which record_fragments returns
# Of third-party code without memory: the destructor of nlohmann::json allocates, and cannot throw;
# libwebp reports some failed allocations as a damaged image (INVALID).
ABORT = -6
ALLOWED = (OK, IO, RUNTIME, UNSUPPORTED)
SAMPLE = {"malloc": 24, "open": 12, "mmap": 6}  # calls that fail without --all; otherwise 10
SECONDS = 120


class Scenario:
    """Arguments of a run within a folder that contains `inputs`, and the output that it writes."""

    def __init__(self, name, arguments, inputs, program="stgs", also=(), resumable=False):
        self.name, self.arguments, self.inputs, self.program = name, arguments, inputs, program
        self.allowed = (*ALLOWED, *also)
        self.resumable = resumable  # a failure leaves what the output has so far


def convert(source, target, *more):
    return Scenario(f"convert {source} {target}", ["convert", source, target, *more], [source],
                    also=[ABORT, INVALID] if source in ("model.sog", "clip.tsog") else [])


SCENARIOS = [
    Scenario("info", ["info", "tiny.stgs", "--lifespans"], ["tiny.stgs"]),
    Scenario("validate", ["validate", "packed.stgs"], ["packed.stgs"]),
    Scenario("render", ["render", "tiny.stgs", "--time", "0", "--size", "64x64", "--backend", "cpu",
                        "-o", "a.png"], ["tiny.stgs"]),
    Scenario("render exr", ["render", "tiny.stgs", "--time", "0", "--size", "64x64", "--backend",
                            "cpu", "-o", "a.exr"], ["tiny.stgs"]),
    Scenario("play", ["bench", "tiny.stgs", "--backend", "cpu", "--size", "64x64", "--play", "player",
                      "--frames", "3", "--progress", "none"], ["tiny.stgs"]),
    Scenario("compare", ["compare", "tiny.stgs", "packed.stgs", "--backend", "cpu"],
             ["tiny.stgs", "packed.stgs"]),
    Scenario("pack", ["pack", "tiny.stgs", "-o", "a.stgs"], ["tiny.stgs"]),
    Scenario("finalize", ["finalize", "live.stgs", "-o", "a.stgs"], ["live.stgs"]),
    Scenario("record", ["a.stgs", "3", "0"], [], program="record_fragments",
             also=[NO_MEMORY], resumable=True),
    convert("tiny.stgs", "a.ply", "--time", "0"),
    convert("tiny.stgs", "a.spz", "--time", "0"),
    convert("tiny.stgs", "a.4dgs"),
    convert("states.4dgs", "a.stgs"),
    convert("model.sog", "a.stgs"),
    convert("clip.tsog", "a.stgs"),
    convert("clip.splatv", "a.stgs"),
    convert("clip.ftgs.ply", "a.stgs"),
]


def contents(path):
    """Returns the bytes of a file; None for a folder."""
    if os.path.isdir(path):
        return None
    with open(path, "rb") as file:
        return file.read()


class Runner:
    def __init__(self, options, fixture):
        self.options, self.fixture, self.problems, self.runs = options, fixture, [], 0

    def program(self, scenario):
        stgs = os.path.abspath(self.options.stgs)
        return stgs if scenario.program == "stgs" else os.path.join(os.path.dirname(stgs), scenario.program)

    def run(self, scenario, fault=None, counts=None):
        """Returns the result, and the contents of the folder besides the inputs."""
        with tempfile.TemporaryDirectory(prefix="stgs-faults-") as folder:
            for name in scenario.inputs:
                shutil.copy(os.path.join(self.fixture, name), folder)
            environment = {**os.environ, "LD_PRELOAD": os.path.abspath(self.options.faults)}
            environment.update({"STGS_FAULT": fault} if fault else {})
            environment.update({"STGS_FAULT_COUNTS": counts} if counts else {})
            result = subprocess.run([self.program(scenario), *scenario.arguments], cwd=folder, check=False,
                                    env=environment, capture_output=True, text=True,
                                    errors="replace", timeout=SECONDS)
            left = {name: contents(os.path.join(folder, name)) for name in os.listdir(folder)
                    if name not in scenario.inputs}
        self.runs += 1
        return result, left

    def counts(self, scenario):
        with tempfile.NamedTemporaryFile("r") as file:
            result, left = self.run(scenario, counts=file.name)
            assert result.returncode == OK, (scenario.name, result.stderr)
            return left, {name: int(count) for name, count in map(str.split, file)}

    def check(self, scenario, fault, expected):
        try:
            result, left = self.run(scenario, fault)
        except subprocess.TimeoutExpired:
            self.problems.append(f"{scenario.name}, {fault}: does not end")
            return
        begin = "stgs: error: " if scenario.program == "stgs" else ""
        errors = [line for line in result.stderr.splitlines() if line.startswith(begin)]
        code = result.returncode
        if code not in scenario.allowed:
            self.report(scenario, fault, f"exit code {code}", result)
        elif code != OK and len(errors) != 1:
            self.report(scenario, fault, f"{len(errors)} error lines", result)
        elif code == OK and left != expected:
            self.report(scenario, fault, f"success leaves {sorted(left)} {[k for k in left if left[k] != expected.get(k)]}", result)
        elif code != OK and left not in ({}, expected) and not (
                scenario.resumable and set(left) == set(expected)):
            self.report(scenario, fault, f"failure leaves {sorted(left)}", result)

    def report(self, scenario, fault, what, result):
        self.problems.append(f"{scenario.name}, {fault}: {what}: {result.stderr.strip()[-300:]}")

    def run_scenario(self, scenario):
        expected, counts = self.counts(scenario)
        for call in CALLS:
            count = counts[call]
            wanted = count if self.options.all else min(count, SAMPLE.get(call, 10))
            for k in range(wanted):
                n = 1 + k * count // wanted
                self.check(scenario, f"{call}:{n}", expected)
            if count > 0:  # nothing works any more
                self.check(scenario, f"{call}:{1 + count // 2}+", expected)
        print(f"{scenario.name}: {counts}", flush=True)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--stgs", required=True)
    parser.add_argument("--fixture", required=True)
    parser.add_argument("--faults", required=True)
    parser.add_argument("--all", action="store_true")
    parser.add_argument("--only", default="")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="stgs-fixture-") as fixture:
        subprocess.run([options.fixture, fixture], check=True, stdout=subprocess.DEVNULL)
        runner = Runner(options, fixture)
        for scenario in SCENARIOS:
            if options.only in scenario.name:
                runner.run_scenario(scenario)
    print("\n".join(runner.problems))
    print(f"{runner.runs} runs, {len(runner.problems)} problems")
    sys.exit(1 if runner.problems else 0)


if __name__ == "__main__":
    main()
