# SPDX-License-Identifier: Apache-2.0
"""`stgs info`: five lines per file, tables on request, several files."""
import json
import os
import unittest

from harness import CliTest

IO = 2


class Info(CliTest):
    def lines(self, *args):
        return self.succeeds("info", *args).stdout.decode().splitlines()

    def test_five_lines_come_first(self):
        tiny = self.fixture("tiny.stgs")
        size = os.path.getsize(tiny)
        kbps = 8 * size / 0.2 / 1000
        lines = self.lines(tiny)
        self.assertRegex(lines[0], rf"^{tiny}: STGS 2\.\d+, lossless, \S+ kB \({size} bytes\)$")
        self.assertRegex(lines[1], rf"^  duration +0\.200 s, 6 frames at 30 fps, {kbps:.0f} kbit/s$")
        self.assertRegex(lines[2], r"^  primitives +400, SH degree \d, \S+ bytes each$")
        self.assertRegex(lines[3], r"^  segments +\d+ in \d tiers?, head \S+ k?B, decoder level \d$")
        self.assertRegex(lines[4], r"^  start camera +64x48, positions( \S+){3} to( \S+){3}$")
        self.assertLess(len(lines), 9)
        self.assertNotIn("stream", "\n".join(lines))

    def test_missing_fields_are_shown_as_none(self):
        lines = self.lines(self.fixture("no_camera.stgs"))
        self.assertRegex(lines[4], "^  start camera +none, positions ")
        self.succeeds("convert", self.fixture("tiny.stgs"), "static.stgs", "--time", "0")
        self.assertRegex(self.lines("static.stgs")[1], r"^  duration +\S+ s, 1 frame at 30 fps$")
        self.assertIsNone(self.json_of("info", "static.stgs")["kbps"])

    def test_tables_are_printed_on_request(self):
        tiny = self.fixture("tiny.stgs")
        text = "\n".join(self.lines(tiny, "--segments"))
        self.assertEqual(self.lines(tiny, "--segments")[:5], self.lines(tiny)[:5])
        self.assertRegex(text, r"\n  decoder +level \d: peak \d+ primitives? \(")
        for head in (r"\n   number  level +tier", r"\n  layer +tier", r"\n  stream +bytes +share"):
            self.assertRegex(text, head)

    def test_several_files_are_listed_in_order(self):
        tiny, packed = self.fixture("tiny.stgs"), self.fixture("packed.stgs")
        blocks = self.succeeds("info", tiny, packed).stdout.decode().split("\n\n")
        self.assertEqual([block.split(":")[0] for block in blocks], [tiny, packed])
        both = self.json_of("info", tiny, packed)["files"]
        self.assertEqual(both, [self.json_of("info", tiny), self.json_of("info", packed)])

    def test_an_unreadable_file_does_not_hide_the_others(self):
        tiny = self.fixture("tiny.stgs")
        result = self.fails(IO, "none.stgs: cannot open", "info", "none.stgs", tiny)
        self.assertIn(b"400, SH degree", result.stdout)
        result = self.stgs("info", tiny, "none.stgs", "--format", "json")
        self.assertEqual(result.returncode, IO)
        files = json.loads(result.stdout)
        self.check_schema("info", files)
        self.assertEqual([f["file"] for f in files["files"]], [tiny])


if __name__ == "__main__":
    unittest.main()
