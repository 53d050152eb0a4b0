# SPDX-License-Identifier: Apache-2.0
"""The same input, settings and seed give the same bytes, with any number of threads."""
import unittest

from harness import CliTest


class Determinism(CliTest):
    def train(self, output, *more):
        self.succeeds("train", self.fixture("prepared"), "-o", output, "--preset", "fast", "--backend",
                      "cpu", "--iterations", "60", "--max-primitives", "300", "--num-evals", "0", *more)
        return self.read(output)

    def pack(self, output, *more):
        self.succeeds("pack", self.fixture("steady.stgs"), "-o", output, *more)
        return self.read(output)

    def test_training_is_byte_identical(self):
        first = self.train("a.stgs", "--threads", "1")
        self.assertEqual(self.train("b.stgs", "--threads", "1"), first)
        self.assertEqual(self.train("c.stgs", "--threads", "2"), first)
        self.assertNotEqual(self.train("d.stgs", "--seed", "2"), first)

    def test_packing_is_byte_identical(self):
        first = self.pack("a.stgs", "--threads", "1")
        self.assertEqual(self.pack("b.stgs", "--threads", "1"), first)
        self.assertEqual(self.pack("c.stgs", "--threads", "2"), first)
        self.assertNotEqual(self.pack("d.stgs", "--quality", "60"), first)


if __name__ == "__main__":
    unittest.main()
