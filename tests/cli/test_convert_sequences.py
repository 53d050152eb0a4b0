# SPDX-License-Identifier: Apache-2.0
"""`stgs convert` from formats with several frames or several files."""
import json
import os
import shutil
import unittest

from harness import CliTest, built_in


class ConvertingPlyFrames(CliTest):
    def make_frames(self):
        """Writes six PLY frames of the fixture's scene; returns their total number of splats."""
        os.mkdir(self.path("frames"))
        count = 0
        for i in range(6):
            count += self.json_of("convert", self.fixture("tiny.stgs"), f"frames/{i:05}.ply",
                                  "--time", f"{i / 30:.6f}")["primitives"]
        return count

    def test_a_folder_of_frames_becomes_a_matching_clip(self):
        splats = self.make_frames()
        result = self.json_of("convert", "frames", "clip.stgs")
        self.assertEqual(result["input_format"], "PLY frames")
        self.assertEqual(result["frames"], 6)
        sequence = result["sequence"]
        self.assertEqual(sequence["splats"], splats)
        self.assertEqual(sequence["primitives"], result["primitives"])
        self.assertLess(result["primitives"], splats)
        self.assertGreater(sequence["matched"], 0.1)
        self.assertLessEqual(sequence["errors"]["position"], 0.0201)
        self.assertIsNone(result["splatv"])
        self.assertEqual(result["bytes_in"],
                         sum(os.path.getsize(self.path("frames", name))
                             for name in os.listdir(self.path("frames"))))
        self.succeeds("validate", "clip.stgs")
        start = self.json_of("info", self.fixture("tiny.stgs"))["start_camera"]
        self.write("start.json", json.dumps(start))
        for i in (0, 3, 5):
            for scene in (self.fixture("tiny.stgs"), "clip.stgs"):
                self.succeeds("render", scene, "--time", f"{i / 30:.6f}", "--camera", "start.json",
                              "-o", "clip.png" if scene == "clip.stgs" else "expected.png")
            self.succeeds("compare", "clip.png", "expected.png", "--min-psnr", "50")

    def test_frame_rate_and_tolerance_apply_to_frames(self):
        self.make_frames()
        result = self.json_of("convert", "frames", "slow.stgs", "--fps", "29.97", "--tolerance", "0")
        self.assertEqual(set(result["sequence"]["errors"].values()), {0})
        info = self.json_of("info", "slow.stgs")
        self.assertAlmostEqual(info["fps"], 30000 / 1001)
        loose = self.json_of("convert", "frames", "loose.stgs", "--tolerance", "20")
        self.assertLess(loose["primitives"], result["primitives"])
        text = self.succeeds("convert", "frames", "a.stgs").stdout.decode()
        self.assertRegex(text, r"6 frames, \d+ splats merged into \d+ primitives")
        single = self.json_of("convert", "frames", "single.ply", "--time", "0.1")
        self.assertEqual(single["output_format"], "PLY")

    def test_convert_rejects_incomplete_frames_and_unrelated_options(self):
        self.make_frames()
        os.remove(self.path("frames", "00002.ply"))
        self.fails(1, "frames missing after", "convert", "frames", "a.stgs")
        os.mkdir(self.path("empty"))
        self.fails(3, "empty: this folder has neither PLY frames", "convert", "empty", "a.stgs")
        for option, value in (("--fps", "30"), ("--frames", "5"), ("--tolerance", "2")):
            self.fails(1, f"{option} applies to", "convert", self.fixture("tiny.stgs"), "a.stgs",
                       option, value)
        self.fails(1, "out of range", "convert", "frames", "a.stgs", "--fps", "0")
        self.assertFalse(os.path.exists(self.path("a.stgs")))


class ConvertingSplatv(CliTest):
    def test_curved_paths_are_reported(self):
        result = self.json_of("convert", self.fixture("clip.splatv"), "a.stgs", "--frames", "60",
                              "--fps", "20")
        self.assertEqual(result["input_format"], "splatv")
        self.assertEqual(result["frames"], 60)
        self.assertEqual(result["primitives"], 12)
        self.assertEqual(result["splatv"]["bent"], 6)
        self.assertGreater(result["splatv"]["path_max"], 0.1)
        self.assertRegex(result["notes"][0], "approximated paths by lines: .* 6 of 12")
        self.assertIsNone(result["sequence"])
        self.assertAlmostEqual(self.json_of("info", "a.stgs")["duration_s"], 3)
        self.fails(1, "--tolerance applies to", "convert", self.fixture("clip.splatv"), "b.stgs",
                   "--tolerance", "1")

    def test_a_truncated_file_is_rejected(self):
        with open(self.fixture("clip.splatv"), "rb") as file:
            data = file.read()
        self.fails(3, "cut.splatv", "convert", self.write("cut.splatv", data[:-1]), "a.stgs")


