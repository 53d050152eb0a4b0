#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The page of stgs web and stgs serve in headless Chromium.

usage: test_viewer.py STGS MAKE_WEB_SCENE
Exit code 77: Chromium, playwright-core, nginx or libmicrohttpd is missing
"""
import array
import base64
import gzip
import os
import re
import shutil
import struct
import subprocess
import sys
import tempfile
import unittest
import wave
import zipfile

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..", "fetch")]
from browser import Server, require  # noqa: E402
from package_case import serve  # noqa: E402

STGS = MAKE = ""
PLAYER = "document.querySelector('stgs-player')"
HOSTILE = "<img src=x onerror=document.title='run'>.stgs"


def with_members(archive, path, change):
    """Writes a copy of an archive, with changed images."""
    with zipfile.ZipFile(archive) as source, zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as out:
        for name in source.namelist():
            content = source.read(name)
            out.writestr(name, change(content) if name.endswith(".webp") else content)


def extended_webp(image):
    """Returns a lossless image with properties that must not change values: it states that it is to be
    turned, and that its alpha is not in use."""
    stream = bytearray(image[20:])
    fields = struct.unpack("<I", stream[1:5])[0]
    size = struct.pack("<Q", (fields & 0x3FFF) | (fields >> 14 & 0x3FFF) << 24)[:6]
    stream[4] &= ~0x10
    turned = b"II*\0" + struct.pack("<IHHHII", 8, 1, 0x112, 3, 1, 6) + bytes(4)
    body = b"WEBPVP8X" + struct.pack("<IB", 10, 8) + bytes(3) + size + b"VP8L" + image[16:20] + stream
    body += b"EXIF" + struct.pack("<I", len(turned)) + turned
    return b"RIFF" + struct.pack("<I", len(body)) + body


class Viewer(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.work = tempfile.mkdtemp(prefix="stgs-viewer-")
        cls.addClassCleanup(shutil.rmtree, cls.work, True)
        cls.scene = cls.path("kitchen.stgs")
        subprocess.run([MAKE, cls.scene, "2000", "2"], check=True)
        cls.stgs("convert", cls.scene, cls.path("titled.stgs"), "--title", "A title", "--log-level", "error")
        cls.stgs("web", cls.scene, "-o", cls.path("site"))
        shutil.copy(cls.scene, cls.path("site", "other.stgs"))
        shutil.copy(cls.path("titled.stgs"), cls.path("site"))
        url, cls.browser = serve(cls, cls.work)
        cls.site = url + "site/"

    @classmethod
    def path(cls, *parts):
        return os.path.join(cls.work, *parts)

    @classmethod
    def stgs(cls, *args):
        subprocess.run([STGS, *args], check=True, stdout=subprocess.DEVNULL)

    def setUp(self):
        self.browser.problems.clear()
        self.browser.resize(480, 270)
        self.check = self.browser.evaluate
        self.wait = self.browser.wait_for

    def serve(self, path):
        """Starts stgs serve; returns the URL of its page."""
        server = subprocess.Popen([STGS, "serve", path, "--log-level", "error"], stdout=subprocess.PIPE,
                                  stderr=subprocess.DEVNULL, text=True)
        self.addCleanup(server.stdout.close)
        self.addCleanup(server.wait)
        self.addCleanup(server.terminate)
        return server.stdout.readline().strip()

    def shows_scene(self, title):
        """Checks that the page plays a scene, whose image has many colours."""
        self.wait(f"{PLAYER} && ({PLAYER}.readyState >= 3 || {PLAYER}.error)", 60)
        self.assertIsNone(self.check(f"{PLAYER}.error && {PLAYER}.error.message"))
        self.assertEqual(self.check("[document.title, document.getElementById('title').textContent]"), [title, title])
        self.wait("document.getElementById('detail').textContent === '1,987 primitives'")
        values = self.check(f"""{PLAYER}.screenshot().then(createImageBitmap).then((image) => {{
            const canvas = new OffscreenCanvas(image.width, image.height), context = canvas.getContext("2d");
            context.drawImage(image, 0, 0);
            return new Set(context.getImageData(0, 0, image.width, image.height).data).size; }})""")
        self.assertGreater(values, 50)
        self.assertEqual(self.browser.problems, [])

    def loud(self):
        """Returns a scene like self.scene that names an audio file, which is next to it."""
        path = self.path("loud", "kitchen.stgs")
        if not os.path.exists(path):
            os.mkdir(self.path("loud"))
            subprocess.run([MAKE, path, "2000", "2", "0.01", "kitchen.wav"], check=True)
            with wave.open(self.path("loud", "kitchen.wav"), "wb") as file:
                file.setparams((1, 1, 8000, 0, "NONE", ""))
                file.writeframes(bytes([128]) * 16000)
        return path

    def shows_problem(self, text):
        self.wait("!document.getElementById('welcome').hidden")
        self.assertIn(text, self.check("document.getElementById('problem').textContent"))
        self.assertTrue(self.check(f"{PLAYER} === null"))

    def test_a_site_plays_its_scene(self):
        self.browser.open(self.site)
        self.shows_scene("kitchen")
        self.assertTrue(self.check(f"!{PLAYER}.paused"))

    def test_an_embedding_page_that_is_named_controls_it(self):
        os.mkdir(self.path("around"))
        with open(self.path("around", "index.html"), "w", encoding="ascii") as file:
            file.write("<!DOCTYPE html><title>around</title><body></body>")
        around = Server(self.path("around"))
        self.addCleanup(around.close)
        self.stgs("web", self.loud(), "-o", self.path("framed"), "--bridge", around.url.rstrip("/"), "--log-level", "error")
        page = self.site.replace("site", "framed")
        self.browser.open(around.url)
        self.check("""addEventListener("message", ({ data, source, origin }) => {
            if (data.stgs !== "ready") return;
            const { port1, port2 } = new MessageChannel();
            window.states = [];
            port1.onmessage = ({ data }) => data.type === "event" && states.push(data.state);
            source.postMessage({ stgs: "connect", version: 1 }, origin, [port2]);
            port1.postMessage({ id: 0, method: "pause", args: [] });
            port1.postMessage({ id: 1, method: "seek", args: [1.5] });
        })""")
        self.check(f"document.body.append(Object.assign(document.createElement('iframe'), {{ src: '{page}' }}))")
        self.wait("'states' in window && states.length > 0 && states[states.length - 1].readyState >= 3", 60)
        self.wait("states[states.length - 1].paused && states[states.length - 1].currentTime === 1.5")
        self.wait("states[states.length - 1].hasAudio")
        self.assertEqual(self.browser.problems, [])

    def test_a_page_of_one_file_opens_from_disk_and_from_a_server(self):
        self.stgs("web", self.loud(), "-o", self.path("scene.html"), "--single-file", "--title", "A <kitchen>",
                  "--log-level", "error")
        self.browser.open("file://" + self.path("scene.html"))
        self.shows_scene("A <kitchen>")
        self.wait(f"{PLAYER}.hasAudio")
        self.assertEqual(self.check("document.querySelectorAll('script[type=\"text/plain\"]').length"), 0)
        self.browser.open("file://" + self.path("scene.html") + "?src=site/other.stgs")
        self.shows_problem("must not load")
        self.assertEqual(self.check("document.getElementById('file').accept"), ".stgs")
        self.assertEqual(self.check("document.getElementById('formats').textContent"), "An .stgs video, from any viewpoint.")
        hosted = self.site.replace("site/", "scene.html")
        self.browser.open(hosted)
        self.shows_scene("A <kitchen>")
        self.wait(f"{PLAYER}.hasAudio")
        self.browser.open(hosted + "?src=site/other.stgs")
        self.shows_scene("other")
        self.assertEqual(self.check(f"[{PLAYER}.audio, {PLAYER}.hasAudio]"), ["auto", False])

    def test_a_link_names_a_scene(self):
        self.browser.open(self.site + "?src=other.stgs")
        self.shows_scene("other")
        self.browser.open(self.site + "?src=titled.stgs")
        self.shows_scene("A title")
        for src in ("file:///etc/passwd", "data:text/plain,x", "javascript:document.title='run'", "blob:null/x",
                    "http://127.0.0.1:1/x.stgs", "//127.0.0.1:1/x.stgs", "http://["):
            with self.subTest(src=src):
                self.browser.open(self.site + "?src=" + src)
                self.shows_problem("must not load")
        self.browser.open(self.site + "?src=" + "http:<img src=x onerror=document.title='run'>")
        self.wait(f"!!{PLAYER} || document.getElementById('problem').textContent !== ''")
        self.assertEqual(self.check("document.images.length"), 0)

    def test_errors_are_shown(self):
        self.browser.open(self.site + "?src=missing.stgs")
        self.wait(f"{PLAYER} && {PLAYER}.error", 60)
        self.assertIn("the server has no such file", self.check(f"{PLAYER}.shadowRoot.querySelector('.error p').textContent"))
        self.assertEqual(self.check("document.getElementById('detail').textContent"), "")

    def test_a_file_is_dropped_or_chosen(self):
        self.browser.open(self.site + "?src=file:///x")
        self.wait("!document.getElementById('welcome').hidden")
        data = {"items": [], "files": [self.scene], "dragOperationsMask": 1}
        for kind in ("dragEnter", "dragOver"):
            self.browser.send("Input.dispatchDragEvent", type=kind, x=200, y=200, data=data)
        self.wait("!document.getElementById('drop').hidden")
        self.browser.send("Input.dispatchDragEvent", type="drop", x=200, y=200, data=data)
        self.shows_scene("kitchen")
        self.assertTrue(self.check("document.getElementById('drop').hidden"))
        self.choose("model.glb", b"glTF" + bytes(200))
        self.wait(f"{PLAYER}.error", 60)
        self.assertIn("not an .stgs file", self.check(f"{PLAYER}.error.message"))

    def choose(self, name, content):
        """Chooses a new file in the dialogue of the page."""
        with open(self.path(name), "wb") as file:
            file.write(content)
        self.browser.call("page.setInputFiles", "#file", self.path(name))

    def test_a_ply_model_is_converted(self):
        self.stgs("convert", self.scene, self.path("binary.ply"), "--time", "0.5", "--log-level", "error")
        with open(self.path("binary.ply"), "rb") as file:
            binary = file.read()
        body = binary.index(b"end_header\n") + len(b"end_header\n")
        header = binary[:body]
        count = int(re.search(rb"element vertex (\d+)", header).group(1))
        names = re.findall(rb"property float (\w+)", header)
        values = array.array("f", binary[body:])
        rows = (" ".join(map(repr, values[i:i + len(names)])) for i in range(0, len(values), len(names)))
        text = header.replace(b"binary_little_endian", b"ascii") + "\n".join(rows).encode() + b"\n"
        for name, content in (("binary.ply", binary), ("text.ply", text)):
            with self.subTest(name=name):
                self.browser.open(self.site + "?src=file:///x")
                self.choose(name, content)
                self.wait(f"{PLAYER} && {PLAYER}.readyState >= 3", 60)
                self.assertEqual(self.check("[document.title, document.getElementById('detail').textContent]"),
                                 [name[:-4], f"{count:,} primitives"])
                bounds = self.check(f"[{PLAYER}.info.boundsMin, {PLAYER}.info.boundsMax]")
                for axis, at in enumerate(map(names.index, (b"x", b"y", b"z"))):
                    self.assertAlmostEqual(bounds[0][axis], min(values[at::len(names)]), 4)
                    self.assertAlmostEqual(bounds[1][axis], max(values[at::len(names)]), 4)
                self.assertEqual(self.browser.problems, [])
        for name, content, problem in (("cut.ply", binary[:len(binary) // 2], "cut.ply: "),
                                       ("mesh.ply", b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\n"
                                                    b"end_header\n0\n", "mesh.ply: "),
                                       ("huge.ply", header.replace(b"vertex %d" % count, b"vertex 4000000000"), "huge.ply: ")):
            with self.subTest(name=name):
                self.choose(name, content)
                self.wait("!document.getElementById('welcome').hidden")
                self.shows_problem(problem)

    def test_models_of_other_formats_are_converted_as_natively(self):
        shutil.copy(os.path.join(HERE, "..", "data", "interchange", "version3.spz"), self.path("version3.spz"))
        self.make_bundle()
        with_members(self.path("bundle.sog"), self.path("extended.sog"), extended_webp)
        self.browser.open(self.site + "?src=file:///x")
        for name in ("version3.spz", "bundle.sog", "extended.sog"):
            with self.subTest(name=name), open(self.path(name), "rb") as file:
                self.choose(name, file.read())
                self.wait(f"{PLAYER} && {PLAYER}.readyState >= 3 && document.title === '{name[:-4]}'", 60)
                scene = self.check(f"""{PLAYER}.srcObject.arrayBuffer().then((bytes) =>
                    btoa(Array.from(new Uint8Array(bytes), (byte) => String.fromCharCode(byte)).join("")))""")
                with open(self.path("page.stgs"), "wb") as file:
                    file.write(base64.b64decode(scene))
                self.assertEqual(self.browser.problems, [])
                self.same_primitives(self.path("page.stgs"), self.path(name))

    def make_bundle(self):
        subprocess.run([MAKE, self.path("bundle.sog"), "3000", "2"], check=True)

    def test_models_that_cannot_be_converted_are_explained(self):
        self.make_bundle()
        with_members(self.path("bundle.sog"), self.path("images.sog"), lambda webp: webp[:len(webp) // 2])
        models = {}
        for name in ("bundle.sog", "images.sog", "version3.spz", "version4.spz"):
            path = self.path(name) if name.endswith(".sog") else os.path.join(HERE, "..", "data", "interchange", name)
            with open(path, "rb") as file:
                models[name] = file.read()
        content = gzip.decompress(models["version3.spz"])
        # A header that states more primitives than fit in the memory of the page.
        many = b"NGSP" + struct.pack("<IIBBBBI", 4, 2**26, 3, 12, 0, 6, 32) + bytes(12) + bytes(2**20)
        more = gzip.compress(content + bytes(2**24))[:-4] + struct.pack("<I", len(content))  # than it states
        self.browser.open(self.site + "?src=file:///x")
        for name, model, problem in (
                ("version4.spz", models["version4.spz"], "zstd, which browsers do not decode; use 'stgs convert'"),
                ("cut.spz", models["version3.spz"][:-20], "cut.spz: "),
                ("more.spz", more, "more.spz: damaged or truncated"),
                ("states.spz", models["version3.spz"][:-4] + b"\xff" * 4, "states.spz: gzip stream is damaged"),
                ("many.spz", many, "exceed the memory limit of 2147483648 bytes"),
                ("cut.sog", models["bundle.sog"][:-20], "cut.sog: "),
                ("images.sog", models["images.sog"], ".webp: the image is damaged")):
            with self.subTest(name=name):
                self.choose(name, model)
                self.wait(f"document.getElementById('problem').textContent.includes('{name}')", 60)
                self.shows_problem(problem)

    def same_primitives(self, scene, model):
        """Checks that a scene has the primitives of the native conversion of a model."""
        values = []
        for i, path in enumerate((scene, model)):
            self.stgs("convert", path, self.path(f"{i}.ply"), "--log-level", "error")
            with open(self.path(f"{i}.ply"), "rb") as file:
                header, body = file.read().split(b"end_header\n", 1)
            values.append((header, array.array("f", body)))
        (header, page), (expected_header, native) = values
        self.assertEqual(header, expected_header)
        self.assertEqual(page, native)

    def test_serve_plays_a_file_with_its_sound(self):
        self.browser.open(self.serve(self.loud()))
        self.shows_scene("kitchen")
        self.wait(f"{PLAYER}.hasAudio")

    def test_serve_lists_a_folder(self):
        os.makedirs(self.path("folder", "below"))
        shutil.copy(self.scene, self.path("folder", "below", "kitchen.stgs"))
        shutil.copy(self.scene, self.path("folder", HOSTILE))
        url = self.serve(self.path("folder"))
        self.browser.open(url)
        self.wait("document.querySelectorAll('.scene').length === 2")
        names = self.check("[...document.querySelectorAll('.label')].map((label) => label.textContent)")
        self.assertEqual(names, [HOSTILE[:-5], "below/kitchen"])
        self.assertEqual(self.check("[document.images.length, document.title]"), [0, "Scenes"])
        for i, title in enumerate((HOSTILE[:-5], "kitchen")):
            self.browser.open(url)
            self.wait("document.querySelectorAll('.scene').length === 2")
            self.browser.call("page.click", f".scene >> nth={i}")
            self.wait(f"!!{PLAYER}")
            self.shows_scene(title)
        self.browser.call("page.click", "#back")
        self.wait("document.querySelectorAll('.scene').length === 2")

    def test_nothing_is_cut_at_the_width_of_a_phone(self):
        self.browser.resize(360, 740, 2, True)
        for page in ("", "?src=file:///x"):
            self.browser.open(self.site + page)
            self.wait(f"!!{PLAYER} || !document.getElementById('welcome').hidden")
            outside = self.check("""[...document.querySelectorAll("button, h1, h2, p, a")].filter((element) => {
                const box = element.getBoundingClientRect();
                return box.width > 0 && (box.left < 0 || box.right > innerWidth); }).length""")
            self.assertEqual(outside, 0)
            self.assertEqual(self.check("document.documentElement.scrollWidth"), 360)


def main():
    global STGS, MAKE
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    STGS, MAKE = map(os.path.abspath, sys.argv[1:])
    version = subprocess.run([STGS, "--version"], capture_output=True, text=True, check=True).stdout
    if " serve" not in version:
        print("skipped: needs a build with stgs serve")
        sys.exit(77)
    require("nginx")
    unittest.main(argv=sys.argv[:1])


if __name__ == "__main__":
    main()
