# SPDX-License-Identifier: Apache-2.0
"""Scenes that are truncated, damaged, foreign or missing."""
import json
import os
import resource
import unittest

from harness import CliTest

IO, INVALID, RUNTIME, UNSUPPORTED, DIFFERS = 2, 3, 4, 5, 7


def flipped(data, offset):
    return data[:offset] + bytes([data[offset] ^ 0x10]) + data[offset + 1:]


class TruncatedScene(CliTest):
    def test_the_available_part_of_a_download_is_used(self):
        """info, render and pack use the available part of a truncated file and report the rest."""
        with open(self.fixture("tiny.stgs"), "rb") as file:
            good = file.read()
        last = max(s["offset"] + s["bytes"] + s["sh_bytes"]
                   for s in self.json_of("info", self.fixture("tiny.stgs"))["segments"])
        cut = self.write("cut.stgs", good[:last - 1])
        info = self.json_of("info", cut)
        self.assertEqual(info["missing_bytes"], len(good) - last + 1)
        self.assertEqual([s["available"] and s["sh_available"] for s in info["segments"]].count(False), 1)
        text = self.succeeds("info", cut).stdout.decode()
        self.assertRegex(text, r"truncated +\d+ bytes missing")
        self.assertIn(f"({os.path.getsize(cut)} of ", text)
        checked = self.fails(INVALID, "cut.stgs: 1 error", "validate", cut, "--format", "json")
        issues = json.loads(checked.stdout)["files"][0]["issues"]
        self.assertEqual([issue["number"] for issue in issues], [106])
        run = self.succeeds("render", cut, "--time", "0", "-o", "out.png")
        self.assertIn("the file is truncated", run.stderr.decode())
        self.assertTrue(os.path.exists(self.path("out.png")))
        run = self.succeeds("pack", cut, "-o", "packed.stgs")
        self.assertIn("the file is truncated", run.stderr.decode())
        self.assertRegex(run.stderr.decode(), r"cannot read 1 of \d+ tiers of segments")


