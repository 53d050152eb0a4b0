# SPDX-License-Identifier: Apache-2.0
"""stgs web: the files of a site, a page of one file, and outputs that exist."""
import base64
import gzip
import os
import re
import shutil
import unittest

from harness import CliTest, built_in

USAGE, IO, INVALID, UNSUPPORTED, NOT_BUILT = 1, 2, 3, 5, 6
FILES = ["index.html", "scene.stgs", "stgs-core.wasm", "stgs-import.js", "stgs-import.wasm", "stgs-sorter.js",
         "stgs-worker.js", "viewer.js"]


@unittest.skipUnless(built_in("web"), "web is not built in")
class Web(CliTest):
    def setUp(self):
        super().setUp()
        self.scene = self.fixture("tiny.stgs")
        with open(self.scene, "rb") as file:
            self.bytes = file.read()

    def test_a_site_has_the_page_the_player_and_the_scene(self):
        about = self.json_of("web", self.scene, "-o", "site")
        self.assertEqual(sorted(os.listdir(self.path("site"))), FILES)
        self.assertEqual(about["bytes"], sum(os.path.getsize(self.path("site", name)) for name in FILES))
        self.assertEqual(self.read("site/scene.stgs"), self.bytes)
        self.assertIn(b'{"scene":"scene.stgs"}', self.read("site/index.html"))
        self.assertTrue(self.read("site/stgs-core.wasm").startswith(b"\0asm"))

    def test_a_page_of_one_file_contains_everything(self):
        self.succeeds("web", self.scene, "-o", "scene.html", "--single-file")
        text = self.read("scene.html").decode()
        def parts(attribute):
            found = re.findall(rf'<script type="text/plain" {attribute}>([^<]*)</script>', text)
            return b"".join(base64.b64decode(part, validate=True) for part in found)
        self.assertEqual(parts('class="stgs-scene"'), self.bytes)
        self.succeeds("web", self.scene, "-o", "site")
        self.assertEqual(gzip.decompress(parts('id="stgs-core"')), self.read("site/stgs-core.wasm"))
        for name in ("worker", "sorter"):
            self.assertEqual(parts(f'id="stgs-{name}"'), self.read(f"site/stgs-{name}.js"))
        script = self.read("site/viewer.js").decode()
        self.assertNotRegex(script, "(?i)</script|<!--")  # would end the element
        self.assertIn(script, text)
        self.assertNotRegex(text, r'(src|href)="(?!data:|\./")')

    def test_damage_of_the_scene_is_reported(self):
        scene = self.write("cut.stgs", self.bytes[:-100])
        self.assertIn(b"warning: ", self.succeeds("web", scene, "-o", "site").stderr)
        self.assertEqual(self.succeeds("web", self.scene, "-o", "other").stderr, b"")

    def test_a_title_is_escaped(self):
        title = '</title><script>alert("1")</script>&'
        self.succeeds("web", self.scene, "-o", "site", "--title", title)
        page = self.read("site/index.html").decode()
        self.assertIn("<title>&lt;/title&gt;&lt;script&gt;alert(&quot;1&quot;)&lt;/script&gt;&amp;</title>", page)
        self.succeeds("convert", self.scene, "titled.stgs", "--title", "Kitchen")
        self.succeeds("web", "titled.stgs", "-o", "kitchen")
        self.assertIn(b"<title>Kitchen</title>", self.read("kitchen/index.html"))

    def test_origins_that_may_embed_the_page_are_checked(self):
        self.succeeds("web", self.scene, "-o", "site", "--bridge", "https://a.example", "--bridge",
                      "http://localhost:8000", "--bridge", "http://[::1]:443")
        self.assertIn(b'"bridge":"https://a.example http://localhost:8000 http://[::1]:443"', self.read("site/index.html"))
        for origin in ("*", "page.example", "https://", "https://a.example/", "ftp://a.example", "https://a.example b",
                       "https://A.example", "HTTPS://a.example", "https://\u00e4.example", "https://a.example:443",
                       "http://a.example:80", "https://a.example:", "https://a.example:0443", "https://[::1]:443"):
            self.fails(USAGE, "not an origin", "web", self.scene, "-o", "other", "--bridge", origin)

    def with_audio(self, location):
        """Returns a scene in the folder `scenes` that names an audio file."""
        os.makedirs(self.path("scenes"), exist_ok=True)
        self.succeeds("pack", self.scene, "-o", "scenes/loud.stgs", "--audio", location, "--log-level", "error")
        return "scenes/loud.stgs"

    def test_the_audio_file_of_the_scene_is_copied(self):
        scene = self.with_audio("./sound/a/track%201.m4a?v=2")
        os.makedirs(self.path("scenes", "sound", "a"))
        self.write("scenes/sound/a/track 1.m4a", b"audio" * 1000)
        about = self.json_of("web", scene, "-o", "site")
        self.assertEqual(about["audio"], "sound/a/track 1.m4a")
        self.assertEqual(self.read("site/sound/a/track 1.m4a"), b"audio" * 1000)
        self.assertEqual(sorted(os.listdir(self.path("site"))), sorted(FILES + ["sound"]))
        self.assertEqual(about["bytes"], 5000 + sum(os.path.getsize(self.path("site", name)) for name in FILES))
        result = self.succeeds("web", scene, "-o", "other")
        self.assertIn(b"with the audio file sound/a/track 1.m4a (5 kB)", result.stderr)
        os.remove(self.path("site", "index.html"))
        for name in FILES[1:]:
            os.remove(self.path("site", name))
        self.fails(USAGE, "site/sound/a/track 1.m4a: exists", "web", scene, "-o", "site")
        self.succeeds("web", scene, "-o", "site", "--overwrite")
        self.assertIsNone(self.json_of("web", self.scene, "-o", "silent")["audio"])

    def test_a_page_of_one_file_contains_the_audio_file(self):
        scene = self.with_audio("a.MP3")
        audio = bytes(range(256)) * 13000  # more than one element
        self.write("scenes/a.MP3", audio)
        self.succeeds("web", scene, "-o", "a.html", "--single-file")
        found = re.findall(r'<script type="text/plain" class="stgs-audio" data-type="audio/mpeg">([^<]*)</script>',
                           self.read("a.html").decode())
        self.assertEqual(b"".join(base64.b64decode(part, validate=True) for part in found), audio)
        self.assertEqual(len(found), 2)
        os.truncate(self.path("scenes", "a.MP3"), (32 << 20) + 1)
        result = self.succeeds("web", scene, "-o", "large.html", "--single-file")
        self.assertRegex(result.stderr.decode(), "^stgs: warning: scenes/loud.stgs: the page has no sound: the audio file "
                         r"'a.MP3' is too large for a page of one file \(33.6 MB, limit 32 MiB\); [^\n]*\n$")
        self.assertNotIn(b'class="stgs-audio"', self.read("large.html").split(b'<script type="module">')[0])

    def test_a_site_without_its_audio_file_is_written_with_a_warning(self):
        self.write("outside.mp3", b"secret")
        os.mkdir(self.path("scenes"))
        os.symlink("../outside.mp3", self.path("scenes", "link.mp3"))
        os.mkdir(self.path("scenes", "folder.mp3"))
        self.write("scenes/notes.txt", b"secret")
        self.write("scenes/.hidden.mp3", b"secret")
        for i, (location, reason) in enumerate((
                ("missing.mp3", "missing.mp3' does not exist; put it there"),
                ("../outside.mp3", "not a file in the folder of the scene or below"),
                ("%2e%2e/outside.mp3", "not a file in the folder of the scene or below"),
                ("a\\..\\..\\outside.mp3", "not a file in the folder of the scene or below"),
                (self.path("outside.mp3"), "not a file in the folder of the scene or below"),
                (".hidden.mp3", "not a file in the folder of the scene or below"),
                ("link.mp3", "link.mp3' leads out of the folder of the scene"),
                ("folder.mp3", "folder.mp3' is not a regular file"),
                ("notes.txt", "not named like an audio file"),
                ("https://a.example/a.mp3", "is a URL"), ("file:outside.mp3", "is a URL"))):
            with self.subTest(location=location):
                result = self.succeeds("web", self.with_audio(location), "-o", f"site{i}")
                self.assertEqual(sorted(os.listdir(self.path(f"site{i}"))), FILES)
                warning = result.stderr.decode()
                self.assertIn(reason, warning)
                self.assertRegex(warning, r"^stgs: warning: scenes/loud.stgs: the page has no sound: [^\n]*\n$")

    def test_existing_outputs_need_a_flag(self):
        self.succeeds("web", self.scene, "-o", "site")
        self.write("site/mine.txt", "kept")
        self.fails(USAGE, "site/index.html: exists; name another output, or replace it with --overwrite", "web",
                   self.scene, "-o", "site")
        self.succeeds("web", self.scene, "-o", "site", "--overwrite", "--title", "Again")
        self.assertIn(b"<title>Again</title>", self.read("site/index.html"))
        self.assertEqual(self.read("site/mine.txt"), b"kept")
        os.mkdir(self.path("own"))
        self.write("own/scene.stgs", "mine")
        self.fails(USAGE, "own/scene.stgs: exists", "web", self.scene, "-o", "own")
        self.assertEqual(self.read("own/scene.stgs"), b"mine")
        self.succeeds("web", self.scene, "-o", "a.html", "--single-file")
        self.fails(USAGE, "a.html: exists", "web", self.scene, "-o", "a.html", "--single-file")
        self.succeeds("web", self.scene, "-o", "a.html", "--single-file", "--overwrite")

    def test_command_lines(self):
        self.fails(USAGE, "web writes a folder, not a .html file", "web", self.scene, "-o", "a.html")
        self.fails(USAGE, "use a name that ends in .html", "web", self.scene, "-o", "a", "--single-file")
        self.fails(USAGE, "--output is required", "web", self.scene)
        self.fails(USAGE, "cannot read standard input", "web", "-", "-o", "site")
        self.fails(USAGE, "download the scene first", "web", "http://here/a.stgs", "-o", "a.html", "--single-file")
        self.fails(USAGE, "would show the user name", "web", "http://me:secret@here/a.stgs", "-o", "site")
        self.fails(IO, "nothere.stgs", "web", "nothere.stgs", "-o", "site")
        self.fails(INVALID, "not an .stgs file", "web", self.write("x.stgs", "text " * 20), "-o", "site")
        self.fails(IO, "folder 'no' does not exist", "web", self.scene, "-o", "no/site")
        self.assertEqual(os.listdir(self.work), ["x.stgs"])

    def test_a_scene_that_is_too_large_for_one_file(self):
        shutil.copy(self.scene, self.path("large.stgs"))
        os.truncate(self.path("large.stgs"), 300 << 20)
        self.fails(UNSUPPORTED, "too large for a page of one file", "web", "large.stgs", "-o", "a.html", "--single-file")
        self.assertFalse(os.path.exists(self.path("a.html")))

    def test_the_profile_draco_is_refused(self):
        if not built_in("draco"):
            self.skipTest("draco is not built in")
        self.succeeds("pack", self.scene, "-o", "draco.stgs", "--profile", "draco")
        self.fails(UNSUPPORTED, "browsers cannot play the profile draco", "web", "draco.stgs", "-o", "site")


class NotBuilt(CliTest):
    @unittest.skipIf(built_in("web"), "web is built in")
    def test_a_build_without_it_reports_it(self):
        self.fails(NOT_BUILT, "'web' is not part of this build", "web", self.fixture("tiny.stgs"), "-o", "site")


if __name__ == "__main__":
    unittest.main()
