# SPDX-License-Identifier: Apache-2.0
"""Tests of the package with npm packages, in Chromium, from nginx.

usage of the scripts: test_NAME.py MAKE_WEB_SCENE RECORD_FRAGMENTS PACKAGE NPM
PACKAGE: the folder of stgs.js. NPM: a node_modules folder with tests/web/package.json.
With SCREENSHOTS=FOLDER in the environment, they write images of their pages. Exit code 77: Chromium,
nginx or an npm package is missing
"""
import json
import os
import shutil
import subprocess
import sys
import tempfile
import unittest

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..", "fetch")]
from browser import Browser, require  # noqa: E402
from nginx import Nginx  # noqa: E402

SIZE = (640, 320)


def serve(case, folder, flags=()):
    """Serves a folder by nginx and starts Chromium until the end of the tests of a class. Returns the
    URL and the browser.
    """
    nginx = case.enterClassContext(Nginx(folder))
    browser = Browser(flags)
    case.addClassCleanup(browser.close)
    return f"http://127.0.0.1:{nginx.port}/", browser


class PackageCase(unittest.TestCase):
    """A page per test. FILES: of this folder; MODULES: of npm, by the name on the server."""

    FILES = ["decode_scene.js"]
    MODULES = {}
    PAGE = ""
    FLAGS = ()  # of Chromium
    make = record = package = npm = ""

    @classmethod
    def setUpClass(cls):
        cls.work = tempfile.mkdtemp(prefix="stgs-package-")
        cls.addClassCleanup(shutil.rmtree, cls.work, True)
        for name in os.listdir(cls.package):
            if name.endswith((".js", ".wasm")):
                shutil.copy(os.path.join(cls.package, name), cls.work)
        for name in cls.FILES + [cls.PAGE]:
            shutil.copy(os.path.join(HERE, name), cls.work)
        for name, source in cls.MODULES.items():
            shutil.copy(os.path.join(cls.npm, source), os.path.join(cls.work, name))
        subprocess.run([cls.make, os.path.join(cls.work, "scene.stgs"), "3000", "3"], check=True)
        cls.url, cls.browser = serve(cls, cls.work, cls.FLAGS)

    def setUp(self):
        self.browser.problems.clear()
        self.browser.resize(*SIZE)
        self.open(self.PAGE)

    def tearDown(self):
        self.assertEqual(self.browser.problems, [])

    def open(self, page):
        self.browser.open(self.url + page)
        self.wait("'ready' in window")

    def check(self, script, *arguments):
        """Calls a function of the page if there are arguments, or evaluates a script."""
        if arguments:
            script = f"{script}({', '.join(map(json.dumps, arguments))})"
        return self.browser.evaluate(script)

    def wait(self, condition, seconds=30):
        self.browser.wait_for(condition, seconds)

    def capture(self, name):
        if folder := os.environ.get("SCREENSHOTS"):
            self.browser.screenshot(os.path.join(folder, name + ".png"))


def run(case):
    """Runs the tests of the calling script. Exit code 77: skipped."""
    if len(sys.argv) != 5:
        sys.exit(__doc__)
    case.make, case.record, case.package, case.npm = map(os.path.abspath, sys.argv[1:])
    require("nginx")
    missing = [path for path in case.MODULES.values()
               if not os.path.exists(os.path.join(case.npm, path))]
    if missing:
        print(f"skipped: needs npm's {missing[0]}; run tools/setup/npm.sh")
        sys.exit(77)
    unittest.main(argv=sys.argv[:1], module="__main__")
