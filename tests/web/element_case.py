# SPDX-License-Identifier: Apache-2.0
"""Tests of <stgs-player> in Chromium. With SCREENSHOTS=FOLDER in the environment, they write images
of its states.
"""
import os
import shutil
import subprocess
import tempfile
import unittest

from browser import Browser, Server, require

TESTS = os.path.dirname(os.path.abspath(__file__))


def bundle(folder):
    for page in ("element_page", "bridge_page"):
        subprocess.run(["esbuild", os.path.join(TESTS, page + ".mjs"), "--bundle",
                        "--format=iife", "--target=es2020", "--log-level=warning",
                        f"--outfile={folder}/{page}.js"], check=True)
        shutil.copy(os.path.join(TESTS, page + ".html"), folder)


class ElementCase(unittest.TestCase):
    """One element per test, on a page of its own."""

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory(prefix="stgs-element-")
        cls.addClassCleanup(cls.folder.cleanup)
        bundle(cls.folder.name)
        cls.server = Server(cls.folder.name)
        cls.addClassCleanup(cls.server.close)
        cls.browser = Browser()
        cls.addClassCleanup(cls.browser.close)

    def setUp(self):
        self.browser.problems.clear()
        self.browser.resize(1280, 720)
        self.browser.open(self.server.url + "element_page.html")
        self.check = self.browser.evaluate
        self.wait = self.browser.wait_for

    def tearDown(self):
        self.assertEqual(self.browser.problems, [])

    def show(self, **attributes):
        attributes.setdefault("src", "scene.stgs")
        self.check(f"show({attributes!r})")

    def show_ready(self, **attributes):
        self.show(**attributes)
        self.wait("player.readyState === 4 && parts.renderers[parts.renderers.length - 1].last")

    def capture(self, name):
        if folder := os.environ.get("SCREENSHOTS"):
            self.browser.screenshot(os.path.join(folder, name + ".png"))

    def centre(self, selector):
        return self.check(f"(() => {{ const r = part('{selector}').getBoundingClientRect();"
                          " return [r.x + r.width / 2, r.y + r.height / 2]; })()")

    def focus_view(self):
        self.check("part('.view').focus()")

    def posted(self, kind):
        return self.check("parts.workers[parts.workers.length - 1].posted"
                          f".filter((message) => message.type === '{kind}')")

    def camera(self):
        return self.check("parts.renderers[parts.renderers.length - 1].last.camera")


def run():
    """Runs the tests of the calling script. Exit code 77: skipped."""
    require("esbuild")
    unittest.main()
