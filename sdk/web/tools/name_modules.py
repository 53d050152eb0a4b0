#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Completes the names of modules that declarations import, "./player" to "./player.js" or
"./player/index.js": programs whose tsc resolves modules as node does (node16, nodenext) need them.

usage: name_modules.py FOLDER    the .d.ts files below it are changed in place
"""
import os
import re
import sys

# from "./x" and import("./x")
IMPORT = re.compile(r'(\bfrom |\bimport\()"(\.[^"]*)"')


def complete_name(name, folder):
    """Returns the name of a module relative to a folder, with its ending. Raises ValueError."""
    path = os.path.join(folder, name)
    if name.endswith(".js") and os.path.exists(path[:-3] + ".d.ts"):
        return name
    for ending in (".js", "/index.js"):
        if os.path.exists(path + ending[:-3] + ".d.ts"):
            return name + ending
    raise ValueError(f"no declarations of {name}")


def name_modules(text, folder):
    return IMPORT.sub(lambda match: f'{match[1]}"{complete_name(match[2], folder)}"', text)


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    for folder, _, names in os.walk(sys.argv[1]):
        for name in names:
            path = os.path.join(folder, name)
            if not name.endswith(".d.ts"):
                continue
            with open(path, encoding="utf-8") as file:
                text = file.read()
            try:
                named = name_modules(text, folder)
            except ValueError as error:
                sys.exit(f"{path}: {error}")
            with open(path, "w", encoding="utf-8") as file:
                file.write(named)


if __name__ == "__main__":
    main()
