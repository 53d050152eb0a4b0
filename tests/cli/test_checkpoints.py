# SPDX-License-Identifier: Apache-2.0
"""Checkpoints: what becomes of a training whose own cannot be written, and where one goes on."""
import resource
import unittest

from harness import CliTest


class FullDisk(CliTest):
    """A limit on the size of files acts as a full disk does, for any user."""

    def limited(self, *more):
        def limit():
            # The scene of the fixture fits, and its checkpoint, four times as large, does not.
            resource.setrlimit(resource.RLIMIT_FSIZE, (65536, 65536))
        args = ["train", self.fixture("prepared"), "--preset", "fast", "--max-primitives", "300",
                "--iterations", "40", "--log-level", "warning", *more]
        return self.stgs(*args, preexec_fn=limit)

    def test_a_checkpoint_that_cannot_be_written_costs_no_scene(self):
        result = self.limited("-o", "a.stgs", "--checkpoint", "run.ckpt", "--checkpoint-interval", "10")
        self.assertEqual(result.returncode, 0, result.stderr)
        warnings = [line for line in result.stderr.decode().splitlines() if "warning" in line]
        self.assertEqual(len(warnings), 2, warnings)  # the first, and that of the end
        for line, begin in zip(warnings, ("10: training goes on", "40: training is done")):
            self.assertRegex(line, f"iteration {begin}, .*not written: run.ckpt: cannot write")
        self.no_leftovers()
        self.succeeds("train", self.fixture("prepared"), "--preset", "fast", "--max-primitives",
                      "300", "--iterations", "40", "-o", "b.stgs")
        self.assertEqual(self.read("a.stgs"), self.read("b.stgs"))

    def test_nor_of_a_window(self):
        result = self.limited("-o", "parts", "--window", "6")
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn(b"000000-000006.stgs.ckpt: cannot write", result.stderr)
        self.json_of("validate", "parts/000000-000006.stgs")


if __name__ == "__main__":
    unittest.main()
