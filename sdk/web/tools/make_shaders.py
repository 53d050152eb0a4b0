#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes the TypeScript modules of the shader texts: the equations of
format/include/stgs/format/math with the .glsl files of sdk/web/src/webgl2, as GLSL ES 3.00, and
with the .wgsl files of sdk/web/src/webgpu, as WGSL.

usage: make_shaders.py [FOLDER]     writes webgl2/shaders.ts and webgpu/shaders.ts
FOLDER: default sdk/web/src

Headers of stgs/format/math, which a shader includes by that name, are resolved here, since neither
language has #include: with the branches for GLSL, each header once, and without comments. For WGSL,
wgsl.py rewrites them, and only what a shader uses is included. The text of the shaders is unchanged.
"""
import json
import os
import re
import sys

import wgsl

HERE = os.path.dirname(os.path.abspath(__file__))
SOURCES = os.path.join(HERE, "..", "src")
HEADERS = os.path.join(HERE, "..", "..", "..", "format", "include")
HEADER = ("#version 300 es\nprecision highp float;\nprecision highp int;\n"
          "precision highp usampler2D;\nprecision highp usampler2DArray;\n")
# Selects the branches for GLSL in lang.h. WebGL does not allow the name in the text itself.
DEFINED = {"GL_core_profile"}
# Folder: name in its module: file.
SHADERS = {"webgl2": {"projectFragment": "project.frag.glsl",
                      "splatVertex": "splat.vert.glsl", "splatFragment": "splat.frag.glsl",
                      "splatDepthFragment": "splat_depth.frag.glsl",
                      "depthFragment": "depth.frag.glsl",
                      "resolveVertex": "resolve.vert.glsl",
                      "resolveFragment": "resolve.frag.glsl"},
           "webgpu": {"projectShader": "project.wgsl", "sortShader": "sort.wgsl",
                      "sortPortableShader": "sort_portable.wgsl",
                      "sortSubgroupsShader": "sort_subgroups.wgsl",
                      "splatShader": "splat.wgsl", "resolveShader": "resolve.wgsl"}}


class Text:
    """Collects the lines of one shader."""

    def __init__(self):
        self.lines = []
        self.header_lines = set()  # indices of the lines that are from headers
        self.is_header = False  # the file that is being read
        self.seen = set()  # included files
        self.macros = {}  # name: whether it takes arguments; all expand to nothing

    def include(self, path):
        path = os.path.normpath(path)
        if path in self.seen:
            return
        self.seen.add(path)
        with open(path, encoding="utf-8") as file:
            text = re.sub(r"/\*.*?\*/", " ", file.read(), flags=re.DOTALL)
        is_header_outside, self.is_header = self.is_header, path.endswith(".h")
        taken = []  # of each open conditional: whether its current branch is used
        for number, line in enumerate(text.replace("\\\n", " ").split("\n"), 1):
            line = re.sub(r"//.*", "", line).rstrip()
            try:
                self.add(line, taken, os.path.dirname(path))
            except ValueError as error:
                sys.exit(f"{path}:{number}: {error}")
        if taken:
            sys.exit(f"{path}: a conditional is not closed")
        self.is_header = is_header_outside

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
                if self.is_header:
                    self.header_lines.add(len(self.lines))
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


def shader(path):
    """Returns the text of a shader, in the language of its name."""
    text = Text()
    text.include(path)
    if path.endswith(".glsl"):
        return HEADER + "\n".join(text.lines) + "\n"
    own, headers = [], []
    for index, line in enumerate(text.lines):
        (headers if index in text.header_lines else own).append(line)
    try:
        declarations = wgsl.declarations_of(wgsl.rewrite(headers))
    except ValueError as error:
        sys.exit(f"{path}: {error}")
    return "\n".join(wgsl.used(declarations, "\n".join(own)) + own) + "\n"


def write_module(folder, output):
    """Writes the module of a folder of SHADERS."""
    lines = ["// SPDX-License-Identifier: Apache-2.0", "// Written by make_shaders.py."]
    for name, file in SHADERS[folder].items():
        text = shader(os.path.join(SOURCES, folder, file))
        lines.append(f"\n/** {file}. */\nexport const {name}: string =")
        parts = [json.dumps(line + "\n") for line in text.rstrip("\n").split("\n")]
        lines.append("  " + " +\n  ".join(parts) + ";")
    text = "\n".join(lines) + "\n"
    if os.path.exists(output):
        with open(output, encoding="utf-8") as file:
            if file.read() == text:
                return  # keeps its time, so that nothing is built again
    with open(output, "w", encoding="utf-8") as file:
        file.write(text)


def main():
    root = sys.argv[1] if len(sys.argv) > 1 else SOURCES
    for folder in SHADERS:
        write_module(folder, os.path.join(root, folder, "shaders.ts"))


if __name__ == "__main__":
    main()
