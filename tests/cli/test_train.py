# SPDX-License-Identifier: Apache-2.0
"""What `stgs train` and its like refuse before they touch a file."""
import json
import os
import signal
import struct
import subprocess
import unittest

import harness
from harness import CliTest, built_in

USAGE, RUNTIME = 1, 4


class Capture(CliTest):
    """The capture that is trained on stays as it is."""

    def test_nothing_is_written_over_it(self):
        folder = self.copy_capture("capture")
        before = self.contents(folder)
        for option, name in [("--log", "points_static.ply"), ("--checkpoint", "capture.json"),
                             ("--report", "frames"), ("--report", "")]:
            args = ["train", folder, "--iterations", "2", option, os.path.join(folder, name)]
            with self.subTest(args=args):
                args += ["-o", "scene.stgs"]
                self.fails(USAGE, f"used by both .*{option}", *args)
                self.assertRegex(self.stgs(*args).stderr, b"DIR")
        self.fails(USAGE, "capture.json: train writes a .stgs file", "train", folder, "--iterations", "2",
                   "-o", os.path.join(folder, "capture.json"))
        self.assertEqual(self.contents(folder), before)
        self.assertEqual(os.listdir(self.work), ["capture"])

    def contents(self, folder):
        found = {}
        for at, _, names in os.walk(folder):
            for name in names:
                with open(os.path.join(at, name), "rb") as file:
                    found[os.path.join(at, name)] = file.read()
        return found

    def test_a_camera_counts_once(self):
        self.fails(USAGE, "camera 'a' is named twice", "evaluate", self.fixture("tiny.stgs"),
                   "--against", self.fixture("prepared"), "--cameras", "a,a")


class Parameters(CliTest):
    def test_values_that_are_none(self):
        for told, sets in [("--set sh_degree=1.5: invalid value \(expected an integer", ["sh_degree=1.5"]),
                           ("--set drop_share=nan: invalid value \(expected a number", ["drop_share=nan"]),
                           ("hyper-parameter seen_background is out of range \(expected 0 to 1, got 7\)", ["seen_background=7"]),
                           ("sh_degree is set twice", ["sh_degree=1", "sh_degree=2"])]:
            with self.subTest(sets=sets):
                options = [part for one in sets for part in ("--set", one)]
                self.fails(USAGE, told, "train", self.fixture("prepared"), "-o", "a.stgs", *options)

    def test_what_leaves_nothing_is_no_scene(self):
        sets = ["prune_opacity=0.999", "initial_opacity=0.01", "initial_opacity_dynamic=0.01",
                "densify_interval=5"]
        self.fails(RUNTIME, "training left no primitives: all were pruned as too faint",
                   "train", self.fixture("prepared"), "-o", "a.stgs", "--backend", "cpu",
                   "--iterations", "60", *[part for one in sets for part in ("--set", one)])
        self.assertFalse(os.path.exists(self.path("a.stgs")))

    @unittest.skipUnless(built_in("encode"), "encode is not built in")
    def test_a_space_that_is_none_is_told_before_the_long_work(self):
        sample = os.path.join(harness.SOURCE, "tests", "data", "workshop")
        for told, options in [("has no direction", ["--up", "0,0,0"]),
                              ("requires an up vector", ["--floor", "0,0,0"])]:
            with self.subTest(options=options):
                self.fails(USAGE, told, "encode", sample, "-o", "a.stgs", *options, "--keep-work",
                           "work")
                self.assertEqual(os.listdir(self.work), [])


class Model(CliTest):
    """What `stgs bench` makes of a scene of 200,001 primitives."""

    def setUp(self):
        super().setUp()
        names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1",
                 "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
        header = "ply\nformat binary_little_endian 1.0\nelement vertex 200001\n"
        header += "".join(f"property float {name}\n" for name in names) + "end_header\n"
        points = b"".join(struct.pack("<14f", k % 97 / 97, k % 89 / 89, k % 83 / 83, 0, 0, 0, -3,
                                      -5, -5, -5, 1, 0, 0, 0) for k in range(200001))
        self.write("model.ply", header.encode() + points)
        self.write("camera.json", json.dumps(
            {"width": 32, "height": 32, "fx": 32, "fy": 32, "cx": 16, "cy": 16,
             "rotation": [1, 0, 0, 0, 1, 0, 0, 0, 1], "translation": [-0.5, -0.5, 3]}))
        self.succeeds("convert", "model.ply", "model.stgs")
        self.bench = ["bench", "model.stgs", "--camera", "camera.json", "--backend", "cpu"]

    def test_more_than_a_file_can_have_is_refused(self):
        self.fails(USAGE, "makes 200001000 primitives of 200001; a file holds at most",
                   *self.bench, "--stored-ratio", "1000")

    def test_what_finds_no_room_in_memory_is_told(self):
        play = [*self.bench, "--stored-ratio", "1", "--quality", "80", "--play", "player", "--frames", "3"]
        told = b"frames are incomplete because --memory is too small"
        self.assertNotIn(told, self.succeeds(*play).stderr)
        self.assertIn(told, self.succeeds(*play, "--memory", "6").stderr)

    def test_it_can_be_stopped_while_the_model_is_made(self):
        args = [harness.STGS, *self.bench, "--stored-ratio", "200"]
        with subprocess.Popen(args, cwd=self.work, stderr=subprocess.PIPE) as process:
            try:
                process.wait(1)
            except subprocess.TimeoutExpired:
                pass
            process.send_signal(signal.SIGINT)
            error = process.communicate(timeout=60)[1].decode()
        self.assertEqual(process.returncode, RUNTIME, error)
        self.assertIn("interrupted by SIGINT: ", error)
