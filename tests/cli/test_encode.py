# SPDX-License-Identifier: Apache-2.0
"""From a capture to a file: what the verbs refuse, and what an interruption leaves."""
import json
import os
import re
import shutil
import signal
import subprocess
import time
import unittest
import urllib.parse
import xml.etree.ElementTree

import harness
from harness import CliTest, built_in

USAGE, IO, INVALID, RUNTIME, NOT_BUILT = 1, 2, 3, 4, 6


def sample():
    return os.path.join(harness.SOURCE, "tests", "data", "workshop")


class Packing(CliTest):
    def test_pack(self):
        report = self.json_of("pack", self.fixture("tiny.stgs"), "-o", "out.stgs")
        self.assertEqual(report["bytes_out"], os.path.getsize(self.path("out.stgs")))
        self.assertLess(report["bytes_out"], report["bytes_in"])
        before = self.json_of("info", self.fixture("tiny.stgs"))["primitives"]
        self.assertEqual(report["primitives"] + report["dropped"], before)
        self.assertEqual(self.json_of("info", "out.stgs")["primitives"], report["primitives"])
        self.json_of("validate", "out.stgs")
        self.succeeds("compare", self.fixture("tiny.stgs"), "out.stgs", "--min-psnr", "30")

    def test_quality_orders_size_and_error(self):
        low = self.json_of("pack", self.fixture("tiny.stgs"), "-o", "low.stgs", "--quality", "20")
        high = self.json_of("pack", self.fixture("tiny.stgs"), "-o", "high.stgs", "--quality", "95")
        self.assertLess(low["bytes_out"], high["bytes_out"])
        self.assertGreater(low["errors"]["colour_rms"], high["errors"]["colour_rms"])

    def test_pack_says_what_the_space_is(self):
        tiny = self.fixture("tiny.stgs")
        self.assertIsNone(self.json_of("info", tiny)["metres_per_unit"])
        self.succeeds("pack", tiny, "-o", "out.stgs", "--metres-per-unit", "0.25", "--up", "0,-3,4",
                      "--floor", "0,1.5,0")
        info = self.json_of("info", "out.stgs")
        self.assertEqual(info["metres_per_unit"], 0.25)
        for value, wanted in zip(info["up"] + info["floor"], (0, -0.6, 0.8, 0, 1.5, 0)):
            self.assertAlmostEqual(value, wanted, 6)
        self.assertRegex(self.succeeds("info", "out.stgs").stdout.decode(), r"unit +0.25 m\n +up ")
        self.succeeds("pack", "out.stgs", "-o", "again.stgs")  # it is kept
        self.assertEqual(self.json_of("info", "again.stgs")["floor"], info["floor"])
        self.assertIsNone(info["sound"])
        self.succeeds("pack", "out.stgs", "-o", "loud.stgs", "--sound", "../a.opus", "--sound-at", "-0.5")
        self.succeeds("pack", "loud.stgs", "-o", "again.stgs")
        self.assertEqual(self.json_of("info", "again.stgs")["sound"], {"place": "../a.opus", "begin_s": -0.5})
        self.assertRegex(self.succeeds("info", "again.stgs").stdout.decode(), r"sound +../a.opus, from -0.500 s")
        self.assertRegex(self.succeeds("convert", "again.stgs", "x.ply", "--time", "0").stderr.decode(),
                         "where the sound is")
        self.fails(1, "--sound", "pack", tiny, "-o", "x.stgs", "--sound-at", "1")
        self.fails(1, "points nowhere", "pack", tiny, "-o", "x.stgs", "--up", "0,0,0")
        self.fails(1, "give an up vector", "pack", tiny, "-o", "x.stgs", "--floor", "0,0,0")

    def test_pack_to_a_rate_and_an_error(self):
        tiny = self.fixture("tiny.stgs")
        free = self.json_of("pack", tiny, "-o", "free.stgs")
        self.assertEqual(free["quality"], 87)
        self.assertEqual(free["held_out"], {"before": None, "after": None})
        report = self.json_of("pack", tiny, "-o", "o.stgs", "--target-kbps",
                              str(0.9 * free["kbps"]), "--max-error", "2")
        self.assertLessEqual(report["kbps"], 0.9 * free["kbps"])
        self.assertLess(report["quality"], 87)
        self.assertLessEqual(report["errors"]["position_max"], 0.002)
        self.fails(USAGE, "kbit/s is too little", "pack", tiny, "-o", "none.stgs",
                   "--target-kbps", "0.1")
        self.assertFalse(os.path.exists(self.path("none.stgs")))
        self.fails(USAGE, "excludes", "pack", tiny, "-o", "none.stgs", "--target-kbps", "10",
                   "--quality", "10")

    def test_pack_measures_on_the_capture_of_the_scene_alone(self):
        prepared = self.fixture("prepared")
        report = self.json_of("pack", self.fixture("tiny.stgs"), "-o", "o.stgs", "--against",
                              prepared)
        held_out = report["held_out"]
        self.assertGreater(held_out["before"]["psnr"], 0)
        self.assertEqual(held_out["before"]["pictures"], held_out["after"]["pictures"])
        for code, message, scene, against in (
                (USAGE, "do not belong together", "longer.stgs", prepared),
                (IO, "none", "tiny.stgs", "none")):
            self.fails(code, message, "pack", self.fixture(scene), "-o", "none.stgs", "--against",
                       against)
            self.assertFalse(os.path.exists(self.path("none.stgs")))

    def test_packing_what_is_packed_is_warned_of(self):
        first = self.stgs("pack", self.fixture("tiny.stgs"), "-o", "one.stgs")
        self.assertNotIn(b"warning", first.stderr)
        again = self.stgs("pack", "one.stgs", "-o", "two.stgs", "--format", "json")
        self.assertEqual(again.returncode, 0)
        self.assertIn(b"stgs: warning: one.stgs: is packed already", again.stderr)
        self.assertEqual(json.loads(again.stdout)["input_profile"], "quantised")

    @unittest.skipUnless(built_in("draco"), "needs libdraco")
    def test_the_profile_draco_is_the_same_scene(self):
        tiny = self.fixture("tiny.stgs")
        ours = self.json_of("pack", tiny, "-o", "ours.stgs")
        report = self.json_of("pack", tiny, "-o", "draco.stgs", "--profile", "draco")
        self.assertEqual(report["errors"], ours["errors"])
        self.assertEqual(report["bytes_out"], os.path.getsize(self.path("draco.stgs")))
        self.assertEqual(self.json_of("info", "draco.stgs")["profile"], "draco")
        self.assertEqual(self.json_of("info", "ours.stgs")["profile"], "quantised")
        self.json_of("validate", "draco.stgs")
        for name in ("ours", "draco"):
            self.succeeds("convert", name + ".stgs", name + ".ply", "--time", "0.1")
        self.assertEqual(self.read("ours.ply"), self.read("draco.ply"))

    @unittest.skipIf(built_in("draco"), "libdraco is there")
    def test_the_profile_draco_is_not_built(self):
        scene = os.path.join(harness.SOURCE, "tests", "data", "draco", "draco.stgs")
        self.assertEqual(self.json_of("info", scene)["profile"], "draco")
        self.fails(NOT_BUILT, "need libdraco", "validate", scene)
        self.fails(NOT_BUILT, "need libdraco", "convert", scene, "o.ply", "--time", "0")
        self.fails(NOT_BUILT, "need libdraco", "pack", self.fixture("tiny.stgs"), "-o",
                   "o.stgs", "--profile", "draco")
        self.fails(NOT_BUILT, "need libdraco", "encode", sample(), "-o", "o.stgs", "--profile", "draco")
        self.assertEqual(os.listdir(self.work), [])

    def test_what_pack_refuses(self):
        tiny = self.fixture("tiny.stgs")
        self.fails(USAGE, "--quality: 101 is out of range", "pack", tiny, "-o", "o.stgs",
                   "--quality", "101")
        self.fails(USAGE, "--profile: lossless not in", "pack", tiny, "-o", "o.stgs",
                   "--profile", "lossless")
        self.fails(USAGE, "--output is required", "pack", tiny)
        self.fails(IO, "none.stgs: cannot open", "pack", "none.stgs", "-o", "o.stgs")
        self.fails(INVALID, "huge_count.stgs", "pack", self.fixture("huge_count.stgs"), "-o",
                   "o.stgs")
        self.fails(IO, "cannot create", "pack", tiny, "-o", "/proc/o.stgs")
        self.assertEqual(os.listdir(self.work), [])


