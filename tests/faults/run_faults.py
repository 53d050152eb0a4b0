# SPDX-License-Identifier: Apache-2.0
"""Runs the program with failing calls of the C library (faults.c), one at a time.

usage: run_faults.py --stgs PROGRAM --fixture MAKE_FIXTURE --faults LIBRARY [--all] [--only TEXT] [--jobs N] [--part K/N]

Each run must end by itself, with the exit code of success or of a failure that a user can
understand, and one error line in that case; its output must be complete or missing, and nothing
else may remain in its folder. Without --all, a small sample of the calls fails.
"""
import argparse
import concurrent.futures
import os
import shutil
import subprocess
import sys
import tempfile

CALLS = ("malloc", "read", "write", "fsync", "rename", "mmap", "thread", "open")
OK, USAGE, IO, INVALID, RUNTIME, UNSUPPORTED = range(6)
NO_MEMORY = 8  # of StatusCode, which record_fragments returns
# libwebp without memory crashes, or reports damage (INVALID), as FFmpeg does without a thread or a
# descriptor.
CRASH = -11
ALLOWED = (OK, IO, RUNTIME, UNSUPPORTED)
SAMPLE = {"malloc": 12, "open": 8, "mmap": 4}  # calls that fail of sampled runs, otherwise 6; half without --all
SECONDS = 120
DATA = os.path.join(os.path.dirname(os.path.abspath(__file__)), os.pardir, "data")


class Scenario:
    """Arguments of a run within a folder that contains `inputs`, and the output that it writes."""

    def __init__(self, name, arguments, inputs, program="stgs", also=(), resumable=False,
                 varies=False, sampled=False, slow=False):
        self.name, self.arguments, self.inputs, self.program = name, arguments, inputs, program
        self.allowed = (*ALLOWED, *also)
        self.resumable = resumable  # a failure leaves the output as far as it is complete
        self.varies = varies  # a library stores data uncompressed if it lacks memory
        self.sampled = sampled  # also with --all: a run takes seconds
        self.slow = slow  # only with --all


def convert(source, target, *more):
    return Scenario(f"convert {source} {target}", ["convert", source, target, *more], [source],
                    also=[CRASH, INVALID] if source in ("model.sog", "clip.tsog") else [])


