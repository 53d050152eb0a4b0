# SPDX-License-Identifier: Apache-2.0
"""`stgs pack`: rates, errors, profiles, and arguments that it rejects."""
import json
import os
import unittest

import harness
from harness import CliTest, built_in

USAGE, IO, INVALID, UNSUPPORTED, NOT_BUILT = 1, 2, 3, 5, 6


class Packing(CliTest):
    def test_pack_reduces_the_size(self):
        report = self.json_of("pack", self.fixture("tiny.stgs"), "-o", "out.stgs")
        self.assertEqual(report["bytes_out"], os.path.getsize(self.path("out.stgs")))
        self.assertLess(report["bytes_out"], report["bytes_in"])
        before = self.json_of("info", self.fixture("tiny.stgs"))["primitives"]
        self.assertEqual(report["primitives"] + report["dropped"], before)
        self.assertEqual(self.json_of("info", "out.stgs")["primitives"], report["primitives"])
        self.json_of("validate", "out.stgs")
        self.succeeds("compare", self.fixture("tiny.stgs"), "out.stgs", "--min-psnr", "30")

    def test_higher_quality_is_larger_and_more_accurate(self):
        low = self.json_of("pack", self.fixture("tiny.stgs"), "-o", "low.stgs", "--quality", "20")
        high = self.json_of("pack", self.fixture("tiny.stgs"), "-o", "high.stgs", "--quality", "95")
        self.assertLess(low["bytes_out"], high["bytes_out"])
        self.assertGreater(low["errors"]["colour_rms"], high["errors"]["colour_rms"])

    def test_pack_sets_units_orientation_and_audio(self):
        tiny = self.fixture("tiny.stgs")
        self.assertIsNone(self.json_of("info", tiny)["metres_per_unit"])
        self.succeeds("pack", tiny, "-o", "out.stgs", "--metres-per-unit", "0.25", "--up", "0,-3,4",
                      "--floor", "0,1.5,0")
        info = self.json_of("info", "out.stgs")
        self.assertEqual(info["metres_per_unit"], 0.25)
        for value, expected in zip(info["up"] + info["floor"], (0, -0.6, 0.8, 0, 1.5, 0)):
            self.assertAlmostEqual(value, expected, 6)
        self.assertRegex(self.succeeds("info", "out.stgs").stdout.decode(), r"unit +0.25 m\n +up ")
        self.succeeds("pack", "out.stgs", "-o", "again.stgs")  # preserves the metadata
        self.assertEqual(self.json_of("info", "again.stgs")["floor"], info["floor"])
        self.assertIsNone(info["audio"])
        self.succeeds("pack", "out.stgs", "-o", "audio.stgs", "--audio", "../a.opus", "--audio-offset", "-0.5")
        self.succeeds("pack", "audio.stgs", "-o", "again.stgs")
        self.assertEqual(self.json_of("info", "again.stgs")["audio"], {"location": "../a.opus", "begin_s": -0.5})
        self.assertRegex(self.succeeds("info", "again.stgs").stdout.decode(), r"audio +../a.opus, from -0.500 s")
        self.assertRegex(self.succeeds("convert", "again.stgs", "x.ply", "--time", "0").stderr.decode(),
                         "the audio location")
        self.fails(1, "--audio", "pack", tiny, "-o", "x.stgs", "--audio-offset", "1")
        self.fails(1, "has no direction", "pack", tiny, "-o", "x.stgs", "--up", "0,0,0")
        self.fails(1, "requires an up vector", "pack", tiny, "-o", "x.stgs", "--floor", "0,0,0")

    def test_pack_meets_a_target_rate_and_error(self):
        tiny = self.fixture("tiny.stgs")
        free = self.json_of("pack", tiny, "-o", "free.stgs")
        self.assertEqual(free["quality"], 87)
        self.assertEqual(free["held_out"], {"before": None, "after": None})
        report = self.json_of("pack", tiny, "-o", "o.stgs", "--target-kbps",
                              str(0.9 * free["kbps"]), "--max-error", "2")
        self.assertLessEqual(report["kbps"], 0.9 * free["kbps"])
        self.assertLess(report["quality"], 87)
        self.assertLessEqual(report["errors"]["position_max"], 0.002)
        self.fails(USAGE, "is too low for this scene", "pack", tiny, "-o", "none.stgs",
                   "--target-kbps", "0.1")
        self.assertFalse(os.path.exists(self.path("none.stgs")))
        self.fails(USAGE, "excludes", "pack", tiny, "-o", "none.stgs", "--target-kbps", "10",
                   "--quality", "10")
        small = self.json_of("pack", tiny, "-o", "o.stgs", "--target-size", str(free["bytes_out"] // 2))
        self.assertLessEqual(small["bytes_out"], free["bytes_out"] // 2)

    def test_pack_measures_against_a_matching_capture_only(self):
        prepared = self.fixture("prepared")
        report = self.json_of("pack", self.fixture("tiny.stgs"), "-o", "o.stgs", "--against",
                              prepared)
        held_out = report["held_out"]
        self.assertGreater(held_out["before"]["psnr"], 0)
        self.assertEqual(held_out["before"]["images"], held_out["after"]["images"])
        for code, message, scene, against in (
                (USAGE, "do not match", "longer.stgs", prepared),
                (IO, "none", "tiny.stgs", "none")):
            self.fails(code, message, "pack", self.fixture(scene), "-o", "none.stgs", "--against",
                       against)
            self.assertFalse(os.path.exists(self.path("none.stgs")))

    def test_packing_a_packed_scene_warns(self):
        first = self.stgs("pack", self.fixture("tiny.stgs"), "-o", "one.stgs")
        self.assertNotIn(b"warning", first.stderr)
        again = self.stgs("pack", "one.stgs", "-o", "two.stgs", "--format", "json")
        self.assertEqual(again.returncode, 0)
        self.assertIn(b"stgs: warning: one.stgs: already packed", again.stderr)
        self.assertEqual(json.loads(again.stdout)["input_profile"], "quantised")

    def test_the_near_lossless_profile_shows_no_difference(self):
        tiny = self.fixture("tiny.stgs")
        best = self.json_of("pack", tiny, "-o", "best.stgs", "--quality", "100")
        report = self.json_of("pack", tiny, "-o", "near.stgs", "--profile", "near-lossless")
        self.assertIsNone(report["quality"])
        self.assertLess(best["bytes_out"], report["bytes_out"])
        self.assertLess(report["errors"]["colour_rms"], 0.5 * best["errors"]["colour_rms"])
        self.assertEqual(self.json_of("info", "near.stgs")["profile"], "near-lossless")
        self.json_of("validate", "near.stgs")
        self.succeeds("compare", tiny, "near.stgs", "--min-psnr", "60")
        text = self.succeeds("pack", tiny, "-o", "near.stgs", "--profile", "near-lossless").stdout.decode()
        self.assertRegex(text, r"\nnear-lossless, [0-9]+ kbit/s; ")
        bound = self.json_of("pack", tiny, "-o", "bound.stgs", "--profile", "near-lossless", "--max-error", "0.01")
        self.assertLessEqual(bound["errors"]["position_max"], 1e-5)
        for more in (("--quality", "90"), ("--target-kbps", "100"), ("--target-size", "1000"), ("--target-psnr", "50")):
            self.fails(USAGE, "near-lossless takes neither --quality nor a target", "pack", tiny, "-o", "none.stgs",
                       "--profile", "near-lossless", *more)
            self.fails(USAGE, "near-lossless takes neither", "encode", harness.sample(), "-o", "none.stgs",
                       "--profile", "near-lossless", *more)
        self.assertFalse(os.path.exists(self.path("none.stgs")))

    def test_a_packed_file_states_its_errors(self):
        def errors(name):
            return {s["name"]: s["max_error"] for s in self.json_of("info", name)["streams"]}
        tiny = self.fixture("tiny.stgs")
        self.assertEqual(set(errors(tiny).values()), {None})
        self.succeeds("pack", tiny, "-o", "q.stgs")
        self.succeeds("pack", tiny, "-o", "near.stgs", "--profile", "near-lossless")
        packed, near = errors("q.stgs"), errors("near.stgs")
        for name in ("position", "log_scale", "rotation", "opacity", "sh0"):
            self.assertGreater(packed[name], near[name])
            self.assertGreater(near[name], 0)
        self.assertRegex(self.succeeds("info", "q.stgs", "--segments").stdout.decode(),
                         r"position .* errors up to [0-9.e-]+, rms [0-9.e-]+")

    @unittest.skipUnless(built_in("draco"), "needs libdraco")
    def test_the_draco_profile_contains_the_same_scene(self):
        tiny = self.fixture("tiny.stgs")
        quantised = self.json_of("pack", tiny, "-o", "quantised.stgs")
        report = self.json_of("pack", tiny, "-o", "draco.stgs", "--profile", "draco")
        self.assertEqual(report["errors"], quantised["errors"])
        self.assertEqual(report["bytes_out"], os.path.getsize(self.path("draco.stgs")))
        self.assertEqual(self.json_of("info", "draco.stgs")["profile"], "draco")
        self.assertEqual(self.json_of("info", "quantised.stgs")["profile"], "quantised")
        self.json_of("validate", "draco.stgs")
        for name in ("quantised", "draco"):
            self.succeeds("convert", name + ".stgs", name + ".ply", "--time", "0.1")
        self.assertEqual(self.read("quantised.ply"), self.read("draco.ply"))

    @unittest.skipIf(built_in("draco"), "libdraco is built in")
    def test_a_build_without_draco_reports_it(self):
        scene = os.path.join(harness.SOURCE, "tests", "data", "draco", "draco.stgs")
        self.assertEqual(self.json_of("info", scene)["profile"], "draco")
        self.fails(NOT_BUILT, "lacks libdraco", "validate", scene)
        self.fails(NOT_BUILT, "lacks libdraco", "convert", scene, "o.ply", "--time", "0")
        self.fails(NOT_BUILT, "lacks libdraco", "pack", self.fixture("tiny.stgs"), "-o",
                   "o.stgs", "--profile", "draco")
        self.fails(NOT_BUILT, "lacks libdraco", "encode", harness.sample(), "-o", "o.stgs",
                   "--profile", "draco")
        self.assertEqual(os.listdir(self.work), [])

    def test_pack_rejects_bad_arguments(self):
        tiny = self.fixture("tiny.stgs")
        self.fails(USAGE, "--quality: 101 is out of range", "pack", tiny, "-o", "o.stgs",
                   "--quality", "101")
        self.fails(USAGE, "--profile: 'lossless' is not one of", "pack", tiny, "-o", "o.stgs",
                   "--profile", "lossless")
        self.fails(USAGE, "--output is required", "pack", tiny)
        self.fails(IO, "none.stgs: cannot open", "pack", "none.stgs", "-o", "o.stgs")
        self.fails(UNSUPPORTED, "huge_count.stgs", "pack", self.fixture("huge_count.stgs"), "-o",
                   "o.stgs")
        self.fails(IO, "cannot create", "pack", tiny, "-o", "/proc/o.stgs")
        self.assertEqual(os.listdir(self.work), [])


if __name__ == "__main__":
    unittest.main()
