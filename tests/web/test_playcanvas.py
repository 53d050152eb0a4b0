#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A scene among the entities of PlayCanvas. See package_case.py for the usage."""
from package_case import PackageCase, run


class PlayCanvas(PackageCase):
    PAGE = "playcanvas_page.html"
    FILES = PackageCase.FILES + ["playcanvas_page.js", "engine_checks.js"]
    MODULES = {"playcanvas.js": "playcanvas/build/playcanvas.mjs"}

    def test_it_shows_the_image_of_the_player(self):
        value = self.check("compareAlone()")
        print(f"alone: {value:.1f} dB", flush=True)
        self.assertGreater(value, 40)

    def test_objects_hide_splats_and_are_covered(self):
        values = self.check("compareBoxes()")
        print(values, flush=True)
        for place in ("before", "behind"):
            self.assertGreater(values[place]["psnr"], 40)
            self.assertEqual(values[place]["alone"], [255, 0, 0])
        self.assertEqual(values["before"]["middle"], [255, 0, 0])
        self.assertNotEqual(values["behind"]["middle"], [255, 0, 0])

    def test_it_follows_its_transform(self):
        value = self.check("compareMoved()")
        print(f"moved: {value:.1f} dB", flush=True)
        self.assertGreater(value, 40)

    def test_other_objects_are_not_affected(self):
        is_same, draws = self.check("compareState()")
        self.assertTrue(is_same)
        self.assertEqual(draws, 0)  # outside of the frustum

    def test_destroy_frees_everything(self):
        before, during, after = self.check("countDestroyed()")
        self.assertGreater(during["Texture"], before["Texture"])
        for kind in ("Texture", "Buffer", "VertexArray", "Program"):
            self.assertLessEqual(after[kind], before[kind], (kind, before, during, after))

    def test_it_draws_on_demand(self):
        values = self.check("playSome()")
        self.assertGreater(values["frames"], 3)
        self.assertGreater(values["time"], 0.2)


if __name__ == "__main__":
    run(PlayCanvas)
