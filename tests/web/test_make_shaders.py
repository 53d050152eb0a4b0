#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""make_shaders.py resolves the headers of the equations, and rejects other directives.

usage: test_make_shaders.py
"""
import os
import re
import sys
import tempfile
import unittest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "sdk", "web", "tools"))
import make_shaders  # noqa: E402

MATH = os.path.join(make_shaders.HEADERS, "stgs", "format", "math")


class MakeShadersTest(unittest.TestCase):
    def resolve(self, text):
        with tempfile.NamedTemporaryFile("w", suffix=".glsl", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            collected = make_shaders.Text()
            collected.include(file.name)
            return collected.lines

    def rejected(self, text):
        with self.assertRaises(SystemExit) as raised:
            self.resolve(text)
        return str(raised.exception)

    def test_each_function_of_the_headers_is_defined_once(self):
        shader = make_shaders.shader("splat.vert.glsl")
        for header in ("lang", "lifespan", "blend", "project", "screen_splat", "sh"):
            with open(os.path.join(MATH, f"{header}.h"), encoding="utf-8") as file:
                names = set(re.findall(r"STGS_FN \w+ (\w+)\(", file.read()))
            self.assertTrue(names)
            for name in names:
                self.assertEqual(len(re.findall(rf"^\w+ {name}\(", shader, re.M)), 1, name)

    def test_shaders_begin_with_the_version_and_have_no_other_directive(self):
        for file in make_shaders.SHADERS.values():
            shader = make_shaders.shader(file)
            self.assertTrue(shader.startswith("#version 300 es\n"))
            self.assertEqual(shader.count("#"), 1)
            self.assertNotIn("STGS_", shader)

    def test_branches_for_glsl(self):
        text = ("#if defined(GL_core_profile)\na\n#ifdef OTHER\nb\n#else\nc\n#endif\n"
                "#else\nd\n#endif\n")
        self.assertEqual(self.resolve(text), ["a", "c"])

    def test_macros_expand_to_nothing(self):
        text = "#define NONE\n#define SIZED(n)\nNONE int f();\nstruct SIZED(16) S {};\n"
        self.assertEqual(self.resolve(text), ["int f();", "struct S {};"])

    def test_text_that_it_does_not_support_is_rejected(self):
        self.assertRegex(self.rejected("x\n#define ONE 1\n"), r":2: #define ONE 1: only macros")
        self.assertRegex(self.rejected("#if ONE > 0\n#endif\n"), "only tests of one macro")
        self.assertRegex(self.rejected('#include "none.h"\n'), "no such file")
        self.assertRegex(self.rejected("#include <cmath>\n"), "only quoted names")
        self.assertRegex(self.rejected("#endif\n"), "#endif without #if")
        self.assertRegex(self.rejected("#ifdef ONE\n"), "a conditional is not closed")
        self.assertRegex(self.rejected("#pragma once\n"), "#pragma is not supported")


if __name__ == "__main__":
    unittest.main()