class Preparing(CliTest):
    def setUp(self):
        super().setUp()
        if not harness.built_in("prepare"):
            self.fails(NOT_BUILT, "cannot prepare captures: install OpenCV", "prepare", self.work,
                       "-o", "out")
            self.skipTest("prepare is not built in")

    def test_what_prepare_refuses(self):
        os.mkdir(self.path("empty"))
        os.mkdir(self.path("text"))
        self.write("text/notes.txt", "no video")
        self.write("file", b"")
        cases = [
            (USAGE, "'film' is not a layout", ["empty", "--layout", "film"]),
            (USAGE, "--scale: 0 is out of range", ["empty", "--scale", "0"]),
            (USAGE, "--scale: 2 is out of range", ["empty", "--scale", "2"]),
            (USAGE, "'5' is not a range of frames", ["empty", "--frames", "5"]),
            (USAGE, "frames 5:2 hold nothing", ["empty", "--frames", "5:2"]),
            (USAGE, "empty: is not a capture of a known layout", ["empty"]),
            (USAGE, "text: is not a capture of a known layout", ["text"]),
            (IO, "missing: does not exist; name the folder that holds", ["missing"]),
            (IO, "file: is not a folder", ["file"]),
        ]
        for code, message, args in cases:
            with self.subTest(args=args):
                self.fails(code, message, "prepare", *args, "-o", "out")
                self.assertFalse(os.path.exists(self.path("out")))
                self.no_leftovers()
        for output in ("/proc/out", "file/out"):
            self.fails(IO, f"^stgs: error: {output}: cannot create: ", "prepare", sample(), "-o", output)

    def test_a_video_that_is_none(self):
        shutil.copytree(sample(), self.path("capture"))
        self.write("capture/cam03.mp4", b"no video at all" * 100)
        args = ["prepare", "capture", "-o", "out"]
        result = self.fails(INVALID, "cam03.mp4: cannot open the video of camera 'cam03'", *args)
        self.assertEqual(self.foreign_lines(result), [])
        self.assertFalse(os.path.exists(self.path("out")))
        # Its index is whole, its pictures are not.
        self.write("capture/cam03.mp4", self.read("capture/cam04.mp4")[:30000])
        result = self.fails(INVALID, "cam03.mp4: cannot decode frame 0 of camera 'cam03'", *args)
        self.assertEqual(self.foreign_lines(result), [])

    def foreign_lines(self, result):
        """What libraries wrote to standard error past us."""
        lines = result.stderr.decode().splitlines()
        return [line for line in lines if not line.startswith("stgs: ")]

    def test_a_killed_prepare_takes_colmap_with_it(self):
        os.mkdir(self.path("bin"))
        self.write("bin/colmap", "#!/bin/sh\necho $$ > \"$PID_FILE\"\nexec sleep 300\n")
        os.chmod(self.path("bin/colmap"), 0o755)
        shutil.copytree(sample(), self.path("capture"))
        os.remove(self.path("capture/poses_bounds.npy"))  # so that COLMAP calibrates
        environment = dict(os.environ, PATH=self.path("bin") + ":" + os.environ["PATH"],
                           PID_FILE=self.path("pid"))
        args = [harness.STGS, "prepare", "capture", "-o", "out", "--scale", "0.25"]
        with subprocess.Popen(args, cwd=self.work, env=environment,
                              stderr=subprocess.DEVNULL) as process:
            self.wait_until(lambda: os.path.exists(self.path("pid")) and self.read("pid"))
            child = int(self.read("pid"))
            process.kill()
        self.wait_until(lambda: not self.lives(child))

    def lives(self, pid):
        """Whether a process runs; one that has ended and waits for its parent does not."""
        try:
            with open(f"/proc/{pid}/stat", encoding="utf-8") as file:
                return file.read().rsplit(")", 1)[1].split()[0] != "Z"
        except FileNotFoundError:
            return False

    def wait_until(self, condition):
        for _ in range(1200):
            if condition():
                return
            time.sleep(0.05)
        self.fail("did not come about within a minute")

    def test_an_existing_folder_is_not_overwritten_unasked(self):
        os.mkdir(self.path("out"))
        self.write("out/notes.txt", "mine")
        self.fails(USAGE, "out: exists and is not a prepared capture", "prepare", sample(), "-o",
                   "out", "--frames", "0:2")
        self.assertEqual(os.listdir(self.path("out")), ["notes.txt"])

    def interrupt(self, process, signal_number):
        """Sends the signal once the work has begun, and returns what it printed."""
        process.stderr.readline()
        for _ in range(2):  # as a terminal and timeout(1) do: to the process and to its group
            process.send_signal(signal_number)
        error = process.stderr.read().decode()
        process.wait()
        return error

    def test_what_a_killed_prepare_left_is_removed(self):
        left = "out.partial-999999999"  # no process has such an id
        os.makedirs(self.path(left, "frames"))
        os.makedirs(self.path("out.partial-notes"))
        self.fails(USAGE, "frames", "prepare", sample(), "-o", "out", "--frames", "0:999")
        self.assertEqual(os.listdir(self.work), ["out.partial-notes"])

    def test_an_interrupted_prepare_leaves_nothing(self):
        args = [harness.STGS, "prepare", sample(), "-o", "out", "--progress", "json"]
        with subprocess.Popen(args, cwd=self.work, stderr=subprocess.PIPE) as process:
            error = self.interrupt(process, signal.SIGTERM)
        self.assertEqual(process.returncode, RUNTIME, error)
        self.assertIn("stgs: error: interrupted", error)
        self.assertEqual(os.listdir(self.work), [])


