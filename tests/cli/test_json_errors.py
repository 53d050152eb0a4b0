# SPDX-License-Identifier: Apache-2.0
"""With --format json, errors are JSON objects on standard error; progress lines have percentages."""
import json
import os
import unittest

from harness import CliTest

USAGE, IO, INVALID, DIFFERS = 1, 2, 3, 7


class JsonErrors(CliTest):
    def error(self, code, *args):
        result = self.stgs(*args, "--format", "json")
        self.assertEqual(result.returncode, code, result.stderr)
        lines = result.stderr.decode().splitlines()
        self.assertEqual(len(lines), 1, lines)
        value = json.loads(lines[0])
        self.check_schema("error", value)
        self.assertEqual(value["error"]["exit_code"], code)
        return value["error"]

    def test_a_foreign_file_has_its_issue_and_offset(self):
        self.write("a.png", b"\x89PNG\r\n\x1a\n" + bytes(100))
        error = self.error(INVALID, "info", "a.png")
        self.assertEqual({key: error[key] for key in ("code", "path", "issue", "offset")},
                         {"code": "invalid_file", "path": "a.png", "issue": 102, "offset": 0})
        self.assertRegex(error["message"], "^a.png: not an .stgs file; this is a PNG image")

    def test_a_message_that_quotes_a_long_token_has_no_place(self):
        for digits in 1, 100000:
            self.write("camera.json", '{"a":"(byte ' + digits * "1")
            error = self.error(INVALID, "render", self.fixture("tiny.stgs"), "--time", "0",
                               "--camera", "camera.json", "-o", "null")
            self.assertEqual((error["issue"], error["offset"]), (None, None))

    def test_damage_has_its_issue_and_offset(self):
        error = self.error(INVALID, "validate", self.fixture("wrong_sum.stgs"))
        self.assertEqual(error["path"], self.fixture("wrong_sum.stgs"))
        self.assertGreater(error["issue"], 100)
        self.assertIsInstance(error["offset"], int)

    def test_errors_state_the_path(self):
        self.assertEqual(self.error(IO, "info", "none.stgs")["path"], "none.stgs")
        os.mkdir(self.path("empty"))
        error = self.error(INVALID, "evaluate", self.fixture("tiny.stgs"), "--against", "empty")
        self.assertEqual(error["code"], "invalid_file")
        self.assertTrue(error["path"].startswith("empty"), error)

    def test_usage_errors_have_no_path(self):
        error = self.error(USAGE, "render", self.fixture("tiny.stgs"), "--tme", "0")
        self.assertEqual((error["code"], error["path"], error["issue"]), ("usage", None, None))
        self.assertIn("did you mean '--time'", error["message"])
        self.assertEqual(self.error(USAGE, "rendr")["code"], "usage")
        result = self.stgs("info", "--format=json")
        self.assertIn("FILE is required", json.loads(result.stderr)["error"]["message"])

    def test_results_are_printed_despite_an_error(self):
        result = self.stgs("compare", self.fixture("tiny.stgs"), self.fixture("packed.stgs"),
                           "--min-psnr", "99", "--format", "json")
        self.assertEqual(result.returncode, DIFFERS)
        self.check_schema("compare", json.loads(result.stdout))
        self.assertEqual(json.loads(result.stderr)["error"]["code"], "differs")

    def test_each_unreadable_file_has_its_error(self):
        result = self.stgs("info", "a.stgs", "b.stgs", self.fixture("tiny.stgs"), "--format", "json")
        self.assertEqual(result.returncode, IO)
        paths = [json.loads(line)["error"]["path"] for line in result.stderr.splitlines()]
        self.assertEqual(sorted(paths), ["a.stgs", "b.stgs"])

    def test_errors_are_text_without_the_option(self):
        result = self.stgs("info", "none.stgs")
        self.assertTrue(result.stderr.startswith(b"stgs: error: none.stgs: "))

    def test_progress_has_percentages(self):
        result = self.succeeds("render", self.fixture("tiny.stgs"), "--frames", "0:6", "-o", "null",
                               "--progress", "json")
        lines = [json.loads(line) for line in result.stderr.splitlines()]
        for line in lines:
            self.check_schema("progress", line)
            self.assertAlmostEqual(line["percent"], 100 * line["done"], delta=0.051)
        self.assertEqual(lines[-1]["percent"], 100)


if __name__ == "__main__":
    unittest.main()
