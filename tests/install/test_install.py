#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Programs outside the source tree build against an installation and render like `stgs render`.

Installs into an empty folder, moves the folder, builds the example with find_package and pkg-config
(each shared and static), and runs each program.
"""
import argparse
import glob
import os
import re
import shutil
import subprocess
import tempfile
import unittest

from hardening import ElfFile, is_elf
from outside import read_png, read_ppm, run

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
        cls.render(ARGUMENTS.minimal, "example.png")

    @classmethod
    def at(cls, name):
        return os.path.join(cls.folder, name)

    @classmethod
    def render(cls, program, name, scene="tiny.stgs", environment=None):
        run(program, cls.at(scene), "0.1", cls.at(name), env=environment)
        return read_png(cls.at(name)) if name.endswith(".png") else read_ppm(cls.at(name))

    def test_the_example_renders_the_same_image_as_the_program(self):
        run(ARGUMENTS.stgs, "render", self.at("tiny.stgs"), "--time", "0.1", "-o", self.at("tiny.png"))
        self.assertGreater(len(set(read_png(self.at("example.png"))[2])), 50)
        # A single byte that differs by 1 gives 87.7 dB.
        run(ARGUMENTS.stgs, "compare", self.at("example.png"), self.at("tiny.png"), "--min-psnr", "90")

    def test_the_example_frames_a_scene_without_a_start_camera(self):
        run(ARGUMENTS.minimal, self.at("no_camera.stgs"), "0.1", self.at("no_camera.png"))
        width, height, pixels = read_png(self.at("no_camera.png"))
        colours = [pixels[k:k + 3] for k in range(0, len(pixels), 3)]
        middle = [colours[width * y + x] for y in range(height // 4, 3 * height // 4)
                  for x in range(width // 4, 3 * width // 4)]
        edges = colours[:width] + colours[-width:]
        self.assertGreater(len(set(middle)), 50)
        # The complete scene is in the image, except the rims of some splats.
        self.assertGreater(edges.count(edges[0]), 0.8 * len(edges))

    def test_the_installed_examples_build_with_their_own_script(self):
        built = {}
        for package in "libstgs-dev", "libstgs-encoder-dev":
            built |= self.build_examples(package)
        self.assertGreaterEqual(set(built), {"minimal", "player", "telepresence_viewer", "encode",
                                             "telepresence_cameras", "telepresence_recorder"})
        self.render(built["minimal"], "built.png")
        self.assertEqual(read_png(self.at("built.png")), read_png(self.at("example.png")))
        run(built["telepresence_recorder"], self.at("telepresence.stgs"), "0.2", "0.1")
        run(ARGUMENTS.stgs, "validate", self.at("telepresence.stgs"))

    def build_examples(self, package):
        """Builds the installed examples of a package; returns their paths by name."""
        folder = os.path.join(self.at("prefix"), f"share/doc/{package}/examples")
        build = self.at(f"build_{package}")
        output = run(ARGUMENTS.cmake, "-S", folder, "-B", build,
                     f"-DCMAKE_PREFIX_PATH={self.at('prefix')}",
                     f"-DCMAKE_C_COMPILER={ARGUMENTS.cc}", f"-DCMAKE_CXX_COMPILER={ARGUMENTS.cxx}")
        run(ARGUMENTS.cmake, "--build", build)
        programs = {os.path.splitext(os.path.basename(path))[0]
                    for path in glob.glob(os.path.join(folder, "*.c*"))}
        omitted = re.findall(r": ([\w, ]+) (?:is|are) left out", output)
        built = programs - set(re.findall(r"\w+", " ".join(omitted)))
        for program in built:
            self.assertTrue(os.path.exists(os.path.join(build, program)), program)
        return {program: os.path.join(build, program) for program in built}

    def by_find_package(self, name, example, language, components=""):
        """Builds an example in a separate project; returns the path of its program."""
        build = self.at(f"build_{name}_{language}")
        run(ARGUMENTS.cmake, "-S", os.path.join(ARGUMENTS.source, "tests/install/consumer"),
            "-B", build, f"-DCMAKE_PREFIX_PATH={self.at('prefix')}",
            f"-DCMAKE_C_COMPILER={ARGUMENTS.cc}", f"-DCMAKE_CXX_COMPILER={ARGUMENTS.cxx}",
            "-DCMAKE_CXX_STANDARD=17", f"-DLIBRARY=stgs::{name}", f"-DLANGUAGE={language}",
            f"-DEXAMPLE={ARGUMENTS.source}/sdk/examples/{example}", f"-DCOMPONENTS={components}")
        run(ARGUMENTS.cmake, "--build", build)
        return os.path.join(build, "consumer")

    def test_find_package_builds_and_renders(self):
        for name, example, language, kind in (("stgs", "minimal.c", "C", "png"),
                                              ("static", "player.cpp", "CXX", "ppm")):
            with self.subTest(library=name, example=example):
                program = self.by_find_package(name, example, language)
                self.assertEqual(self.render(program, f"{name}.{kind}"),
                                 read_png(self.at("example.png")))
                self.assertEqual(self.render(program, f"far.{kind}", "no_camera.stgs"),
                                 self.render(ARGUMENTS.minimal, "m.png", "no_camera.stgs"))

    def by_pkg_config(self, packages, example, words):
        """Builds an example; returns the path of its program and the environment to run it in."""
        environment = dict(os.environ, PKG_CONFIG_PATH=os.path.join(self.library, "pkgconfig"))
        flags = run("pkg-config", "--cflags", "--libs", *words, *packages,
                    env=environment).split()
        run_environment = dict(os.environ)
        if words:  # name the archives, because the linker prefers shared libraries
            flags = [flag.replace("-lstgs", "-l:libstgs") + ".a" if flag.startswith("-lstgs")
                     else flag for flag in flags]
        else:
            run_environment["LD_LIBRARY_PATH"] = self.library
        program = self.at("_".join(["by_pkg_config", *packages, *words]))
        run(ARGUMENTS.cc, os.path.join(ARGUMENTS.source, "sdk/examples", example), *flags,
            "-o", program)
        return program, run_environment

    def test_pkg_config_builds_and_renders(self):
        for name, words in ("shared", []), ("static", ["--static"]):
            with self.subTest(library=name):
                program, environment = self.by_pkg_config(["stgs", "stb"], "minimal.c", words)
                self.assertEqual(self.render(program, f"pc_{name}.png", environment=environment),
                                 read_png(self.at("example.png")))

    def test_the_commands_in_the_embedding_page_work(self):
        with open(os.path.join(ARGUMENTS.source, "sdk/docs/embedding.md"), encoding="utf-8") as file:
            block = re.search(r"<!-- not run: installs; [^\n]*\n```sh\n(.*?)```", file.read(), re.S)
        script = block.group(1)
        for documented, actual in (
                ("/opt/stgs", self.at("by_page")), ("cmake ", f"{ARGUMENTS.cmake} "),
                ("build/release", ARGUMENTS.build), ("packed.stgs", "tiny.stgs"),
                ("sdk/examples", os.path.join(ARGUMENTS.source, "sdk/examples"))):
            self.assertIn(documented, script)
            script = script.replace(documented, actual)
        subprocess.run(["sh", "-e", "-c", script], cwd=self.folder, check=True,
                       stdout=subprocess.DEVNULL)
        self.assertEqual(read_png(self.at("image.png")), read_png(self.at("example.png")))

    def test_the_encoder_links_and_encodes(self):
        programs = [(self.by_find_package(name, "encode.c", "C", name), None)
                    for name in ("encoder", "encoder_static")]
        programs += [self.by_pkg_config(["stgs_encoder"], "encode.c", words)
                     for words in ([], ["--static"])]
        prepares = " prepare" in run(ARGUMENTS.stgs, "--version")
        for program, environment in programs:
            with self.subTest(program=program):
                result = subprocess.run([program, self.at("none"), self.at("none.stgs")],
                                        env=environment, capture_output=True, text=True, check=False)
                self.assertEqual(result.returncode, 1, result.stderr)
                self.assertIn("STGS_ERROR_IO" if prepares else "STGS_ERROR_NOT_BUILT", result.stderr)
        if not prepares:
            self.skipTest("needs a build with OpenCV")
        capture = os.path.join(ARGUMENTS.source, "tests/data/workshop")
        output = run(programs[0][0], capture, self.at("draft.stgs"), "draft")
        self.assertRegex(output, r"^\d+ primitives, \d+ bytes, PSNR \d+\.\d dB against")
        run(ARGUMENTS.minimal, self.at("draft.stgs"), "0", self.at("draft.png"))
        self.assertGreater(len(set(read_png(self.at("draft.png"))[2])), 50)

    def test_the_installed_files_are_hardened(self):
        files = [path for path in glob.glob(self.at("prefix/**"), recursive=True)
                 if os.path.isfile(path) and not path.endswith((".a", ".o")) and is_elf(path)]
        self.assertGreaterEqual(len(files), 3)
        for path in files:
            with self.subTest(file=os.path.basename(path)):
                file = ElfFile("readelf", path)
                self.assertEqual(file.link_problems(), [])
                self.assertTrue(file.has_stack_protector())

    def test_the_shared_libraries_have_their_sonames(self):
        names = {os.path.basename(path) for path in glob.glob(os.path.join(self.library, "*.so*"))}
        self.assertEqual(names, {f"lib{name}.so{version}" for name in ("stgs", "stgs_encoder")
                                 for version in ("", ".0", ".0.1.0")})


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    for argument in ("build", "source", "stgs", "fixture", "minimal", "cmake", "cc", "cxx"):
        parser.add_argument(f"--{argument}", required=True)
    ARGUMENTS, rest = parser.parse_known_args()
    unittest.main(argv=["test_install.py", *rest])