class Paging(CliTest):
    def page(self, folder):
        """index.html, which must stand alone: no script, nothing from elsewhere, no lost file."""
        text = self.read(os.path.join(folder, "index.html")).decode()
        self.assertNotRegex(text, r"<script|https?:|<link|@import")
        for name in re.findall(r'src="([^"]+)"', text):
            self.assertTrue(os.path.exists(self.path(folder, urllib.parse.unquote(name))), name)
        for svg in re.findall(r"<svg.*?</svg>", text, re.DOTALL):
            xml.etree.ElementTree.fromstring(svg)
        return text


class Training(Paging):
    def train(self, *more):
        return ["train", self.fixture("prepared"), "-o", "out.stgs", "--preset", "fast", *more]

    def test_train_makes_a_lossless_scene(self):
        report = self.json_of(*self.train("--iterations", "20", "--max-primitives", "300"))
        self.assertEqual(report["iterations"], 20)
        self.assertRegex(report["backend"], r"^(cpu|cuda) \(.+\)$")
        self.assertEqual(report["bytes"], os.path.getsize(self.path("out.stgs")))
        info = self.json_of("info", "out.stgs")
        self.assertEqual(info["profile"], "lossless")
        self.assertEqual(info["primitives"], report["primitives"])
        self.json_of("validate", "out.stgs")
        first = self.read("out.stgs")
        self.succeeds(*self.train("--iterations", "20", "--max-primitives", "300", "--threads",
                                  "1"))
        self.assertEqual(self.read("out.stgs"), first, "the same seed, another scene")

    def test_parameters_are_listed(self):
        report = self.json_of("train", "--list-parameters", "--preset", "fast")
        self.assertGreater(len(report["parameters"]), 5)

    def test_what_train_refuses(self):
        os.mkdir(self.path("empty"))
        self.write("rubbish", b"rubbish" * 100)
        prepared = self.fixture("prepared")
        cases = [
            (USAGE, "DIR, the prepared capture, is required", ["train", "-o", "o.stgs"]),
            (USAGE, "--output, the file to make, is required", ["train", prepared]),
            (USAGE, "--preset: slow not in", self.train("--preset", "slow")),
            (USAGE, "--ablate: colour not in", self.train("--ablate", "colour")),
            (USAGE, "--iterations: 0 is out of range", self.train("--iterations", "0")),
            (USAGE, "write KEY=VALUE", self.train("--set", "lambda")),
            (USAGE, "the option of that name is given too",
             self.train("--set", "iterations=5", "--iterations", "2")),
            (USAGE, "--set lr_radius=1 has no effect with --ablate lifespan",
             self.train("--set", "lr_radius=1", "--ablate", "lifespan")),
            (USAGE, "--set plain_reset=.2 has no effect without --ablate densification",
             self.train("--set", "plain_reset=.2")),
            (USAGE, "--set perceptual_patch=64 has no effect without --perceptual-weights",
             self.train("--set", "perceptual_patch=64")),
            (USAGE, "no such hyper-parameter", self.train("--set", "zzz=1")),
            (USAGE, "the hyper-parameter iterations is 0; it must be from 1 to",
             self.train("--set", "iterations=0")),
            (USAGE, "--checkpoint-interval requires --checkpoint",
             self.train("--checkpoint-interval", "5")),
            (IO, "is not a prepared capture", ["train", "empty", "-o", "o.stgs"]),
            (IO, "cannot create", ["train", prepared, "-o", "/proc/o.stgs"]),
            (IO, "none.ckpt", self.train("--resume", "none.ckpt")),
            (INVALID, "rubbish", self.train("--resume", "rubbish")),
        ]
        for code, message, args in cases:
            with self.subTest(args=args):
                self.fails(code, message, *args)
        self.assertEqual(sorted(os.listdir(self.work)), ["empty", "rubbish"])

    def test_outputs_that_are_one_file_are_refused(self):
        self.write("scene.stgs", b"old")
        os.mkdir(self.path("sub"))
        os.symlink(self.work, self.path("sub/up"))
        os.symlink("scene.stgs", self.path("link.ckpt"))
        train = ["train", self.fixture("prepared"), "-o", "scene.stgs", "--preset", "fast"]
        for one, other, args in [
                ("--output", "--checkpoint", [*train, "--checkpoint", "scene.stgs"]),
                ("--output", "--checkpoint", [*train, "--checkpoint", "link.ckpt"]),
                ("--output", "--checkpoint", [*train, "--checkpoint", "sub/up/scene.stgs"]),
                ("--output", "--log", [*train, "--log", "sub/../scene.stgs"]),
                ("--output", "--resume", [*train, "--resume", "link.ckpt"]),
                ("--output", "--report", ["train", self.fixture("prepared"), "-o", "new",
                                          "--report", "new"]),
                ("--output", "--report", ["train", self.fixture("prepared"), "-o",
                                          "sub/index.html", "--report", "sub"]),
                ("--checkpoint", "--log", [*train, "--checkpoint", "a", "--log", "./a"]),
                ("--output", "--checkpoint", ["encode", sample(), "-o", "scene.stgs",
                                              "--checkpoint", "link.ckpt"]),
                ("--keep-work", "--checkpoint", ["encode", sample(), "-o", "b.stgs", "--keep-work",
                                                 "w", "--checkpoint", "w/../w/trained.stgs"])]:
            with self.subTest(args=args):
                if "w" in args:
                    os.mkdir(self.path("w"))
                self.fails(USAGE, f"is where both {one} and {other} lead", *args)
        self.assertEqual(self.read("scene.stgs"), b"old")
        self.assertEqual(sorted(os.listdir(self.work)), ["link.ckpt", "scene.stgs", "sub", "w"])

    def test_a_killed_train_goes_on_to_the_same_bytes(self):
        """SIGKILL anywhere, twice; the log and the scene end as those of an unbroken run."""
        options = ["--iterations", "2000", "--max-primitives", "300", "--set",
                   "densify_interval=20"]
        self.succeeds(*self.train(*options, "--log", "whole.jsonl"))
        os.rename(self.path("out.stgs"), self.path("whole.stgs"))
        options += ["--log", "log.jsonl", "--checkpoint", "run.ckpt", "--checkpoint-interval",
                    "50"]
        at = 0
        for share in (0.3, 0.6):
            resume = ["--resume", "run.ckpt"] if at else []
            args = [harness.STGS, *self.train(*options, *resume, "--progress", "json")]
            with subprocess.Popen(args, cwd=self.work, stderr=subprocess.PIPE) as process:
                for line in process.stderr:
                    progress = json.loads(line) if line.startswith(b"{") else {}
                    if progress.get("stage") == "train" and progress["done"] >= share:
                        break
                process.kill()
            self.assertEqual(process.returncode, -signal.SIGKILL)
            self.assertFalse(os.path.exists(self.path("out.stgs")))
            before, at = at, int.from_bytes(self.iteration("run.ckpt"), "little")
            self.assertGreater(at, before)
            self.assertLess(at, 2000)
        # What a kill leaves of a checkpoint that is being written goes with the next run.
        self.write(f".run.{process.pid}.tmp.ckpt", b"half a checkpoint")
        self.succeeds(*self.train(*options, "--resume", "run.ckpt"))
        self.assertEqual(self.read("out.stgs"), self.read("whole.stgs"))
        self.assertEqual(self.log("log.jsonl"), self.log("whole.jsonl"))

    def iteration(self, checkpoint):
        """Its 8 bytes: after the magic and the fingerprint."""
        data = self.read(checkpoint)
        at = 16 + int.from_bytes(data[8:16], "little")
        return data[at:at + 8]

    def log(self, name):
        """The lines of a log, each by its schema, without what the clock gave."""
        lines = [json.loads(line) for line in self.read(name).splitlines()]
        for line in lines:
            self.check_schema("training_log", line)
            del line["seconds"]
        return lines

    def test_held_out_views_are_measured_and_change_nothing(self):
        args = self.train("--iterations", "20", "--max-primitives", "300")
        with_them = self.json_of(*args, "--log", "log.jsonl", "--held-out", "2")
        scene = self.read("out.stgs")
        measures = [line for line in self.log("log.jsonl") if "held_out" in line]
        self.assertEqual([line["iteration"] for line in measures], [10, 20])
        self.assertEqual(measures[-1]["held_out"], with_them["held_out"])
        # The sample is the one test camera's six frames: what evaluate measures.
        report = self.json_of("evaluate", "out.stgs", "--against", self.fixture("prepared"))
        self.assertAlmostEqual(report["psnr"], with_them["held_out"]["psnr"], 3)
        self.assertAlmostEqual(report["psnr_cc"], with_them["held_out"]["psnr_cc"], 3)
        shown = self.succeeds(*args, "--held-out", "2", "--progress", "json").stderr.decode()
        last = [line for line in shown.splitlines() if '"stage":"train"' in line][-1]
        self.assertRegex(last, r"held-out psnr \d+\.\d\d dB")
        without = self.json_of(*args, "--held-out", "0")
        self.assertIsNone(without["held_out"])
        self.assertEqual(self.read("out.stgs"), scene)

    def test_normals_are_trained_and_logged_where_asked_for(self):
        args = self.train("--iterations", "60", "--max-primitives", "300", "--log", "log.jsonl")
        self.succeeds(*args)
        self.assertEqual(self.normals(), [0, 0, 0])
        without = self.read("out.stgs")
        self.succeeds(*args, "--set", "weight_normal=0.01", "--set", "normal_from=0.5")
        first, *later = self.normals()
        self.assertEqual(first, 0)
        self.assertTrue(later and all(value > 0 for value in later))
        self.assertNotEqual(self.read("out.stgs"), without)
        # The coupled form has no axes of its own.
        self.fails(USAGE, "weight_normal=0.01 has no effect with --ablate representation",
                   *args, "--set", "weight_normal=0.01", "--ablate", "representation")

    def normals(self):
        return [line["normal"] for line in self.log("log.jsonl") if "normal" in line]

    def test_frames_from_disk_give_the_same_scene(self):
        args = self.train("--iterations", "20", "--max-primitives", "300")
        frames = self.json_of(*args)["frames"]
        self.assertTrue(frames["resident"])
        self.assertLess(frames["peak"], frames["budget"])
        scene = self.read("out.stgs")
        frames = self.json_of(*args, "--frame-memory", "40K")["frames"]
        self.assertFalse(frames["resident"])
        self.assertEqual(frames["budget"], 40 << 10)
        self.assertGreater(frames["peak"], 0)
        self.assertEqual(self.read("out.stgs"), scene)
        for size in ("0", "much", "-1G", "8Q", "G"):
            self.fails(USAGE, "write for example 512M or 8G", *args, f"--frame-memory={size}")

    def test_the_report_shows_the_run_and_the_final_scene(self):
        args = self.train("--iterations", "120", "--max-primitives", "300", "--seed", "3", "--set",
                          "prune_opacity=0.004", "--threads", "1", "--report", "a <b>/page")
        os.mkdir(self.path("a <b>"))
        report = self.json_of(*args)
        self.assertEqual(report["report"], "a <b>/page")
        text = self.page("a <b>/page")
        self.assertIn("<td>threads</td><td>1</td>", text)
        for title in ("Loss, running mean", "Held-out PSNR, dB", "Primitives"):
            self.assertEqual(text.count(f"<title>{title}</title>"), 2, title)  # steps, seconds
        self.assertIn("<td>prune_opacity</td><td>0.004</td>", text)
        self.assertIn("--report 'a &lt;b&gt;/page'", text)
        self.assertIn("120", text)
        motion = self.json_of("info", "out.stgs", "--lifespans")["motion"]
        self.assertIn(f"{100 * motion['static']['share']:.1f} %: they live", text)
        self.assertIn("whole clip", text)
        self.assertEqual(len(self.log("a <b>/page/training.jsonl")), 4 + 5)
        for frame in range(6):
            truth = self.fixture(f"prepared/frames/c/{frame:06}.png")
            same = self.json_of("compare", f"a <b>/page/truth_c_{frame:06}.png", truth)
            self.assertEqual(same["max_difference"], 0)
            self.succeeds("render", "out.stgs", "--frames", f"{frame}:{frame + 1}", "--cameras",
                          self.fixture("prepared"), "--which", "c", "-o", "end.png")
            self.assertEqual(self.read(f"a <b>/page/render_c_{frame:06}.png"),
                             self.read("end.png"))

    def test_a_report_without_held_out_cameras_shows_training_cameras(self):
        folder = self.copy_capture("all")
        with open(os.path.join(folder, "capture.json"), encoding="utf-8") as file:
            capture = json.load(file)
        for camera in capture["cameras"]:
            camera["test"] = False
        self.write("all/capture.json", json.dumps(capture))
        self.succeeds("train", "all", "-o", "out.stgs", "--preset", "fast", "--iterations", "5",
                      "--report", "page", "--log", "mine.jsonl")
        self.assertIn("No camera was held out", self.page("page"))
        self.assertNotIn("training.jsonl", os.listdir(self.path("page")))
        self.fails(IO, "page/index.html", "train", "all", "-o", "out.stgs", "--iterations", "1",
                   "--report", "page/index.html")

    def test_ablations_may_be_combined(self):
        args = self.train("--iterations", "20", "--max-primitives", "300")
        scenes = []
        for names in ("lifespan", "densification,lifespan", "lifespan,densification",
                      "lifespan,modulation,densification"):
            # The fixture stands still: brought to rest, it is the same with f and without.
            self.succeeds(*args, "--ablate", names, "--set", "densify_interval=2",
                          "--set", "velocity_shrink=0")
            scenes.append(self.read("out.stgs"))
        self.assertEqual(scenes[1], scenes[2])
        self.assertEqual(len(set(scenes)), 3)
        self.fails(USAGE, "names 'lifespan' twice", *args, "--ablate", "lifespan,lifespan")
        self.fails(USAGE, "--ablate modulation has no effect beside representation",
                   *args, "--ablate", "representation,modulation")
        self.fails(USAGE, "--ablate: magic not in", *args, "--ablate", "lifespan,magic")
        self.fails(USAGE, "nothing was found to move", *args, "--ablate", "lifespan,initialisation")

    def test_an_interrupted_train_writes_its_checkpoint_and_no_scene(self):
        args = [harness.STGS, *self.train("--iterations", "100000", "--checkpoint", "run.ckpt",
                                          "--progress", "json")]
        with subprocess.Popen(args, cwd=self.work, stderr=subprocess.PIPE) as process:
            for line in process.stderr:
                if b'"train"' in line:
                    break
            process.send_signal(signal.SIGINT)
            error = process.stderr.read().decode()
        self.assertEqual(process.returncode, RUNTIME, error)
        self.assertIn("stgs: error: interrupted", error)
        self.assertEqual(os.listdir(self.work), ["run.ckpt"])


