#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The shared library exports exactly the functions of its headers; the static library has no symbol
of the Vulkan loader or of volk, which an application may link as well.

usage: test_exports.py NM SHARED STATIC SDK_FOLDER stgs|stgs_encoder
"""
import re
import subprocess
import sys

from outside import headers_of


def symbols_of(nm, which, library):
    """Returns pairs of a kind and a name."""
    output = subprocess.run([nm, which, "--defined-only", library], capture_output=True, text=True,
                            check=True).stdout
    lines = [line.split() for line in output.splitlines()]
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
    print(f"archive: {len(foreign)} Vulkan symbols {foreign[:3]}")
    for name, found in ("map", mapped), ("library", exported):
        print(f"{name}: missing {sorted(header - found)}, unexpected {sorted(found - header)}")
    sys.exit(0 if header and header == mapped == exported and not foreign else 1)


if __name__ == "__main__":
    main()
