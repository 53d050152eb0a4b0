#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs the fuzz targets on their seeds and corpora alone, without mutations, and prints which lines they
reach. Builds nothing:

    cmake --preset fuzz-coverage && cmake --build build/fuzz-coverage --target fuzz_programs
    tests/fuzz/coverage_of_corpora.py build/fuzz-coverage

usage: coverage_of_corpora.py BUILD [--corpus FOLDER] [--missing PATH]... [--min PERCENT]
  BUILD     a folder of the preset fuzz-coverage: clang with -fprofile-instr-generate -fcoverage-mapping
  --corpus  also reads FOLDER/NAME, for inputs of a run of libFuzzer
  --missing prints the lines of these files (substrings of their paths) that no input reaches
  --min     exit code 1 if less than PERCENT of the lines of container, codec, scene or interchange are reached

A line counts if it has code besides brackets. Files of EXEMPT do not count.
"""
import argparse
import collections
import glob
import os
import re
import shutil
import subprocess
import sys
import tempfile

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(os.path.dirname(HERE))
SOURCES = "format/src/"
FOLDERS = ("core", "container", "codec", "scene", "quantise", "interchange")
GOAL = ("container", "codec", "scene", "interchange")  # that --min applies to
# Writers, most of whose unreached lines refuse arguments of a caller that no target of the preset passes.
EXEMPT = {
    "format/src/scene/recorder.cpp": "writes; calls of a recorder are the input of the target sdk_recorder",
    "format/src/scene/write_check.cpp": "refuses scenes of a caller; those that readers return are valid",
}
SUFFIXES = ("", "-14", "-15", "-16", "-17", "-18", "-19", "-20")


def tool(name):
    for suffix in SUFFIXES:
        if shutil.which(name + suffix):
            return name + suffix
    sys.exit(f"{name} not found (Debian: llvm)")


def targets(build):
    """Returns the folders of corpora by target, of targets that are built."""
    with open(os.path.join(build, "tests/fuzz/targets.txt"), encoding="utf-8") as file:
        rows = [line.strip().split(";") for line in file if line.strip()]
    found = {row[0]: row[1:] for row in rows if os.path.exists(os.path.join(build, "bin", "fuzz_" + row[0]))}
    if not found:
        sys.exit(f"{build}: no fuzz target is built; build the target fuzz_programs")
    return found


def run(build, name, folders, scratch):
    """Runs a target on its seeds and the files of the folders. Returns its profile."""
    program = os.path.abspath(os.path.join(build, "bin", "fuzz_" + name))
    seeds, profile = os.path.join(scratch, name), os.path.join(scratch, name + ".profraw")
    nowhere = dict(os.environ, LLVM_PROFILE_FILE="/dev/null")
    subprocess.run([program, "--write-seeds", seeds], check=True, env=nowhere)
    files = [path for folder in [seeds, *folders] for path in sorted(glob.glob(os.path.join(folder, "*")))
             if os.path.isfile(path)]
    environment = dict(os.environ, LLVM_PROFILE_FILE=profile)
    if subprocess.run([program, *files], cwd=scratch, env=environment).returncode != 0:
        sys.exit(f"fuzz_{name} failed on its corpora")
    return profile


def code_lines(path):
    """Returns the numbers of the lines with code besides brackets and keywords of a branch."""
    numbers = set()
    with open(path, encoding="utf-8") as file:
        for number, line in enumerate(file, 1):
            text = re.sub(r"//.*", "", line).strip()
            if re.search(r"\w", text) and not re.fullmatch(r"[{}\s]*(else|do)?[{}\s]*|(case .*|default):", text):
                numbers.add(number)
    return numbers


def executed_lines(build, names, profiles, scratch):
    """Returns the counts of the lines by path below ROOT."""
    merged = os.path.join(scratch, "merged.profdata")
    subprocess.run([tool("llvm-profdata"), "merge", "-sparse", *profiles, "-o", merged], check=True)
    programs = [os.path.join(build, "bin", "fuzz_" + name) for name in names]
    command = [tool("llvm-cov"), "export", "-format=lcov", f"-instr-profile={merged}", programs[0]]
    for program in programs[1:]:
        command += ["-object", program]
    report = subprocess.run([*command, os.path.join(ROOT, SOURCES)], check=True, capture_output=True, text=True).stdout
    counts, path = collections.defaultdict(dict), None
    for line in report.splitlines():
        if line.startswith("SF:"):
            path = os.path.relpath(line[3:], ROOT)
        elif line.startswith("DA:"):
            number, count = line[3:].split(",")[:2]
            counts[path][int(number)] = max(counts[path].get(int(number), 0), int(count))
    return counts


class Count:
    """Lines with code of a file or folder, and those of them that are reached."""

    def __init__(self):
        self.lines = self.reached = 0
        self.missing = []

    def add(self, other):
        self.lines += other.lines
        self.reached += other.reached

    def percent(self):
        return 100.0 * self.reached / self.lines if self.lines else 100.0

    def __str__(self):
        return f"{self.percent():6.1f} %  {self.reached:5d} of {self.lines:5d}"


def count_file(path, executed):
    out = Count()
    with open(os.path.join(ROOT, path), encoding="utf-8") as file:
        texts = file.read().splitlines()
    for number in sorted(code_lines(os.path.join(ROOT, path)) & executed.keys()):
        out.lines += 1
        out.reached += executed[number] > 0
        if executed[number] == 0:
            out.missing.append((number, texts[number - 1]))
    return out


def report(counts, missing):
    """Prints the files and the folders. Returns the counts of the folders."""
    folders = {folder: Count() for folder in FOLDERS}
    for path in sorted(counts):
        folder = path[len(SOURCES):].split("/")[0]
        if folder not in folders:
            continue
        count = count_file(path, counts[path])
        print(f"{count}  {path}{' (exempt)' if path in EXEMPT else ''}")
        if path not in EXEMPT:
            folders[folder].add(count)
        if any(part in path for part in missing):
            for number, text in count.missing:
                print(f"    {number:4d} {text}")
    print("\nWithout the exempt files:")
    for folder, count in folders.items():
        print(f"{count}  {SOURCES}{folder}")
    return folders


def main():
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("build")
    parser.add_argument("--corpus")
    parser.add_argument("--missing", action="append", default=[])
    parser.add_argument("--min", type=float, default=0)
    options = parser.parse_args()
    corpora = targets(options.build)
    with tempfile.TemporaryDirectory() as scratch:
        profiles = []
        for name, folders in corpora.items():
            further = [os.path.join(options.corpus, name)] if options.corpus else []
            profiles.append(run(options.build, name, folders + further, scratch))
        counts = executed_lines(options.build, list(corpora), profiles, scratch)
    folders = report(counts, options.missing)
    low = [folder for folder in GOAL if folders[folder].percent() < options.min]
    if low:
        sys.exit(f"less than {options.min} %: {', '.join(low)}")


if __name__ == "__main__":
    main()
