#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The samples of sdk/docs, and of the guide to live encoding, compile and run against an installation.

The ```c or ```cpp blocks of a page together form one program. Its argument is a scene, or for
encoding.md a capture and an output; it must succeed (that of live.md, which needs cameras, is only
built), and fail for a missing file. The ```python
blocks form one program in a folder with scene.stgs, which runs if the module is built. A ```cmake
block builds the page's program (as main.c). The functions, constants and structs that the pages
name are declared. test_site.py follows the links.
"""
import argparse
import glob
import os
import re
import shutil
import subprocess
import tempfile
import unittest

from outside import run

ENCODING = {"encoding.md", "live.md"}  # pages whose programs use libstgs_encoder
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.DOTALL | re.MULTILINE)

parser = argparse.ArgumentParser()
for argument in ("build", "source", "fixture", "cmake", "cc", "cxx"):
    parser.add_argument(f"--{argument}", required=True)
parser.add_argument("--python", help="interpreter of the Python module, if it is built")
ARGUMENTS = parser.parse_args()


def read(path):
    with open(path, encoding="utf-8") as file:
        return file.read()


class Docs(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp()
        cls.addClassCleanup(shutil.rmtree, cls.folder)
        run(ARGUMENTS.fixture, cls.folder)
        run(ARGUMENTS.cmake, "--install", ARGUMENTS.build, "--prefix", cls.at("prefix"))
        cls.library = os.path.dirname(glob.glob(cls.at("prefix/**/libstgs.so"), recursive=True)[0])
        cls.docs = os.path.join(ARGUMENTS.source, "sdk/docs")
        cls.pages = {os.path.basename(path): read(path)
                     for path in glob.glob(os.path.join(cls.docs, "*.md"))}
        cls.pages["live.md"] = read(os.path.join(cls.docs, "guide/live.md"))

    @classmethod
    def at(cls, name):
        return os.path.join(cls.folder, name)

    @classmethod
    def arguments(cls, page):
        if page == "encoding.md":
            return [os.path.join(ARGUMENTS.source, "tests/data/workshop"), cls.at("encoded.stgs")]
        if page == "live.md":
            return [cls.at("rig.json"), cls.at("live.stgs"), cls.at("left"), cls.at("right")]
        return [cls.at("tiny.stgs")]

    @classmethod
    def can_run(cls, page):
        if page == "live.md":  # needs cameras
            return False
        return page != "encoding.md" or " prepare" in run(cls.at("prefix/bin/stgs"), "--version")

    def blocks(self, page, language):
        return [text for kind, text in BLOCK.findall(self.pages[page]) if kind == language]

    def build(self, page):
        """Builds the page's program and returns its path; None if the page has none."""
        compilers = {"c": (ARGUMENTS.cc, "-std=c99", "-D_POSIX_C_SOURCE=200809L"),
                     "cpp": (ARGUMENTS.cxx, "-std=c++17")}
        kind = "cpp" if self.blocks(page, "cpp") else "c"
        text = "\n".join(self.blocks(page, kind))
        if not text:
            return None
        source, program = self.at(f"{page}.{kind}"), self.at(page + ".program")
        with open(source, "w", encoding="utf-8") as file:
            file.write(text)
        run(*compilers[kind], "-pedantic", "-Wall", "-Wextra", "-Werror", source,
            "-I", self.at("prefix/include"), "-L", self.library,
            *(["-lstgs_encoder"] if page in ENCODING else []), "-lstgs", "-lpthread",
            f"-Wl,-rpath,{self.library}", "-o", program)
        return program

    def test_programs_in_the_pages_compile_and_run(self):
        built = 0
        for page in self.pages:
            with self.subTest(page):
                program = self.build(page)
                if program is None:
                    continue
                built += 1
                if self.can_run(page):
                    run(program, *self.arguments(page))
                if page == "playing.md":  # a scene without a start camera plays too
                    self.assertIn("layers", run(program, self.at("no_camera.stgs")))
                result = subprocess.run([program, self.at("no such file"), *self.arguments(page)[1:]],
                                        capture_output=True, text=True, timeout=60, check=False)
                self.assertEqual(result.returncode, 1, result.stdout + result.stderr)
        self.assertGreaterEqual(built, 8)

    def test_the_program_of_the_readme_renders_an_image(self):
        text = read(os.path.join(ARGUMENTS.source, "README.md"))
        blocks = [code for kind, code in BLOCK.findall(text) if kind == "c"]
        self.assertEqual(len(blocks), 1)
        self.assertLessEqual(len(blocks[0].splitlines()), 20)
        self.pages["readme"] = text
        program = self.build("readme")
        del self.pages["readme"]
        image = subprocess.run([program, self.at("tiny.stgs")], capture_output=True, timeout=60,
                               check=True).stdout
        head, pixels = image.split(b"ENDHDR\n", 1)
        fields = dict(line.split(b" ") for line in head.splitlines()[1:])
        self.assertEqual(len(pixels), 4 * int(fields[b"WIDTH"]) * int(fields[b"HEIGHT"]))
        self.assertGreater(len(set(pixels)), 20)
        self.assertEqual(subprocess.run([program, self.at("no such file")], check=False).returncode, 1)

    def test_build_scripts_in_the_pages_work(self):
        built = 0
        for page in self.pages:
            for script in self.blocks(page, "cmake"):
                built += 1
                folder = tempfile.mkdtemp(dir=self.folder)
                for name, text in ("CMakeLists.txt", script), ("main.c", "\n".join(self.blocks(page, "c"))):
                    with open(os.path.join(folder, name), "w", encoding="utf-8") as file:
                        file.write(text)
                run(ARGUMENTS.cmake, "-S", folder, "-B", f"{folder}/build",
                    f"-DCMAKE_PREFIX_PATH={self.at('prefix')}", f"-DCMAKE_C_COMPILER={ARGUMENTS.cc}")
                run(ARGUMENTS.cmake, "--build", f"{folder}/build")
                if self.can_run(page):
                    run(f"{folder}/build/app", *self.arguments(page))
        self.assertGreaterEqual(built, 2)

    @unittest.skipUnless(ARGUMENTS.python, "the Python module is not built")
    def test_python_samples_run(self):
        shutil.copy(self.at("tiny.stgs"), self.at("scene.stgs"))
        module = glob.glob(self.at("prefix/**/stgs.*.so"), recursive=True)[0]
        environment = dict(os.environ, PYTHONPATH=os.path.dirname(module),
                           LD_LIBRARY_PATH=self.library, PYTHONDONTWRITEBYTECODE="1")
        program = "\n".join(self.blocks("python.md", "python"))
        output = run(ARGUMENTS.python, "-c", program, cwd=self.folder, env=environment)
        self.assertIn("fixture", output)
        self.assertIn("STGS_ERROR_IO", output)

    def test_every_block_is_of_a_tested_kind(self):
        for page, text in self.pages.items():
            kinds = {kind for kind, _ in BLOCK.findall(text)}
            self.assertEqual(text.count("\n```"), 2 * len(BLOCK.findall(text)), page)
            # test_packages.py runs the sh blocks of README.md, test_install.py that of embedding.md.
            # The tests of the program run those of the guide.
            also = {"README.md": {"sh"}, "embedding.md": {"sh"}, "python.md": {"python"},
                    "live.md": {"sh", "json"}}.get(page, set())
            self.assertLessEqual(kinds, {"c", "cpp", "cmake"} | also)

    def test_named_declarations_exist(self):
        headers = "".join(read(path) for path in glob.glob(self.at("prefix/include/stgs/*.h")))
        declared = set(re.findall(r"\bstgs_\w+|\bSTGS_\w+", headers))
        options = read(os.path.join(ARGUMENTS.source, "cmake/options.cmake"))
        declared |= set(re.findall(r"^option\((STGS_\w+)", options, re.MULTILINE))
        declared |= {f"STGS_WITH_{name}" for name in
                     re.findall(r"^stgs_option\((\w+)", options, re.MULTILINE)}
        for page, text in self.pages.items():
            # Excludes blocks, which are compiled, and names of the Unity plugin.
            prose = BLOCK.sub("", text)
            for name in re.findall(r"`(stgs_(?!unity)\w+|STGS_\w+)\b", prose):
                self.assertTrue(name in declared or os.path.exists(
                    self.at(f"prefix/include/stgs/{name}.h")), f"{page} names {name}")

    def test_structs_without_a_size_are_listed(self):
        headers = "".join(read(path) for path in glob.glob(self.at("prefix/include/stgs/*.h")))
        bodies = re.findall(r"^typedef struct (\w+) \{(.*?)^\} \1;", headers, re.DOTALL | re.MULTILINE)
        self.assertGreater(len(bodies), 20)
        sentence = re.search(r"carry no size: (.*?), which", self.pages["formats-and-errors.md"],
                             re.DOTALL).group(1)
        self.assertEqual({name for name, body in bodies if "size_t struct_size;" not in body},
                         set(re.findall(r"`(\w+)`", sentence)))


if __name__ == "__main__":
    unittest.main(argv=["test_docs.py"])
