# SPDX-License-Identifier: Apache-2.0
"""Prepared captures that are not whole, or not those that a scene was trained on."""
import json
import os
import unittest

from harness import CliTest

IO = 2


class PartOfACapture(CliTest):
    def test_a_folder_without_its_points_is_not_trained_on(self):
        for name in ("points_static.ply", "points_dynamic.ply"):
            with self.subTest(name=name):
                folder = self.copy_capture(name[:-4])
                os.remove(os.path.join(folder, name))
                self.fails(IO, f"{name}: no such file, .*prepare", "train", folder, "--preset",
                           "fast", "--iterations", "5", "-o", "scene.stgs")
                self.assertFalse(os.path.exists(self.path("scene.stgs")))


class OtherCapture(CliTest):
    def moved(self, name, change):
        """The fixture's capture with the cameras that `change` makes of its own."""
        folder = self.copy_capture(name)
        path = self.path(name, "capture.json")
        with open(path, encoding="utf-8") as file:
            capture = json.load(file)
        for camera in capture["cameras"]:
            change(camera)
        with open(path, "w", encoding="utf-8") as file:
            json.dump(capture, file)
        return folder

    def test_a_scene_that_is_measured_against_another_capture_is_warned_of(self):
        def along(camera):
            camera["translation"][0] += 0.01

        def smaller(camera):
            camera["fx"] *= 0.99  # as at another scale: they stand where they stood
        self.succeeds("train", self.fixture("prepared"), "--preset", "fast", "--iterations", "20",
                      "-o", "scene.stgs")
        warning = b"stgs: warning: scene.stgs: no camera of other has the pose of"
        self.moved("other", along)
        self.moved("same", smaller)
        for args in (["evaluate", "scene.stgs"], ["pack", "scene.stgs", "-o", "packed.stgs"]):
            with self.subTest(verb=args[0]):
                self.assertIn(warning, self.succeeds(*args, "--against", "other").stderr)
                for capture in ("same", self.fixture("prepared")):
                    self.assertNotIn(b"warning", self.succeeds(*args, "--against", capture).stderr)


if __name__ == "__main__":
    unittest.main()