class ConvertingFourdgs(CliTest):
    def test_a_scene_is_written_and_read_back(self):
        tiny = self.fixture("tiny.stgs")
        result = self.json_of("convert", tiny, "a.4dgs")
        self.assertEqual(result["output_format"], "4dgs")
        self.assertEqual((result["frames"], result["time_s"]), (6, None))
        self.assertEqual(result["primitives_in"], 400)
        self.assertLess(0.1, result["errors"]["visibility_max"])
        self.assertLess(result["errors"]["position_max"], 0.01)
        notes = "\n".join(result["notes"])
        for part in ("dropped 3 of 400 primitives", "approximated the lifespans of ",
                     "visibility differs by up to 0.5, ", "clipped 18 of 1191 colours",
                     "4dgs cannot hold the image size and roll of the start camera",
                     "4dgs rounds or clips"):
            self.assertIn(part, notes)
        text = self.succeeds("convert", tiny, "b.4dgs").stdout.decode()
        self.assertRegex(text, r"opacity at a frame \S+, time ")
        self.assertEqual(self.read("a.4dgs"), self.read("b.4dgs"))
        back = self.json_of("convert", "a.4dgs", "c.stgs")
        self.assertEqual((back["input_format"], back["frames"], back["sequence"]), ("4dgs", 6, None))
        self.assertEqual(back["primitives"], result["primitives"])
        self.succeeds("validate", "c.stgs")
        self.succeeds("compare", tiny, "c.stgs", "--min-psnr", "40")
        self.assertEqual(self.json_of("convert", "a.4dgs", "d.stgs", "--fps", "60")["frames"], 12)

    def test_one_time_is_static(self):
        self.succeeds("convert", self.fixture("tiny.stgs"), "a.4dgs", "--time", "0.1")
        result = self.json_of("convert", "a.4dgs", "a.ply")
        self.assertEqual(result["frames"], 1)
        self.assertNotIn("motion and lifespans", "\n".join(result["notes"]))

    def test_states_become_primitives(self):
        result = self.json_of("convert", self.fixture("states.4dgs"), "a.stgs")
        self.assertEqual((result["input_format"], result["frames"]), ("4dgs", 48))
        self.assertEqual(result["sequence"]["splats"], 24 * 2 + 24 * 3)
        self.assertEqual(result["primitives"], 4)
        self.assertEqual(result["sequence"]["whole_clip"], 1)
        # At one frame per second, the step is a motion.
        slow = self.json_of("convert", self.fixture("states.4dgs"), "b.stgs", "--fps", "1",
                            "--tolerance", "2")
        self.assertEqual((slow["frames"], slow["primitives"]), (2, 3))
        self.assertEqual(slow["sequence"]["moving"], 1)

    def test_unsuitable_options_and_files_are_rejected(self):
        states = self.fixture("states.4dgs")
        self.fails(1, "--frames applies to .splatv", "convert", states, "a.stgs", "--frames", "3")
        self.fails(1, "--quality applies to .stgs output", "convert", states, "a.4dgs", "--quality", "3")
        self.succeeds("convert", self.fixture("tiny.stgs"), "tiny.4dgs")
        self.fails(1, "to which tolerances do not apply", "convert", "tiny.4dgs", "a.stgs",
                   "--tolerance", "1")
        self.fails(1, "lasts 2 s, but PLY holds a single time", "convert", states, "a.ply")
        data = self.read(states)
        self.fails(3, "the file is truncated", "convert", self.write("cut.4dgs", data[:-1]), "a.stgs")
        self.fails(5, "unsupported version of .4dgs", "convert",
                   self.write("new.4dgs", data[:5] + b"2" + data[6:]), "a.stgs")


class ConvertingSog(CliTest):
    @unittest.skipUnless(built_in("sog"), "needs libwebp and libzip")
    def test_a_bundle_and_a_folder_of_chunks_convert(self):
        result = self.json_of("convert", self.fixture("model.sog"), "a.stgs")
        self.assertEqual((result["input_format"], result["primitives"], result["sh_degree"]),
                         ("SOG", 30, 1))
        chunks = self.json_of("convert", self.fixture("chunks"), "b.stgs")
        self.assertEqual(chunks["primitives"], 45)
        self.assertGreater(chunks["bytes_in"], 0)
        one = self.json_of("convert", os.path.join(self.fixture("chunks"), "0_1", "meta.json"),
                           "c.ply")
        self.assertEqual(one["primitives"], 25)
        self.succeeds("validate", "a.stgs", "b.stgs")

    @unittest.skipUnless(built_in("sog"), "needs libwebp and libzip")
    def test_damaged_models_are_rejected(self):
        shutil.copytree(self.fixture("chunks"), self.path("chunks"))
        os.remove(self.path("chunks", "0_1", "sh0.webp"))
        self.fails(2, "sh0.webp: cannot open", "convert", "chunks", "a.stgs")
        self.write("broken.sog", b"PK\x03\x04 and nothing else")
        self.fails(3, "broken.sog: cannot read as a zip archive", "convert", "broken.sog", "a.stgs")

    @unittest.skipIf(built_in("sog"), "libwebp and libzip are built in")
    def test_a_build_without_sog_reports_it(self):
        self.write("a.sog", b"PK\x03\x04")
        self.fails(6, "lacks libwebp or libzip", "convert", "a.sog", "a.stgs")


