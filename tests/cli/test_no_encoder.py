#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""In a build without the encoder its verbs answer with exit code 6, whatever their arguments.

usage: test_no_encoder.py STGS
"""
import subprocess
import sys
import unittest

PROGRAM = sys.argv.pop(1)


class NoEncoder(unittest.TestCase):
    def run_verb(self, *arguments):
        return subprocess.run([PROGRAM, *arguments], capture_output=True, text=True, check=False)

    def test_the_verbs_are_not_built(self):
        for verb in "prepare", "train", "pack", "encode":
            for arguments in [], ["capture", "-o", "scene.stgs", "--preset", "fast"]:
                with self.subTest(verb=verb, arguments=arguments):
                    done = self.run_verb(verb, *arguments)
                    self.assertEqual(done.returncode, 6, done.stderr)
                    self.assertIn(f"'{verb}' is not part of this build", done.stderr)
                    self.assertIn("STGS_WITH_ENCODER", done.stderr)

    def test_the_list_of_verbs_names_them(self):
        self.assertIn("not in this build", self.run_verb("--help").stdout)


if __name__ == "__main__":
    unittest.main()
