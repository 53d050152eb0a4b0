#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares the ABIs of the C headers with the baselines sdk/stgs.abi and sdk/stgs_encoder.abi.

usage: test_abi.py SDK CC ABIDW ABIDIFF [--update]

The comparison uses a library of empty functions compiled from the headers, so that opaque types stay
opaque. The compiler checks the real library against the same declarations, and test_exports.py
against the same symbols. Functions and constants may be added. Any other change fails; if it is
intended, `--update` (the build target stgs_abi_baseline) writes a new baseline. This includes a
struct that grows at its end: make sure that the library accepts the old size as well.
"""
import argparse
import os
import re
import subprocess
import sys
import tempfile
import unittest

from outside import LIBRARIES, headers_of

ARGUMENTS = None


def read(*parts):
    with open(os.path.join(*parts), encoding="utf-8") as file:
        return file.read()


def write(text, *parts):
    with open(os.path.join(*parts), "w", encoding="utf-8") as file:
        file.write(text)


def headers():
    """Returns the text of each header without comments, by library and file name."""
    folder = os.path.join(ARGUMENTS.sdk, "include/stgs")
    return {library: {os.path.basename(path): re.sub(r" */\*.*?\*/", "", read(path), flags=re.DOTALL)
                      for path in headers_of(library, folder)} for library in LIBRARIES}


def constants(text):
    """Returns the names of enumerators and numeric macros, except versions, which may change."""
    names = re.findall(r"\b(STGS_[A-Z0-9_]+) *=", text)
    names += re.findall(r"^#define (STGS_[A-Z0-9_]+) +(?:U?INT64_MAX|\d+)$", text, re.MULTILINE)
    return [name for name in names if not name.startswith("STGS_VERSION_")]


def build(name, folder, texts, symbol_map):
    """Compiles a library with the functions of the headers and one function per constant. Each
    constant has an enum of its own, because abidiff treats an enumerator as unchanged if any
    enumerator of its enum has the value."""
    os.makedirs(os.path.join(folder, "stgs"))
    for of_library in texts.values():
        for file, text in of_library.items():
            write(text, folder, "stgs", file)
    every = "\n".join(texts[name].values())
    functions = re.findall(r"^STGS_API[^;{]*\)(?=;)", every, re.MULTILINE)
    source = "".join(f'#include "stgs/{file}"\n' for file in texts[name])
    source += "".join(f"{function} {{ __builtin_trap(); }}\n" for function in functions)
    source += "".join(f"enum of_{constant} {{ value_of_{constant} = {constant} }};\n"
                      f"STGS_API enum of_{constant} constant_{constant}(void) "
                      "{ __builtin_trap(); }\n" for constant in constants(every))
    write(source, folder, "interface.c")
    write(symbol_map.replace("global:", "global: constant_*;", 1), folder, "interface.map")
    built = os.path.join(folder, f"lib{name}.so")
    # Compile within the folder, so that the baseline does not contain its name.
    subprocess.run([ARGUMENTS.cc, "-g", "-O0", "-fPIC", "-shared", "-w", "-I.", "interface.c",
                    "-Wl,--version-script=interface.map", f"-Wl,-soname,lib{name}.so.0", "-o", built],
                   check=True, cwd=folder)
    return built


def compare(name, texts, symbol_map):
    """Returns whether the ABI is compatible with the baseline, and abidiff's output."""
    with tempfile.TemporaryDirectory() as folder:
        result = subprocess.run([ARGUMENTS.abidiff, "--no-added-syms", "--no-architecture",
                                 os.path.join(ARGUMENTS.sdk, f"{name}.abi"),
                                 build(name, folder, texts, symbol_map)],
                                capture_output=True, text=True, check=False)
        return result.returncode == 0, result.stdout + result.stderr


def map_of(name):
    return read(ARGUMENTS.sdk, f"{name}.map")


def update():
    for name in LIBRARIES:
        with tempfile.TemporaryDirectory() as folder:
            subprocess.run([ARGUMENTS.abidw, "--no-corpus-path", "--no-comp-dir-path",
                            "--no-show-locs", "--no-architecture", "--type-id-style", "hash",
                            "--no-parameter-names", "--out-file",
                            os.path.join(ARGUMENTS.sdk, f"{name}.abi"),
                            build(name, folder, headers(), map_of(name))], check=True)


class Abi(unittest.TestCase):
    def setUp(self):
        self.texts, self.map = headers(), map_of("stgs")

    def change(self, old, new):
        texts = self.texts["stgs"]
        self.assertEqual(texts["stgs.h"].count(old), 1, old)
        texts["stgs.h"] = texts["stgs.h"].replace(old, new)

    def test_the_headers_match_the_baseline(self):
        for name in LIBRARIES:
            with self.subTest(name):
                compatible, output = compare(name, self.texts, map_of(name))
                self.assertTrue(compatible, f"{output}\nif this is intended, build the target "
                                "stgs_abi_baseline")

    def test_incompatible_changes_of_the_encoder_are_detected(self):
        texts = self.texts["stgs_encoder"]
        texts["stgs_encoder.h"] = texts["stgs_encoder.h"].replace("double quality;",
                                                                  "float quality;", 1)
        compatible, output = compare("stgs_encoder", self.texts, map_of("stgs_encoder"))
        self.assertFalse(compatible, output)

    def test_functions_and_constants_may_be_added(self):
        self.change("STGS_API uint32_t stgs_version(void);",
                    "STGS_API uint32_t stgs_version(void);\nSTGS_API uint32_t stgs_added(int x);")
        self.change("STGS_BACKEND_VULKAN = 3", "STGS_BACKEND_VULKAN = 3, STGS_BACKEND_ADDED = 4")
        self.map = self.map.replace("stgs_version;", "stgs_version; stgs_added;")
        compatible, output = compare("stgs", self.texts, self.map)
        self.assertTrue(compatible, output)

    def test_incompatible_changes_are_detected(self):
        breaks = {
            "a function is removed": ("STGS_API uint32_t stgs_version(void);", ""),
            "a parameter has another type": ("stgs_view* view, uint32_t width",
                                             "stgs_view* view, uint64_t width"),
            "a field has another type": ("float near_plane;", "double near_plane;"),
            "fields are swapped": ("uint64_t max_file_bytes;\n  uint64_t max_primitives;",
                                   "uint64_t max_primitives;\n  uint64_t max_file_bytes;"),
            "a constant has another value": ("STGS_BACKEND_VULKAN = 3", "STGS_BACKEND_VULKAN = 2"),
            "a limit has another value": ("STGS_MAX_VIEWS 4", "STGS_MAX_VIEWS 2"),
        }
        for change, (old, new) in breaks.items():
            with self.subTest(change):
                self.setUp()
                self.change(old, new)
                symbols = self.map if new else self.map.replace("stgs_version;", "")
                compatible, output = compare("stgs", self.texts, symbols)
                self.assertFalse(compatible, output)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    for argument in ("sdk", "cc", "abidw", "abidiff"):
        parser.add_argument(argument)
    parser.add_argument("--update", action="store_true")
    ARGUMENTS, rest = parser.parse_known_args()
    if ARGUMENTS.update:
        sys.exit(update())
    unittest.main(argv=["test_abi.py", *rest])
