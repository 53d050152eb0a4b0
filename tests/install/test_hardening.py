#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The built program, libraries and modules are hardened, and export the documented symbols alone."""
import argparse
import os
import re
import subprocess
import sys
import unittest

from hardening import ElfFile, ENDBR64, readelf

ARGUMENTS = None
# Bindings: they call no function of libc with a buffer whose size the compiler knows.
NO_CHECKED_CALLS = ("stgs.cpython", "libstgs_unity")
EXPORTS = re.compile(r"stgs_\w+|STGS_(ENCODER_)?0|PyInit_stgs|Unity\w+")


def base(path):
    return os.path.basename(path)


class Hardening(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.files = [ElfFile(ARGUMENTS.readelf, path) for path in ARGUMENTS.files]
        cls.libraries = [file for file in cls.files if ".so" in base(file.path)]

    def test_relocations_stack_and_segments(self):
        for file in self.files:
            with self.subTest(file=base(file.path)):
                self.assertEqual(file.link_problems(), [])

    def test_the_stack_protector_is_compiled_in(self):
        for file in self.files:
            with self.subTest(file=base(file.path)):
                self.assertTrue(file.has_stack_protector())

    def test_calls_of_libc_are_checked(self):
        if not ARGUMENTS.fortify:
            self.skipTest("not an optimised build")
        for file in self.files:
            with self.subTest(file=base(file.path)):
                if not base(file.path).startswith(NO_CHECKED_CALLS):
                    self.assertNotEqual(file.fortified(), [])

    def test_libraries_export_the_documented_symbols_alone(self):
        for file in self.libraries:
            with self.subTest(file=base(file.path)):
                self.assertNotEqual(file.exports, {})
                foreign = [name for name in file.exports if not EXPORTS.fullmatch(name)]
                self.assertEqual(foreign, [])

    def test_indirect_branches_are_marked(self):
        """Each exported function can be called indirectly with CET. Whether the loader enables it
        is the decision of the linker: it drops the property if a single linked object lacks it,
        such as the start files of the C library or a static library. The test reports those."""
        if not ARGUMENTS.cet:
            self.skipTest("the compiler has no -fcf-protection")
        for file in self.libraries:
            with self.subTest(file=base(file.path)):
                self.assertEqual(file.unmarked_exports(), [])
        start = subprocess.run([ARGUMENTS.cxx, "-print-file-name=crti.o"], capture_output=True,
                               text=True, check=True).stdout.strip()
        marked_start = "IBT" in readelf(ARGUMENTS.readelf, start, "-n")
        for file in self.files:
            with self.subTest(file=base(file.path)):
                self.assertGreater(file.bytes.count(ENDBR64), 10)
                if not file.has_branch_property():
                    reason = "a static library" if marked_start else "crti.o of the C library"
                    print(f"{base(file.path)}: no IBT and SHSTK property, because of {reason}")
                    self.assertTrue(not marked_start or ARGUMENTS.unmarked_libraries)


def main():
    global ARGUMENTS
    parser = argparse.ArgumentParser()
    parser.add_argument("--readelf", required=True)
    parser.add_argument("--cxx", required=True)
    parser.add_argument("--fortify", action="store_true", help="an optimised build")
    parser.add_argument("--cet", action="store_true", help="compiled with -fcf-protection")
    parser.add_argument("--unmarked-libraries", action="store_true",
                        help="static libraries without the CET property are linked (cudart)")
    parser.add_argument("--files", nargs="+", required=True)
    ARGUMENTS = parser.parse_args()
    unittest.main(argv=[sys.argv[0]])


if __name__ == "__main__":
    main()
