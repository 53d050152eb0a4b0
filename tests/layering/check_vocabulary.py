#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Fails on names and phrases that the project has replaced by the field's standard terms.

usage: check_vocabulary.py ROOT     exit code 0: clean; 1: findings, one per line on stdout

vocabulary.csv lists them: a regular expression (Python, matched line by line), the paths it applies
to (a regular expression on the path below ROOT), what to write instead, and the reason. A line that
must keep such a word, because another library or format defines it, is matched by exempt.csv.
"""
import csv
import os
import re
import sys

from check_sources import CODE, SCRIPTS, source_files

TEXT = CODE + SCRIPTS + (".md", ".json", ".csv", ".in", ".bash", ".fish", ".zsh", ".frag", ".vert",
                         ".map", ".pyi", ".yml", ".yaml", ".cs", ".txt")
HERE = os.path.dirname(os.path.abspath(__file__))
# The list itself, the names of others, and records of what was run under earlier names.
NOT_CHECKED = re.compile(
    r"^(tests/layering/(vocabulary|exempt)\.csv|tests/layering/.*vocabulary\.py"
    r"|tests/bench/results\.csv|tests/conformance/vectors/|tests/fuzz/corpus/|LICENSE$)")


def read_rules(path):
    with open(path, encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def load_rules(folder=HERE):
    """(pattern, scope, replacement, reason) and (pattern, scope) of the exemptions, compiled."""
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
            # An exemption covers the span that it matches, not the rest of its line.
            covered = any(where.search(path) and any(
                e.start() <= match.start() and match.end() <= e.end() for e in what.finditer(line))
                for what, where in exempt)
            if not covered:
                yield f"{path}:{number}: '{match.group()}': write {instead} ({reason})"


def check(root, rules, exempt):
    findings = []
    for path in source_files(root, TEXT):
        if NOT_CHECKED.search(path):
            continue
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
