#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The example pages show a scene. See package_case.py for the usage."""
import os

from package_case import HERE, PackageCase, run
from page_server import WEBGPU_FLAGS

ROOT = os.path.join(HERE, "..", "..", "sdk")
EXAMPLES = os.path.join(ROOT, "examples", "web")
GUIDE = os.path.join(ROOT, "docs", "guide", "browser.md")
PLAIN = "player_page.html"
# The displayed colours of the page's first canvas.
COLOURS = """new Promise((resolve) => requestAnimationFrame(() => {
  const source = document.querySelector("canvas")
    ?? document.querySelector("stgs-player").shadowRoot.querySelector("canvas");
  const canvas = new OffscreenCanvas(64, 64), context = canvas.getContext("2d");
  context.drawImage(source, 0, 0, 64, 64);
  resolve(new Set(new Uint32Array(context.getImageData(0, 0, 64, 64).data.buffer)).size);
}))"""


class Examples(PackageCase):
    PAGE = PLAIN
    FLAGS = WEBGPU_FLAGS
    MODULES = {"three.module.js": "three/build/three.module.js",
               "three.core.js": "three/build/three.core.js",
               "three.webgpu.js": "three/build/three.webgpu.js",
               "three.tsl.js": "three/build/three.tsl.js",
               "playcanvas.js": "playcanvas/build/playcanvas.mjs",
               "iwer.js": "iwer/build/iwer.module.js"}

    def setUp(self):
        self.browser.problems.clear()
        self.browser.resize(640, 360)

    def show(self, name, page):
        with open(os.path.join(self.work, "page.html"), "w", encoding="utf-8") as file:
            file.write(page)
        self.browser.open(self.url + "page.html?" + name)
        self.wait(f"{COLOURS}.then((count) => count > 300)", 60)
        self.capture("example_" + name)

    def test_example_pages(self):
        for name in sorted(name for name in os.listdir(EXAMPLES) if name.endswith(".html")):
            with self.subTest(name), open(os.path.join(EXAMPLES, name), encoding="utf-8") as file:
                self.show(name, file.read())

    def test_the_buttons_of_the_example_enter(self):
        with open(os.path.join(EXAMPLES, "webxr.html"), encoding="utf-8") as file:
            page = file.read()
        start = ('<script type="module">import { metaQuest3, XRDevice } from "./iwer.js";'
                 "new XRDevice(metaQuest3).installRuntime({ forceInstall: true });</script>")
        self.show("webxr", page.replace('<script type="module" src', start + '<script type="module" src'))
        self.wait("document.querySelectorAll('nav button').length === 2")
        self.check("document.querySelectorAll('nav button')[0].click()")
        self.wait("document.querySelector('stgs-player').isInXR")


if __name__ == "__main__":
    run(Examples)
