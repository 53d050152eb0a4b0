#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The shared library exports the functions of its header, and nothing else.

usage: test_exports.py NM LIBRARY SDK_FOLDER
"""
import re
import subprocess
import sys


def main():
    nm, library, folder = sys.argv[1:]
    with open(f"{folder}/include/stgs/stgs.h", encoding="utf-8") as file:
        header = set(re.findall(r"^STGS_API[^;]*?\b(stgs_\w+)\(", file.read(), re.MULTILINE))
    with open(f"{folder}/stgs.map", encoding="utf-8") as file:
        mapped = set(re.findall(r"^\s+(\w+);$", file.read(), re.MULTILINE))
    shown = subprocess.run([nm, "-D", "--defined-only", library], capture_output=True, text=True,
                           check=True).stdout
    symbols = [line.split()[-2:] for line in shown.splitlines()]
    exported = {name.split("@")[0] for kind, name in symbols if kind != "A"}
    for name, found in ("map", mapped), ("library", exported):
        print(f"{name}: lacks {sorted(header - found)}, has too {sorted(found - header)}")
    sys.exit(0 if header and header == mapped == exported else 1)


if __name__ == "__main__":
    main()