SCENARIOS = [
    Scenario("info", ["info", "tiny.stgs", "--lifespans"], ["tiny.stgs"]),
    Scenario("validate", ["validate", "packed.stgs"], ["packed.stgs"]),
    Scenario("threads", ["validate", "packed.stgs", "--threads", "9"], ["packed.stgs"]),
    Scenario("render", ["render", "tiny.stgs", "--time", "0", "--size", "64x64", "--backend", "cpu",
                        "-o", "a.png"], ["tiny.stgs"]),
    Scenario("render exr", ["render", "tiny.stgs", "--time", "0", "--size", "64x64", "--backend",
                            "cpu", "-o", "a.exr"], ["tiny.stgs"], varies=True),
    Scenario("play", ["bench", "tiny.stgs", "--backend", "cpu", "--size", "64x64", "--play", "player",
                      "--frames", "3", "--progress", "none"], ["tiny.stgs"]),
    Scenario("compare", ["compare", "tiny.stgs", "packed.stgs", "--backend", "cpu"],
             ["tiny.stgs", "packed.stgs"]),
    Scenario("pack", ["pack", "tiny.stgs", "-o", "a.stgs"], ["tiny.stgs"]),
    Scenario("finalize", ["finalize", "live.stgs", "-o", "a.stgs"], ["live.stgs"]),
    Scenario("record", ["a.stgs", "3", "0"], [], program="record_fragments",
             also=[NO_MEMORY], resumable=True),
    Scenario("sdk player", ["tiny.stgs", "0.1", "a.ppm"], ["tiny.stgs"],
             program="stgs_player_example", also=[USAGE], resumable=True, varies=True),
    Scenario("train", ["train", "prepared", "-o", "a.stgs", "--backend", "cpu", "--iterations", "2",
                       "--progress", "none"], ["prepared"], varies=True, sampled=True),
    Scenario("prepare", ["prepare", "workshop", "-o", "out", "--frames", "0:2", "--scale", "0.2", "--progress",
                         "none"], ["workshop"], also=[INVALID], varies=True, sampled=True, slow=True),
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


def problem_of(scenario, result, left, expected, fault):
    """Returns the problem of a run; None: there is none. `left`: the contents of its folder."""
    code = result.returncode
    if code not in scenario.allowed:
        return f"exit code {code}"
    if code == OK:
        is_complete = left == expected or (scenario.varies and set(left) == set(expected))
        return None if is_complete else f"success leaves {sorted(left)}"
    begin = "stgs: error: " if scenario.program == "stgs" else ""
    errors = [line for line in result.stderr.splitlines() if line.startswith(begin)]
    if len(errors) != 1 and code != CRASH:
        return f"{len(errors)} error lines"
    if "error: not enough memory" in result.stderr or code == CRASH:
        # Ended without unwinding: temporary files and locks stay for the next run.
        left = {name: bytes_ for name, bytes_ in left.items()
                if ".tmp" not in name and not name.endswith(".lock")}
    if fault.startswith("open:") and fault.endswith("+"):
        # Without descriptors no folder can be listed to delete it.
        left = {name: bytes_ for name, bytes_ in left.items() if not name.endswith(".tmp.work")}
    is_clean = left in ({}, expected) or (scenario.resumable and set(left) == set(expected))
    return None if is_clean else f"failure leaves {sorted(left)}"


class DoesNotEnd(Exception):
    """With the stacks of the threads, if eu-stack (package elfutils) is installed."""


def run_for(seconds, command, folder, environment):
    """Runs a command to its end, or raises DoesNotEnd."""
    with subprocess.Popen(command, cwd=folder, env=environment, text=True, errors="replace",
                          stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        try:
            output, error = process.communicate(timeout=seconds)
        except subprocess.TimeoutExpired:
            has_stacks = shutil.which("eu-stack") is not None
            stacks = subprocess.run(["eu-stack", "-p", str(process.pid)], capture_output=True, text=True,
                                    check=False).stdout if has_stacks else ""
            process.kill()
            raise DoesNotEnd(stacks) from None
    return subprocess.CompletedProcess(command, process.returncode, output, error)


class Runner:
    def __init__(self, options, fixture, pool):
        self.options, self.fixture, self.pool = options, fixture, pool
        self.checks = []  # futures: whether a run has a problem
        self.part, self.parts = map(int, options.part.split("/"))
        self.known = 0  # runs of all parts

    def program(self, scenario):
        stgs = os.path.abspath(self.options.stgs)
        return stgs if scenario.program == "stgs" else os.path.join(os.path.dirname(stgs), scenario.program)

    def run(self, scenario, fault=None, counts=None):
        """Returns the result, and the contents of the folder besides the inputs."""
        with tempfile.TemporaryDirectory(prefix="stgs-faults-") as folder:
            for name in scenario.inputs:
                path = os.path.join(DATA if name == "workshop" else self.fixture, name)
                if os.path.isdir(path):
                    shutil.copytree(path, os.path.join(folder, name))
                else:
                    shutil.copy(path, folder)
            environment = {**os.environ, "LD_PRELOAD": os.path.abspath(self.options.faults)}
            environment.update({"STGS_FAULT": fault} if fault else {})
            environment.update({"STGS_FAULT_COUNTS": counts} if counts else {})
            result = run_for(SECONDS, [self.program(scenario), *scenario.arguments], folder, environment)
            left = {name: contents(os.path.join(folder, name)) for name in os.listdir(folder)
                    if name not in scenario.inputs}
        return result, left

    def counts(self, scenario):
        with tempfile.NamedTemporaryFile("r") as file:
            result, left = self.run(scenario, counts=file.name)
            assert result.returncode == OK, (scenario.name, result.stderr)
            return left, {name: int(count) for name, count in map(str.split, file)}

    def check(self, scenario, fault, expected):
        """Returns the problem of a run; None: there is none."""
        try:
            result, left = self.run(scenario, fault)
        except DoesNotEnd as error:
            return f"{scenario.name}, {fault}: does not end\n{error}"
        problem = problem_of(scenario, result, left, expected, fault)
        return problem and f"{scenario.name}, {fault}: {problem}: {result.stderr.strip()[-300:]}"

    def report(self, scenario, fault, expected):
        """Prints the problem of a run at once. Returns whether there is one."""
        problem = self.check(scenario, fault, expected)
        if problem:
            print(problem, flush=True)
        return bool(problem)

    def start(self, scenario, fault, expected):
        if self.known % self.parts == self.part - 1:
            self.checks.append(self.pool.submit(self.report, scenario, fault, expected))
        self.known += 1

    def problems(self):
        """Waits for all runs. Returns the number of problems."""
        return sum(check.result() for check in self.checks)

    def run_scenario(self, scenario):
        expected, counts = self.counts(scenario)
        for call in CALLS:
            count = counts[call]
            exhaustive = self.options.all and not scenario.sampled
            sample = SAMPLE.get(call, 6) // (1 if self.options.all else 2)
            wanted = count if exhaustive else min(count, sample)
            for k in range(wanted):
                n = 1 + k * count // wanted
                self.start(scenario, f"{call}:{n}", expected)
            if count > 0:  # nothing works any more
                self.start(scenario, f"{call}:{1 + count // 2}+", expected)
        print(f"{scenario.name}: {counts}", flush=True)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--stgs", required=True)
    parser.add_argument("--fixture", required=True)
    parser.add_argument("--faults", required=True)
    parser.add_argument("--all", action="store_true")
    parser.add_argument("--only", default="")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--part", default="1/1", help="run part K of N, to share the runs between machines")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="stgs-fixture-") as fixture, \
         concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
        subprocess.run([options.fixture, fixture], check=True, stdout=subprocess.DEVNULL)
        runner = Runner(options, fixture, pool)
        for scenario in SCENARIOS:
            if options.only in scenario.name and (options.all or not scenario.slow):
                runner.run_scenario(scenario)
        problems = runner.problems()
    print(f"{len(runner.checks)} runs, {problems} problems")
    sys.exit(1 if problems else 0)


if __name__ == "__main__":
    main()
