# SPDX-License-Identifier: Apache-2.0
"""Prepared captures that are incomplete, or that differ from the one a scene was trained on."""
import json
import os
import time
import unittest

import harness
from harness import CliTest
from repeated_video import repeated_video

IO, INVALID, UNSUPPORTED = 2, 3, 5


class IncompleteCapture(CliTest):
    def test_train_rejects_a_capture_without_points(self):
        for name in ("points_static.ply", "points_dynamic.ply"):
            with self.subTest(name=name):
                folder = self.copy_capture(name[:-4])
                os.remove(os.path.join(folder, name))
                self.fails(IO, f"{name}: no such file, .*prepare", "train", folder, "--preset",
                           "fast", "--iterations", "5", "-o", "scene.stgs")
                self.assertFalse(os.path.exists(self.path("scene.stgs")))


class OtherCapture(CliTest):
    def changed(self, name, change):
        """Copies the fixture's capture with `change` applied to each camera."""
        folder = self.copy_capture(name)
        path = self.path(name, "capture.json")
        with open(path, encoding="utf-8") as file:
            capture = json.load(file)
        for camera in capture["cameras"]:
            change(camera)
        with open(path, "w", encoding="utf-8") as file:
            json.dump(capture, file)
        return folder

    def test_measuring_against_another_capture_warns(self):
        def shift(camera):
            camera["translation"][0] += 0.01

        def rescale(camera):
            camera["fx"] *= 0.99  # like another --scale: the poses stay the same
        self.succeeds("train", self.fixture("prepared"), "--preset", "fast", "--iterations", "20",
                      "-o", "scene.stgs")
        warning = b"stgs: warning: scene.stgs: no camera of other has the pose of"
        self.changed("other", shift)
        self.changed("same", rescale)
        for args in (["evaluate", "scene.stgs"], ["pack", "scene.stgs", "-o", "packed.stgs"]):
            with self.subTest(verb=args[0]):
                self.assertIn(warning, self.succeeds(*args, "--against", "other").stderr)
                for capture in ("same", self.fixture("prepared")):
                    self.assertNotIn(b"warning", self.succeeds(*args, "--against", capture).stderr)


