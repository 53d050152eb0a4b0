#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""STGS in the build of an application, with add_subdirectory and FetchContent.

With --fixture and --minimal, the application is built and its images are compared; without them, it
is only configured.
"""
import argparse
import os
import shutil
import subprocess
import tempfile
import unittest

from outside import read_png, run

ARGUMENTS = None


class Subproject(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp()
        self.addCleanup(shutil.rmtree, self.folder)

    def at(self, name):
        return os.path.join(self.folder, name)

    def configure(self, method, *options):
        return run(ARGUMENTS.cmake, "-G", "Ninja", "-S",
                   os.path.join(ARGUMENTS.source, "tests/install/subproject"),
                   "-B", self.at(method), f"-DSTGS_SOURCE={ARGUMENTS.source}", f"-DMETHOD={method}",
                   f"-DEXAMPLE={ARGUMENTS.source}/sdk/examples/minimal.c",
                   f"-DCMAKE_C_COMPILER={ARGUMENTS.cc}", f"-DCMAKE_CXX_COMPILER={ARGUMENTS.cxx}",
                   *options)

    def test_only_dependencies_of_the_player_are_looked_up(self):
        for method in "add_subdirectory", "FetchContent":
            with self.subTest(method=method):
                self.configure(method)
                with open(self.at(f"{method}/CMakeCache.txt"), encoding="utf-8") as file:
                    cache = file.read()
                for name in "Eigen3_DIR", "CLI11_DIR", "OpenCV_DIR", "MPI_CXX", "glfw3_DIR", \
                            "Catch2_DIR", "Python3_EXECUTABLE", "CMAKE_CUDA_COMPILER":
                    self.assertNotIn(f"\n{name}", cache)

    def test_only_linked_targets_are_built_by_default(self):
        self.configure("add_subdirectory")
        ninja = os.path.join(self.at("add_subdirectory"), "build.ninja")
        with open(ninja, encoding="utf-8") as file:
            default = next(line for line in file if line.startswith("build all: phony"))
        self.assertIn("with_stgs", default)
        self.assertNotIn("stgs/sdk", default)

    def test_the_application_builds_and_renders(self):
        if ARGUMENTS.minimal is None:
            self.skipTest("only configured")
        self.configure("FetchContent", "-DCMAKE_BUILD_TYPE=Release",
                       *([f"-DCMAKE_CXX_COMPILER_LAUNCHER={ARGUMENTS.launcher}"]
                         if ARGUMENTS.launcher else []))
        build = self.at("FetchContent")
        run(ARGUMENTS.cmake, "--build", build)
        run(ARGUMENTS.cmake, "--install", build, "--prefix", self.at("prefix"))
        installed = [name for _, _, names in os.walk(self.at("prefix")) for name in names]
        self.assertEqual(installed, ["with_stgs"])
        run(ARGUMENTS.fixture, self.folder)
        run(ARGUMENTS.minimal, self.at("tiny.stgs"), "0.1", self.at("expected.png"))
        for program in "with_stgs", "with_static":
            run(os.path.join(build, program), self.at("tiny.stgs"), "0.1", self.at("image.png"))
            self.assertEqual(read_png(self.at("image.png")), read_png(self.at("expected.png")))


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    for argument in "source", "cmake", "cc", "cxx":
        parser.add_argument(f"--{argument}", required=True)
    for argument in "fixture", "minimal", "launcher":
        parser.add_argument(f"--{argument}")
    ARGUMENTS, rest = parser.parse_known_args()
    unittest.main(argv=["test_subproject.py", *rest])
