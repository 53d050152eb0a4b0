#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes the TypeScript module of the shader texts: the equations of
format/include/stgs/format/math and the .glsl files of sdk/web/src/webgl2, as GLSL ES 3.00.

usage: make_shaders.py [OUTPUT]     default: sdk/web/src/webgl2/shaders.ts

Headers of stgs/format/math, which a .glsl file includes by that name, are resolved here, since
WebGL has no #include: with the branches for GLSL, each header once, and without comments. The text
of the other lines is unchanged.
"""
import json
import os
import re
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
SOURCES = os.path.join(HERE, "..", "src", "webgl2")
HEADERS = os.path.join(HERE, "..", "..", "..", "format", "include")
HEADER = ("#version 300 es\nprecision highp float;\nprecision highp int;\n"
          "precision highp usampler2D;\nprecision highp usampler2DArray;\n")
# Selects the branches for GLSL in lang.h. WebGL does not allow the name in the text itself.
DEFINED = {"GL_core_profile"}
# Name in the module: file.
SHADERS = {"splatVertex": "splat.vert.glsl", "splatFragment": "splat.frag.glsl",
           "resolveVertex": "resolve.vert.glsl", "resolveFragment": "resolve.frag.glsl"}


class Text:
    """Collects the lines of one shader."""

    def __init__(self):
        self.lines = []
        self.seen = set()  # included files
        self.macros = {}  # name: whether it takes arguments; all expand to nothing

    def include(self, path):
        path = os.path.normpath(path)
        if path in self.seen:
            return
        self.seen.add(path)
        with open(path, encoding="utf-8") as file:
            text = re.sub(r"/\*.*?\*/", " ", file.read(), flags=re.DOTALL)
        taken = []  # of each open conditional: whether its current branch is used
        for number, line in enumerate(text.replace("\\\n", " ").split("\n"), 1):
            line = re.sub(r"//.*", "", line).rstrip()
            try:
                self.add(line, taken, os.path.dirname(path))
            except ValueError as error:
                sys.exit(f"{path}:{number}: {error}")
        if taken:
            sys.exit(f"{path}: a conditional is not closed")

    def add(self, line, taken, folder):
        directive = re.match(r"\s*#\s*(\w+)\s*(.*)", line)
        name, rest = directive.groups() if directive else (None, "")
        if name in ("ifdef", "ifndef", "if"):
            taken.append(self.condition(name, rest))
        elif name in ("else", "endif"):
            if not taken:
                raise ValueError(f"#{name} without #if")
            branch = taken.pop()
            if name == "else":
                taken.append(not branch)
        elif not all(taken):
            return
        elif name == "include":
            self.resolve(rest, folder)
        elif name == "define":
            self.define(rest)
        elif name is not None:
            raise ValueError(f"#{name} is not supported; write it without this directive")
        elif line:
            line = self.expand(line)
            if line.strip():
                self.lines.append(line)

    def condition(self, name, rest):
        if name == "if":
            match = re.fullmatch(r"(!?)\s*defined\s*\(\s*(\w+)\s*\)", rest)
        else:
            match = re.fullmatch(r"()(\w+)", rest)
        if not match:
            raise ValueError(f"#{name} {rest}: only tests of one macro are supported")
        is_defined = match[2] in DEFINED or match[2] in self.macros
        return is_defined != (name == "ifndef" or match[1] == "!")

    def resolve(self, rest, folder):
        match = re.fullmatch(r'"([^"]+)"', rest)
        if not match:
            raise ValueError(f"#include {rest}: only quoted names are supported")
        paths = [os.path.join(root, match[1]) for root in (folder, HEADERS)]
        found = [path for path in paths if os.path.exists(path)]
        if not found:
            raise ValueError(f"#include {rest}: no such file")
        self.include(found[0])

    def define(self, rest):
        match = re.fullmatch(r"(\w+)(\([\w\s,]*\))?\s*(.*)", rest)
        if not match or match[3]:
            raise ValueError(f"#define {rest}: only macros that expand to nothing are supported")
        self.macros[match[1]] = match[2] is not None

    def expand(self, line):
        for name, has_arguments in self.macros.items():
            arguments = r"\s*\([^()]*\)" if has_arguments else ""
            line = re.sub(rf"\b{name}\b{arguments}\s?", "", line)
        return line


def shader(file):
    text = Text()
    text.include(os.path.join(SOURCES, file))
    return HEADER + "\n".join(text.lines) + "\n"


def main():
    output = sys.argv[1] if len(sys.argv) > 1 else os.path.join(SOURCES, "shaders.ts")
    lines = ["// SPDX-License-Identifier: Apache-2.0", "// Written by make_shaders.py."]
    for name, file in SHADERS.items():
        lines.append(f"\n/** {file}, GLSL ES 3.00. */\nexport const {name}: string =")
        parts = [json.dumps(line + "\n") for line in shader(file).rstrip("\n").split("\n")]
        lines.append("  " + " +\n  ".join(parts) + ";")
    text = "\n".join(lines) + "\n"
    if os.path.exists(output):
        with open(output, encoding="utf-8") as file:
            if file.read() == text:
                return  # keeps its time, so that nothing is built again
    with open(output, "w", encoding="utf-8") as file:
        file.write(text)


if __name__ == "__main__":
    main()
