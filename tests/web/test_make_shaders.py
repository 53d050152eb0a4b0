#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""make_shaders.py resolves the headers of the equations, rewrites them for WGSL, and rejects
unsupported text.

usage: test_make_shaders.py
"""
import os
import re
import sys
import tempfile
import unittest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "sdk", "web", "tools"))
import make_shaders  # noqa: E402
import wgsl  # noqa: E402

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

    def shader(self, folder, file):
        return make_shaders.shader(os.path.join(make_shaders.SOURCES, folder, file))

    def check_functions(self, shader, pattern):
        """Each function of the headers that a shader uses is defined once; returns their names."""
        defined = set()
        for header in ("lang", "lifespan", "blend", "project", "screen_splat", "sh"):
            with open(os.path.join(MATH, f"{header}.h"), encoding="utf-8") as file:
                names = set(re.findall(r"STGS_FN \w+ (\w+)\(", file.read()))
            self.assertTrue(names)
            for name in names:
                found = re.findall(pattern.format(name), shader, re.M)
                is_used = re.search(rf"\b{name}\(", shader) is not None
                self.assertEqual(len(found), 1 if is_used else 0, name)
                defined |= {name} if found else set()
        return defined

    def test_each_function_of_the_headers_is_defined_once(self):
        defined = self.check_functions(self.shader("webgl2", "splat.vert.glsl"), r"^\w+ {}\(")
        self.assertIn("covariance_of", defined)  # unused
        defined = self.check_functions(self.shader("webgpu", "project.wgsl"), r"^fn {}\(")
        self.assertIn("projection_rows", defined)  # used by another function of the headers
        self.assertNotIn("covariance_of", defined)

    def test_glsl_begins_with_the_version_and_has_no_other_directive(self):
        for file in make_shaders.SHADERS["webgl2"].values():
            shader = self.shader("webgl2", file)
            self.assertTrue(shader.startswith("#version 300 es\n"))
            self.assertEqual(shader.count("#"), 1)
            self.assertNotIn("STGS_", shader)

    def test_wgsl_has_no_directive_and_no_type_of_glsl(self):
        for file in make_shaders.SHADERS["webgpu"].values():
            shader = self.shader("webgpu", file)
            self.assertNotRegex(shader, r"#|STGS_|\bfloat\b|\?")

    def test_forms_that_are_rewritten_for_wgsl(self):
        lines = ["const int kTwo = 2;", "struct A {", "  float x, y;", "  int v[3];", "};", "int f(A a,",
                 "      float x) {", "  A b;", "  float y =", "      x + 1.0f;", "  b.v[1] = 3;",
                 "  if (y < x) return kTwo;", "  bool big = floatBitsToUint(y) > 2u;",
                 "  return big ? 1 : kTwo;", "}"]
        self.assertEqual(wgsl.rewrite(lines), [
            "const kTwo: i32 = 2;", "struct A {", "  x: f32, y: f32,", "  v: array<i32, 3>,", "}",
            "fn f(a: A, x: f32) -> i32 {", "  var b: A;", "  let y: f32 = x + 1.0f;", "  b.v[1] = 3;",
            "  if (y < x) { return kTwo; }", "  let big: bool = bitcast<u32>(y) > 2u;",
            "  return select(kTwo, 1, big);", "}"])

    def test_other_forms_are_rejected(self):
        for text in ("float x;", "float f(float a) { while (a < 1.0f) a = 2.0f; }", "float f() { g(); }",
                     "float f(float a) { return a > 0.0f ? 1.0f : a < 0.0f ? 2.0f : 3.0f; }"):
            with self.assertRaisesRegex(ValueError, "supported", msg=text):
                wgsl.rewrite([text])

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
