#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The configuration of nginx in the guide sends the headers that it describes, and lets a page of another
origin play a scene with a package from that server. See package_case.py for the usage.
"""
import gzip
import http.client
import os
import re
import shutil
import subprocess
import tempfile
import unittest
import wave

from package_case import HERE, SIZE, Nginx, run, serve
from test_examples import COLOURS

GUIDE = os.path.join(HERE, "..", "..", "sdk", "docs", "guide", "hosting.md")
# Only the script violations.js is the page's own.
PAGE = """<!DOCTYPE html>
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; connect-src {url}; media-src {url}; img-src {url};
  script-src 'self' {url} 'wasm-unsafe-eval'; worker-src {url} blob:">
<script src="violations.js"></script>
<script type="module" src="{url}/stgs-0.1.0/stgs.js"></script>
<stgs-player src="{url}/scenes/scene.stgs" poster="{url}/scenes/poster.svg" controls autoplay loop muted></stgs-player>
"""
VIOLATIONS = """window.violations = [];
addEventListener("securitypolicyviolation", (event) => violations.push(`${event.violatedDirective} ${event.blockedURI}`));
"""
POSTER = """<svg xmlns="http://www.w3.org/2000/svg" width="8" height="4"/>"""


class Hosting(unittest.TestCase):
    MODULES = {}
    make = record = package = npm = ""

    @classmethod
    def setUpClass(cls):
        cls.work = tempfile.mkdtemp(prefix="stgs-hosting-")
        cls.addClassCleanup(shutil.rmtree, cls.work, True)
        files, page = (os.path.join(cls.work, name) for name in ("files", "page"))
        os.makedirs(os.path.join(files, "scenes"))
        os.mkdir(page)
        installed = shutil.copytree(cls.package, os.path.join(files, "stgs-0.1.0"))
        with open(os.path.join(installed, "stgs-core.wasm"), "rb") as core, \
                gzip.open(os.path.join(installed, "stgs-core.wasm.gz"), "wb") as compressed:
            shutil.copyfileobj(core, compressed)
        scenes = os.path.join(files, "scenes")
        subprocess.run([cls.make, os.path.join(scenes, "scene.stgs"), "3000", "3", "0.1", "sound.wav"], check=True)
        with wave.open(os.path.join(scenes, "sound.wav"), "wb") as file:
            file.setparams((1, 2, 8000, 0, "NONE", "not compressed"))
            file.writeframes(bytes(8000 * 2 * 3))
        with open(os.path.join(scenes, "poster.svg"), "w", encoding="ascii") as file:
            file.write(POSTER)
        with open(GUIDE, encoding="utf-8") as file:
            settings = re.search(r"```nginx\n(.*?)```", file.read(), re.DOTALL)[1]
        cls.port = cls.enterClassContext(Nginx(files, settings=settings)).port
        with open(os.path.join(page, "index.html"), "w", encoding="utf-8") as file:
            file.write(PAGE.format(url=f"http://127.0.0.1:{cls.port}"))
        with open(os.path.join(page, "violations.js"), "w", encoding="utf-8") as file:
            file.write(VIOLATIONS)
        cls.url, cls.browser = serve(cls, page)

    def request(self, method, path, **headers):
        """Returns the status and the headers of a response. Each header must be sent once."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=10)
        connection.request(method, path, headers={"Origin": "https://page.example", **headers})
        response = connection.getresponse()
        names = [name for name, _ in response.getheaders()]
        connection.close()
        self.assertEqual(len(names), len(set(names)))
        return response.status, response.headers

    def test_scenes(self):
        status, headers = self.request("GET", "/scenes/scene.stgs", Range="bytes=10-19")
        self.assertEqual(status, 206)
        self.assertRegex(headers["Content-Range"], r"^bytes 10-19/\d+$")
        self.assertRegex(headers["ETag"], '^"')
        self.assertEqual(headers["Access-Control-Allow-Origin"], "*")
        self.assertEqual(headers["Access-Control-Expose-Headers"], "Content-Range, ETag")
        self.assertEqual(headers["Cache-Control"], "no-cache")
        # The page can read the status of errors.
        status, headers = self.request("GET", "/scenes/none.stgs", Range="bytes=0-9")
        self.assertEqual((status, headers["Access-Control-Allow-Origin"]), (404, "*"))

    def test_preflight_requests_for_scenes(self):
        status, headers = self.request("OPTIONS", "/scenes/scene.stgs", **{
            "Access-Control-Request-Method": "GET", "Access-Control-Request-Headers": "range"})
        self.assertEqual(status, 204)
        self.assertEqual(headers["Access-Control-Allow-Origin"], "*")
        self.assertEqual(headers["Access-Control-Allow-Headers"], "Range")
        self.assertEqual(headers["Access-Control-Max-Age"], "86400")

    def test_packages(self):
        status, headers = self.request("GET", "/stgs-0.1.0/stgs-core.wasm", **{"Accept-Encoding": "gzip"})
        self.assertEqual((status, headers["Content-Encoding"]), (200, "gzip"))
        self.assertEqual(headers["Vary"], "Accept-Encoding")
        self.assertEqual(headers["Content-Type"], "application/wasm")
        self.assertEqual(headers["Access-Control-Allow-Origin"], "*")
        self.assertEqual(headers["Cache-Control"], "public, max-age=31536000, immutable")

    def test_a_page_of_another_origin_shows_a_scene(self):
        self.browser.resize(*SIZE)
        self.browser.open(self.url + "index.html")
        self.browser.wait_for(f"{COLOURS}.then((count) => count > 300)", 60)
        player = "document.querySelector('stgs-player')"
        self.browser.wait_for(f"{player}.hasAudio")
        self.browser.wait_for(f"{player}.shadowRoot.querySelector('img').naturalWidth === 8")
        self.assertEqual(self.browser.evaluate(f"getComputedStyle({player}).display"), "block")
        width, height = self.browser.evaluate(
            f"(({{ width, height }}) => [width, height])({player}.shadowRoot.querySelector('canvas'))")
        self.assertGreater(width, 300)
        self.assertGreater(height, 150)
        self.assertEqual(self.browser.evaluate("violations"), [])
        self.assertEqual(self.browser.problems, [])


if __name__ == "__main__":
    run(Hosting)
