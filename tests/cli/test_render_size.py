# SPDX-License-Identifier: Apache-2.0
"""`render --size` keeps pixels square; --stretch keeps the field of view of each axis. The view has
the near plane of the file."""
import json
import unittest

from harness import CliTest

USAGE = 1


class RenderSize(CliTest):
    def setUp(self):
        super().setUp()
        self.tiny = self.fixture("tiny.stgs")
        self.start = self.json_of("info", self.tiny)["start_camera"]

    def render(self, name, *args):
        self.succeeds("render", self.tiny, "--time", "0.05", "-o", name, *args)
        return self.read(name)

    def camera(self, **changes):
        return self.write("camera.json", json.dumps({**self.start, **changes}))

    def test_another_aspect_ratio_shows_more(self):
        """At twice the width, focal lengths stay and the principal point stays in the middle."""
        width, height = self.start["width"], self.start["height"]
        camera = self.camera(width=2 * width, cx=2 * self.start["cx"])
        wide = self.render("wide.png", "--size", f"{2 * width}x{height}")
        self.assertEqual(wide, self.render("expected.png", "--camera", camera))
        camera = self.camera(height=2 * height, cy=2 * self.start["cy"])
        tall = self.render("tall.png", "--size", f"{width}x{2 * height}")
        self.assertEqual(tall, self.render("expected.png", "--camera", camera))

    def test_stretch_scales_each_axis(self):
        width, height = self.start["width"], self.start["height"]
        camera = self.camera(width=2 * width, cx=2 * self.start["cx"], fx=2 * self.start["fx"])
        stretched = self.render("stretched.png", "--size", f"{2 * width}x{height}", "--stretch")
        self.assertEqual(stretched, self.render("expected.png", "--camera", camera))

    def test_stretch_has_no_effect_at_the_same_aspect_ratio(self):
        size = f"{3 * self.start['width'] // 2}x{3 * self.start['height'] // 2}"
        self.assertEqual(self.render("a.png", "--size", size),
                         self.render("b.png", "--size", size, "--stretch"))

    def test_stretch_requires_a_size(self):
        self.fails(USAGE, "--stretch requires --size", "render", self.tiny, "--time", "0", "-o",
                   "null", "--stretch")

    def test_a_file_without_near_plane_renders_as_with_the_default(self):
        expected = self.render("expected.png")
        self.succeeds("render", self.fixture("no_near.stgs"), "--time", "0.05", "-o", "same.png")
        self.assertEqual(self.read("same.png"), expected)


if __name__ == "__main__":
    unittest.main()