class DamagedSegments(CliTest):
    """Damage affects single records: primitives are rendered without SH if only SH is damaged."""

    def spans(self, name):
        """Yields the byte ranges of each segment's two records: primitives, and SH or None."""
        for s in self.json_of("info", self.fixture(name))["segments"]:
            base = s["offset"], s["offset"] + s["bytes"]
            yield base, ((s["sh_offset"], s["sh_offset"] + s["sh_bytes"])
                         if s["sh_bytes"] else None)

    def damaged(self, name, which):
        """Copies a fixture with a bit flipped in each record of one kind (0: primitives, 1: SH)."""
        with open(self.fixture(name), "rb") as file:
            data = file.read()
        for records in self.spans(name):
            if records[which]:
                data = flipped(data, sum(records[which]) // 2)
        return self.write(f"damaged_{which}_{name}", data)

    def render(self, scene, name, time=0.05):
        run = self.stgs("render", scene, "--time", time, "-o", name, "--format", "json")
        self.assertEqual(run.returncode, 0, run.stderr)
        report = json.loads(run.stdout)
        self.check_schema("render", report)
        return report, run.stderr.decode()

    def assert_similar(self, a, b):
        self.succeeds("compare", a, b, "--min-psnr", "60")

    def test_the_first_half_of_a_file_renders_without_sh(self):
        with open(self.fixture("steady.stgs"), "rb") as file:
            complete = file.read()
        half = self.write("half.stgs", complete[:len(complete) // 2])
        segments = self.json_of("info", half)["segments"]
        self.assertTrue(all(s["available"] for s in segments))
        self.assertFalse(any(s["sh_available"] for s in segments))
        self.assertIn("3 without SH", self.succeeds("info", half).stdout.decode())
        report, warnings = self.render(half, "half.png")
        self.assertEqual(report["damaged"], {"segments": 0, "sh": len(segments)})
        self.assertIn("rendered 3 tiers of segments without SH", warnings)
        self.render(self.fixture("steady_plain.stgs"), "plain.png")
        self.render(self.fixture("steady.stgs"), "complete.png")
        self.assert_similar("half.png", "plain.png")
        self.fails(DIFFERS, "dB", "compare", "half.png", "complete.png", "--min-psnr", "60")
        bench = self.json_of("bench", half, "--num-frames", "2")
        self.assertEqual(bench["damaged"], report["damaged"])
        self.fails(INVALID, "half.stgs: 1 error", "validate", half)

    def test_damaged_sh_does_not_affect_primitives(self):
        self.render(self.damaged("steady.stgs", 1), "damaged.png")
        self.render(self.fixture("steady_plain.stgs"), "plain.png")
        self.assert_similar("damaged.png", "plain.png")
        self.fails(INVALID, "error", "validate", "damaged_1_steady.stgs")
        run = self.succeeds("pack", "damaged_1_steady.stgs", "-o", "packed.stgs")
        self.assertRegex(run.stderr.decode(), r"cannot read the SH of (\d+) of \1 .*is damaged")

    def test_damaged_sh_in_a_recording_is_reported(self):
        report, warnings = self.render(self.damaged("live.stgs", 1), "live.png")
        self.assertGreater(report["damaged"]["sh"], 0)
        self.assertEqual(report["damaged"]["segments"], 0)
        self.assertIn("is damaged", warnings)

    def test_rendering_without_any_segment_fails(self):
        for scene in ("steady.stgs", "live.stgs"):
            damaged = self.damaged(scene, 0)
            for verb in (["render", damaged, "--time", "0.05", "-o", "out.png"],
                         ["bench", damaged, "--num-frames", "1"]):
                self.fails(INVALID, "no data for .* can be read: .*damaged", *verb)
            self.assertFalse(os.path.exists(self.path("out.png")))

    def test_intact_segments_are_rendered(self):
        with open(self.fixture("packed.stgs"), "rb") as file:
            data = file.read()
        first = next(self.spans("packed.stgs"))[0]
        scene = self.write("one.stgs", flipped(data, sum(first) // 2))
        report, warnings = self.render(scene, "one.png", 0.15)  # two segments are active
        self.assertEqual(report["damaged"], {"segments": 1, "sh": 0})
        self.assertIn("skipped 1 damaged tier of segments", warnings)


class DamagedScenes(CliTest):
    def setUp(self):
        super().setUp()
        with open(self.fixture("tiny.stgs"), "rb") as file:
            self.good = file.read()

    def test_unusable_files_are_rejected_by_every_verb(self):
        without_copy = flipped(self.good, len(self.good) - 20)  # damages the copy of the head
        cases = [
            (IO, "missing.stgs: cannot open: No such file or directory; check the name", self.path("missing.stgs")),
            (IO, "this is a folder; name a file in it", self.work),
            (IO, "not a regular file", "/dev/null"),
            (INVALID, "empty.stgs: too short for an .stgs file .*; copy or download it again", self.write("empty.stgs", b"")),
            (INVALID, r"short.stgs: too short for an .stgs file \(expected at least 32 bytes, got 17",
             self.write("short.stgs", self.good[:17])),
            (INVALID, "cut.stgs: the file is truncated within its head .*got 100",
             self.write("cut.stgs", self.good[:100])),
            (INVALID, "words.stgs: too short for an .stgs file .*; this is a text file",
             self.write("words.stgs", "no scene")),
            (INVALID, "text.stgs: not an .stgs file; this is a text file", self.write("text.stgs", "no scene " * 50)),
            (INVALID, "magic.stgs: not an .stgs file; its content is unknown",
             self.write("magic.stgs", flipped(without_copy, 1))),
            (INVALID, "meta.stgs: record 'META' is damaged",
             self.write("meta.stgs", flipped(without_copy, 80))),
            (UNSUPPORTED, r"newer_major.stgs.*unsupported format version \(expected 2.x, got 3.0\)",
             self.fixture("newer_major.stgs")),
            (UNSUPPORTED, r"experiment.stgs.*pre-release version 0.6.*create the file again",
             self.fixture("experiment.stgs")),
            (UNSUPPORTED, "huge_count.stgs.*4294967296 primitives exceed the limit of 200000000",
             self.fixture("huge_count.stgs")),
            (INVALID, r"huge_bytes.stgs: .*outside the body", self.fixture("huge_bytes.stgs")),
        ]
        verbs = {
            "info": lambda f: ["info", f],
            "render": lambda f: ["render", f, "--time", "0", "-o", "out.png"],
            "evaluate": lambda f: ["evaluate", f, "--against", self.fixture("prepared")],
            "compare": lambda f: ["compare", f, self.fixture("tiny.stgs")],
        }
        for code, message, path in cases:
            for verb, arguments in verbs.items():
                with self.subTest(verb=verb, path=path):
                    self.fails(code, message, *arguments(path))
        self.assertFalse(os.path.exists(self.path("out.png")))

    def test_bytes_after_the_end_are_reported_and_ignored(self):
        path = self.write("long.stgs", self.good + b"more")
        self.assertEqual([d["number"] for d in self.json_of("info", path)["damage"]], [106])
        self.assertIn("extra bytes after the end of the file", self.succeeds("info", path).stdout.decode())
        self.succeeds("compare", path, self.fixture("tiny.stgs"))
        run = self.succeeds("render", path, "--time", "0", "-o", "null")
        self.assertIn("extra bytes after the end of the file", run.stderr.decode())
        self.fails(INVALID, "1 error", "validate", path)

    def test_a_damaged_segment_is_found_when_it_is_read(self):
        """info reads only the head and works; render skips the segment; evaluate fails."""
        last = max(s["offset"] + s["bytes"] for s in self.json_of("info", self.fixture("tiny.stgs"))["segments"])
        path = self.write("body.stgs", flipped(self.good, last - 40))
        self.succeeds("info", path)
        run = self.succeeds("render", path, "--frames", "0:6", "-o", "null")
        self.assertRegex(run.stderr.decode(), r"skipped 1 damaged tier of segments.*body.stgs: .*checksum")
        self.fails(INVALID, r"body.stgs: .*checksum.* \(rendering 0(\.\d+)? s\)$", "evaluate", path,
                   "--against", self.fixture("prepared"))

    @unittest.skipIf(os.environ.get("STGS_SANITIZE"), "a sanitizer reserves more memory than the limit")
    def test_out_of_memory_errors_state_the_file_and_the_time(self):
        def limit():
            resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30))
        self.fails(RUNTIME, r"tiny.stgs: cannot render 0\.1 s: out of memory; .*30000x30000 pixels.*--size",
                   "render", self.fixture("tiny.stgs"), "--time", "0.1", "--size", "30000x30000",
                   "-o", "null", "--threads", "2", "--memory", "64G", preexec_fn=limit)

    def test_invalid_start_cameras_are_rejected(self):
        for name, message in (("wide_start", "2147483712"), ("skew_start", "rotation")):
            for args in (["render", self.fixture(name + ".stgs"), "--time", "0", "-o", "null"],
                         ["compare", self.fixture(name + ".stgs"), self.fixture("tiny.stgs")]):
                with self.subTest(args=args):
                    self.fails(INVALID, f"{name}.stgs: .*{message}", *args)

    def test_validate_reports_invalid_and_unreadable_files(self):
        good, packed = self.fixture("tiny.stgs"), self.fixture("packed.stgs")
        report = self.json_of("validate", good, packed)
        self.assertTrue(report["valid"])
        for name in ("huge_bytes", "wrong_sum"):
            result = self.fails(INVALID, r"\d+ error", "validate", self.fixture(name + ".stgs"),
                                "--format", "json")
            report = json.loads(result.stdout)
            self.check_schema("validate", report)
            self.assertFalse(report["valid"])
            self.assertGreater(report["files"][0]["issues"][0]["number"], 0)
        result = self.fails(IO, "cannot open", "validate", good, self.path("none.stgs"),
                            "--format", "json")
        report = json.loads(result.stdout)
        self.check_schema("validate", report)
        self.assertTrue(report["files"][0]["valid"])
        self.assertIn("cannot open", report["files"][1]["unreadable"])

    def test_validate_detects_every_flipped_byte(self):
        """validate exits with 3 for each of 100 flipped bytes (5: a newer version)."""
        for i in range(100):
            offset = i * (len(self.good) - 1) // 99
            path = self.write("flip.stgs", flipped(self.good, offset))
            result = self.stgs("validate", path)
            self.assertIn(result.returncode, (INVALID, UNSUPPORTED), f"byte {offset} flipped")


if __name__ == "__main__":
    unittest.main()
