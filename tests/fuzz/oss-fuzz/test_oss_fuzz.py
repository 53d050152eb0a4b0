#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks the files for OSS-Fuzz.

usage: test_oss_fuzz.py                          options, dictionaries and project.yaml fit the targets
       test_oss_fuzz.py --build [TARGET...]      also runs build.sh with clang, libFuzzer, the sanitizers of OSS-Fuzz
                                                 and the libraries of this system, and starts each program
exit code 0: passed; 1: failed; 77: --build without clang or zip
"""
import configparser
import glob
import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest
import zipfile

import make_dictionaries

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(os.path.dirname(os.path.dirname(HERE)))
ENTRY = re.compile(r'(\w+=)?"((?:[^"\\\x00-\x1f\x7f-\xff]|\\["\\]|\\x[0-9a-fA-F]{2})+)"')
# Undefined behaviour as OSS-Fuzz configures it, at the same time as address.
UNDEFINED = ("bool,array-bounds,float-divide-by-zero,function,integer-divide-by-zero,return,shift,"
             "signed-integer-overflow,vla-bound,vptr")
BUILD = "--build" in sys.argv


def read(name):
    with open(os.path.join(HERE, name), encoding="utf-8") as file:
        return file.read()


def targets():
    with open(os.path.join(HERE, "..", "CMakeLists.txt"), encoding="utf-8") as file:
        return set(re.findall(r"(?m)^ *stgs_fuzz_target\((\w+)", file.read()))


def options(name):
    parser = configparser.ConfigParser()
    parser.read_string(read(f"fuzz_{name}.options"))
    return parser


class Files(unittest.TestCase):
    def test_every_target_has_options(self):
        found = {os.path.basename(path)[5:-8] for path in glob.glob(os.path.join(HERE, "fuzz_*.options"))}
        self.assertEqual(found, targets())

    def test_options_limit_each_input(self):
        for name in targets():
            with self.subTest(name):
                parsed = options(name)
                self.assertEqual(parsed.sections(), ["libfuzzer"])
                limits = dict(parsed["libfuzzer"])
                dictionary = limits.pop("dict", None)
                self.assertEqual(set(limits), {"max_len", "timeout", "rss_limit_mb", "malloc_limit_mb"})
                self.assertTrue(all(int(value) > 0 for value in limits.values()))
                if dictionary is not None:
                    self.assertTrue(os.path.exists(os.path.join(HERE, dictionary)), dictionary)

    def test_every_dictionary_is_used(self):
        used = {options(name)["libfuzzer"].get("dict") for name in targets()} - {None}
        self.assertEqual(used, {os.path.basename(path) for path in glob.glob(os.path.join(HERE, "*.dict"))})

    def test_dictionaries_parse(self):
        for path in glob.glob(os.path.join(HERE, "*.dict")):
            lines = [line for line in read(os.path.basename(path)).splitlines() if not line.startswith("#")]
            self.assertGreater(len(lines), 5)
            self.assertEqual(len(lines), len(set(lines)))
            for line in lines:
                self.assertTrue(ENTRY.fullmatch(line), f"{path}: {line}")

    def test_dictionaries_match_the_sources(self):
        for name, text in make_dictionaries.texts().items():
            self.assertEqual(read(name), text, f"{name}: run make_dictionaries.py")

    def test_project_builds_what_build_sh_supports(self):
        project = re.sub(r"(?m)^#.*\n", "", read("project.yaml"))
        lists = dict(re.findall(r"(?m)^(\w+):\n((?:  - \w+\n)+)", project))
        names = {key: set(re.findall(r"- (\w+)", value)) for key, value in lists.items()}
        self.assertEqual(names["fuzzing_engines"], {"libfuzzer", "afl", "honggfuzz"})
        self.assertLessEqual(names["sanitizers"], {"address", "undefined", "memory"})
        image = re.search(r"(?m)^FROM gcr\.io/oss-fuzz-base/base-builder:(\S+)$", read("Dockerfile")).group(1)
        self.assertEqual(re.search(r"(?m)^base_os_version: (\S+)$", project).group(1), image)

    def test_libraries_are_pinned_and_built(self):
        fetched = re.findall(r"(?m)^ +https://github\.com/[\w-]+/([\w-]+):(\S+?)(?:; do)? \\$", read("Dockerfile"))
        self.assertGreaterEqual(len(fetched), 9)
        for name, version in fetched:
            self.assertRegex(version, r"\d+\.\d+")
            self.assertRegex(read("build.sh"), rf"build_library {name}[/ ]|\$SRC/{name}\"")

    def test_scripts_have_valid_syntax(self):
        subprocess.run(["bash", "-n", os.path.join(HERE, "build.sh")], check=True)


@unittest.skipUnless(BUILD, "without --build")
class Build(unittest.TestCase):
    def test_programs_run(self):
        with tempfile.TemporaryDirectory() as folder:
            out = os.path.join(folder, "out")
            os.symlink(ROOT, os.path.join(folder, "stgs"))
            flags = (f"-O1 -fno-omit-frame-pointer -gline-tables-only -fsanitize=address,{UNDEFINED} "
                     f"-fno-sanitize-recover={UNDEFINED} -fsanitize=fuzzer-no-link "
                     "-DFUZZING_BUILD_MODE_UNSAFE_FOR_PRODUCTION")
            environment = dict(os.environ, CC="clang", CXX="clang++", CFLAGS=flags, CXXFLAGS=flags, SRC=folder,
                               OUT=out, LIB_FUZZING_ENGINE="-fsanitize=fuzzer", STGS_SYSTEM_LIBRARIES="1",
                               STGS_TARGETS=" ".join(TARGETS), WORK=os.path.join(folder, "work"))
            subprocess.run([os.path.join(HERE, "build.sh")], check=True, env=environment)
            # Those of this configuration, as CMake lists them.
            with open(os.path.join(folder, "work", "stgs", "tests", "fuzz", "targets.txt"), encoding="utf-8") as file:
                built = [line.split(";")[0].strip() for line in file]
            self.assertGreater(len(built), 10)
            for name in TARGETS or built:
                with self.subTest(name):
                    self.start(out, name, os.path.join(folder, "corpus", name))

    def start(self, out, name, corpus):
        """Runs a program for a second on its seed corpus, with its options."""
        with zipfile.ZipFile(os.path.join(out, f"fuzz_{name}_seed_corpus.zip")) as seeds:
            self.assertGreater(len(seeds.namelist()), 0)
            seeds.extractall(corpus)
        arguments = []
        for key, value in options(name)["libfuzzer"].items():
            arguments.append(f"-{key}={os.path.join(out, value) if key == 'dict' else value}")
        subprocess.run([os.path.join(out, f"fuzz_{name}"), "-max_total_time=1", *arguments, corpus], check=True,
                       cwd=corpus, timeout=1200,
                       env=dict(os.environ, ASAN_OPTIONS="allocator_may_return_null=1:detect_leaks=0"))


TARGETS = [argument for argument in sys.argv[1:] if argument != "--build"]

if __name__ == "__main__":
    if BUILD and not (shutil.which("clang++") and shutil.which("zip")):
        print("clang++ or zip not found")
        sys.exit(77)
    unittest.main(argv=sys.argv[:1])
