# SPDX-License-Identifier: Apache-2.0
"""Training and encoding: what they refuse, what they leave, and what an interruption does."""
import json
import os
import re
import signal
import subprocess
import unittest
import urllib.parse
import xml.etree.ElementTree

import harness
from harness import CliTest

USAGE, IO, INVALID, RUNTIME = 1, 2, 3, 4


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
            (USAGE, "--output is required", ["train", prepared]),
            (USAGE, "--preset: 'slow' is not one of", self.train("--preset", "slow")),
            (USAGE, "--ablate: 'colour' is not one of", self.train("--ablate", "colour")),
            (USAGE, "--iterations: 0 is out of range", self.train("--iterations", "0")),
            (USAGE, "expected KEY=VALUE", self.train("--set", "lambda")),
            (USAGE, "conflicts with --iterations",
             self.train("--set", "iterations=5", "--iterations", "2")),
            (USAGE, "--set lr_radius=1 has no effect with --ablate lifespan",
             self.train("--set", "lr_radius=1", "--ablate", "lifespan")),
            (USAGE, "--set plain_reset=.2 has no effect without --ablate densification",
             self.train("--set", "plain_reset=.2")),
            (USAGE, "--set perceptual_patch=64 has no effect without --perceptual-weights",
             self.train("--set", "perceptual_patch=64")),
            (USAGE, "unknown hyper-parameter", self.train("--set", "zzz=1")),
            (USAGE, r"hyper-parameter iterations is out of range \(expected 1 to",
             self.train("--set", "iterations=0")),
            (USAGE, "--checkpoint-interval requires --checkpoint",
             self.train("--checkpoint-interval", "5")),
            (IO, "not a prepared capture", ["train", "empty", "-o", "o.stgs"]),
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
                ("--checkpoint", "--log", [*train, "--checkpoint", "a", "--log", "./a"]),
                ("--output", "--checkpoint", ["encode", harness.sample(), "-o", "scene.stgs",
                                              "--checkpoint", "link.ckpt"]),
                ("--keep-work", "--checkpoint", ["encode", harness.sample(), "-o", "b.stgs",
                                                 "--keep-work", "w", "--checkpoint",
                                                 "w/../w/trained.stgs"])]:
            with self.subTest(args=args):
                if "w" in args:
                    os.mkdir(self.path("w"))
                self.fails(USAGE, f"used by both {one} and {other}", *args)
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
        with_them = self.json_of(*args, "--log", "log.jsonl", "--num-evals", "2")
        scene = self.read("out.stgs")
        measures = [line for line in self.log("log.jsonl") if "held_out" in line]
        self.assertEqual([line["iteration"] for line in measures], [10, 20])
        self.assertEqual(measures[-1]["held_out"], with_them["held_out"])
        # The sample is the one test camera's six frames: what evaluate measures.
        report = self.json_of("evaluate", "out.stgs", "--against", self.fixture("prepared"))
        self.assertAlmostEqual(report["psnr"], with_them["held_out"]["psnr"], 3)
        self.assertAlmostEqual(report["psnr_cc"], with_them["held_out"]["psnr_cc"], 3)
        shown = self.succeeds(*args, "--num-evals", "2", "--progress", "json").stderr.decode()
        last = [line for line in shown.splitlines() if '"stage":"train"' in line][-1]
        self.assertRegex(last, r"held-out psnr \d+\.\d\d dB")
        without = self.json_of(*args, "--num-evals", "0")
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
            self.fails(USAGE, "expected for example 512M or 8G", *args, f"--frame-memory={size}")

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
        self.assertIn(f"{100 * motion['static']['share']:.1f} %: visible in every frame", text)
        self.assertIn("whole clip", text)
        self.assertEqual(len(self.log("a <b>/page/training.jsonl")), 4 + 5)
        for frame in range(6):
            truth = self.fixture(f"prepared/frames/c/{frame:06}.png")
            same = self.json_of("compare", f"a <b>/page/ground_truth_c_{frame:06}.png", truth)
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
        self.assertIn("Training cameras (none was held out)", self.page("page"))
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
        self.fails(USAGE, "'lifespan' is given twice", *args, "--ablate", "lifespan,lifespan")
        self.fails(USAGE, "--ablate: modulation has no effect together with representation",
                   *args, "--ablate", "representation,modulation")
        self.fails(USAGE, "--ablate: 'magic' is not one of", *args, "--ablate", "lifespan,magic")
        self.fails(USAGE, "has no dynamic points", *args, "--ablate", "lifespan,initialisation")

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
        args = [harness.STGS, "encode", harness.sample(), "-o", "out.stgs", "--progress", "json",
                "--scale", "0.25", "--frames", "0:6", "--iterations", "10"]
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
                self.assertRegex(error, r"(?m)^stgs: error: interrupted by SIG(INT|TERM): ")
                self.assertEqual(f"{left[0]}: removed" in error, stage == "train", error)
                self.assertEqual(self.read("out.stgs"), b"old")
                self.assertEqual(sorted(os.listdir(self.work)), sorted(["out.stgs", *kept]))

    def test_an_encode_leaves_its_file_and_its_report(self):
        report = self.json_of("encode", harness.sample(), "-o", "out.stgs", "--scale", "0.25",
                              "--frames", "0:2", "--preset", "fast", "--iterations", "10",
                              "--report", "page")
        self.assertEqual(report["train"]["held_out"]["images"], 2)
        self.assertEqual(report["report"], "page")
        self.assertIn("Test cameras: render and ground truth", self.page("page"))
        self.assertEqual(sorted(os.listdir(self.work)), ["out.stgs", "page"])

    def test_what_encode_refuses(self):
        self.fails(IO, "cannot create", "encode", harness.sample(), "-o", "/proc/out.stgs")
        self.write("rubbish", b"rubbish" * 100)
        encode = ["encode", harness.sample(), "-o", "o.stgs", "--progress", "json"]
        for code, message, more in [
                (USAGE, "--quality: 500 is out of range", ["--quality", "500"]),
                (USAGE, "--set lr_time=soon: invalid value", ["--set", "lr_time=soon"]),
                (USAGE, "hyper-parameter iterations is out of range", ["--set", "iterations=0"]),
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
        self.succeeds("encode", harness.sample(), "-o", "out.stgs", *prepare, *train,
                      "--keep-work", "work")
        self.succeeds("train", "work/prepared", "-o", "trained.stgs", *train)
        self.assertEqual(self.read("trained.stgs"), self.read("work/trained.stgs"))


if __name__ == "__main__":
    unittest.main()
