#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Reports names and phrases that the project has replaced by the standard terms of the field.

usage: check_vocabulary.py ROOT     exit code 0: clean; 1: findings, one per line on stdout

vocabulary.csv lists them: a regular expression (Python, matched line by line), the paths that it
applies to (a regular expression on the path below ROOT), the replacement, and the reason. exempt.csv
lists the uses that another library or format defines.
"""
import csv
import os
import re
import subprocess
import sys

from check_sources import CODE, SCRIPTS, source_files

TEXT = CODE + SCRIPTS + (".md", ".json", ".csv", ".in", ".bash", ".fish", ".zsh", ".frag", ".vert",
                         ".map", ".pyi", ".yml", ".yaml", ".cs", ".txt")
HERE = os.path.dirname(os.path.abspath(__file__))
# The lists themselves, generated data, and records of runs under earlier names.
NOT_CHECKED = re.compile(
    r"^(tests/layering/(vocabulary|exempt)\.csv|tests/layering/.*vocabulary\.py"
    r"|tests/bench/results\.csv|tests/conformance/vectors/|tests/fuzz/corpus/|LICENSE$)")


def read_rules(path):
    with open(path, encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def load_rules(folder=HERE):
    """Returns the rules (pattern, scope, replacement, reason) and exemptions (pattern, scope)."""
    rules = [(re.compile(row["pattern"]), re.compile(row["scope"]), row["instead"], row["reason"])
             for row in read_rules(os.path.join(folder, "vocabulary.csv"))]
    exempt = [(re.compile(row["pattern"]), re.compile(row["scope"]))
              for row in read_rules(os.path.join(folder, "exempt.csv"))]
    return rules, exempt


def check_line(path, number, line, rules, exempt):
    for pattern, scope, instead, reason in rules:
        if not scope.search(path):
            continue
        for match in pattern.finditer(line):
            # An exemption covers the span that it matches, not the rest of the line.
            covered = any(exempt_scope.search(path) and any(
                e.start() <= match.start() and match.end() <= e.end()
                for e in exempt_pattern.finditer(line))
                for exempt_pattern, exempt_scope in exempt)
            if not covered:
                yield f"{path}:{number}: '{match.group()}': write {instead} ({reason})"


def candidates(root, paths, rules):
    """Returns the paths of files that may contain a term. GNU grep searches for all rules at once, ten
    times faster than Python; without it, these are all paths."""
    joined = "|".join(f"(?i:{pattern.pattern[4:]})" if pattern.flags & re.IGNORECASE
                      else f"(?:{pattern.pattern})" for pattern, _, _, _ in rules)
    try:
        found = subprocess.run(["grep", "-lZP", "-e", joined, "--", *paths], cwd=root, check=False,
                               env=dict(os.environ, LC_ALL="C"), capture_output=True)
    except OSError:
        return paths
    if found.returncode > 1:  # this grep has no -P
        return paths
    return [os.fsdecode(path) for path in found.stdout.split(b"\0") if path]


def check(root, rules, exempt):
    findings = []
    paths = [path for path in source_files(root, TEXT) if not NOT_CHECKED.search(path)]
    for path in candidates(root, paths, rules):
        with open(os.path.join(root, path), encoding="utf-8") as file:
            for number, line in enumerate(file, 1):
                findings += check_line(path, number, line, rules, exempt)
    return findings


def main():
    if len(sys.argv) != 2 or not os.path.isdir(sys.argv[1]):
        sys.exit(__doc__)
    findings = check(sys.argv[1], *load_rules())
    for finding in findings:
        print(finding)
    print(f"{len(findings)} findings")
    sys.exit(1 if findings else 0)


if __name__ == "__main__":
    main()