class ConvertingTimedFormats(CliTest):
    @unittest.skipUnless(built_in("sog"), "needs libwebp and libzip")
    def test_linear_motion_of_a_sogst_is_exact(self):
        result = self.json_of("convert", self.fixture("linear.sogst"), "a.stgs")
        self.assertEqual((result["input_format"], result["frames"], result["sh_degree"]),
                         ("sogst", 20, 1))
        self.assertEqual(result["notes"], [])
        self.assertEqual((result["curves"]["curved"], result["curves"]["pieces"]), (0, 0))
        self.assertAlmostEqual(self.json_of("info", "a.stgs")["fps"], 10)
        self.fails(1, "--fps applies to", "convert", self.fixture("linear.sogst"), "b.stgs",
                   "--fps", "10")

    @unittest.skipUnless(built_in("sog"), "needs libwebp and libzip")
    def test_curved_paths_of_a_sogst_are_divided_within_the_tolerance(self):
        result = self.json_of("convert", self.fixture("curved.sogst"), "a.stgs")
        curves = result["curves"]
        self.assertEqual(curves["curved"], 40)
        self.assertGreater(curves["pieces"], curves["divided"])
        self.assertEqual(result["primitives_in"], 40 - curves["divided"] + curves["pieces"])
        self.assertGreater(curves["divided"], 0)
        self.assertLessEqual(curves["opacity_max"], 0.0201)
        if curves["above_bound"] == 0:
            self.assertLessEqual(curves["position_relative_max"], 0.1001)
        self.assertRegex(result["notes"][0], "approximated 40 curved paths by lines: error")
        self.assertRegex(result["notes"][1], r"divided \d+ of 40 primitives into \d+ pieces")
        loose = self.json_of("convert", self.fixture("curved.sogst"), "b.stgs",
                             "--tolerance", "100")["curves"]
        self.assertLess(loose["pieces"], curves["pieces"])
        self.succeeds("validate", "a.stgs", "b.stgs")

    @unittest.skipUnless(built_in("sog"), "needs libwebp and libzip")
    def test_a_tsog_gets_its_timing_from_the_options(self):
        result = self.json_of("convert", self.fixture("clip.tsog"), "a.stgs", "--frames", "40",
                              "--fps", "20")
        self.assertEqual((result["input_format"], result["frames"]), ("tsog", 40))
        self.assertIsNone(result["curves"])
        self.assertAlmostEqual(self.json_of("info", "a.stgs")["duration_s"], 2)
        self.succeeds("validate", "a.stgs")

    def test_an_ftgs_ply_keeps_its_frames(self):
        result = self.json_of("convert", self.fixture("clip.ftgs.ply"), "a.stgs", "--fps", "60")
        self.assertEqual((result["input_format"], result["frames"], result["primitives"]),
                         ("FTGS PLY", 61, 9))
        self.assertAlmostEqual(self.json_of("info", "a.stgs")["fps"], 60)
        self.fails(1, "states its number of frames .61.", "convert", self.fixture("clip.ftgs.ply"),
                   "b.stgs", "--frames", "10")
        with open(self.fixture("clip.ftgs.ply"), "rb") as file:
            data = file.read()
        self.fails(3, "cut.ply", "convert", self.write("cut.ply", data[:-1]), "b.stgs")


class ConvertingToUsd(CliTest):
    def test_a_clip_has_samples_and_a_single_time_has_none(self):
        result = self.json_of("convert", self.fixture("tiny.stgs"), "clip.usda")
        self.assertEqual((result["output_format"], result["frames"], result["time_s"]),
                         ("USD", 6, None))
        self.assertIsNone(result["errors"])
        self.assertTrue(any("the start camera" in note for note in result["notes"]))
        with open(self.path("clip.usda")) as file:
            text = file.read()
        self.assertTrue(text.startswith("#usda 1.0\n"))
        self.assertIn("endTimeCode = 5", text)
        self.assertIn("opacities.timeSamples", text)
        self.assertEqual(text.count("{"), text.count("}"))
        still = self.json_of("convert", self.fixture("tiny.stgs"), "still.usda", "--time", "0.1")
        self.assertEqual(still["time_s"], 0.1)
        with open(self.path("still.usda")) as file:
            self.assertNotIn("timeSamples", file.read())
        self.fails(5, "cannot read USD, only write it", "convert", "clip.usda", "a.stgs")
        self.fails(1, "--quality applies to .stgs", "convert", self.fixture("tiny.stgs"), "a.usda",
                   "--quality", "80")
