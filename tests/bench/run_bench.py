#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs benchmark cases and reports which metrics moved by more than their noise.

usage: run_bench.py [CASES...] [--build build/release] [--stgs PROGRAM] [--machine NAME]
                    [--file NAME=PATH...] [--repetitions N] [--work FOLDER] [--append] [--list]

CASES are names, patterns such as 'render_cuda_*' or groups of cases.json; the default is the group
quick. Metrics are compared with the last rows of results.csv of the same machine and case;
README.md states the rule. --append adds a row for each metric and repetition. Exit code 1 if a case
failed.
"""
import argparse
import csv
import datetime
import fnmatch
import itertools
import json
import math
import pathlib
import re
import shlex
import subprocess
import sys

import bench_data
import ring_cameras

CASES = bench_data.FOLDER / "cases.json"
SOURCE = bench_data.FOLDER.parents[1]
PLACEHOLDER = re.compile(r"\{([\w.]+)\}")
NOISE_DEVIATIONS = 3  # a metric moved if it differs by more standard deviations than this
MIN_CHANGE = 0.02  # relative; smaller differences of times and rates never count as a move


def expand(case):
    """Yields a case per combination of the choices of "for", with names and settings filled in."""
    choices = {key: values if isinstance(values, dict) else dict(zip(values, values))
               for key, values in case.get("for", {}).items()}
    for names in itertools.product(*choices.values()):
        named = dict(zip(choices, names))
        settings = {key: choices[key][name] for key, name in named.items()}
        yield {**case, "name": fill(case["name"], named), "case": fill(case["case"], named),
               "command": fill(case["command"], settings)}


def fill(text, values):
    return PLACEHOLDER.sub(lambda match: str(values.get(match[1], match[0])), text)


def select(book, patterns):
    cases = [case for entry in book["cases"] for case in expand(entry)]
    patterns = [pattern for name in patterns for pattern in book["groups"].get(name, [name])]
    for pattern in patterns:
        if not fnmatch.filter([case["name"] for case in cases], pattern):
            raise SystemExit(f"cases.json: no case '{pattern}'; run_bench.py --list prints them")
    return [case for case in cases
            if any(fnmatch.fnmatch(case["name"], pattern) for pattern in patterns)]


class Files:
    """The files of the commands: those of --file, and others that are made once in --work."""

    def __init__(self, book, args):
        self.recipes, self.work = book["files"], args.work
        self.paths = dict(entry.split("=", maxsplit=1) for entry in args.file)
        for name in self.paths:
            if name not in self.recipes:
                raise SystemExit(f"--file {name}: cases.json has no such file "
                                 f"(expected one of {', '.join(self.recipes)})")
        self.values = {"stgs": args.stgs or f"{args.build}/bin/stgs", "build": args.build,
                       "source": SOURCE, "work": args.work, "bench": bench_data.FOLDER,
                       "cameras": " ".join(f"--camera={args.work}/c{i}.json"
                                           for i in range(ring_cameras.COUNT))}
        self.recorded = {"stgs": "stgs", "build": "build/release", "source": ".", "work": ".",
                      "bench": "tests/bench",
                      "cameras": f"--camera=c{{0..{ring_cameras.COUNT - 1}}}.json",
                      **{name: name for name in self.recipes}}

    def command(self, text):
        """Returns the command with its paths, after making the files that it names."""
        for name in PLACEHOLDER.findall(text):
            if name in self.recipes and name not in self.values:
                self.values[name] = self.paths.get(name) or self.make(name)
        return shlex.split(fill(text, self.values))

    def make(self, name):
        path = self.work / name
        if self.recipes[name] is None:
            raise RuntimeError(f"needs {name}; name it with --file {name}=PATH (see README.md)")
        if not path.exists():
            self.values[name] = path
            output(self.command(self.recipes[name]))
        return path

    def recorded_command(self, text):
        """Returns the command for results.csv, without paths of this machine."""
        return " ".join(fill(text, self.recorded).split())


def output(command):
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"{shlex.join(map(str, command))}: exit code {done.returncode}: "
                           f"{done.stderr[-500:].strip()}")
    return done.stdout


def value_at(report, path):
    """Returns the value at a path like warm.frame_ms.p50; None if it is missing and ends in ?."""
    for key in path.rstrip("?").split("."):
        if key not in report and path.endswith("?"):
            return None
        report = report[key]
    return report


def measure(spec, report):
    if isinstance(spec, str):
        return value_at(report, spec)
    value = value_at(report, spec["value"]) * spec.get("scale", 1)
    for path in spec.get("over", []):
        value /= value_at(report, path)
    return value - value_at(report, spec["minus"]) if "minus" in spec else value


def metrics_of(case, report):
    values = {name: measure(spec, report) for name, spec in case["metrics"].items()}
    if "table" in case:
        table = case["table"]
        for row in value_at(report, table["rows"]):
            name = re.sub(r"\W+", "_", row[table["name"]])
            values.update({fill(key, {"name": name}): row[column]
                           for key, column in table["metrics"].items()})
    return {name: float(value) for name, value in values.items() if value is not None}


def verdict(metric, values, before):
    """Returns better, worse, same or new; the reference as text; the noise."""
    median = bench_data.statistics.median(values)
    if not before:
        return "new", "", NOISE_DEVIATIONS * bench_data.deviation(values)
    past = [float(row.value) for row in before]
    reference = bench_data.median(before)
    noise = NOISE_DEVIATIONS * math.hypot(bench_data.deviation(values), bench_data.deviation(past))
    if bench_data.unit_of(metric) not in bench_data.EXACT_UNITS:
        noise = max(noise, MIN_CHANGE * abs(reference))
    change = median - reference
    percent = f" ({100 * change / reference:+.1f} %)" if reference else ""
    text = f"{reference:.6g} on {before[-1].date} at {before[-1].commit}{percent}"
    if abs(change) <= noise:
        return "same", text, noise
    improved = (change > 0) == bench_data.higher_is_better(metric)
    return "better" if improved else "worse", text, noise


def commit_of_tree():
    """Returns the commit of the source tree; empty if files differ from it."""
    git = ["git", "-C", str(SOURCE)]
    changed = output([*git, "status", "--porcelain", "--untracked-files=no", "--", ".",
                      ":!tests/bench/results.csv", ":!tests/bench/SUMMARY.md"])
    return "" if changed else output([*git, "rev-parse", "--short=7", "HEAD"]).strip()


def new_rows(case, measured, machine, commit, command, rows):
    """Yields rows of results.csv; run numbers continue those of the same day and commit."""
    date = datetime.date.today().isoformat()
    names = (date, commit, machine, case["benchmark"], case["case"])
    for metric in measured[0]:
        same = [row for row in rows if row[:6] == (*names, metric)
                and row.command.startswith(command + bench_data.COMMENT)]
        for number, values in enumerate(measured, len(same) + 1):
            yield bench_data.Result(*names, metric, f"{values[metric]:.7g}",
                                    bench_data.unit_of(metric),
                                    f"{command}{bench_data.COMMENT}run {number}")


def run_case(case, files, rows, args):
    command = files.command(case["command"])
    measured = [metrics_of(case, json.loads(output(command)))
                for _ in range(args.repetitions or case["repetitions"])]
    for metric in measured[0]:
        values = [run[metric] for run in measured]
        earlier = bench_data.series(rows, args.machine, case["benchmark"], case["case"], metric)
        state, reference, noise = verdict(metric, values,
                                          bench_data.latest(earlier) if earlier else [])
        line = (f"{case['name']} | {metric} | {bench_data.statistics.median(values):.6g} "
                f"{bench_data.unit_of(metric)} | noise {noise:.2g} | {state}")
        print(line + (f" | {reference}" if reference else ""), flush=True)
    return measured


def append(path, rows):
    with open(path, "a", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(rows)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("cases", nargs="*", default=["quick"], metavar="CASES")
    parser.add_argument("--build", default="build/release", help="build folder")
    parser.add_argument("--stgs", help="the program (default: bin/stgs in the build folder)")
    parser.add_argument("--machine", default="", help="name in machines.csv, needed to compare and "
                        "append")
    parser.add_argument("--file", action="append", default=[], metavar="NAME=PATH")
    parser.add_argument("--repetitions", type=int, help="runs per case (default: from cases.json)")
    parser.add_argument("--work", type=pathlib.Path, default=pathlib.Path("build/bench"))
    parser.add_argument("--results", type=pathlib.Path, default=bench_data.RESULTS)
    parser.add_argument("--append", action="store_true")
    parser.add_argument("--list", action="store_true", help="print the names of the cases and stop")
    args = parser.parse_args()
    book = json.loads(CASES.read_text(encoding="utf-8"))
    cases = select(book, ["*"] if args.list else args.cases)
    if args.list:
        print("\n".join(case["name"] for case in cases))
        return 0
    if args.machine and args.machine not in bench_data.read_machines():
        raise SystemExit(f"--machine {args.machine}: add it to machines.csv first")
    if args.append and not args.machine:
        raise SystemExit("--append needs --machine")
    args.work.mkdir(parents=True, exist_ok=True)
    ring_cameras.write_cameras(args.work)
    rows, files, failed = bench_data.read_results(args.results), Files(book, args), 0
    commit = commit_of_tree() if args.append else ""
    for case in cases:
        try:
            measured = run_case(case, files, rows, args)
        except (RuntimeError, OSError, KeyError, ValueError) as error:
            failed += 1
            print(f"{case['name']}: {error}", file=sys.stderr, flush=True)
            continue
        if args.append:
            append(args.results, new_rows(case, measured, args.machine, commit,
                                          files.recorded_command(case["command"]), rows))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
