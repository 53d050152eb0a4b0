# SPDX-License-Identifier: Apache-2.0
"""Prepared captures that are incomplete, or that differ from the one a scene was trained on."""
import json
import os
import unittest

from harness import CliTest

IO = 2


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


if __name__ == "__main__":
    unittest.main()
