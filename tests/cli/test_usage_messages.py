# SPDX-License-Identifier: Apache-2.0
"""Messages for wrong command lines name the argument and the accepted values."""
import json
import unittest

from harness import CliTest

USAGE, INVALID, DIFFERS = 1, 3, 7


class UsageMessages(CliTest):
    def test_missing_arguments_show_the_usage(self):
        tiny = self.fixture("tiny.stgs")
        self.fails(USAGE, r"FILE is required; usage: stgs render FILE -o OUTPUT \(see 'stgs render "
                          r"--help'\)$", "render", "--time", "0", "-o", "x.png")
        self.fails(USAGE, r"--output is required; usage: stgs pack SCENE -o OUTPUT", "pack",
                   tiny, "x.stgs")
        self.fails(USAGE, "DIR, the prepared capture, is required; usage: stgs train DIR -o OUTPUT",
                   "train", "-o", "x.stgs")
        self.fails(USAGE, "--size needs a value", "render", tiny, "--time", "0", "-o", "null",
                   "--size")

    def test_unexpected_arguments_are_named(self):
        tiny = self.fixture("tiny.stgs")
        self.fails(USAGE, "unexpected argument 'x'; usage: stgs finalize FILE -o OUTPUT", "finalize",
                   tiny, "x", "-o", "out.stgs")
        self.fails(USAGE, "unknown option '--frams'; did you mean '--frames'", "render", "x", tiny,
                   "--frams")
        self.fails(USAGE, "unknown option '--bogus'", "--bogus")

    def test_choices_are_listed(self):
        self.fails(USAGE, "--preset: 'quick' is not one of fast, default, best", "train", "x", "-o",
                   "y.stgs", "--preset", "quick")
        self.fails(USAGE, "--format: 'jsn' is not one of text, json; did you mean 'json'", "info",
                   self.fixture("tiny.stgs"), "--format", "jsn")

    def test_numbers_that_are_not_integers_are_explained(self):
        train = ["train", self.fixture("prepared"), "-o", "x.stgs", "--iterations"]
        self.fails(USAGE, "--iterations: '1e3' is not an integer; write 1000", *train, "1e3")
        self.fails(USAGE, r"--iterations: '2\.5' is not an integer \(", *train, "2.5")

    def test_empty_values_are_rejected(self):
        self.fails(USAGE, "FILE is empty", "info", "")
        self.fails(USAGE, "--output is empty", "pack", self.fixture("tiny.stgs"), "-o", "")


class OtherMessages(CliTest):
    def test_counts_agree_with_their_nouns(self):
        tiny = self.fixture("tiny.stgs")
        text = self.succeeds("render", tiny, "--time", "0", "-o", "null").stdout.decode()
        self.assertIn("null: 1 image, ", text)
        text = self.succeeds("render", tiny, "--frames", "0:2", "-o", "null").stdout.decode()
        self.assertIn("null: 2 images, ", text)
        self.fails(INVALID, r"huge_bytes.stgs: (1 error|\d+ errors)$", "validate",
                   self.fixture("huge_bytes.stgs"))

    def test_validate_states_each_problem_once(self):
        files = [self.fixture("huge_bytes.stgs"), "none.stgs", self.fixture("tiny.stgs")]
        result = self.stgs("validate", *files)
        self.assertEqual(result.returncode, INVALID)
        out, errors = result.stdout.decode(), result.stderr.decode()
        self.assertRegex(out, r"huge_bytes.stgs: error: .* \(byte \d+, issue \d+\)\n")
        self.assertIn("tiny.stgs: valid\n", out)
        self.assertNotIn("none.stgs", out)
        self.assertEqual(errors.count("none.stgs: cannot open"), 1)
        self.assertNotIn("issue", errors)

    def test_compare_states_the_difference(self):
        self.fails(DIFFERS, r"the scenes differ in duration: \S*tiny.stgs lasts 0\.2 s, \S+ lasts "
                            r"0\.4 s", "compare", self.fixture("tiny.stgs"),
                   self.fixture("longer.stgs"))

    def test_camera_file_errors_name_the_field(self):
        render = ["render", self.fixture("tiny.stgs"), "--time", "0", "-o", "null", "--camera"]
        self.fails(INVALID, "a.json: .*line 1, column 2", *render, self.write("a.json", "{"))
        self.fails(INVALID, "b.json: .*width", *render, self.write("b.json", json.dumps({"fx": 1})))


if __name__ == "__main__":
    unittest.main()
