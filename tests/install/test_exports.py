#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The shared library exports the functions of its headers, and nothing else; the static one has no
name of the Vulkan loader's or of volk's, which its user may link too.

usage: test_exports.py NM SHARED STATIC SDK_FOLDER stgs|stgs_encoder
"""
import re
import subprocess
import sys

from outside import headers_of


def symbols_of(nm, which, library):
    """Pairs of a kind and a name."""
    shown = subprocess.run([nm, which, "--defined-only", library], capture_output=True, text=True,
                           check=True).stdout
    lines = [line.split() for line in shown.splitlines()]
    return [words[-2:] for words in lines if len(words) == 3]


def main():
    nm, library, archive, folder, name = sys.argv[1:]
    header = set()
    for path in headers_of(name, f"{folder}/include/stgs"):
        with open(path, encoding="utf-8") as file:
            header |= set(re.findall(r"^STGS_API[^;]*?\b(stgs_\w+)\(", file.read(), re.MULTILINE))
    with open(f"{folder}/{name}.map", encoding="utf-8") as file:
        mapped = set(re.findall(r"^\s+(\w+);$", file.read(), re.MULTILINE))
    exported = {name.split("@")[0] for kind, name in symbols_of(nm, "-D", library) if kind != "A"}
    foreign = [name for _, name in symbols_of(nm, "-g", archive) if re.match("(vk|volk)[A-Z]", name)]
    print(f"archive: has {len(foreign)} names of Vulkan's {foreign[:3]}")
    for name, found in ("map", mapped), ("library", exported):
        print(f"{name}: lacks {sorted(header - found)}, has too {sorted(found - header)}")
    sys.exit(0 if header and header == mapped == exported and not foreign else 1)


if __name__ == "__main__":
    main()