class HostileCapture(CliTest):
    """Captures of others: nothing outside the folder is read, and counts and sizes are limited."""

    def setUp(self):
        super().setUp()
        self.folder = self.copy_capture("capture")
        with open(self.path("capture", "capture.json"), encoding="utf-8") as file:
            self.json = json.load(file)
        self.camera = next(c["name"] for c in self.json["cameras"] if not c["test"])
        self.frame = self.path("capture", "frames", self.camera, "000000." +
                               self.json["frame_extension"])
        self.begin = time.monotonic()

    def train(self, *args):
        return ["train", self.folder, "--preset", "fast", "--iterations", "5", "-o", "scene.stgs",
                *args]

    def rejects(self, code, message, **changes):
        with open(self.path("capture", "capture.json"), "w", encoding="utf-8") as file:
            json.dump({**self.json, **changes}, file)
        self.fails(code, message, *self.train())

    def replace(self, path, make):
        os.remove(path)
        make(path)

    def test_numbers_of_capture_json_are_exact_and_bounded(self):
        self.rejects(UNSUPPORTED, "unknown version 1.5", stgs_capture=1.5)
        self.rejects(UNSUPPORTED, "unknown version", stgs_capture="1")
        for frames in (10**9, 1.5, 0, 1e300, "2"):
            self.rejects(INVALID, '"frames" is .*expected an integer from 1 to', frames=frames)
        self.rejects(INVALID, '"first_frame" is 0.5', first_frame=0.5)
        self.rejects(INVALID, '"time_base" is 1.5', time_base=[1.5, 30])
        self.rejects(INVALID, "too many cameras", cameras=self.json["cameras"] * 2000)
        camera = dict(self.json["cameras"][0], width=1.5)
        self.rejects(INVALID, '"width" is 1.5', cameras=[camera])
        self.assertLess(time.monotonic() - self.begin, 60)

    def test_frames_that_do_not_exist_are_reported_before_the_work(self):
        frames = len(os.listdir(os.path.dirname(self.frame)))
        self.rejects(IO, f"no such file: frame {frames} of camera .*of 1000000", frames=10**6)
        self.assertLess(time.monotonic() - self.begin, 60)

    def test_names_of_capture_json_stay_in_the_folder(self):
        for extension in ("/../../x", "png/../../../x", "exe", ""):
            self.rejects(INVALID, "frame_extension is", frame_extension=extension)
        for name in ("..", ".", ".hidden", "a/b", "a\nb", "a\0b", ""):
            self.rejects(INVALID, "cannot be a folder name",
                         cameras=[dict(c, name=name) for c in self.json["cameras"]])

        self.rejects(INVALID, "two cameras have the name", cameras=self.json["cameras"] * 2)

    @unittest.skipUnless(harness.built_in("prepare"), "prepare is not built in")
    def test_videos_that_repeat_a_stored_frame_are_rejected(self):
        """FFmpeg decodes a frame that is followed by stray bytes."""
        os.mkdir(self.path("videos"))
        frames = [{"file_path": name, "transform_matrix": [[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 5], [0, 0, 0, 1]]}
                  for x, name in enumerate(("a.mp4", "b.mp4"))]
        self.write("videos/transforms.json", json.dumps({"w": 480, "h": 360, "fl_x": 400, "fps": 30,
                                                         "frames": frames}).encode())
        with open(os.path.join(harness.sample(), "cam03.mp4"), "rb") as file:
            source = file.read()
        for stray in (b"", b"\0\0"):
            with self.subTest(stray=stray):
                for name in ("a.mp4", "b.mp4"):
                    self.write("videos/" + name, repeated_video(source, 3000, stray))
                self.fails(INVALID, "video of camera '[ab]': cannot decode frame [0-9]+ .the file states "
                                    "the same stored frames many times",
                           "prepare", "videos", "-o", "out", "--scale", "0.1")

    def test_links_that_leave_the_capture_are_refused(self):
        outside = self.path("outside")
        os.rename(self.frame, outside)
        for target in (outside, "../../../outside"):
            os.symlink(target, self.frame)
            self.fails(INVALID, "leads out of the capture's folder.*--allow-outside", *self.train())
            self.succeeds(*self.train("--allow-outside"))
            os.remove(self.frame)
        os.rename(outside, self.path("capture", "kept"))
        os.symlink("../../kept", self.frame)  # stays inside
        os.symlink(self.folder, self.path("link"))
        self.folder = self.path("link")
        self.succeeds(*self.train())
        for name in ("points_static.ply", "capture.json"):
            path = self.path("capture", name)
            os.rename(path, outside)
            os.symlink(outside, path)
            self.fails(INVALID, f"{name}: leads out of the capture's folder", *self.train())
            self.replace(path, lambda p: os.rename(outside, p))

    def test_pipes_in_place_of_files_end_the_run_at_once(self):
        for path in (self.frame, self.path("capture", "points_dynamic.ply"),
                     self.path("capture", "capture.json")):
            kept = self.path("kept")
            os.rename(path, kept)
            os.mkfifo(path)
            self.fails(IO, "not a regular file", *self.train())
            self.replace(path, lambda p: os.rename(kept, p))
        self.assertLess(time.monotonic() - self.begin, 60)

    def test_a_script_with_the_name_of_a_video_is_not_run(self):
        if not harness.built_in("prepare"):
            self.skipTest("prepare is not built in")
        os.mkdir(self.path("videos"))
        matrix = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]
        cameras = {f"cam{k}": {"K": [[500, 0, 320], [0, 500, 240], [0, 0, 1]], "w2c": matrix}
                   for k in range(2)}
        self.write("videos/cameras.json", json.dumps(cameras))
        inner = os.path.join(harness.sample(), "cam03.mp4")
        for text in (f"ffconcat version 1.0\nfile '{inner}'\n", f"#EXTM3U\n{inner}\n"):
            for k in range(2):
                self.write(f"videos/cam{k}.mp4", text)
            self.fails(INVALID, "cam0.mp4: video of camera 'cam0': not an MP4", "prepare", "videos",
                       "-o", "out")


if __name__ == "__main__":
    unittest.main()
