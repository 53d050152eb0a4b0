# SPDX-License-Identifier: Apache-2.0
"""The verbs that read a scene, with valid input."""
import json
import os
import shutil
import signal
import subprocess
import unittest

import harness
from harness import CliTest

USAGE = 1


class Backends(CliTest):
    def test_vulkan_and_cpu_render_the_same_image(self):
        if not harness.renders_with("vulkan"):
            self.skipTest("Vulkan is not built in")
        tiny = self.fixture("tiny.stgs")
        render = ["render", tiny, "--time", "0.05", "--backend"]
        result = self.stgs(*render, "vulkan", "-o", "vulkan.png")
        if result.returncode == 5:
            self.assertIn(b"use backend 'cpu'", result.stderr)
            self.skipTest("no Vulkan device found")
        self.assertEqual(result.returncode, 0, result.stderr)
        self.succeeds(*render, "cpu", "-o", "cpu.png")
        self.succeeds("compare", "cpu.png", "vulkan.png", "--min-psnr", "50")
        bench = self.json_of("bench", tiny, "--num-frames", "2", "--backend", "vulkan")
        self.assertEqual(bench["backend"], "vulkan")


class Reading(CliTest):
    def test_info_describes_a_scene(self):
        info = self.json_of("info", self.fixture("tiny.stgs"))
        self.assertEqual(info["primitives"], 400)
        self.assertEqual(info["bytes"], os.path.getsize(self.fixture("tiny.stgs")))
        self.assertAlmostEqual(info["bytes_per_primitive"], info["bytes"] / 400)
        self.assertAlmostEqual(info["duration_s"], 0.2)
        self.assertEqual(info["profile"], "lossless")
        self.assertEqual(sum(s["primitives"] for s in info["segments"]), 400)
        self.assertEqual(sum(s["raw_bytes"] for s in info["streams"]), 400 * 4 * (17 + 4 * 3))
        packed = self.json_of("info", self.fixture("packed.stgs"))
        self.assertEqual(packed["profile"], "quantised")
        self.assertLess(packed["bytes"], info["bytes"])
        text = self.succeeds("info", self.fixture("tiny.stgs")).stdout.decode()
        self.assertIn("400", text)
        self.assertIn("position", text)

    def test_info_lists_lifespans_on_request(self):
        info = self.json_of("info", self.fixture("tiny.stgs"), "--lifespans")
        motion = info["motion"]
        visible = info["primitives"] - motion["never_visible"]
        lifespans = motion["lifespans"]
        self.assertEqual(sum(b["primitives"] for b in lifespans["bins_s"]) +
                         lifespans["whole_clip"], visible)
        self.assertEqual(sum(b["primitives"] for b in motion["speeds"]["bins"]), visible)
        # About 60 % of the fixture is active for the complete clip and drifts by about 1e-5.
        share = motion["static"]["share"]
        self.assertAlmostEqual(share * visible, motion["static"]["primitives"])
        self.assertGreater(share, 0.4)
        self.assertLess(share, 0.75)
        self.assertAlmostEqual(motion["static"]["bound"],
                               motion["static"]["scene_radius"] / 1000)
        self.assertNotIn("motion", self.json_of("info", self.fixture("tiny.stgs")))
        text = self.succeeds("info", self.fixture("tiny.stgs"), "--lifespans").stdout.decode()
        self.assertRegex(text, rf"static +{motion['static']['primitives']} ")
        self.fails(5, "huge_count.stgs", "info", self.fixture("huge_count.stgs"), "--lifespans")

    def test_recordings_are_read_and_finalized(self):
        """Recordings are readable, truncated or not; finalize writes a finished file."""
        recorded, cut = self.fixture("recorded.stgs"), self.fixture("cut.stgs")
        info = self.json_of("info", recorded)
        self.assertEqual((info["form"], info["incomplete_bytes"]), ("recorded", 0))
        self.assertEqual((info["frames"], len(info["parts"]), info["primitives"]), (6, 2, 800))
        info = self.json_of("info", cut)
        self.assertEqual((info["form"], info["incomplete_bytes"]), ("growing", 1000))
        self.assertEqual((info["frames"], len(info["parts"]), info["primitives"]), (3, 1, 400))
        text = self.succeeds("info", cut).stdout.decode()
        self.assertIn("not closed yet", text)
        self.assertIn("1000 bytes after its last complete fragment", text)
        self.assertEqual(self.json_of("validate", recorded)["files"][0]["issues"], [])
        issues = self.json_of("validate", cut)["files"][0]["issues"]
        self.assertEqual([(i["number"], i["severity"]) for i in issues], [(314, "warning")])
        for path, frames, parts in ((recorded, 6, 2), (cut, 3, 1)):
            report = self.json_of("finalize", path, "-o", "out.stgs")
            self.assertEqual((report["frames"], report["parts"]), (frames, parts))
            self.assertEqual(report["closed"], path == recorded)
            self.assertEqual(report["bytes_in"], os.path.getsize(path))
            self.assertEqual(report["bytes_out"], os.path.getsize(self.path("out.stgs")))
            self.assertEqual(self.json_of("info", "out.stgs")["form"], "finished")
            self.assertEqual(self.json_of("validate", "out.stgs")["files"][0]["issues"], [])
            for name, scene in (("a.png", path), ("b.png", "out.stgs")):
                self.succeeds("render", scene, "--time", "0.05", "-o", name)
            with open(self.path("a.png"), "rb") as a, open(self.path("b.png"), "rb") as b:
                self.assertEqual(a.read(), b.read())
        # Neither a recording nor what finalize makes of it states the bytes of its streams.
        for path in (recorded, cut, "out.stgs"):
            streams = self.json_of("info", path)["streams"]
            self.assertEqual({s["bytes"] for s in streams}, {None})
            self.assertTrue(all(s["raw_bytes"] > 0 for s in streams))
            text = self.succeeds("info", path, "--segments").stdout.decode()
            self.assertRegex(text, r"(?m)^  position +not stated +- +-$")
        tiny = self.fixture("tiny.stgs")
        streams = self.json_of("info", tiny)["streams"]
        self.assertTrue(all(isinstance(s["bytes"], int) for s in streams))
        text = self.succeeds("info", tiny, "--segments").stdout.decode()
        self.assertRegex(text, r"(?m)^  position +[1-9][0-9]* +[0-9.]+ % +[0-9.]+ %$")
        self.assertNotIn("not stated", text)
        self.fails(1, "already finished; nothing to do", "finalize", tiny, "-o", "x.stgs")
        self.fails(1, "is the recording itself", "finalize", recorded, "-o", recorded)
        self.assertFalse(os.path.exists(self.path("x.stgs")))

    def test_a_file_name_that_is_not_utf8_is_accepted(self):
        shutil.copy(self.fixture("tiny.stgs"), self.path("x\udcff.stgs"))  # the byte 0xff
        self.assertEqual(self.json_of("info", "x\udcff.stgs")["file"], "x\ufffd.stgs")
        report = self.json_of("validate", "x\udcff.stgs")
        self.assertEqual(report["files"][0]["file"], "x\ufffd.stgs")

    def test_evaluate_measures_against_a_capture(self):
        report = self.json_of("evaluate", self.fixture("tiny.stgs"), "--against",
                              self.fixture("prepared"), "--cameras", "all")
        self.assertEqual(report["images"], 18)
        self.assertEqual([v["camera"] for v in report["views"]], ["a", "b", "c"])
        # The ground truth is a render of this scene in 8 bits: only rounding remains, 1/12 LSB^2.
        self.assertGreater(report["psnr"], 58)
        self.assertGreaterEqual(report["psnr_cc"], report["psnr"])
        self.assertGreater(report["ssim"], 0.99)
        sampled = self.json_of("evaluate", self.fixture("packed.stgs"), "--against",
                               self.fixture("prepared"), "--every", "4")
        self.assertEqual(sampled["images"], 2)
        self.assertGreater(sampled["psnr"], 25)
        self.assertLess(sampled["psnr"], report["psnr"])
        # Most primitives that span the clip move by a negligible 1e-6 per frame; the rest moves.
        for drift in (report["static_drift"], sampled["static_drift"]):
            self.assertGreater(drift["primitives"], 100)
            self.assertLess(drift["median_px"], drift["bound_px"])
            self.assertGreater(drift["mean_px"], drift["bound_px"])
            self.assertGreater(drift["within_bound"], 0.5 * drift["primitives"])
            self.assertLess(drift["within_bound"], drift["primitives"])
        # The median needs more than two frames.
        self.assertGreater(report["moving_share"], 0)
        self.assertLess(report["moving_share"], 0.9)
        self.assertGreater(report["psnr_moving"], 58)
        self.assertIsNone(sampled["moving_share"])
        self.assertIsNone(sampled["psnr_moving"])

    def test_moving_pixels_are_measured_separately(self):
        against = ["--against", self.copy_capture("static")]
        for frame in range(1, 6):
            shutil.copy(self.path("static/frames/c/000000.png"),
                        self.path(f"static/frames/c/00000{frame}.png"))
        static = self.json_of("evaluate", self.fixture("tiny.stgs"), *against)
        self.assertEqual(static["moving_share"], 0)
        self.assertIsNone(static["psnr_moving"])
        # One frame from another camera moves, and the render differs only there.
        shutil.copy(self.path("static/frames/a/000003.png"),
                    self.path("static/frames/c/000003.png"))
        moved = self.json_of("evaluate", self.fixture("tiny.stgs"), *against)
        self.assertGreater(moved["moving_share"], 0)
        self.assertLess(moved["moving_share"], 1 / 6)
        self.assertLess(moved["psnr_moving"], moved["psnr_pooled"] - 3)
        self.assertEqual(moved["views"][0]["psnr_moving"], moved["psnr_moving"])

    def test_results_do_not_depend_on_threads(self):
        args = ["evaluate", self.fixture("packed.stgs"), "--against", self.fixture("prepared"),
                "--cameras", "all"]
        one, two = self.json_of(*args, "--threads", "1"), self.json_of(*args, "--threads", "2")
        for report in (one, two):
            del report["peak_memory"]
        self.assertEqual(one, two)

    def test_bench_measures_frames(self):
        scene = self.fixture("tiny.stgs")
        result = self.json_of("bench", scene, "--num-frames", "7", "--size", "32x24")
        for name in ("cold", "warm"):
            steps = result[name]["frame_ms"]
            self.assertLessEqual(steps["p50"], steps["p95"])
            self.assertLessEqual(steps["p95"], steps["p99"])
            self.assertAlmostEqual(result[name]["fps"] * steps["p50"], 1000)
        self.assertEqual(result["cameras"], [{"width": 32, "height": 24}])
        self.assertEqual(result["stored"], result["primitives"])
        moving = self.json_of("bench", scene, "--num-frames", "7", "--size", "32x24", "--animate",
                              "--seed", "3")
        self.assertTrue(moving["animated"])
        self.assertLess(moving["active"], moving["primitives"])
        full = self.json_of("bench", scene, "--num-frames", "2", "--size", "32x24",
                            "--full-sh", "--backend", "cpu")
        self.assertTrue(full["full_sh"])
        self.assertEqual(full["warm"]["device_ms"]["p99"], 0)
        packed = self.json_of("bench", scene, "--num-frames", "2", "--size", "32x24",
                              "--full-sh", "--quality", "80")
        self.assertEqual(packed["quality"], 80)
        self.assertLess(3 * packed["file_bytes"], full["file_bytes"])
        self.fails(USAGE, "--quality applies to a synthetic scene; add --animate", "bench", scene, "--quality", "80")
        self.fails(USAGE, "--seed applies to a synthetic scene; add --animate", "bench", scene, "--seed", "2")
        text = self.succeeds("bench", scene, "--num-frames", "2").stdout.decode()
        self.assertRegex(text, r"cold +mean ms +p50 +p95 +p99\n +frame ")
        self.fails(USAGE, "--num-frames: .*0", "bench", scene, "--num-frames", "0")

    def test_bench_renders_two_eyes(self):
        args = ["bench", self.fixture("tiny.stgs"), "--num-frames", "3", "--size", "32x24",
                "--backend", "cpu"]
        one, two = self.json_of(*args), self.json_of(*args, "--stereo", "0.06")
        self.assertNotIn("stereo", one)
        self.assertEqual(two["stereo"]["eye_distance"], 0.06)
        times = two["warm"]["frame_ms"]["p50"] / two["stereo"]["one_eye"]["frame_ms"]["p50"]
        self.assertAlmostEqual(two["stereo"]["ratio_to_one_eye"], times)
        self.assertEqual(two["active"], one["active"])
        self.assertGreater(two["rendered"], 1.5 * one["rendered"])
        self.assertIn(b"two eyes take", self.succeeds(*args, "--stereo", "0.06").stdout)
        near = self.json_of(*args, "--stereo", "0.06", "--fovea", "8")
        self.assertEqual((one["fovea"], near["fovea"]), (None, 8))
        times = near["warm"]["frame_ms"]["p50"] / near["stereo"]["one_eye_foveated"]["frame_ms"]["p50"]
        self.assertAlmostEqual(near["stereo"]["ratio_to_one_eye_foveated"], times)

    def test_bench_rejects_steps_where_the_backend_lacks_them(self):
        # It fails at once, not after a million frames.
        self.fails(5, "'cpu' cannot profile its steps", "bench", self.fixture("tiny.stgs"),
                   "--steps", "--backend", "cpu", "--num-frames", "1000000")

    def test_bench_stores_more_primitives_than_are_active(self):
        args = ["bench", self.fixture("tiny.stgs"), "--num-frames", "5", "--size", "32x24"]
        one, many = (self.json_of(*args, "--stored-ratio", n) for n in ("1", "20"))
        self.assertEqual(many["primitives"], 20 * one["primitives"])
        # Some opacities are too low to render; some lifespans only touch the sampled times.
        self.assertLessEqual(one["active"], one["primitives"])
        self.assertAlmostEqual(many["active"], one["active"], delta=0.02 * one["active"])
        self.fails(USAGE, "--animate excludes --stored-ratio", *args, "--stored-ratio", "2", "--animate")

    def test_bench_plays_through_the_timeline_and_the_player(self):
        scene = self.fixture("tiny.stgs")
        for through in ("timeline", "player"):
            with self.subTest(through=through):
                play = self.json_of("bench", scene, "--play", through, "--frames", "9", "--refresh",
                                    "50", "--rate", "2", "--size", "32x24",
                                    "--backend", "cpu")["play"]
                # Nine frames of 1/30 s at rate 2.
                self.assertEqual(play["refreshes"], 8)
                self.assertLessEqual(play["rendering"]["frame_ms"]["p99"], play["max_ms"])
                self.assertLessEqual(play["fetch_share"], 1)
                self.assertEqual(play["failed_reads"], 0)
                if through == "timeline":
                    self.assertEqual(play["incomplete"], 0)
        # A CPU cannot render a frame of this size in 0.1 ms.
        late = self.json_of("bench", scene, "--play", "timeline", "--frames", "1", "--refresh",
                            "10000", "--size", "640x480", "--backend", "cpu")["play"]
        self.assertEqual(late["missed"], late["refreshes"])
        # At a low refresh rate, both render the same times.
        slow = [self.json_of("bench", self.fixture("longer.stgs"), "--play", through, "--frames",
                             "60", "--refresh", "2.2", "--size", "32x24", "--backend", "cpu",
                             "--stereo", "0.06") for through in ("timeline", "player")]
        self.assertEqual(slow[0]["active"], slow[1]["active"])
        self.assertEqual((play["eye_distance"], slow[1]["play"]["eye_distance"]), (None, 0.06))
        text = self.succeeds("bench", scene, "--play", "player", "--frames", "2").stdout.decode()
        self.assertRegex(text, r"2 frames at rate 1, 100 refreshes/s: \d of 7 ")
        self.fails(USAGE, "--frames requires --play", "bench", scene, "--frames", "9")
        self.fails(USAGE, "--num-frames excludes --play", "bench", scene, "--play", "player",
                   "--num-frames", "9")
        self.fails(USAGE, r"takes 3\.33e\+10 refreshes .at most 10000000", "bench", scene, "--play",
                   "timeline", "--frames", "1000000", "--rate", "0.01", "--refresh", "10000")
        camera = self.write("camera.json", json.dumps(self.json_of("info", scene)))
        self.fails(USAGE, "uses one camera, not 2", "bench", scene, "--play", "player",
                   "--camera", camera, "--camera", camera)

    def test_compare_measures_scenes_and_images(self):
        tiny, packed = self.fixture("tiny.stgs"), self.fixture("packed.stgs")
        same = self.json_of("compare", tiny, tiny, "--min-psnr", "100")
        self.assertEqual(same["psnr"], 100)
        self.assertEqual(same["max_difference"], 0)
        near = self.json_of("compare", tiny, packed)
        self.assertEqual(near["primitives"][0], 400)
        self.assertGreater(near["primitives"][1], 390)  # packing omits primitives that are never visible
        self.assertLess(near["psnr"], 100)
        self.fails(7, "is below 99", "compare", tiny, packed, "--min-psnr", "99")
        self.fails(7, "lasts", "compare", tiny, self.fixture("longer.stgs"))
        self.succeeds("render", tiny, "--time", "0", "-o", "a.png")
        self.succeeds("render", tiny, "--time", "0.1", "-o", "b.png")
        self.assertLess(self.json_of("compare", "a.png", "b.png")["psnr"], 60)
        self.succeeds("render", tiny, "--time", "0", "--size", "32x24", "-o", "small.png")
        self.fails(7, "a.png is 64x48, small.png is 32x24", "compare", "a.png", "small.png")
        if harness.built_in("exr"):
            self.succeeds("render", tiny, "--time", "0", "-o", "a.exr")
            self.fails(3, r"nan.exr: channel G of pixel \(3, 2\) is -?nan", "compare",
                       self.fixture("nan.exr"), self.fixture("nan.exr"), "--min-psnr", "40")
            # Half floats and linear light lose less than rounding to 8 bits.
            self.assertGreater(self.json_of("compare", "a.png", "a.exr")["psnr"], 55)


