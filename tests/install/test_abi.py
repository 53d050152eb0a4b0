#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Holds the binary interface of the C headers against the committed one, sdk/stgs.abi.

usage: test_abi.py SDK CC ABIDW ABIDIFF [--update]

What is compared is a library of empty functions that is compiled from the headers: the compiler
holds the real one to the same declarations, test_exports.py to the same symbols, and types that the
headers leave opaque stay so. Functions and constants may be added. All else fails, and where it is
meant, `--update` (the build's target stgs_abi_baseline) writes the new baseline. A struct that grows
at its end is such a case: see that the library takes the old size too.
"""
import argparse
import glob
import os
import re
import subprocess
import sys
import tempfile
import unittest

ARGUMENTS = None
BASELINE = "stgs.abi"


def read(*parts):
    with open(os.path.join(*parts), encoding="utf-8") as file:
        return file.read()


def write(text, *parts):
    with open(os.path.join(*parts), "w", encoding="utf-8") as file:
        file.write(text)


def headers():
    """What is declared: text by name, without comments."""
    return {os.path.basename(path): re.sub(r" */\*.*?\*/", "", read(path), flags=re.DOTALL)
            for path in sorted(glob.glob(os.path.join(ARGUMENTS.sdk, "include/stgs/*.h")))}


def constants(text):
    """Names of enumerators and of macros that are numbers; a version is meant to change."""
    names = re.findall(r"\b(STGS_[A-Z0-9_]+) *=", text)
    names += re.findall(r"^#define (STGS_[A-Z0-9_]+) +(?:U?INT64_MAX|\d+)$", text, re.MULTILINE)
    return [name for name in names if not name.startswith("STGS_VERSION_")]


def library(folder, texts, symbol_map):
    """Compiles a library of the headers' functions, and of one more for each constant: abidiff takes
    an enumerator for unchanged if any of its enum has the value, so each has an enum of its own."""
    os.makedirs(os.path.join(folder, "stgs"))
    for name, text in texts.items():
        write(text, folder, "stgs", name)
    every = "\n".join(texts.values())
    functions = re.findall(r"^STGS_API[^;{]*\)(?=;)", every, re.MULTILINE)
    source = "".join(f'#include "stgs/{name}"\n' for name in texts)
    source += "".join(f"{function} {{ __builtin_trap(); }}\n" for function in functions)
    source += "".join(f"enum of_{name} {{ value_of_{name} = {name} }};\n"
                      f"STGS_API enum of_{name} constant_{name}(void) {{ __builtin_trap(); }}\n"
                      for name in constants(every))
    write(source, folder, "stub.c")
    write(symbol_map.replace("global:", "global: constant_*;", 1), folder, "stub.map")
    built = os.path.join(folder, "libstgs.so")
    # From within the folder, whose name the baseline would tell else.
    subprocess.run([ARGUMENTS.cc, "-g", "-O0", "-fPIC", "-shared", "-w", "-I.", "stub.c",
                    "-Wl,--version-script=stub.map", "-Wl,-soname,libstgs.so.0", "-o", built],
                   check=True, cwd=folder)
    return built


def compare(texts, symbol_map):
    """Whether programs that were built with the baseline still run; and what abidiff says."""
    with tempfile.TemporaryDirectory() as folder:
        told = subprocess.run([ARGUMENTS.abidiff, "--no-added-syms", "--no-architecture",
                               os.path.join(ARGUMENTS.sdk, BASELINE),
                               library(folder, texts, symbol_map)],
                              capture_output=True, text=True, check=False)
        return told.returncode == 0, told.stdout + told.stderr


def update():
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([ARGUMENTS.abidw, "--no-corpus-path", "--no-comp-dir-path", "--no-show-locs",
                        "--no-architecture", "--type-id-style", "hash", "--no-parameter-names",
                        "--out-file", os.path.join(ARGUMENTS.sdk, BASELINE),
                        library(folder, headers(), read(ARGUMENTS.sdk, "stgs.map"))], check=True)


class Abi(unittest.TestCase):
    def setUp(self):
        self.texts, self.map = headers(), read(ARGUMENTS.sdk, "stgs.map")

    def change(self, old, new):
        self.assertEqual(self.texts["stgs.h"].count(old), 1, old)
        self.texts["stgs.h"] = self.texts["stgs.h"].replace(old, new)

    def test_the_headers_keep_to_the_baseline(self):
        kept, told = compare(self.texts, self.map)
        self.assertTrue(kept, f"{told}\nwhere this is meant: build the target stgs_abi_baseline")

    def test_functions_and_constants_may_be_added(self):
        self.change("STGS_API uint32_t stgs_version(void);",
                    "STGS_API uint32_t stgs_version(void);\nSTGS_API uint32_t stgs_added(int x);")
        self.change("STGS_BACKEND_VULKAN = 3", "STGS_BACKEND_VULKAN = 3, STGS_BACKEND_ADDED = 4")
        self.map = self.map.replace("stgs_version;", "stgs_version; stgs_added;")
        kept, told = compare(self.texts, self.map)
        self.assertTrue(kept, told)

    def test_what_breaks_programs_is_found(self):
        breaks = {
            "a function is gone": ("STGS_API uint32_t stgs_version(void);", ""),
            "a parameter is of another type": ("stgs_view* view, uint32_t width",
                                               "stgs_view* view, uint64_t width"),
            "a field is of another type": ("float near_plane;", "double near_plane;"),
            "fields have changed places": ("uint64_t max_file_bytes;\n  uint64_t max_primitives;",
                                           "uint64_t max_primitives;\n  uint64_t max_file_bytes;"),
            "a constant has another value": ("STGS_BACKEND_VULKAN = 3", "STGS_BACKEND_VULKAN = 2"),
            "a limit has another value": ("STGS_MAX_VIEWS 4", "STGS_MAX_VIEWS 2"),
        }
        for what, (old, new) in breaks.items():
            with self.subTest(what):
                self.setUp()
                self.change(old, new)
                symbols = self.map if new else self.map.replace("stgs_version;", "")
                kept, told = compare(self.texts, symbols)
                self.assertFalse(kept, told)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    for argument in ("sdk", "cc", "abidw", "abidiff"):
        parser.add_argument(argument)
    parser.add_argument("--update", action="store_true")
    ARGUMENTS, rest = parser.parse_known_args()
    if ARGUMENTS.update:
        sys.exit(update())
    unittest.main(argv=["test_abi.py", *rest])
