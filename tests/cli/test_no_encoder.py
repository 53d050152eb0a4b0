#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""In a build without the encoder, its verbs exit with code 6 for any arguments.

usage: test_no_encoder.py STGS
"""
import subprocess
import sys
import unittest

PROGRAM = sys.argv.pop(1)


class NoEncoder(unittest.TestCase):
    def run_verb(self, *arguments):
        return subprocess.run([PROGRAM, *arguments], capture_output=True, text=True, check=False)

    def test_encoder_verbs_exit_with_code_6(self):
        for verb in "prepare", "train", "pack", "encode", "live":
            for arguments in [], ["capture", "-o", "scene.stgs", "--preset", "fast"]:
                with self.subTest(verb=verb, arguments=arguments):
                    done = self.run_verb(verb, *arguments)
                    self.assertEqual(done.returncode, 6, done.stderr)
                    self.assertIn(f"'{verb}' is not part of this build", done.stderr)
                    self.assertIn("STGS_WITH_ENCODER", done.stderr)

    def test_help_marks_encoder_verbs_as_not_built(self):
        self.assertIn("not in this build", self.run_verb("--help").stdout)


if __name__ == "__main__":
    unittest.main()
