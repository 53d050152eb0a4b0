#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A scene among the entities of PlayCanvas. See package_case.py for the usage."""
from engine_case import EngineCase
from package_case import run


class PlayCanvas(EngineCase):
    PAGE = "playcanvas_page.html"
    FILES = EngineCase.FILES + ["playcanvas_page.js"]
    MODULES = {"playcanvas.js": "playcanvas/build/playcanvas.mjs"}

    def test_it_shows_the_image_of_the_player(self):
        value = self.check("compareAlone()")
        print(f"alone: {value:.1f} dB", flush=True)
        self.assertGreater(value, 40)

    def test_objects_hide_splats_and_are_covered(self):
        self.check_boxes({})

    def test_it_follows_its_transform(self):
        self.check_transform()

    def test_other_objects_are_not_affected(self):
        self.check_state()

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