class Encoding(Paging):
    def setUp(self):
        super().setUp()
        if not harness.built_in("encode"):
            self.skipTest("encode is not built in")

    def stopped(self, number, stage):
        """An encode to out.stgs that gets the signal at the first line of `stage`: its exit code
        and what it printed."""
        args = [harness.STGS, "encode", sample(), "-o", "out.stgs", "--progress", "json", "--scale",
                "0.25", "--frames", "0:6", "--iterations", "10"]
        lines = []
        with subprocess.Popen(args, cwd=self.work, stderr=subprocess.PIPE) as process:
            for line in process.stderr:
                lines.append(line)
                if f'"stage":"{stage}'.encode() in line:
                    process.send_signal(number)
                    break
            lines.append(process.stderr.read())
        return process.returncode, b"".join(lines).decode()

    def test_stopped_encodes_leave_the_old_file(self):
        """Killed in prepare, interrupted in train and in pack."""
        self.write("out.stgs", b"old")
        code, error = self.stopped(signal.SIGKILL, "")
        self.assertEqual(code, -signal.SIGKILL, error)
        self.assertEqual(self.read("out.stgs"), b"old")
        left = [name for name in os.listdir(self.work) if name != "out.stgs"]
        self.assertEqual(len(left), 1)
        self.assertRegex(left[0], r"^\.out\.stgs\.\d+\.tmp\.work$")
        # What looks alike and is not: of a process that lives, of another output, of no process.
        kept = [f".out.stgs.{os.getpid()}.tmp.work", left[0].replace("out", "in"),
                ".out.stgs.x1.tmp.work"]
        for name in kept:
            os.mkdir(self.path(name))
        for stage in ("train", "pack"):
            with self.subTest(stage=stage):
                code, error = self.stopped(signal.SIGINT, stage)
                self.assertEqual(code, RUNTIME, error)
                self.assertRegex(error, r"(?m)^stgs: error: interrupted: ")
                self.assertEqual(f"{left[0]}: removed" in error, stage == "train", error)
                self.assertEqual(self.read("out.stgs"), b"old")
                self.assertEqual(sorted(os.listdir(self.work)), sorted(["out.stgs", *kept]))

    def test_an_encode_leaves_its_file_and_its_report(self):
        report = self.json_of("encode", sample(), "-o", "out.stgs", "--scale", "0.25", "--frames",
                              "0:2", "--preset", "fast", "--iterations", "10", "--report", "page")
        self.assertEqual(report["train"]["held_out"]["pictures"], 2)
        self.assertEqual(report["report"], "page")
        self.assertIn("Test cameras, render and truth", self.page("page"))
        self.assertEqual(sorted(os.listdir(self.work)), ["out.stgs", "page"])

    def test_what_encode_refuses(self):
        self.fails(IO, "cannot create", "encode", sample(), "-o", "/proc/out.stgs")
        self.write("rubbish", b"rubbish" * 100)
        encode = ["encode", sample(), "-o", "o.stgs", "--progress", "json"]
        for code, message, more in [
                (USAGE, "--quality: 500 is out of range", ["--quality", "500"]),
                (USAGE, "'soon' is not a value for lr_time", ["--set", "lr_time=soon"]),
                (USAGE, "iterations is 0", ["--set", "iterations=0"]),
                (IO, "none.ckpt", ["--keep-work", "w", "--resume", "none.ckpt"]),
                (INVALID, "rubbish: not an STGS checkpoint",
                 ["--keep-work", "w", "--resume", "rubbish"])]:
            with self.subTest(more=more):
                result = self.fails(code, message, *encode, *more)
                self.assertNotIn(b'"stage"', result.stderr, "prepare had begun")
        self.assertEqual(os.listdir(self.work), ["rubbish"])

    def test_the_initialisation_is_ablated_as_by_the_verbs_one_by_one(self):
        prepare = ["--scale", "0.25", "--frames", "0:2"]
        train = ["--preset", "fast", "--iterations", "10", "--ablate", "initialisation"]
        self.succeeds("encode", sample(), "-o", "out.stgs", *prepare, *train, "--keep-work", "work")
        self.succeeds("train", "work/prepared", "-o", "trained.stgs", *train)
        self.assertEqual(self.read("trained.stgs"), self.read("work/trained.stgs"))


if __name__ == "__main__":
    unittest.main()