class Rendering(CliTest):
    def test_renders_do_not_depend_on_the_source_of_the_camera(self):
        tiny = self.fixture("tiny.stgs")
        info = self.json_of("info", tiny)
        self.write("info.json", json.dumps(info))
        self.write("start.json", json.dumps(info["start_camera"]))
        self.succeeds("render", tiny, "--time", "0", "-o", "default.png")
        for camera in ("info.json", "start.json"):
            self.succeeds("render", tiny, "--time", "0", "--camera", camera, "-o", "out.png")
            self.assertEqual(self.read("out.png"), self.read("default.png"))
        self.succeeds("render", tiny, "--frames", "0:1", "--cameras", self.fixture("prepared"),
                      "--which", "b", "-o", "out.png")
        self.assertEqual(self.read("out.png"), self.read("default.png"))
        with open(os.path.join(self.fixture("prepared"), "frames/b/000000.png"), "rb") as file:
            self.assertEqual(file.read(), self.read("default.png"))

    def test_several_cameras_render_to_folders(self):
        report = self.json_of("render", self.fixture("tiny.stgs"), "--frames", "0:", "--cameras",
                              self.fixture("prepared"), "--which", "all", "-o", "out/")
        self.assertEqual(report["images"], 18)
        self.assertEqual(sorted(os.listdir(self.path("out"))), ["a", "b", "c"])
        self.assertEqual(len(os.listdir(self.path("out", "c"))), 6)
        self.assertGreater(report["peak_memory"], 1 << 20)

    def test_y4m_contains_the_selected_frames(self):
        result = self.succeeds("render", self.fixture("tiny.stgs"), "--frames", "1:4", "-o", "-")
        header, rest = result.stdout.split(b"\n", 1)
        self.assertEqual(header, b"YUV4MPEG2 W64 H48 F30:1 Ip A1:1 C444 XCOLORRANGE=LIMITED")
        self.assertEqual(len(rest), 3 * (len(b"FRAME\n") + 3 * 64 * 48))
        self.assertIn(b"3 images", result.stderr)
        self.succeeds("render", self.fixture("tiny.stgs"), "--frames", "1:4", "-o", "out.y4m")
        self.assertEqual(self.read("out.y4m"), result.stdout)

    def test_a_white_y4m_is_white(self):
        empty = ["render", self.fixture("tiny.stgs"), "--time", "0", "--camera", "away.json"]
        self.write("away.json", json.dumps({
            "width": 16, "height": 16, "fx": 16, "fy": 16, "cx": 8, "cy": 8,
            "rotation": [-1, 0, 0, 0, 1, 0, 0, 0, -1], "translation": [0, 0, -50]}))
        result = self.succeeds(*empty, "--background", "1,1,1", "-o", "-")
        frame = result.stdout.split(b"FRAME\n")[1]
        self.assertEqual(set(frame[:256]), {235})
        self.assertEqual(set(frame[256:]), {128})

    def test_side_by_side_doubles_the_width(self):
        self.succeeds("render", self.fixture("tiny.stgs"), "--frames", "2:3", "--cameras",
                      self.fixture("prepared"), "--side-by-side", "-o", "both.png")
        width, height = (int.from_bytes(self.read("both.png")[i:i + 4], "big") for i in (16, 20))
        self.assertEqual((width, height), (128, 48))

    def test_mp4_is_written_with_even_sizes(self):
        if not harness.built_in("mp4"):
            self.fails(6, "has no mp4", "render", self.fixture("tiny.stgs"), "--frames", "0:2",
                       "-o", "out.mp4")
            return
        self.succeeds("render", self.fixture("tiny.stgs"), "--frames", "0:6", "-o", "out.mp4")
        self.assertIn(b"ftyp", self.read("out.mp4")[:16])
        self.fails(1, "mp4 needs an even width and height, not 33x24", "render", self.fixture("tiny.stgs"),
                   "--frames", "0:2", "--size", "33x24", "-o", "odd.mp4")

    def test_exr_contains_colour_alpha_and_depth(self):
        if not harness.built_in("exr"):
            self.fails(6, "has no EXR", "render", self.fixture("tiny.stgs"), "--time", "0", "-o",
                       "out.exr")
            return
        self.succeeds("render", self.fixture("tiny.stgs"), "--time", "0", "-o", "out.exr")
        data = self.read("out.exr")
        self.assertEqual(data[:4], b"\x76\x2f\x31\x01")
        for channel in (b"R\0\1", b"A\0\1", b"Z\0\2"):  # 1: half, 2: float
            self.assertIn(channel, data[:1000])

    def test_progress_lines_follow_their_schema(self):
        result = self.succeeds("render", self.fixture("tiny.stgs"), "--frames", "0:6", "-o", "null",
                               "--progress", "json")
        lines = [json.loads(line) for line in result.stderr.decode().splitlines()]
        for line in lines:
            self.check_schema("progress", line)
        self.assertEqual(lines[-1]["done"], 1)

    def test_an_interrupted_video_preserves_the_old_file(self):
        self.write("out.y4m", b"old")
        args = [harness.STGS, "render", self.fixture("tiny.stgs"), "--frames", "0:6", "--size",
                "1280x720", "-o", "out.y4m", "--progress", "json"]
        with subprocess.Popen(args, cwd=self.work, stderr=subprocess.PIPE) as process:
            process.stderr.readline()  # the first frame is done
            process.send_signal(signal.SIGINT)
            error = process.stderr.read().decode()
        self.assertEqual(process.returncode, 4, error)
        self.assertIn("interrupted", error)
        self.assertEqual(self.read("out.y4m"), b"old")
        self.assert_no_leftovers()


if __name__ == "__main__":
    unittest.main()
