#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What is installed serves programs outside the tree, and the example draws what `stgs render` does.

Installs into an empty folder, moves it, builds the example there by find_package (shared and static)
and by pkg-config (both), and runs each.
"""
import argparse
import glob
import os
import shutil
import tempfile
import unittest

from outside import read_ppm, run, write_png

ARGUMENTS = None


class Install(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp()
        cls.addClassCleanup(shutil.rmtree, cls.folder)
        run(ARGUMENTS.fixture, cls.folder)
        run(ARGUMENTS.cmake, "--install", ARGUMENTS.build, "--prefix", cls.at("first"))
        os.rename(cls.at("first"), cls.at("prefix"))
        cls.library = os.path.dirname(glob.glob(cls.at("prefix/**/libstgs.so"), recursive=True)[0])
        cls.picture(ARGUMENTS.minimal, "example.ppm")

    @classmethod
    def at(cls, name):
        return os.path.join(cls.folder, name)

    @classmethod
    def picture(cls, program, name, environment=None):
        run(program, cls.at("tiny.stgs"), "0.1", cls.at(name), env=environment)
        return read_ppm(cls.at(name))

    def test_the_example_draws_what_the_program_draws(self):
        run(ARGUMENTS.stgs, "render", self.at("tiny.stgs"), "--time", "0.1", "-o", self.at("tiny.png"))
        width, height, pixels = read_ppm(self.at("example.ppm"))
        self.assertGreater(len(set(pixels)), 50)
        write_png(self.at("example.png"), width, height, pixels)
        # A byte that differs by 1 would be 87.7 dB.
        run(ARGUMENTS.stgs, "compare", self.at("example.png"), self.at("tiny.png"), "--min-psnr", "90")

    def by_find_package(self, name, example, language):
        build = self.at(f"build_{name}_{language}")
        run(ARGUMENTS.cmake, "-S", os.path.join(ARGUMENTS.source, "tests/install/consumer"),
            "-B", build, f"-DCMAKE_PREFIX_PATH={self.at('prefix')}",
            f"-DCMAKE_C_COMPILER={ARGUMENTS.cc}", f"-DCMAKE_CXX_COMPILER={ARGUMENTS.cxx}",
            "-DCMAKE_CXX_STANDARD=17", f"-DLIBRARY=stgs::{name}", f"-DLANGUAGE={language}",
            f"-DEXAMPLE={ARGUMENTS.source}/sdk/examples/{example}")
        run(ARGUMENTS.cmake, "--build", build)
        self.assertEqual(self.picture(os.path.join(build, "consumer"), f"{name}_{language}.ppm"),
                         read_ppm(self.at("example.ppm")))

    def test_find_package(self):
        for name in ("stgs", "static"):
            for example, language in ("minimal.c", "C"), ("player.cpp", "CXX"):
                with self.subTest(library=name, example=example):
                    self.by_find_package(name, example, language)

    def test_pkg_config(self):
        environment = dict(os.environ, PKG_CONFIG_PATH=os.path.join(self.library, "pkgconfig"))
        for name, words in ("shared", []), ("static", ["--static"]):
            with self.subTest(library=name):
                flags = run("pkg-config", "--cflags", "--libs", *words, "stgs",
                            env=environment).split()
                if words:  # the archive, where the linker would take the shared library
                    flags = ["-l:libstgs.a" if flag == "-lstgs" else flag for flag in flags]
                program = self.at(f"by_pkg_config_{name}")
                run(ARGUMENTS.cc, os.path.join(ARGUMENTS.source, "sdk/examples/minimal.c"), *flags,
                    "-o", program)
                used = dict(os.environ)
                if not words:
                    used["LD_LIBRARY_PATH"] = self.library
                self.assertEqual(self.picture(program, f"pc_{name}.ppm", used),
                                 read_ppm(self.at("example.ppm")))

    def test_the_shared_library_has_its_soname(self):
        names = {os.path.basename(path) for path in glob.glob(os.path.join(self.library, "*.so*"))}
        self.assertEqual(names, {"libstgs.so", "libstgs.so.0", "libstgs.so.0.1.0"})


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    for argument in ("build", "source", "stgs", "fixture", "minimal", "cmake", "cc", "cxx"):
        parser.add_argument(f"--{argument}", required=True)
    ARGUMENTS, rest = parser.parse_known_args()
    unittest.main(argv=["test_install.py", *rest])
